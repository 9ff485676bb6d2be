"""Energy-momentum: a discrete-gradient method on the canonical form of the tree, order 2.

Keeps the energy of a machine that neither loads nor dampers act on, at any step, and the momenta of
symmetries: of coordinates that energy does not depend on, linear and angular momentum of a flying
machine, vertical angular momentum of one that hangs in a ball joint.  Loads and dampers act by their
value in the middle of the step; the energy's balance with their work is exact.  Sources: Gonzalez
1996 (discrete gradient); Simo & Wong 1991 (rotations).  Derivation: docs/integrators.md.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import SceneError
from flexmbd.given import checked
from flexmbd.integrate import state as st
from flexmbd.integrate.controller import Rule, Stepper, make_advance, next_step, settle
from flexmbd.integrate.data_loads import find_defects, push, put_pushes
from flexmbd.integrate.discrete_gradient import workspace as step
from flexmbd.integrate.discrete_gradient.momentum_end import accelerate_end
from flexmbd.integrate.discrete_gradient.momentum_predictors import remember
from flexmbd.integrate.discrete_gradient.newton import bind, solve_factored, solve_step
from flexmbd.integrate.discrete_gradient.sparse_matrices import is_sparse, multiply_end_mass, solve_iteration
from flexmbd.integrate.discrete_gradient.step import kinetic_energy
from flexmbd.integrate.discrete_gradient.workspace import EnergyMomentumWorkspace
from flexmbd.integrate.explicit.loop_dynamics import Loops, new_loops, set_row_scales, update_row_scales
from flexmbd.integrate.filtered_error import filtered_ratio, misses_no_load, ratio_with_loads, vibration_rate
from flexmbd.integrate.interior_support import refuse_interiors
from flexmbd.integrate.jumps import take_jump
from flexmbd.integrate.lasting import forget_passing, judge_lasting
from flexmbd.multibody.kernels.algebra.so3 import add3, cross3, dot3, load3, scale3, store3
from flexmbd.multibody.kernels.base.array_struct import ArrayStruct
from flexmbd.multibody.kernels.base.arrays import Plan, Work, new_work
from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel
from flexmbd.multibody.kernels.base.deferred import NUMBER, deferred_kernel
from flexmbd.multibody.kernels.inverse_dynamics.canonical import canonical, momenta, potential_energy
from flexmbd.multibody.kernels.inverse_dynamics.recursion import forward_kinematics
from flexmbd.multibody.kernels.physics.joints import retract, spin_of
from flexmbd.multibody.kernels.physics.time_functions import evaluate_times
from flexmbd.multibody.kernels.reading.constraint_tables import is_driven
from flexmbd.multibody.kernels.reading.evaluated_motion import joint_turn
from flexmbd.multibody.kernels.reading.force_tables import storing_plan
from flexmbd.multibody.kernels.reading.plan_entries import driven_time, time_of_row
from flexmbd.multibody.kernels.reading.tree import has_modal_damping, masses, tree_joints
from flexmbd.multibody.kernels.tangent.diagonal_blocks import between
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.plan.scene_matrices import row_sizes
from flexmbd.overflow import looked_at, refuse_not_finite

FloatArray = NDArray[np.float64]

ORDER = 2

# The step changes seldom, for each change costs a factorisation.
_RULE = Rule(exponent=1.0 / 3.0, shortest=1.0 / 64.0)
_SAMPLES = 8  # states at which energy's dependence on coordinates is sampled
_ROUND_OFF = 1e-11  # of the largest gradient: one that is zero but for rounding


@checked()
@dataclass(frozen=True)
class EnergyMomentum:
    """Choice of the method.

    ``newton`` is the tolerance of Newton's iteration, relative to the machine's sizes and speeds: energy is
    kept to about that at each step.

    Loops are closed at the end of each step, in position and velocity.
    With error control the steps differ in length; energy and momenta are kept at each of them as at
    equal ones.  A fixed step whose equations Newton's iteration does not solve is taken in parts, of
    1/64 at least, which stand in the trajectory as steps.  Where a motion is
    prescribed its drive does work, energy is not kept, and the method is the implicit midpoint rule.

    Raises:
        SceneError: ``newton`` does not lie between 0 and 0.001.
    """

    newton: float = 1e-12

    def __post_init__(self) -> None:
        if not 0.0 < self.newton <= 1e-3:
            raise SceneError(f"newton must lie between 0 and 0.001, got {self.newton}")

    @property
    def name(self) -> str:
        """How ``explain`` calls the method."""
        return f"energy-momentum (discrete gradient), Newton to {self.newton:g}, order {ORDER}"

    @property
    def order(self) -> int:
        """Order of positions and velocities."""
        return ORDER

    def check(self, scene: CompiledScene) -> None:
        """Runs every scene without bodies that have a history."""
        refuse_interiors(scene, self.name, why="it needs potential energies")

    def stepper(self, scene: CompiledScene, state: st.State, groups: st.Groups, work: Work) -> Stepper:
        """See ``integrate.protocol.Integrator``."""
        plan = scene.plan
        stored = storing_plan(plan)
        scratch = step.new_workspace(plan, work, scene.nx, scene.nv, projector(scene, stored), row_sizes(scene))
        memory = scratch.memory
        loops = new_loops(plan, memory.loops, scene.nv, bounds=np.unique(scratch.tangent.blocks.rows))
        bind(plan, stored, work, loops, state, groups, scratch)

        def drop_factors() -> None:
            memory.step_factored[0] = 0.0

        def begin() -> None:
            drop_factors()
            memory.keeps_energy[0] = not is_driven(plan)
            memory.nonconservative[0] = is_nonconservative(plan)
            set_row_scales(scene, loops, state, work)
            memory.surplus[0] = 0.0
            memory.before[:] = state.a
            momenta(plan, work, state.x, state.v, scratch.zeros, memory.momentum)
            forward_kinematics(plan, work, state.x, scratch.zeros, scratch.zeros)
            kinetic = kinetic_energy(memory.momentum, state.v)
            memory.energy[0] = kinetic + potential_energy(stored, work, state.x)

        drop_factors()
        method = EnergyMomentumMethod(plan, stored, work, loops, scratch, self.newton)
        return Stepper(make_advance(advance, method, _RULE, state, groups), begin, drop_factors, memory)


@dataclass(frozen=True, eq=False)
class EnergyMomentumMethod(ArrayStruct):
    """Arguments of an attempt."""

    plan: Plan
    stored_plan: Plan
    work: Work
    loops: Loops
    scratch: EnergyMomentumWorkspace
    newton: float


def is_nonconservative(plan: Plan) -> bool:
    """Whether loads or dampers may act."""
    return has_modal_damping(plan) or len(plan.forces) > 0 or len(plan.elements) > 0


def projector(scene: CompiledScene, stored: Plan) -> FloatArray:
    """(2 bodies + nv, 9) see ``EnergyMomentumWorkspace.projector``.

    The directions of a joint that energy does not depend on follow from its gradients at a few states, in the
    axes of the joint's outer frame.

    Raises:
        AssemblyError: energies beyond what doubles hold.
    """
    plan, nv = scene.plan, scene.nv
    bodies = len(plan.tree)
    size = scene.group_full[scene.group_of]
    with looked_at():
        seen = _gradients(scene, stored, size)
        refuse_not_finite("how energy changes with the joints", seen * size)
    joints = [k for slots in scene.index.joints.values() for k in range(slots.v.start, slots.v.stop)]
    of_joints = set(joints)
    joints += [k for k in range(nv) if k not in of_joints and not scene.index.is_modal(k)]
    nothing = _ROUND_OFF * float(np.abs(seen[:, joints] * size[joints]).max(initial=0.0))
    kept = np.zeros((2 * bodies + nv, 9))
    kept[2 * bodies :, 0] = 1.0
    for joint in tree_joints(plan):
        o = joint.v.start
        if joint.spin is not None:
            kept[2 * joint.row + 1] = _span_projection(seen[:, joint.spin], size[joint.spin.start], nothing)
        if joint.is_free:
            kept[2 * joint.row] = _span_projection(seen[:, joint.plain_v], size[o], nothing)
            continue
        for k in range(joint.plain_v.start, joint.plain_v.stop):
            if np.abs(seen[:, k]).max() * size[k] <= nothing:
                kept[2 * bodies + k, 0] = 0.0
    return kept


def _span_projection(seen: FloatArray, size: float, nothing: float) -> FloatArray:
    """(9,) projection on the span of the gradients (k, 3), row by row."""
    _, values, axes = np.linalg.svd(seen)
    kept = axes[values * size > nothing]
    return (kept.T @ kept).ravel()


def _gradients(scene: CompiledScene, stored: Plan, size: FloatArray) -> FloatArray:
    """(k, nv) gradients of energy at a few states, rotational ones in the axes of the joint's outer frame.

    The speeds are those at which the kinetic energy is as large as the potential one, whatever units these are in;
    without potential energy the rate is 1 1/s.
    """
    plan, nv = scene.plan, scene.nv
    modal = np.array([scene.index.is_modal(k) for k in range(nv)], bool)
    none, random = np.zeros(nv), np.random.default_rng(0)
    share = size * np.where(modal, 1e-3, 1.0)
    places = [random.standard_normal(nv) * share for _ in range(_SAMPLES)]
    still = np.array([_gradient(scene, stored, place, none, np.zeros(len(plan.rows))) for place in places])
    potential = float(np.abs(still * share).max(initial=0.0))
    mass = float(masses(plan).sum())
    rate = math.sqrt(potential / mass) / scene.extent if potential > 0.0 and mass > 0.0 else 1.0
    multipliers = mass * (scene.extent * rate) * rate
    return np.array(
        [
            _gradient(
                scene, stored, place, random.standard_normal(nv) * share * rate,
                random.standard_normal(len(plan.rows)) * multipliers,
            )
            for place in places
        ]
    )  # fmt: skip


def _gradient(
    scene: CompiledScene, stored: Plan, place: FloatArray, v: FloatArray, multipliers: FloatArray
) -> FloatArray:
    """(nv,) gradient of energy at ``place`` from the scene's start, with velocities v and multipliers (m,)."""
    plan, work = scene.plan, new_work(scene.plan)
    none, p, x, gradient = np.zeros(scene.nv), np.zeros(scene.nv), np.empty(scene.nx), np.zeros(scene.nv)
    retract(plan, scene.start, place, x)
    wrench = np.zeros((len(plan.tree), 6))
    canonical(stored, work, x, v, 0.5 * v, none, multipliers, wrench, np.zeros(6), p, gradient)
    for joint in tree_joints(plan):
        if joint.spin is not None:
            gradient[joint.spin] = joint_turn(work, joint.row) @ gradient[joint.spin]
    return gradient


