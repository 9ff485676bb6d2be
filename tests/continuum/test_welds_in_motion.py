"""Welds in motion: what they join moves as one, and hands momentum on."""

from mpi4py import MPI

import numpy as np
import pytest
from interior_momentum import linear_momentum
from welded_plates import DEPTH, LENGTH, RHO, SHELL, SOFT, WIDTH, butted, tee

import flexmbd as fm
from flexmbd.continuum import (
    BodyAcceleration,
    ExplicitContinuum,
    ExplicitRun,
    ImplicitContinuum,
    Interface,
    MpiTeam,
    NonlinearModel,
    PressureOnFacets,
    RegularCheckpoints,
    TractionOnFacets,
)
from flexmbd.forms import solid_shell, st_venant_kirchhoff


def machine(given, kind, integrator, **run):
    """A plate that swings and is pulled by loads that follow; energies and the root's wrench at the end."""
    mesh, welds, (root, end) = given
    body = NonlinearModel(mesh, st_venant_kirchhoff, SOFT, degree=1, welds=welds, interfaces=[Interface(root)])
    loads = [PressureOnFacets(end, -2e4), TractionOnFacets(end, (0.0, 0.0, -2e3), follows=True, name="side")]
    scene = fm.System(gravity=(0.0, 0.0, -9.81), team=MpiTeam(MPI.COMM_WORLD))
    part = scene.add(fm.ContinuumBody(kind(body, loads=[*loads, BodyAcceleration((0.0, 0.0, 1.0))])), name="part")
    hinge = scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), part.frame(root))
    hinge.velocity = (3.0,)
    found = scene.simulate(integrator=integrator, **run)
    return np.array([series[-1] for series in found.energies(part).values()]), found.interior_wrench(part, root)[-1]


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("kind", "integrator", "run"),
    [
        (ImplicitContinuum, fm.GeneralizedAlpha(), {"t_end": 0.004, "h": 1e-3}),
        (ImplicitContinuum, fm.GeneralizedAlpha(), {"t_end": 0.002, "rtol": 1e-3}),
        (ExplicitContinuum, fm.CentralDifference(), {"t_end": 2e-4, "h": 4e-6}),
    ],
)
def test_a_seam_of_like_meshes_is_no_seam_in_motion(kind, integrator, run):
    one, whole = (machine(given, kind, integrator, **run) for given in butted())
    for found, wanted in zip(one, whole, strict=True):
        np.testing.assert_allclose(found, wanted, rtol=1e-7, atol=1e-9 * np.abs(wanted).max())


def tumbling(x):
    """(n, 3) m/s at places (n, 3) m."""
    return np.asarray(np.cross([5.0, 80.0, 3.0], x) + np.array([1.0, 2.0, 3.0]), dtype=np.float64)


@pytest.mark.mpi
def test_momentum_is_kept_in_flight():
    mesh, welds = tee(gap=2e-3)
    body = NonlinearModel(mesh, solid_shell, SHELL, degree=1, welds=welds)
    flight = ExplicitRun(body, velocity=tumbling)
    motion = flight.motion
    motion.start(0.9 * flight.stable_step)
    before = motion.momentum(np.zeros(3))
    account = flight.simulate(150 * flight.stable_step)
    np.testing.assert_allclose(motion.momentum(np.zeros(3)), before, atol=1e-12 * np.abs(before).max())
    assert account.error < 4e-3  # that of the steps, as of a plate in one piece
    assert motion.mass == pytest.approx(RHO * DEPTH * WIDTH * (2 * LENGTH + 0.05), rel=1e-12)
    apart = body.complete_nodes(motion.x.copy()) - motion.x
    assert np.abs(apart).max(initial=0.0) < 1e-14


def test_a_flight_goes_on_to_the_bit_after_a_restart(tmp_path):
    def flight():
        mesh, welds = tee()
        body = NonlinearModel(mesh, solid_shell, SHELL, degree=1, welds=welds)
        return ExplicitRun(body, velocity=tumbling)

    whole, first, second = flight(), flight(), flight()
    h = 0.9 * whole.stable_step
    whole.simulate(20 * h, h=h, outputs=2)
    file = RegularCheckpoints(tmp_path / "flight.npz", every=10 * h)
    first.simulate(20 * h, h=h, outputs=2, checkpoints=file)
    second.simulate(20 * h, h=h, outputs=2, restart=file.path)
    np.testing.assert_array_equal(first.motion.x, whole.motion.x)
    np.testing.assert_array_equal(second.motion.x, whole.motion.x)


def test_what_hits_a_seam_gets_what_it_gives():
    """A ball on nodes that follow: momentum and energy of both, explicit steps."""
    mesh, welds, (root, _) = butted()[0]
    body = NonlinearModel(mesh, st_venant_kirchhoff, SOFT, degree=1, welds=welds, interfaces=[Interface(root)])
    interior = ExplicitContinuum(body)
    scene = fm.System()
    part = scene.add(fm.ContinuumBody(interior), name="part")
    scene.connect(fm.joint.Free(), scene.ground.frame(), part.frame(root))
    ball = scene.add(fm.RigidBody(1.0, (1e-3,) * 3), name="ball")
    fall = scene.connect(fm.joint.Free(), scene.ground.frame(p=(0.199, 0.01, DEPTH / 2 + 0.0452)), ball.frame())
    fall.velocity = (0.3, 0.0, -1.0, 0.0, 0.0, 0.0)
    scene.touch(fm.contact.Nodes(part, "b.top"), fm.contact.Sphere(ball.frame(), 0.045), fm.contact.Hard(mu=0.2))
    run = scene.simulate(1.5e-3, h=4e-6, integrator=fm.CentralDifference())
    energy = run.energy().total + sum(run.energies(part).values())
    assert np.ptp(energy) < 1e-4 * energy[0]
    (force,) = run.outer_forces(part).values()
    assert np.abs(force).max() > 500.0
    given = ball.mass * (run.velocity(ball.frame())[-1] - run.velocity(ball.frame())[0])
    begun = ball.mass * run.velocity(ball.frame())[0]
    np.testing.assert_allclose(linear_momentum(interior, run, part.frame(root)), -given, atol=1e-10 * abs(begun).max())
