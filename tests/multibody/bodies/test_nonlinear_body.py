"""Bodies with nonlinear stiffness in machines: closed forms, rigid bodies, and what a run keeps and says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from particles import packed, particle_body
from scipy.special import ellipj, ellipk

import flexmbd as fm
from flexmbd.record.reduced_body import InterfaceFrame, NonlinearStiffness, ReducedBody

METHODS = [fm.ExplicitRungeKutta(), fm.RadauIIA(), fm.GeneralizedAlpha(), fm.EnergyMomentum()]
NAMES = ["explicit", "radau", "alpha", "energy-momentum"]


def oscillator(quartic, *, energy=1e3):
    """One mode of w^2 = 90, a quartic energy, held at its root."""
    record = particle_body(4, modes=1).record
    face = np.zeros((2, 6, 1))
    range_of = np.array([energy]), np.array([1e-3]), np.eye(1)
    stiffness = NonlinearStiffness(np.zeros(1), np.array([quartic]), face, *range_of)
    scene = fm.System()
    body = scene.add(fm.FlexibleBody(replace(record, nonlinear=stiffness, stiffness=np.array([90.0]))), name="spring")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), body.frame("root"))
    body.q, body.q_rate = [0.7], [0.0]
    return scene, body


@pytest.mark.parametrize(("method", "error"), [*zip(METHODS, (1e-7, 1e-6, 1e-4, 1e-4), strict=True)], ids=NAMES)
def test_duffing_oscillator(method, error):
    """q'' + 90 q + 4 d q^3 = 0: a cosine of Jacobi's, by whose period the run ends."""
    d = 60.0
    rate = np.sqrt(90.0 + 4.0 * d * 0.49)
    m = 2.0 * d * 0.49 / rate**2
    scene, body = oscillator(d)
    run = scene.simulate(3.0 * 4.0 * ellipk(m) / rate, rtol=1e-8 if error < 1e-5 else 1e-6, integrator=method)
    np.testing.assert_allclose(run.q(body)[:, 0], 0.7 * ellipj(rate * run.t, m)[1], atol=error)
    assert run.energy().elastic[0] == pytest.approx(45.0 * 0.49 + d * 0.7**4, rel=1e-13)


PLACES = np.array([[0.3, 0.1, 0.05], [0.5, -0.1, -0.05], [0.6, 0.05, 0.0]])
MASS = np.array([0.5, 0.3, 0.6])
TIP = np.array([0.6, 0.1, 0.0])


def turning_record(stiffness):
    """Three particles whose two modes turn them about z: u = s [z] X + c [z]^2 X.

    With s = sin(phi), c = 1 - cos(phi) this is a rotation; the energy stiffness (s^2 + (1 - c)^2 - 1)^2 / 8 of other
    displacements is a polynomial of degree four.
    """
    z = np.cross(np.eye(3), [0.0, 0.0, 1.0])
    size = np.sqrt(np.einsum("k,ki,ki->", MASS, PLACES @ z.T, PLACES @ z.T))
    modes = np.array([z, z @ z]) / size
    phi = np.einsum("nij,kj->kin", modes, PLACES)
    fields = np.concatenate([np.ones((1, 3)), PLACES.T, phi.transpose(2, 1, 0).reshape(-1, 3)])
    tip = np.zeros((6, 2))
    tip[:3], tip[5, 0] = np.einsum("nij,j->in", modes, TIP), 1.0 / size
    face = np.zeros((2, 6, 2))
    face[1, :2, 1] = -1.0 / size
    # (s^2 + c^2 - 2 c)^2 = 4 c^2 - 4 c (s^2 + c^2) + (s^2 + c^2)^2, s and c being q / size
    square, cubic = np.eye(2), np.zeros((2, 2, 2))
    cubic[1] = -4.0 * square
    quartic = np.einsum("ij,kl->ijkl", square, square)
    share = stiffness / 8.0
    return ReducedBody(
        gram=(fields * MASS) @ fields.T,
        stiffness=np.array([1e-9, 8.0 * share / size**2]),
        damping=np.zeros((2, 2)),
        interfaces=(
            InterfaceFrame("root", np.zeros(3), np.eye(3), np.zeros((6, 2))),
            InterfaceFrame("tip", TIP, np.eye(3), tip),
        ),
        frame="root",
        partition=np.eye(2),
        partition_names=("sine", "cosine"),
        nonlinear=NonlinearStiffness(
            packed(share * cubic) / size**3,
            packed(share * quartic) / size**4,
            face,
            energy=np.array([1e-3]),
            tolerance=np.array([1e-3]),
            compared=np.eye(2),
        ),
    )