@kernel
def _add_rotation_error(move, before, after, a_before, a_after, o, h, error):
    """Add the local error of the rotation ``move``, against a quadrature of order 4 with Magnus' first bracket."""
    turn = load3(move, o)
    angle = math.sqrt(dot3(turn, turn))
    share = 2.0 * math.atan(0.5 * angle) / angle if angle > 1e-8 else 1.0
    bracket = scale3(h * h * h / 12.0, cross3(load3(before, o), load3(a_before, o)))
    difference = add3(scale3(share - 1.0, turn), scale3(-1.0, bracket))
    store3(error, o, add3(load3(error, o), difference))


@kernel
def _filter(plan, scratch, error):
    """Filter an error (nv,) into ``s.correction`` by the iteration matrix.

    This damps the error in stiff parts and removes it across rows.  ``s.full_matrix``, or ``s.end_mass``, must hold the
    mass matrix.
    """
    free = plan.free
    if is_sparse(scratch):
        multiply_end_mass(plan, scratch, error)
        solve_iteration(scratch)
        return
    for i in range(scratch.correction.shape[1]):
        scratch.correction[0, i] = 0.0
    bounds = scratch.tangent.blocks.free
    for c in range(bounds.shape[0] - 1):
        for i in range(*between(bounds, c)):
            for j in range(*between(bounds, c)):
                scratch.correction[0, i] += scratch.full_matrix[free[i], free[j]] * error[free[j]]
    solve_factored(plan, scratch)


