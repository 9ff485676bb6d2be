"""A part that ranks reduce, or a body that they share, moves as on one: records, runs, files."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np
import pytest

import flexmbd as fm
from flexmbd import forms, meshes
from flexmbd.continuum import ContinuumModel, ImplicitContinuum, Interface, MpiTeam, NonlinearModel
from flexmbd.reduction import Keep, craig_bampton

COMM = MPI.COMM_WORLD
ENDS = [Interface("x_min"), Interface("x_max")]

pytestmark = pytest.mark.mpi


@pytest.fixture
def folder(tmp_path):
    """The root's."""
    return COMM.bcast(tmp_path)


def team(comm):
    return {} if comm.size == 1 else {"team": MpiTeam(comm)}


def swung(comm):
    """A bar of plastic on a hinge: its record and its run."""
    plastic = forms.solid_linear.Parameters(E=1.3e9, nu=0.3, rho=1100.0)
    mesh = meshes.block(1.0, 0.04, 0.06, divisions=(6, 1, 1), comm=comm)
    model = ContinuumModel(mesh, forms.solid_linear, plastic, degree=2, interfaces=ENDS)
    bar = craig_bampton(model, modes=3, frame="x_min", geometric_stiffness=False, keep=Keep(modes=True, surface=True))
    scene = fm.System(gravity=(0.0, 0.0, -9.81), **team(comm))
    link = scene.add(fm.FlexibleBody(bar), name="bar")
    hinge = scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), link.frame("x_min"))
    hinge.velocity = 2.0
    run = scene.simulate(0.1, rtol=1e-8, integrator=fm.ExplicitRungeKutta())
    return bar, run, run.position(link.frame("x_max"), t=np.linspace(0.0, 0.1, 11))


def test_a_reduced_bar(folder):
    """To what the eigensolver leaves; what is written by rank 0 is whole, and read by all."""
    bar, run, path = swung(COMM)
    alone, _, expected = swung(MPI.COMM_SELF)
    np.testing.assert_allclose(bar.frequencies(["x_min"])[:3], alone.frequencies(["x_min"])[:3], rtol=1e-8)
    np.testing.assert_allclose(bar.mass, alone.mass, rtol=1e-12)
    np.testing.assert_allclose(path, expected, atol=1e-7)
    run.save(folder / "run.h5")
    if COMM.rank == 0:
        bar.save(folder / "bar.h5")
        fm.export.mbdyn(bar, folder / "bar.fem")
        run.animate(folder / "bar.gif", size=(160, 120), fps=4)
    COMM.barrier()
    read = fm.ReducedBody.load(folder / "bar.h5")
    np.testing.assert_array_equal(read.frequencies(["x_min"]), bar.frequencies(["x_min"]))
    assert (folder / "bar.fem").stat().st_size > 1000
    assert (folder / "bar.gif").stat().st_size > 1000


def pressed(comm):
    """A yielding rod of steel, implicit, with a ball at its end: positions and energies."""
    steel = forms.j2_plasticity.Parameters(
        E=2.1e11, nu=0.3, rho=7850.0, yield_stress=2.5e8, hardening=forms.j2_plasticity.LinearHardening(8e8)
    )
    mesh = meshes.block(0.2, 0.02, 0.02, divisions=(6, 1, 2), comm=comm)
    body = NonlinearModel(mesh, forms.j2_plasticity, steel, degree=1, interfaces=ENDS)
    rod = fm.ContinuumBody(ImplicitContinuum(body, rigid_parts={"x_max": fm.RigidBody(3.0, (1e-3, 1e-3, 1e-3))}))
    scene = fm.System(**team(comm))
    scene.add(rod, name="rod")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), rod.frame("x_min"))
    scene.add_force(fm.force.FrameForce(rod.frame("x_max"), (0.0, 0.0, 1.5e4)))
    run = scene.simulate(2e-3, h=1e-4)
    return run.position(rod.frame("x_max")), run.energies(rod)


def test_a_yielding_rod():
    """To what Newton's iteration leaves."""
    path, energies = pressed(COMM)
    expected, alone = pressed(MPI.COMM_SELF)
    assert alone["plastic"][-1] > 0.01 * alone["elastic"].max()
    moved = abs(expected - expected[0]).max()
    np.testing.assert_allclose(path, expected, atol=1e-4 * moved)
    for name, values in alone.items():
        np.testing.assert_allclose(energies[name], values, atol=1e-3 * abs(alone["elastic"]).max())
