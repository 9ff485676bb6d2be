"""Bodies whose frames never rotate: which they are, and that leaving their Coriolis terms out changes nothing."""

from __future__ import annotations

import numpy as np
import pytest
from machines import slider_crank
from particles import particle_body
from scipy.spatial.transform import Rotation

import flexmbd as fm
from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.kernels.forward_dynamics.articulated import forward_dynamics
from flexmbd.multibody.kernels.forward_dynamics.articulated_layout import new_articulated_work
from flexmbd.multibody.kernels.inverse_dynamics.recursion import forward_kinematics
from flexmbd.multibody.kernels.inverse_dynamics.residual import residual
from flexmbd.multibody.kernels.physics.joints import retract
from flexmbd.multibody.kernels.tangent.residual_tangent import tangent
from flexmbd.multibody.kernels.tangent.tangent_layout import new_tangent_work
from flexmbd.multibody.plan import plan_arrays as plan_module

NEVER, ROTATES = kinds.NONROTATING, kinds.ROTATING
TURN = Rotation.from_rotvec([0.4, -0.7, 0.2]).as_matrix()
SKEWED = np.array([[0.3, 0.0, 0.04], [0.0, 0.4, 0.0], [0.04, 0.0, 0.5]])
joint = fm.joint


def chain(*links):
    """Bodies one behind the other: (joint, frame on the one before, own frame, body)."""
    scene = fm.System(gravity=(0.4, -9.81, 1.3))
    before_frame = scene.ground.frame
    for kind, place, own, body in links:
        scene.add(body)
        inner = before_frame(place) if isinstance(place, str) else before_frame(p=place)
        outer = body.frame(own) if isinstance(own, str) else body.frame(**own)
        scene.connect(kind, inner, outer)
        before_frame = body.frame
    return scene


def rod(inertia=(0.15, 0.2, 0.3), com=(0.3, 0.1, 0.0)):
    return fm.RigidBody(1.2, np.asarray(inertia), com)


def beam(modes=4):
    return fm.FlexibleBody(particle_body(3, modes=modes, damping=1.0).record)


X = (0.6, 0.1, 0.0)
HERE = {"p": (0.0, 0.0, 0.0)}
TURNED = {"p": (0.1, 0.0, 0.0), "R": Rotation.from_rotvec([0.0, 0.0, 0.9]).as_matrix()}


def hinge(axis="z"):
    return joint.Revolute(axis)


def slide(axis="x"):
    return joint.Prismatic(axis)


CHAINS = {
    "plane": (
        [(hinge(), X, HERE, rod()), (hinge(), X, TURNED, rod()), (hinge((0, 0, -1)), X, HERE, rod())],
        [ROTATES] * 3,
    ),
    "slides": ([(slide(), X, HERE, rod()), (slide((1, 2, 3)), X, HERE, rod(SKEWED))], [NEVER] * 2),
    "slide, then hinge": (
        [(slide("z"), X, HERE, rod()), (hinge("y"), X, HERE, rod(com=(0.3, 0.0, 0.0)))],
        [NEVER, ROTATES],
    ),
    "hinge, then slide out of the plane": (
        [(hinge(), X, HERE, rod()), (slide((1, 2, 3)), X, HERE, rod())],
        [ROTATES] * 2,
    ),
    "fixed": (
        [(joint.Fixed(), X, HERE, rod(SKEWED)), (hinge(), X, HERE, rod()), (joint.Fixed(), X, HERE, rod())],
        [NEVER, ROTATES, ROTATES],
    ),
    "products of inertia": ([(hinge(), X, HERE, rod(SKEWED)), (hinge(), X, HERE, rod())], [ROTATES, ROTATES]),
    "centre out of the plane": ([(hinge(), X, HERE, rod(com=(0.3, 0.1, 0.05)))], [ROTATES]),
    "hinge out of the plane": ([(hinge(), X, {"p": (0.0, 0.0, 0.1)}, rod())], [ROTATES]),
    "crossed hinges": (
        [(hinge("z"), X, HERE, rod()), (hinge("y"), X, HERE, rod()), (hinge("y"), X, HERE, rod())],
        [ROTATES, ROTATES, ROTATES],
    ),
    "a degree aside": (
        [(hinge("z"), X, HERE, rod()), (hinge((0.0, 0.01745, 1.0)), X, HERE, rod())],
        [ROTATES, ROTATES],
    ),
    "screw": ([(joint.Screw(0.02), X, HERE, rod()), (hinge(), X, HERE, rod())], [ROTATES] * 2),
    "planar joint": (
        [(joint.Planar(), X, HERE, rod()), (hinge(), X, HERE, rod())],
        [NEVER, NEVER, ROTATES, ROTATES],
    ),
    "cylindrical": ([(joint.Cylindrical("y"), X, HERE, rod(com=(0.3, 0.0, 0.0)))], [NEVER, ROTATES]),
    "universal": ([(joint.Universal("x", "y"), X, HERE, rod())], [ROTATES, ROTATES]),
    "ball": ([(joint.Spherical(), X, HERE, rod()), (slide(), X, HERE, rod())], [ROTATES] * 2),
    "free": ([(joint.Free(), X, HERE, rod())], [ROTATES]),
    "flexible on a slide": ([(slide(), X, "root", beam()), (slide(), "tip", HERE, rod())], [NEVER, ROTATES]),
    "flexible on a hinge": ([(hinge(), X, "root", beam()), (hinge(), "root", HERE, rod())], [ROTATES, ROTATES]),
}