@kernel
def _ratio(plan, state, groups, scratch, h, rate, noise, lasting):
    rates = scratch.memory.own_rate
    return filtered_ratio(
        plan, state, groups, scratch.error_x, scratch.error_v, scratch.own_rate, rates, h, rate, noise, lasting
    )


@deferred_kernel(NUMBER)
def _ratio_with_loads(plan, work, state, groups, scratch, h, rate, noise, ratio):
    """The error's ratio where loads that are data act in the step, see ``data_loads``.

    Of motions a step misses nothing: its driven velocities are what they travel over its length.
    """
    found = find_defects(plan, state, h, state.numbers[st.STEP_BEFORE], scratch.data)
    errors = scratch.error_x, scratch.error_v, scratch.own_rate, scratch.memory.own_rate
    if misses_no_load(plan, state, groups, *errors, h, rate, noise, found):
        return ratio
    push(plan, work, state, scratch.x_end, scratch.v_end, scratch.a_end, scratch.zero_multipliers, scratch.data)
    put_pushes(plan, scratch.data, scratch.correction)
    solve_factored(plan, scratch)
    lasting = (1.0, state.numbers[st.STEP_LASTING])
    return ratio_with_loads(plan, state, groups, *errors, h, rate, noise, lasting, scratch.correction)


