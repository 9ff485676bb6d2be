"""Stress of a plate under a harmonic pressure and on a shaken foot, against the unreduced plate."""

from mpi4py import MPI

import numpy as np
import pytest
import scipy.sparse.linalg
from full_model import gather

from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.continuum.finite_elements.stress import StressRecovery
from flexmbd.coupling import Coupling
from flexmbd.errors import ReductionError
from flexmbd.forms import solid_linear
from flexmbd.reduction import Keep, Pressure, Truncation, craig_bampton, load_vectors

STEEL = solid_linear.Parameters(E=2.1e11, nu=0.3, rho=7850.0)
PUSH = Pressure("push", "z_max")


@pytest.fixture(scope="module")
def plate():
    mesh = meshes.plate(0.4, 0.2, 0.02, h=0.05, comm=MPI.COMM_SELF)
    return ContinuumModel(mesh, solid_linear, STEEL, degree=2, interfaces=[Interface("x_min")])


def full_stress(model, force, share, lowest):
    """(k, 6) Pa of the unreduced plate held at its foot, at a share of the lowest frequency."""
    free = np.ones(model.n_owned, dtype=bool)
    free[model.interfaces[0].dofs] = False
    k, m = (gather(matrix)[free][:, free] for matrix in (model.K, model.M))
    u = np.zeros(model.n_owned)
    u[free] = scipy.sparse.linalg.spsolve((k - share**2 * lowest * m).tocsc(), force[free])
    sigma = StressRecovery(model).nodal(u)
    return sigma[:, [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]


def errors(model, modes, force, modal, *, share=0.5, **more):
    """Largest error over the largest stress, with so many modes; `modal` of a record: the load's work on its modes."""
    body = craig_bampton(model, modes=modes, frame="x_min", loads=[PUSH], keep=Keep(stress=True), **more)
    lowest = craig_bampton(model, modes=1, frame="x_min", geometric_stiffness=False).stiffness[0]
    q = modal(body) / (body.stiffness - share**2 * lowest)
    expected = full_stress(model, force, share, lowest)
    return abs(body.stress.sigma @ q - expected).max() / abs(expected).max(), body


@pytest.mark.parametrize("geometric_stiffness", [True, False])
def test_stress_under_a_pressure(plate, geometric_stiffness):
    """Mode by mode it converges slowly; with residual vectors as (omega / omega_n)^2 of what is left out."""
    force = load_vectors(plate, [PUSH])[:, 0]

    def modal(body):
        return body.loads.modal[0]

    # three times the lowest frequency
    how = {"geometric_stiffness": geometric_stiffness, "share": 3.0}
    without, plain = errors(plate, 24, force, modal, **how)
    corrected, body = errors(plate, 24, force, modal, residual_vectors=True, **how)
    assert without > 1e-2
    assert corrected < 2e-6
    assert corrected < 1e-3 * without
    number = int(body.provenance["residual vectors"])
    assert 0 < number <= 13
    assert body.partition_names[-1] == f"residual {number}"
    assert body.stiffness[:12] == pytest.approx(plain.stiffness[:12], rel=1e-4)


def test_stress_of_a_shaken_foot(plate):
    """The foot accelerates along z by 1 m/s^2: inertia forces -M e_z, on the modes minus their momentum."""
    force = -gather(plate.M) @ plate.rigid_motions(np.zeros(3), np.eye(3))[:, 2]

    def modal(body):
        return -body.mass_matrix()[2, 6:]

    without, _ = errors(plate, 12, force, modal)
    corrected, _ = errors(plate, 12, force, modal, residual_vectors=True)
    assert corrected < 1e-2 * without
    # at rest it is exact with any number of modes
    static, _ = errors(plate, 0, force, modal, share=0.0, residual_vectors=True)
    assert static < 1e-8


@pytest.mark.mpi
def test_with_interfaces_and_free_modes():
    mesh = meshes.block(0.4, 0.05, 0.03, divisions=(6, 1, 1))
    model = ContinuumModel(mesh, solid_linear, STEEL, degree=2, interfaces=[Interface("x_min"), Interface("x_max")])
    for modes in (4, Truncation(4, free=True)):
        body = craig_bampton(model, modes=modes, frame="x_min", residual_vectors=True)
        plain = craig_bampton(model, modes=modes, frame="x_min", geometric_stiffness=False)
        assert body.n_modes > plain.n_modes
        assert (body.frequencies()[:4] <= plain.frequencies()[:4] * (1 + 1e-9)).all()
        assert body.stretch is not None
    floating = craig_bampton(model, modes=4, residual_vectors=True)
    assert 0 < int(floating.provenance["residual vectors"]) <= 6
    with pytest.raises(ReductionError, match="residual_vectors must be"):
        craig_bampton(model, modes=2, frame="x_min", residual_vectors=3)


def test_averaged_interfaces_leave_no_round_off_among_the_residual_vectors():
    """A load on one is held by its own reactions alone: what is left of its response is no shape."""
    mesh = meshes.block(0.3, 0.02, 0.02, divisions=(4, 1, 1), comm=MPI.COMM_SELF)
    ends = [Interface("x_min"), Interface("x_max", coupling=Coupling.AVERAGED)]
    model = ContinuumModel(mesh, solid_linear, STEEL, degree=2, interfaces=ends)
    force = -gather(model.M) @ model.rigid_motions(np.zeros(3), np.eye(3))[:, 2]

    def modal(body):
        return -body.mass_matrix()[2, 6:]

    static, body = errors_of(model, force, modal)
    assert static < 1e-7
    assert int(body.provenance["residual vectors"]) <= 6 + 6


def errors_of(model, force, modal):
    """As `errors` at rest without modes; the surface of the averaged end is loaded by nothing else."""
    body = craig_bampton(
        model, modes=0, frame="x_min", keep=Keep(stress=True), residual_vectors=True, geometric_stiffness=False
    )
    expected = full_stress(model, force, 0.0, 0.0)
    return abs(body.stress.sigma @ (modal(body) / body.stiffness) - expected).max() / abs(expected).max(), body