def compiled(name):
    return chain(*CHAINS[name][0]).compile().scene


@pytest.fixture(params=sorted(CHAINS))
def found(request):
    return compiled(request.param), CHAINS[request.param][1]


def forced(plan):
    """The plan with all bodies free to turn."""
    tree = plan.tree.copy()
    tree[:, at.ROTATION] = ROTATES
    return plan.replace(tree=tree)


def states(scene, count=4):
    """Random configurations, velocities, accelerations."""
    rng = np.random.default_rng(5)
    for _ in range(count):
        move, v, a = 0.7 * rng.standard_normal((3, scene.nv))
        x = np.empty(scene.nx)
        retract(scene.plan, scene.start, move, x)
        yield x, v, a


def test_the_plan_tells_how_bodies_turn(found):
    scene, expected = found
    assert scene.plan.tree[:, at.ROTATION].tolist() == expected


def test_what_the_plan_promises_is_so(found):
    """Angular velocities of random motions are zero of a body whose frame never rotates, and of no other."""
    scene, _ = found
    plan, work = scene.plan, new_work(scene.plan)
    for x, v, a in states(scene):
        forward_kinematics(plan, work, x, v, a)
        spins = work.body[:, at.B_W : at.B_W + 3]
        assert np.array_equal(spins.any(axis=1), plan.tree[:, at.ROTATION] == ROTATES)


def test_nothing_is_missing(found):
    """Motion, forces, reactions' wrenches and tangent with the terms in and out."""
    scene, _ = found
    nothing = np.zeros(0)
    results = []
    for plan in (scene.plan, forced(scene.plan)):
        parts = []
        for x, v, a in states(scene):
            work, out = new_work(plan), np.zeros(scene.nv)
            residual(plan, work, x, v, a, nothing, out)
            parts += [out.copy(), work.body[:, at.B_F : at.B_T + 3].ravel()]
            matrix = np.zeros((scene.nv, scene.nv))
            tw = new_tangent_work(plan, scene.nv, sizes=np.ones((2, scene.nv)))
            tangent(plan, work, tw, x, v, a, nothing, 1.3, 0.7, 0.2, matrix)
            parts.append(matrix.ravel())
            forward_dynamics(plan, work, new_articulated_work(plan), x, v, out, nothing)
            parts.append(out.copy())
        results.append(parts)
    for part, whole in zip(*results, strict=True):
        np.testing.assert_allclose(part, whole, rtol=1e-13, atol=1e-13 * np.abs(whole).max(initial=1.0))


@pytest.mark.parametrize("name", ["plane", "products of inertia", "flexible on a slide"])
def test_runs_and_reactions_are_the_same(name, monkeypatch):
    """A simulation in which all terms are computed."""
    runs = []
    for _ in range(2):
        scene = chain(*CHAINS[name][0])
        run = scene.simulate(0.4, h=0.01, integrator=fm.RadauIIA())
        runs.append(np.hstack([run.x, *(run.reaction(c) for c in scene._connections)]))
        monkeypatch.setattr(plan_module, "classify_rotations", lambda tree, _: np.full(len(tree), ROTATES))
    assert np.abs(runs[0] - runs[1]).max() < 1e-11 * np.abs(runs[1]).max()


def test_an_unbalanced_rotor_still_shakes_its_bearing():
    """The moment of the products of inertia, J_xz w^2, in a rotor that turns about one axis."""
    scene = fm.System()
    rotor = scene.add(fm.RigidBody(1.0, SKEWED), name="rotor")
    bearing = scene.connect(hinge(), scene.ground.frame(), rotor.frame())
    bearing.velocity = 30.0
    run = scene.simulate(0.1, h=0.01)
    expected = np.zeros((len(run.t), 6))
    expected[:, 4] = SKEWED[0, 2] * 30.0**2
    np.testing.assert_allclose(run.reaction(bearing), expected, atol=1e-9)


def test_a_balanced_rotor_does_not_shake_its_bearing():
    """A principal axis through the centre of mass: the gyroscopic moment w x (J w) is zero, and computed as such."""
    scene = fm.System()
    rotor = scene.add(fm.RigidBody(1.0, (0.3, 0.4, 0.5)), name="rotor")
    bearing = scene.connect(hinge(), scene.ground.frame(), rotor.frame())
    bearing.velocity = 30.0
    assert not scene.simulate(0.1, h=0.01).reaction(bearing).any()


def test_explain_says_what_is_left_out():
    """Of flexible bodies alone: gyroscopic terms of rigid ones cost too little to be left out."""
    text = chain(*CHAINS["flexible on a slide"][0]).explain()
    assert "Coriolis and centrifugal terms of body 1 (no joint turns the frame)" in text
    for scene in (slider_crank()[0], chain(*CHAINS["slides"][0]), chain(*CHAINS["flexible on a hinge"][0])):
        assert not any(word in scene.explain() for word in ("gyroscopic terms", "Coriolis"))