@kernel
def _local_error(plan, work, state, groups, scratch, a_end, h, rate, noise):
    """The ratio of the step's error to the tolerance, against quadratures of its velocities and accelerations.

    ``noise``: the share of scales that Newton's iteration leaves; no shorter step makes it less.
    """
    judge_lasting(plan, work, state, groups, scratch.x_end, scratch.v_end)
    h1 = state.numbers[st.STEP_BEFORE]
    v_end = scratch.v_end
    for k in range(a_end.shape[0]):
        correction = h * h / 12.0 * (state.a[k] - a_end[k])
        scratch.error_x[k] = scratch.increment[k] - 0.5 * h * (state.v[k] + v_end[k]) - correction
        # the integral of the parabola through the last three accelerations
        curve = 0.0
        if h1 > 0.0:
            slope = (state.a[k] - scratch.memory.before[k]) / h1
            curve = ((a_end[k] - state.a[k]) / h - slope) / (h + h1)
        mean = 0.5 * (state.a[k] + a_end[k]) - curve * h * h / 6.0
        scratch.error_v[k] = v_end[k] - state.v[k] - h * mean
        scratch.own_rate[k] = curve
    for i in range(plan.tree.shape[0]):
        o = spin_of(plan.tree[i])
        if o >= 0:
            _add_rotation_error(scratch.increment, state.v, v_end, state.a, a_end, o, h, scratch.error_x)
    for j in range(plan.free.shape[0]):
        scratch.error_x[j] = scratch.error_x[plan.free[j]]
    _filter(plan, scratch, scratch.own_rate)
    for j in range(plan.free.shape[0]):
        k = plan.free[j]
        scratch.own_rate[k] = vibration_rate(groups, k, scratch.correction[0, j])
    _filter(plan, scratch, scratch.error_v)
    for j in range(plan.free.shape[0]):
        scratch.error_v[j] = scratch.correction[0, j]
    ratio = _ratio(plan, state, groups, scratch, h, rate, noise, (1.0, state.numbers[st.STEP_LASTING]))
    if ratio <= 1.0 and scratch.data.known[0] == 1:
        ratio = _ratio_with_loads(plan, work, state, groups, scratch, h, rate, noise, ratio)
    forget_passing(plan, state, groups, scratch.own_rate)
    return ratio


