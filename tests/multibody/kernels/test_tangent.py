"""The analytic tangent against differences of the residual."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from mixed_machine import mixed_scene
from particles import particle_body
from scipy.spatial.transform import Rotation

import flexmbd as fm
from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.kernels.inverse_dynamics.residual import residual
from flexmbd.multibody.kernels.physics.joints import retract
from flexmbd.multibody.kernels.tangent.residual_tangent import tangent
from flexmbd.multibody.kernels.tangent.tangent_layout import new_tangent_work
from flexmbd.multibody.plan.scene_matrices import constraint_jacobian, constraint_values, mass_matrix

# central differences of order 8
WEIGHTS = ((1, 4.0 / 5.0), (2, -1.0 / 5.0), (3, 4.0 / 105.0), (4, -1.0 / 280.0))


def tree_only(compiled):
    """The plan without its loops."""
    return compiled.plan.replace(rows=np.zeros((0, compiled.plan.rows.shape[1]), np.int64))


def random_state(compiled, seed, spread=0.5):
    rng = np.random.default_rng(seed)
    x = np.empty(compiled.nx)
    retract(compiled.plan, compiled.start, rng.standard_normal(compiled.nv) * spread, x)
    v, a = rng.standard_normal((2, compiled.nv))
    return x, v, a, rng.standard_normal(len(compiled.plan.rows))


def analytic(plan, state, weights):
    x, v, a, multipliers = state
    matrix = np.full((len(v), len(v)), np.nan)
    scratch = new_work(plan), new_tangent_work(plan, len(v), sizes=np.ones((2, len(v))))
    tangent(plan, *scratch, x, v, a, multipliers, *weights, matrix)  # type: ignore[call-arg]
    return matrix


def differenced(plan, state, which, step):
    """Derivative by x, v or a (0, 1, 2), by differences of order 8."""
    x, v, a, multipliers = state
    work = new_work(plan)
    matrix = np.zeros((len(v), len(v)))
    for j, unit in enumerate(np.eye(len(v))):
        for k, weight in WEIGHTS:
            for sign in (1.0, -1.0):
                place = [x.copy(), v.copy(), a.copy()]
                if which == 0:
                    retract(plan, x, sign * k * step * unit, place[0])
                else:
                    place[which] += sign * k * step * unit
                out = np.zeros(len(v))
                residual(plan, work, *place, multipliers, out)  # type: ignore[call-arg]
                matrix[:, j] += sign * weight / step * out
    return matrix


def compare(plan, state, *, speed_step=0.5):
    """``speed_step``: inertia is quadratic in velocities, and exact for differences of any step."""
    for which, step in enumerate((1e-2, speed_step, 0.5)):
        weights = np.eye(3)[which]
        expected = differenced(plan, state, which, step)
        # each entry over what its row and column make of the matrix
        rows = np.abs(expected).max(axis=1, keepdims=True)
        columns = np.abs(expected).max(axis=0, keepdims=True)
        scale = np.sqrt(rows * columns) + 1e-4 * np.abs(expected).max()
        error = np.abs(analytic(plan, state, weights) - expected) / scale
        assert error.max() < 1e-10, (which, error.max(), np.unravel_index(error.argmax(), error.shape))


KINDS = [{}, {"rotors": True}, {"nonlinear": True}]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", range(4))
def test_tree_of_every_joint_and_body(seed, kind):
    """Rigid and flexible parents, stretch, damping, rotors inside, a reversed joint, children on deforming frames."""
    scene, *_ = mixed_scene(**kind)
    compiled = scene.compile().scene
    state = random_state(compiled, seed, spread=(0.5, 0.01, 1.0, 2.0)[seed])
    compare(tree_only(compiled), state)


@pytest.mark.parametrize("nonlinear", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_reactions_of_loops(seed, nonlinear):
    """Loops between bodies, to the ground, at deforming frames of one body or two."""
    scene, *_ = mixed_scene(nonlinear=nonlinear)
    compiled = scene.compile().scene
    assert len(compiled.plan.rows) == 15
    compare(compiled.plan, random_state(compiled, seed))


@pytest.mark.parametrize("nonlinear", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_jacobian_of_rows(seed, nonlinear):
    scene, *_ = mixed_scene(nonlinear=nonlinear)
    compiled = scene.compile().scene
    x, v, a, multipliers = random_state(compiled, seed)
    plan, work = compiled.plan, new_work(compiled.plan)
    tw = new_tangent_work(plan, compiled.nv, sizes=np.ones((2, compiled.nv)))
    tangent(plan, work, tw, x, v, a, multipliers, 0.3, 0.7, 1.0, np.zeros((compiled.nv, compiled.nv)))
    expected = constraint_jacobian(compiled, work, x)
    np.testing.assert_allclose(tw.jacobian, expected, atol=1e-13 * np.abs(expected).max())
    slope = np.zeros_like(expected)
    for j, unit in enumerate(np.eye(compiled.nv)):
        for k, weight in WEIGHTS:
            for sign in (1.0, -1.0):
                place = x.copy()
                retract(plan, x, sign * k * 1e-2 * unit, place)
                rate = constraint_values(compiled, work, place, v)[1]
                slope[:, j] += sign * weight / 1e-2 * rate
    whole = 0.3 * slope + 0.7 * expected
    np.testing.assert_allclose(tw.rate_jacobian, whole, atol=1e-11 * np.abs(whole).max())


@fm.compiled
def _law(t, beta, rate):
    return -3.0 * beta**3 - 0.4 * rate * abs(rate)


@fm.compiled
def _everywhere(t, x, v, out):
    for k in range(len(v)):
        out[k] = -0.3 * v[k] * v[0] + 0.2 * v[len(v) - 1] ** 2


def forced_scene():
    """Every kind of force between frames that deform, on both sides of a branch, and on coordinates."""
    scene = fm.System(gravity=(0.0, -9.81, 1.0))
    turn = Rotation.from_rotvec([0.2, 0.6, -0.3]).as_matrix()
    bodies = []
    for k, joint in enumerate((fm.joint.Screw(0.3, "x"), fm.joint.Spherical())):
        body = scene.add(fm.FlexibleBody(particle_body(20 + k, modes=3, damping=1.0).record), name=f"limb {k}")
        scene.connect(joint, scene.ground.frame(p=(0.3 * k, 0.1, 0.2), R=turn), body.frame("root"))
        bodies.append(body)
    last = scene.add(fm.RigidBody(0.8, (0.02, 0.03, 0.02), (0.1, 0.0, 0.2)), name="last")
    hinge = scene.connect(fm.joint.Revolute("y"), bodies[0].frame("tip"), last.frame())
    ends = bodies[0].frame("tip"), bodies[1].frame("tip")
    matrix = np.diag([50.0, 60.0, 70.0, 5.0, 6.0, 7.0]) + 0.5
    scene.add_force(fm.force.Bushing(*ends, matrix, 0.1 * matrix))
    scene.add_force(fm.force.SpringDamper(ends[1], last.frame(p=(0.2, 0.1, 0.0)), 40.0, 0.2, 3.0))
    scene.add_force(fm.force.FrameForce(ends[1], (1.0, 2.0, 3.0), (0.3, 0.2, 0.1)))
    scene.add_force(fm.force.FrameForce(ends[0], (1.0, 2.0, 3.0), (0.3, 0.2, 0.1), fm.force.Axes.FRAME))
    scene.add_force(fm.force.JointSpring(hinge, 4.0, 0.2, 0.6))
    scene.add_force(fm.force.JointFriction(hinge, 0.3, 1.0))
    return scene, hinge


@pytest.mark.parametrize("seed", range(2))
def test_force_elements(seed):
    scene, _ = forced_scene()
    compiled = scene.compile().scene
    compare(compiled.plan, random_state(compiled, seed, spread=0.2), speed_step=2e-2)


@fm.compiled
def _with_states(t, data, z, u, d, R, rate, spin, out):
    for k in range(3):
        out[k] = -data[0] * d[k] * (1.0 + d[0] ** 2) + data[1] * z[0] * rate[k] + z[1] ** 2 * d[(k + 1) % 3]
        out[k] += u[0] * R[k, 0]
        out[3 + k] = -2.0 * spin[k] + z[1] * R[k, 2]
    out[6] = -z[0] * z[1] + d[0] * rate[1] + u[1]
    out[7] = -2.0 * z[1] + R[0, 1] * spin[2] + np.sin(d[2]) * z[0]


@dataclass(frozen=True, eq=False)
class WithTwoStates(fm.force.BetweenFrames, fm.force.WithStates):
    frame_F: fm.Frame
    frame_G: fm.Frame

    def check(self):
        pass

    def assemble(self, table):
        table.frame_states(
            _with_states, self.what, self.frame_F, self.frame_G, states={"a": 0.3, "b": -0.2}, scale=(2.0, 0.5),
            numbers=[3.0, 0.4], inputs=[1.5, 0.7],
        )  # fmt: skip


@fm.compiled
def _rates(t, z, u, out):
    out[0], out[1] = -z[0] + u[0] ** 2, z[0] * u[1]


@fm.compiled
def _outputs(t, z, u, out):
    out[0], out[1], out[2] = z[0] * z[1], u[0] - z[1] ** 2, 3.0 * z[0]


@pytest.mark.parametrize("kind", ["half-way bushing", "line force", "states", "loads by states", "shaft inertia"])
def test_forces_between_frames_with_states_and_loads_by_them(kind):
    """Between a frame that deforms and one that flies; inertias on coordinates with them."""
    scene = fm.System(gravity=(0.0, -9.81, 1.0))
    flexible = scene.add(fm.FlexibleBody(particle_body(3, modes=3).record), name="flexible")
    ball, flying = (scene.add(fm.RigidBody(m, (0.05, 0.06, 0.07), (0.2, 0.05, -0.1))) for m in (1.3, 0.7))
    hinge = scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), flexible.frame("root"))
    scene.connect(fm.joint.Spherical(), flexible.frame("tip"), ball.frame())
    scene.connect(fm.joint.Free(), scene.ground.frame(), flying.frame())
    turn = Rotation.from_rotvec([0.2, 0.6, -0.3]).as_matrix()
    F, G = flexible.frame("tip"), flying.frame(p=(0.1, 0.2, 0.3), R=turn)
    if kind == "half-way bushing":
        parts = np.random.default_rng(1).standard_normal((2, 6, 6))
        scene.add_force(fm.force.Bushing(F, G, parts[0] @ parts[0].T, parts[1] @ parts[1].T, symmetric=True))
    elif kind == "line force":
        scene.add_force(fm.force.LineForce(F, G, 3.7))
        scene.add_force(fm.force.LineForce(scene.ground.frame(p=(1.0, 2.0, 3.0)), G, -3.7))
    elif kind == "states":
        scene.add_force(WithTwoStates(F, G))
        scene.add_force(WithTwoStates(scene.ground.frame(p=(0.1, 0.3, 0.0)), ball.frame(p=(0.3, 0.1, 0.1))))
    elif kind == "shaft inertia":
        scene.add_force(fm.force.ShaftInertia(hinge, 0.01, ratio=7.0))
    else:
        signals = [fm.Signal(name) for name in "abc"]
        scene.add_force(fm.force.LineForce(F, G, signals[0]))
        given = (1.0, signals[1], 0.0), (signals[2], 2.0, 0.0)
        scene.add_force(fm.force.FrameForce(G, *given, axes=fm.force.Axes.FRAME))
        scene.add_force(fm.force.JointTorque(hinge, signals[2]))
        followed = [fm.output.Position(hinge), fm.output.Velocity(hinge)]
        scene.add_states(
            _rates, initial=[0.4, 0.7], scale=(2.0, 0.3), measurements=followed, outputs=_outputs, inputs=signals
        )
    compiled = scene.compile().scene
    for seed in range(2):
        compare(compiled.plan, random_state(compiled, seed, spread=0.4))


def test_forces_of_users_by_differences():
    """Central differences of the laws hold some ten digits."""
    scene, hinge = forced_scene()
    without = scene.compile().scene
    scene.add_force(fm.force.JointLaw(hinge, _law))
    scene.add_force(fm.force.StateForce(_everywhere))
    compiled = scene.compile().scene
    state = random_state(compiled, 4, spread=0.2)
    weights = (0.3, 0.7, 0.0)
    added = analytic(compiled.plan, state, weights) - analytic(without.plan, state, weights)
    x, v = state[0], state[1]
    expected = np.zeros_like(added)
    expected[:, 0] += 0.7 * 0.3 * v
    expected += 0.7 * np.diag(np.full(len(v), 0.3 * v[0]))
    expected[:, -1] -= 0.7 * 0.4 * v[-1]
    k = compiled.index.joints[hinge].v.start
    beta = x[compiled.index.joints[hinge].x.start]
    expected[k, k] += 0.3 * 9.0 * beta**2 + 0.7 * 0.8 * abs(v[k])
    np.testing.assert_allclose(added, expected, atol=1e-8)


def branched_scene():
    """A flexible parent with children on both of its frames and on its body, twice over."""
    scene = fm.System(gravity=(1.0, -9.81, 2.0))
    turn = Rotation.from_rotvec([0.7, 0.2, -0.4]).as_matrix()
    trunk = particle_body(5, modes=4, damping=1.0, stretched=(1,))
    bodies = [scene.add(fm.FlexibleBody(trunk.record), name="trunk")]
    scene.connect(fm.joint.Free(), scene.ground.frame(p=(0.2, 0.1, -0.3), R=turn), bodies[0].frame())
    for k, name in enumerate(("tip", "tip", "root", None)):
        joint = (fm.joint.Spherical(), fm.joint.Revolute("y"), fm.joint.Prismatic("x"), fm.joint.Fixed())[k]
        limb = scene.add(fm.FlexibleBody(particle_body(6 + k, modes=2).record), name=f"limb {k}")
        scene.connect(joint, bodies[0].frame(name), limb.frame("root"))
        hand = scene.add(fm.RigidBody(0.3 + k, (0.01, 0.02, 0.02), (0.1, 0.2, 0.3)), name=f"hand {k}")
        scene.connect(fm.joint.Revolute((1.0, k, 2.0)), limb.frame("tip"), hand.frame(R=turn))
        bodies += [limb, hand]
    return scene


def test_branches_on_a_flexible_body():
    compiled = branched_scene().compile().scene
    compare(tree_only(compiled), random_state(compiled, 1))
    matrix = analytic(tree_only(compiled), random_state(compiled, 1), (1.0, 1.0, 1.0))
    names = np.array(compiled.velocity_names)
    first = np.char.find(names, "limb 0.q") >= 0
    second = np.char.find(names, "limb 1.q") >= 0
    assert not matrix[np.ix_(first, second)].any()
    assert np.abs(matrix[np.ix_(first, first)]).min() > 0.0


def test_far_from_the_origin():
    """A machine that flies fast and far away has the tangent that it has at home."""
    compiled = branched_scene().compile().scene
    x, v, a, none = random_state(compiled, 2)
    plan = tree_only(compiled)
    here = analytic(plan, (x, v, a, none), (1.0, 0.5, 0.2))
    x, v = x.copy(), v.copy()
    x[:3] += 1e6
    v[:3] += 1e4
    np.testing.assert_allclose(analytic(plan, (x, v, a, none), (1.0, 0.5, 0.2)), here, atol=1e-7)


def test_driven_joints_keep_their_rows():
    scene, *_ = mixed_scene()
    hinge = scene._connections[1]
    hinge.prescribe(lambda t: (t, 1.0, 0.0))
    compiled = scene.compile().scene
    assert len(compiled.plan.driven) == 1
    compare(tree_only(compiled), random_state(compiled, 3))


def test_mass_matrix():
    scene, *_ = mixed_scene()
    compiled = scene.compile().scene
    state = random_state(compiled, 5)
    expected = mass_matrix(compiled, new_work(compiled.plan), state[0])
    np.testing.assert_allclose(analytic(tree_only(compiled), state, (0.0, 0.0, 1.0)), expected, atol=1e-12)


def test_weights_add_up():
    scene, *_ = mixed_scene()
    compiled = scene.compile().scene
    plan, state = tree_only(compiled), random_state(compiled, 6)
    parts = [analytic(plan, state, unit) for unit in np.eye(3)]
    both = analytic(plan, state, (3.0, -0.7, 0.2))
    np.testing.assert_allclose(both, 3.0 * parts[0] - 0.7 * parts[1] + 0.2 * parts[2], atol=1e-11)


def test_joint_kinds_are_all_there():
    found = set(map(tuple, mixed_scene()[0].compile().scene.plan.tree[:, [at.JOINT_TURN, at.JOINT_ADDS]].tolist()))
    none, about_z, ball = kinds.TURN_NONE, kinds.TURN_ABOUT_Z, kinds.TURN_BALL
    assert found == {(none, 0), (about_z, 1), (none, 1), (ball, 0), (ball, 3)}


def test_reduced_bodies_of_many_modes_on_each_other():
    """More than a joint has unknowns, which other loops take, and of each body another number."""
    scene = fm.System(gravity=(0.0, -9.81, 1.0))
    end = scene.ground.frame()
    limbs = (7, fm.joint.Universal()), (9, fm.joint.Spherical()), (3, fm.joint.Screw(0.3))
    for k, (modes, joint) in enumerate(limbs):
        body = scene.add(fm.FlexibleBody(particle_body(40 + k, modes=modes, damping=1.0).record))
        scene.connect(joint, end, body.frame("root"))
        end = body.frame("tip")
    compiled = scene.compile().scene
    compare(compiled.plan, random_state(compiled, 1, spread=0.2), speed_step=2e-2)
