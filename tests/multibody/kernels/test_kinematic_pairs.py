"""Joints of one kinematic pair that the package does not have, against the same joint made of several steps.

Joints of steps alone, which put massless links between their bodies, against inverse dynamics.

Each is what a user would write: one file, a pair and a joint that names it.  The coordinates are those of the steps, so
that all of the machine's numbers must be the same: kinematics, dynamics both ways, tangent, momenta, loops, output and
the runs of every integrator.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations
from typing import ClassVar

import numpy as np
import pytest
from particles import particle_body
from random_trees import somewhere
from scipy.spatial.transform import Rotation

import flexmbd as fm
from flexmbd.errors import SceneError
from flexmbd.multibody.joint.kinematic_pair import PRISMATIC, REVOLUTE, SPHERICAL, KinematicPair, screw
from flexmbd.multibody.joint.protocol import ALIGNED, ON_AXIS, CarriedBySteps, Row, Step
from flexmbd.multibody.kernels.forward_dynamics.articulated import articulate, forward_dynamics, solve_mass
from flexmbd.multibody.kernels.forward_dynamics.articulated_layout import new_articulated_work
from flexmbd.multibody.kernels.inverse_dynamics.canonical import canonical
from flexmbd.multibody.kernels.inverse_dynamics.residual import residual
from flexmbd.multibody.kernels.tangent.residual_tangent import tangent
from flexmbd.multibody.kernels.tangent.tangent_layout import new_tangent_work

TURN = (1.0, 0.0, 0.0, 0.0)
ALONG_X, ALONG_Y, ALONG_Z = ((0.0, *unit) for unit in np.eye(3).tolist())


@dataclass(frozen=True)
class Made(CarriedBySteps):
    """A joint of the steps that it is given, about and along the axes of its frames."""

    steps: tuple[Step, ...]

    turn: ClassVar[np.ndarray] = np.eye(3)
    rows: ClassVar[tuple[Row, ...]] = (*ON_AXIS, *ALIGNED)  # no joint here closes a loop

    @property
    def velocity_names(self):
        """Counted."""
        return tuple(f"v{k}" for k in range(len(self.angular)))


SLIDES = (Step(PRISMATIC, "x"), Step(PRISMATIC, "y"), Step(PRISMATIC, "z"))
PAIRS = {
    "cylindrical": (KinematicPair((ALONG_Z, TURN)), (SLIDES[2], Step(REVOLUTE))),
    "turn first": (KinematicPair((TURN, ALONG_Z)), (Step(REVOLUTE), SLIDES[2])),
    "nut on a slide": (KinematicPair(((1.0, 0.0, 0.0, 0.3), ALONG_Z)), (Step(screw(0.3)), SLIDES[2])),
    "planar": (KinematicPair((ALONG_X, ALONG_Y, TURN)), (*SLIDES[:2], Step(REVOLUTE))),
    "plane": (KinematicPair((ALONG_X, ALONG_Y)), SLIDES[:2]),
    "gantry": (KinematicPair((ALONG_X, ALONG_Y, ALONG_Z)), SLIDES),
    "robot": (KinematicPair((ALONG_X, ALONG_Y, ALONG_Z, TURN)), (*SLIDES, Step(REVOLUTE))),
    "ball on a rail": (KinematicPair((ALONG_Z,), ball=True), (SLIDES[2], Step(SPHERICAL))),
    "ball on a plane": (KinematicPair((ALONG_X, ALONG_Y), ball=True), (*SLIDES[:2], Step(SPHERICAL))),
}
EVERY = pytest.mark.parametrize("name", PAIRS)
METHODS = [fm.ExplicitRungeKutta(), fm.GeneralizedAlpha(), fm.RadauIIA(), fm.EnergyMomentum(), fm.CentralDifference()]


def machine(steps, *, reverse=False, loop=True, moving=True):
    """A body on a ball carries a flexible one by the joint, whose tip carries another body by it; springs, a loop."""
    scene = fm.System(gravity=(1.0, -9.0, 3.0))
    turn = Rotation.from_rotvec([0.3, -0.5, 0.8]).as_matrix()
    base = scene.add(fm.RigidBody(1.3, np.diag([0.2, 0.3, 0.4]), (0.1, 0.05, -0.02)), name="base")
    bar = scene.add(fm.FlexibleBody(particle_body(1, modes=4, damping=2.0, stretched=(1,)).record), name="bar")
    tool = scene.add(fm.RigidBody(0.7, np.diag([0.1, 0.2, 0.15]), (0.1, 0.1, 0.03)), name="tool")
    joint = Made(tuple(steps))
    ball = scene.connect(fm.joint.Spherical(), scene.ground.frame(), base.frame(R=turn))
    first = scene.connect(joint, base.frame(p=(0.3, 0.0, 0.1)), bar.frame("root"), name="first")
    ends = bar.frame("tip"), tool.frame(p=(0.0, -0.1, 0.0), R=turn)
    second = scene.connect(joint, *(ends[::-1] if reverse else ends), name="second")
    for body, k in ((bar, 40.0), (tool, 30.0)):
        scene.add_force(fm.force.SpringDamper(scene.ground.frame(p=(0.5, 0.2, -0.3)), body.frame(), k, 0.1, 0.2))
    if loop:
        scene.connect(fm.joint.PointOnPlane("z"), scene.ground.frame(), tool.frame())
    if moving:
        ball.velocity = (0.5, -0.3, 0.8)
    if moving and not loop:
        first.velocity = second.velocity = np.linspace(0.3, -0.4, len(joint.angular))
    return scene, (base, bar, tool), (first, second)


def evaluated(compiled, seed):
    """Everything that the kernels compute at a random state, by unknowns."""
    x, v, work = somewhere(compiled, seed)
    plan, nv = compiled.plan, compiled.nv
    rng = np.random.default_rng(seed)
    given, multipliers, a = rng.standard_normal(nv), rng.standard_normal(len(plan.rows)), np.zeros(nv)
    aw, moved = new_articulated_work(plan), np.zeros((nv, nv))
    forward_dynamics(plan, work, aw, x, v, a, multipliers)
    articulate(plan, work, aw, x)
    solve_mass(plan, work, aw, np.eye(nv), moved)
    required, matrix = np.zeros(nv), np.zeros((nv, nv))
    residual(plan, work, x, v, given, multipliers, required)
    tw = new_tangent_work(plan, nv, sizes=np.ones((2, nv)))
    tangent(plan, work, tw, x, v, given, multipliers, 0.3, 0.7, 1.0, matrix)
    p, gradient, none = np.zeros((3, nv))
    canonical(plan, work, x, v, 0.5 * v, none, multipliers, np.zeros((len(plan.tree), 6)), np.zeros(6), p, gradient)
    return x, v, a, moved, required, matrix, tw.jacobian.copy(), tw.rate_jacobian.copy(), p, gradient


def assert_same(found, expected, share):
    """Arrays pair by pair, to a share of the largest number of each."""
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(one, other, rtol=0.0, atol=share * np.abs(other).max())


@EVERY
@pytest.mark.parametrize("reverse", [False, True])
def test_every_law_has_the_numbers_of_the_steps(name, reverse):
    """Poses, both dynamics, tangent, constraint rows and canonical form at random states."""
    pair, steps = PAIRS[name]
    if reverse and not pair.reversible:
        pytest.skip("coordinates that the other end does not see")
    one, several = (machine(s, reverse=reverse)[0].compile().scene for s in ((Step(pair),), steps))
    assert len(one.plan.tree) < len(several.plan.tree)
    for seed in range(3):
        assert_same(evaluated(one, seed), evaluated(several, seed), 1e-12)


@EVERY
def test_output_has_the_numbers_of_the_steps(name):
    """Motions, reactions and energies of a run by fixed steps; the machine linearised at its end."""
    pair, steps = PAIRS[name]
    found = []
    for made in ((Step(pair),), steps):
        scene, bodies, joints = machine(made)
        run = scene.simulate(0.05, h=1e-3, integrator=fm.RadauIIA())
        observed = (run.position, run.rotation, run.velocity, run.acceleration)
        motions = [f(b.frame()) for b in bodies[1:] for f in observed]
        told = [f(j) for j in joints for f in (run.beta, run.beta_rate, run.reaction)]
        found.append([*motions, *told, run.energy().total])
    assert_same(found[0], found[1], 1e-9)


@EVERY
@pytest.mark.parametrize("loop", [False, True])
@pytest.mark.parametrize("method", METHODS, ids=lambda m: type(m).__name__)
def test_runs_are_those_of_the_steps(name, method, loop):
    """Every integrator, by error control, but one whose steps keep their length until another one pays."""
    pair, steps = PAIRS[name]
    ends = []
    for made in ((Step(pair),), steps):
        scene, (*_, tool), joints = machine(made, loop=loop)
        how = {"h": 5e-4} if isinstance(method, fm.CentralDifference) else {"rtol": 1e-5}
        run = scene.simulate(0.1, integrator=method, **how)
        ends.append([run.position(tool.frame())[-1], *(run.beta(j)[-1] for j in joints), run.stats.steps])
    assert_same(ends[0], ends[1], 1e-8)


@EVERY
def test_a_linearised_machine_is_that_of_the_steps(name):
    """M, C and K about the equilibrium of a machine that springs hold in place."""
    pair, steps = PAIRS[name]
    found = []
    for made in ((Step(pair),), steps):
        scene, bodies, joints = machine(made, loop=False, moving=False)
        for joint in joints if not pair.ball else ():
            for k in range(len(joint.joint.angular)):
                scene.add_force(fm.force.JointSpring(joint, 50.0, coordinate=k))
        for body in bodies:
            scene.add_force(fm.force.Bushing(scene.ground.frame(), body.frame(), np.eye(6) * 30.0))
        lin = scene.linearize(about=scene.equilibrium())
        found.append([lin.M, lin.C, lin.K])
    assert_same(found[0], found[1], 1e-7)


SINGLE = {
    **dict(zip(("slide x", "slide y", "slide z"), SLIDES, strict=True)),
    "turn x": Step(REVOLUTE, "x"),
    "turn z": Step(REVOLUTE),
    "screw y": Step(screw(0.3), "y"),
    "ball": Step(SPHERICAL),
}
TURNS = {"turn x", "turn z", "ball"}
CHAINS = [
    *(pair for pair in permutations(SINGLE, 2) if not ("ball" in pair and TURNS.issuperset(pair))),
    ("slide x", "slide y", "ball"),
    ("ball", "slide x", "slide y"),
    ("slide x", "turn x", "slide z"),
    ("turn z", "slide x", "turn x"),
    ("slide x", "slide y", "slide z", "ball"),
]
NEAR_AND_FAR = [0.0, *(s * 10.0**e for e in (-300, -30, -17, -16, -15, -13, -10, -6, -3, 0, 3) for s in (1, -1))]


def unbalanced(compiled, x, v, work):
    """What inverse dynamics finds wanting at forward dynamics' accelerations, as a share of the terms' sum by row."""
    plan, nv = compiled.plan, compiled.nv
    a, none = np.zeros(nv), np.zeros(0)
    forward_dynamics(plan, work, new_articulated_work(plan), x, v, a, none)
    at_rest, left, terms = np.zeros((3, nv))
    residual(plan, work, x, v, np.zeros(nv), none, at_rest)
    residual(plan, work, x, v, a, none, left)
    column = np.zeros(nv)
    for k, unit in enumerate(np.eye(nv)):
        residual(plan, work, x, v, unit, none, column)
        terms += np.abs(column - at_rest) * abs(a[k])
    return np.abs(left) / (terms + np.abs(at_rest))


@pytest.mark.parametrize("names", CHAINS, ids=" ".join)
def test_accelerations_keep_their_digits_wherever_the_steps_stand(names):
    """Coordinates from 1e-300 to 1e3, all at once and one at a time: what is left over is rounded squares of arms."""
    scene, _, joints = machine([SINGLE[name] for name in names], loop=False)
    compiled = scene.compile().scene
    x0, v, work = somewhere(compiled, 1)
    adding = []
    for joint in joints:
        first = compiled.index.joints[joint].x.start
        for step in joint.joint.steps:
            adding += range(first, first + len(step.pair.columns))
            first += len(step.pair.start)
    for size in NEAR_AND_FAR:
        for moved in (adding, *([k] for k in adding)):
            x = x0.copy()
            x[adding] = 0.0
            x[moved] = size
            assert unbalanced(compiled, x, v, work).max() < 1e-14 * max(1.0, size**2), (size, moved)


@pytest.mark.parametrize(
    ("columns", "ball", "said"),
    [
        (((0.0, 0.0, 0.0, 2.0),), False, "unit vectors"),
        (((0.0, 1.0, 0.0, 0.0), (0.0, 0.6, 0.8, 0.0)), False, "right angles"),
        ((TURN, TURN), False, "one coordinate of a kinematic pair may turn"),
        ((TURN,), True, "with a ball none may turn"),
        (((1.0, 0.1, 0.0, 0.0),), False, "slide with it along z alone"),
        ((ALONG_X,), False, "slides along z"),
        ((1.0, 0.0, 0.0, 0.0), False, "four numbers"),
        (((1.0, 0.0, 0.0),), False, "four numbers"),
        (((1.0, 0.0, 0.0, float("nan")),), False, "four numbers"),
        ("axis", False, "four numbers"),
    ],
)
def test_what_is_no_pair_is_refused(columns, ball, said):
    """Each by its own reason."""
    with pytest.raises(SceneError, match=said):
        KinematicPair(columns, ball)


def test_a_gear_takes_one_coordinate_of_a_pair():
    """A rack that rolls on the turn of a cylindrical pair: the same run as with that pair in two steps."""
    ends = []
    for steps in ((Step(PAIRS["cylindrical"][0]),), PAIRS["cylindrical"][1]):
        scene = fm.System(gravity=(0.3, -9.0, 2.0))
        shaft = scene.add(fm.RigidBody(1.0, (0.1, 0.2, 0.3), (0.1, 0.0, 0.0)), name="shaft")
        wheel = scene.add(fm.RigidBody(0.5, (0.1, 0.1, 0.1)), name="wheel")
        joint = scene.connect(Made(steps), scene.ground.frame(), shaft.frame())
        axle = scene.connect(fm.joint.Revolute("x"), scene.ground.frame(p=(0.0, 1.0, 0.0)), wheel.frame())
        scene.couple(fm.joint.Gear(joint, axle, 2.0))
        scene.couple(fm.joint.RackAndPinion(axle, joint, 0.3))
        run = scene.simulate(0.3, rtol=1e-6, integrator=fm.RadauIIA())
        ends.append([run.beta(joint), run.beta(axle)])
        np.testing.assert_allclose(run.beta(axle), 2.0 * run.beta(joint)[:, 1], atol=1e-8)
        np.testing.assert_allclose(run.beta(joint)[:, 0], 0.3 * run.beta(axle), atol=1e-8)
    assert_same(ends[0], ends[1], 1e-9)


@pytest.mark.parametrize(("pair", "axis"), [("REVOLUTE", "z"), (1, "z"), (KinematicPair(), "w")])
def test_a_step_that_is_none_is_refused(pair, axis):
    with pytest.raises(SceneError, match=r"KinematicPair|axis"):
        Step(pair, axis)
