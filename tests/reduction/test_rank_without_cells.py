"""Two cells on any number of ranks: with three, two of them have none, and the bodies are those of one process."""

from mpi4py import MPI

import numpy as np
import pytest

import flexmbd as fm
from flexmbd import forms, meshes
from flexmbd.continuum import ContinuumModel, Interface, MpiTeam
from flexmbd.reduction import BlockMethod, Keep, KrylovSchur, Solver, Truncation, craig_bampton

pytestmark = pytest.mark.mpi

RUBBER = forms.solid_linear.Parameters(E=2e9, nu=0.3, rho=1e3)


def reduced(comm, *, coupling=fm.Coupling.RIGID, frame="x_min", modes=3, **options):
    mesh = meshes.block(1.0, 0.1, 0.1, divisions=(2, 1, 1), cell="hexahedron", degree=1, comm=comm)
    ends = [Interface(name, coupling=coupling) for name in ("x_min", "x_max")]
    model = ContinuumModel(mesh, forms.solid_linear, RUBBER, degree=2, interfaces=ends)
    return model, craig_bampton(model, frame=frame, modes=modes, **options)


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"frame": None, "coupling": fm.Coupling.AVERAGED},
        {"solver": Solver.ITERATIVE, "eigensolver": KrylovSchur()},
        {"modes": Truncation(tol=1e-2, below_hz=600.0), "eigensolver": BlockMethod()},
    ],
)
def test_the_reduced_body_is_that_of_one_process(options):
    _, body = reduced(MPI.COMM_WORLD, **options)
    _, alone = reduced(MPI.COMM_SELF, **options)
    assert body.n_modes == alone.n_modes
    np.testing.assert_allclose(body.frequencies(), alone.frequencies(), rtol=1e-8)
    np.testing.assert_allclose(body.inertia, alone.inertia, rtol=1e-10, atol=1e-12 * alone.inertia.max())


def test_it_moves_and_is_stressed_alike():
    def largest(comm):
        model, record = reduced(comm, keep=Keep(modes=True, surface=True, stress=True))
        scene = fm.System(gravity=(0.0, 0.0, -9.81), team=MpiTeam(comm))
        body = scene.add(fm.FlexibleBody(record), name="arm")
        scene.connect(fm.joint.Fixed(), scene.ground.frame(), body.frame("x_min"))
        run = scene.simulate(0.01, rtol=1e-6)
        return run.position(body.frame("x_max"))[-1], run.stress(body, model, t=0.01).max

    here, alone = largest(MPI.COMM_WORLD), largest(MPI.COMM_SELF)
    np.testing.assert_allclose(here[0], alone[0], rtol=1e-9, atol=1e-12)
    assert here[1] == pytest.approx(alone[1], rel=1e-7)