@kernel
def _accept(plan, loops, state, scratch, a_end, h):
    """Make the trial state the current one."""
    remember(plan, state, scratch, h)
    for k in range(state.v.shape[0]):
        scratch.memory.before[k] = state.a[k]
        scratch.memory.momentum[k] = scratch.p_end[k]
        before = scratch.memory.own_rate[k]
        scratch.memory.own_rate[k] = st.own_rate(scratch.own_rate[k], before, state.numbers[st.RATE], h)
        state.v[k] = scratch.v_end[k]
        state.a[k] = a_end[k]
    for k in range(state.x.shape[0]):
        state.x[k] = scratch.x_end[k]
    for i in range(state.multipliers.shape[0]):
        state.multipliers[i] = scratch.nu_end[i]
    update_row_scales(loops, state)
    memory = scratch.memory
    memory.energy[0] += memory.load_work[0]
    there = kinetic_energy(memory.momentum, state.v) + scratch.energy[step.POTENTIAL_END]
    memory.surplus[0] = there - memory.energy[0] if memory.keeps_energy[0] == 1 else 0.0


@kernel
def _solve(plan, stored_plan, work, loops, state, groups, scratch, h, rate, newton):
    """A trial step of h; False if Newton's iteration failed."""
    t = state.numbers[st.TIME]
    if plan.driven.shape[0] + plan.rows.shape[0] > 0:
        evaluate_times(plan, st.function_time(state.numbers, state.numbers[st.STEP_END]), work.time)
        for i in range(plan.rows.shape[0]):
            f = time_of_row(plan.rows[i])
            if f >= 0:
                scratch.row_end[i, 0] = work.time[f, 0]
                scratch.row_end[i, 1] = work.time[f, 1]
        for i in range(plan.driven.shape[0]):
            for k in range(3):
                scratch.driven[i, k] = work.time[driven_time(plan.driven[i]), k]
    evaluate_times(plan, t + 0.5 * h, work.time)
    st.set_scales(state, groups, scratch, rate, newton)
    return solve_step(plan, stored_plan, work, loops, state, groups, scratch, h, newton)


@kernel
def _attempt(method, state, groups, h):
    """An attempt at a step, see ``controller``."""
    plan = method.plan
    stored_plan = method.stored_plan
    work = method.work
    loops = method.loops
    scratch = method.scratch
    newton = method.newton
    number = state.numbers
    count = state.counts
    rate = number[st.RATE]
    solved = _solve(plan, stored_plan, work, loops, state, groups, scratch, h, rate, newton)
    if solved and plan.flag[0] == 0:
        evaluate_times(plan, st.function_time(state.numbers, number[st.STEP_END]), work.time)
        accelerate_end(plan, work, loops, scratch)
    if settle(plan, state, solved):
        ratio = 0.0
        if count[st.FIXED_STEP] == 0:
            noise = max(newton, scratch.round_off_floor[0])
            ratio = _local_error(plan, work, state, groups, scratch, scratch.a_end, h, rate, noise)
            if not ratio <= 1.0 and take_jump(plan.free, state, groups, state.a, scratch.a_end, 1.0, h):
                ratio = 1.0
        number[st.ERROR_RATIO] = ratio
        if ratio <= 1.0:
            _accept(plan, loops, state, scratch, scratch.a_end, h)


@entry_kernel
def advance(method, rule, knots, state, groups, record):
    """Step until the end, a full record, or a failure; see ``controller``."""
    h = 0.0
    while True:
        h = next_step(method.plan, rule, knots, state, groups, record, h)
        if h == 0.0:
            return state.counts[st.OUTCOME]
        _attempt(method, state, groups, h)
