"""Stress modes of the record: closed forms in axes that lie askew, and the model's own stress."""

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from bracket import ALUMINIUM, GROUPS, TURN, bracket, turned

from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.errors import FormulationError
from flexmbd.forms import solid_linear, st_venant_kirchhoff
from flexmbd.reduction import Keep, craig_bampton, guyan

AXES = turned(0.4, 0.7, -0.2)
SIX = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


def no_contraction(model, interfaces):
    """The bracket's mesh of a material whose rigid ends hinder nothing."""
    parameters = solid_linear.Parameters(E=ALUMINIUM.E, nu=0.0, rho=ALUMINIUM.rho)
    return ContinuumModel(model.mesh, solid_linear, parameters, degree=2, interfaces=interfaces)


@pytest.mark.mpi
def test_uniform_tension():
    """F/A along the block, seen from a body frame whose axes are another pair askew."""
    model = no_contraction(bracket(), [Interface("root", axes=AXES), Interface("tip")])
    body = guyan(model, frame="root", keep=Keep(stress=True))
    force, area = 4e4, 0.06 * 0.1
    along = AXES.T @ TURN[:, 0]
    q = body.interface("tip").modes[:3].T @ (force * along) / body.stiffness
    expected = force / area * np.outer(along, along)
    six = np.array([expected[ab] for ab in SIX])
    found = body.stress.sigma @ q
    assert found.shape == (len(body.stress.node), 6)
    assert abs(found - six).max() < 1e-8 * force / area


@pytest.mark.mpi
@pytest.mark.parametrize("frame", ["root", None])
def test_against_the_model(frame):
    """The model's stress at any modal coordinates, by the same nodes, on any number of ranks."""
    model = bracket("root", "tip", degree=1)
    body = craig_bampton(model, modes=3, frame=frame, keep=Keep(modes=True, stress=True))
    q = np.cos(3.0 * np.arange(body.n_modes)) / np.sqrt(body.stiffness)
    picture = model.stress_field(body, q)
    assert np.array_equal(body.stress.node, picture.node)
    assert abs(body.stress.x - picture.x).max() < 1e-15
    expected = np.array([picture.stress[:, a, b] for a, b in SIX]).T
    found = body.stress.sigma @ q
    assert abs(found - expected).max() < 1e-10 * abs(expected).max()
    assert len(set(MPI.COMM_WORLD.allgather(body.stress.sigma.tobytes()))) == 1
    alone = craig_bampton(
        bracket("root", "tip", comm=MPI.COMM_SELF, degree=1), modes=3, frame=frame, keep=Keep(stress=True)
    )
    assert np.array_equal(alone.stress.node, body.stress.node)
    off = alone.stress.sigma - body.stress.sigma
    assert abs(off).max(axis=(0, 1)) == pytest.approx(0.0, abs=1e-7 * abs(body.stress.sigma).max())


@pytest.mark.mpi
def test_nodes_of_interfaces():
    """Those of the two ends of the block, by their places, and no others."""
    model = bracket("root", "tip", degree=2)
    body = guyan(model, frame=None, keep=Keep(stress=True))
    in_mesh = body.stress.x @ body.R_MB.T + body.p_MB_M
    for number, name in enumerate(("root", "tip")):
        on_end = GROUPS[name](in_mesh.T)
        assert on_end.sum() > 8
        assert np.array_equal(body.stress.interface == number, on_end)
    assert set(body.stress.interface) == {-1, 0, 1}


def test_only_where_asked_for(tmp_path):
    model = bracket("root", "tip", comm=MPI.COMM_SELF, degree=1)
    assert guyan(model, frame="root").stress is None
    body = guyan(model, frame="root", keep=Keep(stress=True))
    body.save(tmp_path / "body.h5")
    again = type(body).load(tmp_path / "body.h5")
    assert np.array_equal(again.stress.sigma, body.stress.sigma)
    assert np.array_equal(again.stress.node, body.stress.node)


def quadratic(u, state, p):
    h = ufl.grad(u)
    return p.E * h.T * h


def test_of_a_stress_that_is_not_linear_they_are_the_linear_part():
    """The two forms are one solid where displacements are small."""
    mesh = meshes.block(1.0, 0.2, 0.1, divisions=(3, 1, 1), cell="hexahedron", degree=1, comm=MPI.COMM_SELF)
    found = []
    for form in (solid_linear, st_venant_kirchhoff):
        steel = form.Parameters(E=2.1e11, nu=0.3, rho=7850.0)
        model = ContinuumModel(mesh, form, steel, degree=2, interfaces=[Interface("x_min"), Interface("x_max")])
        found.append(guyan(model, frame="x_min", keep=Keep(stress=True)).stress.sigma)
    assert found[1] == pytest.approx(found[0], rel=1e-9, abs=1e-9 * abs(found[0]).max())


@pytest.mark.mpi
def test_a_stress_that_small_displacements_do_not_make_is_refused(monkeypatch):
    monkeypatch.setattr(solid_linear, "stress", quadratic)
    with pytest.raises(FormulationError, match="its stress is not linear in the displacement"):
        guyan(bracket("root", "tip", degree=1), frame="root", keep=Keep(stress=True))