def double_pendulum(*, by_modes):
    """Particles that turn about z by modes of a body at rest, or as a rigid body on a hinge; one hangs on them."""
    scene = fm.System(gravity=(0.3, -9.81, 0.0))
    lower = fm.RigidBody(0.4, (0.01, 0.012, 0.013), (0.2, 0.05, 0.0))
    ground = scene.ground.frame()
    if by_modes:
        upper = scene.add(fm.FlexibleBody(turning_record(1e9)), name="upper")
        scene.connect(fm.joint.Fixed(), ground, upper.frame("root"))
        tip = upper.frame("tip")
    else:
        centre = MASS @ PLACES / MASS.sum()
        arms = PLACES - centre
        inertia = np.einsum("k,kab->ab", MASS, [(r @ r) * np.eye(3) - np.outer(r, r) for r in arms])
        upper = scene.add(fm.RigidBody(MASS.sum(), inertia, tuple(centre)), name="upper")
        scene.connect(fm.joint.Revolute("z"), ground, upper.frame())
        tip = upper.frame(TIP)
    scene.add(lower, name="lower")
    hinge = scene.connect(fm.joint.Revolute((0.3, 0.1, 1.0)), tip, lower.frame(p=(0.05, 0.0, 0.02)))
    hinge.velocity = 1.5
    return scene, tip, lower, hinge


def test_face_that_turns_as_a_rigid_body():
    """By 70 degrees and back: places, rotations, spins and reactions are those of rigid bodies."""
    runs = []
    for by_modes in (True, False):
        scene, tip, lower, hinge = double_pendulum(by_modes=by_modes)
        run, t = scene.simulate(0.25, rtol=1e-8, integrator=fm.RadauIIA()), np.linspace(0.0, 0.25, 26)
        frames = (tip, lower.frame())
        parts = [f(frame, t=t) for frame in frames for f in (run.position, run.rotation, run.angular_velocity)]
        runs.append([*parts, run.reaction(hinge)[-1]])
    turned = np.arccos(0.5 * (np.trace(runs[1][1], axis1=1, axis2=2) - 1.0))
    assert turned.max() > 0.5
    for one, other in zip(*runs, strict=True):
        np.testing.assert_allclose(one, other, atol=2e-5 * np.abs(other).max())


def stretched(*, polynomial):
    """A swinging body with membrane strains, or with the polynomial of their energy; its tip does not turn."""
    record = particle_body(1, modes=4, stretched=(0, 2), damping=0.5).record
    root, tip = record.interfaces
    record = replace(record, interfaces=(root, replace(tip, modes=np.diag([1, 1, 1, 0, 0, 0]) @ tip.modes)))
    if polynomial:
        stretch, face = record.stretch, np.zeros((2, 6, 4))
        cubic = 0.5 * np.einsum("mi,mjk->ijk", stretch.strain, stretch.P)
        quartic = 0.125 * np.einsum("mij,mkl->ijkl", stretch.P, stretch.P)
        more = np.array([1e3]), np.array([1e-3]), np.eye(4)
        nonlinear = NonlinearStiffness(packed(cubic), packed(quartic), face, *more)
        record = replace(record, stretch=None, nonlinear=nonlinear)
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    body = scene.add(fm.FlexibleBody(record), name="body")
    arm = scene.add(fm.RigidBody(0.5, np.diag([0.01, 0.02, 0.03]), (0.2, 0.1, 0.0)), name="arm")
    scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), body.frame("root")).position = 1.0
    scene.connect(fm.joint.Spherical(), body.frame("tip"), arm.frame())
    return scene


@pytest.mark.parametrize("method", METHODS[:3], ids=NAMES[:3])
def test_polynomial_of_membrane_strains_moves_as_they_do(method):
    """The same energy written in two ways: the same steps, but for round-off; discrete gradients are others."""
    one, other = (stretched(polynomial=kind).simulate(0.3, h=1e-3, integrator=method) for kind in (False, True))
    np.testing.assert_allclose(other.x, one.x, atol=1e-9)
    np.testing.assert_allclose(other.v, one.v, atol=1e-8 * np.abs(one.v).max())
    np.testing.assert_allclose(other.energy().elastic, one.energy().elastic, rtol=1e-7)


def flying(gravity=(0.0, 0.0, 0.0)):
    """A tumbling body, its strains in the hundredths, with a rigid one on a face that turns by finite angles."""
    scene = fm.System(gravity=gravity)
    body = scene.add(fm.FlexibleBody(particle_body(2, modes=4, stretched=(0, 1), nonlinear=True).record), name="body")
    arm = scene.add(fm.RigidBody(0.5, np.diag([0.01, 0.02, 0.03]), (0.2, 0.1, 0.0)), name="arm")
    free = scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame("root"))
    free.velocity = (0.3, -0.2, 0.5, 3.0, -2.0, 4.0)
    hinge = scene.connect(fm.joint.Revolute("x"), body.frame("tip"), arm.frame())
    hinge.velocity = 2.0
    return scene, body


def test_energy_and_momenta_of_a_flying_body_are_kept():
    """By discrete gradients, whatever the step; the face turns by a third of a radian."""
    scene, body = flying()
    run = scene.simulate(5.0, h=0.005, integrator=fm.EnergyMomentum())
    assert np.ptp(run.q(body), axis=0).max() > 0.1
    energy, momentum = run.energy(), run.momentum()
    assert np.ptp(energy.total) < 1e-11 * np.abs(energy.total).max()
    assert np.ptp(momentum.linear, axis=0).max() < 1e-12 * np.abs(momentum.linear).max()
    assert np.ptp(momentum.angular, axis=0).max() < 1e-11 * np.abs(momentum.angular).max()


@pytest.mark.parametrize("method", [fm.ExplicitRungeKutta(), fm.RadauIIA(), fm.GeneralizedAlpha()], ids=NAMES[:3])
def test_power_of_faces_that_turn(method):
    """What joints and faces do to each other takes no power: energy is kept as well as rtol asks."""
    scene, _ = flying((0.0, 0.0, -9.81))
    run = scene.simulate(0.5, rtol=1e-9 if method.name != "generalized-alpha" else 1e-7, integrator=method)
    energy = run.energy()
    assert np.ptp(energy.elastic) > 0.1
    assert np.ptp(energy.total) < (1e-7 if method.name != "generalized-alpha" else 1e-4) * np.abs(energy.kinetic).max()


def test_restart_to_the_bit(tmp_path):
    scene, _ = flying()
    whole = scene.simulate(0.2, checkpoints=[0.1], integrator=fm.RadauIIA())
    kept = fm.Checkpoint.load(whole.checkpoints[0].save(tmp_path / "kept.npz"))
    rest = flying()[0].simulate(0.2, restart=kept, integrator=fm.RadauIIA())
    np.testing.assert_array_equal(rest.x, whole.x[-len(rest.t) :])


def test_body_that_leaves_its_range_is_told_once():
    """45 q^2 + 60 q^4 J from 0.7 on: 36 J at the start, 20 J at most."""
    scene, _ = oscillator(60.0, energy=20.0)
    with pytest.warns(fm.RangeWarning, match=r"'spring' stores 36\.46 J at t = 0 s, more than the 20 J") as told:
        scene.simulate(0.5)
    assert len(told) == 1


def test_face_that_is_turned_inside_out_is_named():
    record = particle_body(4, modes=1).record
    face = np.zeros((2, 6, 1))
    face[1, 0, 0] = -2.0
    stiffness = NonlinearStiffness(np.zeros(1), np.zeros(1), face, np.array([1e3]), np.array([1e-3]), np.eye(1))
    scene = fm.System()
    body = scene.add(fm.FlexibleBody(replace(record, nonlinear=stiffness)), name="rod")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), body.frame("root"))
    body.q_rate = [20.0]
    said = r"face of interface 'tip' of flexible body 'rod' has det F = -\S+ at t ="
    with pytest.raises(fm.SimulationError, match=said):
        scene.simulate(0.2)
