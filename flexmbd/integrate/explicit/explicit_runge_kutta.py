"""Explicit Runge-Kutta pairs on the state's manifold, with projection onto closed loops.

In each step the configuration is x = x_n moved by local coordinates u, with du/dt the inverse
differential of the move applied to v, and dv/dt the forward dynamics; so the pair keeps its order for
rotations too; of round bodies the spin is left out (``kernels.round_bodies``).  Sources: Munthe-Kaas
1999; Dormand & Prince 1980; Hairer, Norsett & Wanner 1993 (sections II.4, II.10); projection: Hairer &
Wanner 1996, section VII.2.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from functools import partial

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import SceneError
from flexmbd.given import checked
from flexmbd.integrate import state as st
from flexmbd.integrate.controller import Rule, Stepper, make_advance, next_step, no_factors
from flexmbd.integrate.explicit.explicit_machine import ExplicitMachine
from flexmbd.integrate.explicit.fixed_step import judge
from flexmbd.integrate.explicit.force_noise import (
    ForceNoise,
    new_force_noise,
    no_force_noise,
    noise_is_due,
    put_noise,
    sample_noise,
)
from flexmbd.integrate.explicit.loop_dynamics import (
    LoopMemory,
    Loops,
    accelerate,
    is_nearly_singular,
    new_loop_memory,
    new_loops,
    project,
    project_onto_tangent,
    set_row_scales,
    update_row_scales,
)
from flexmbd.integrate.explicit.runge_kutta_workspace import RungeKuttaWorkspace, new_workspace
from flexmbd.integrate.explicit.step_errors import is_looked_at, take_error
from flexmbd.integrate.explicit.step_growth import runge_kutta_growth
from flexmbd.integrate.explicit.tableau import Pair, Tableau, TableauArrays
from flexmbd.integrate.interior_support import refuse_interiors
from flexmbd.integrate.jumps import put_widest, sum_of_sizes, take_jump
from flexmbd.multibody.kernels.algebra import rotation_update
from flexmbd.multibody.kernels.algebra.rotation_update import coordinate_slots, from_local_coordinates, to_local_rates
from flexmbd.multibody.kernels.base.array_struct import ArrayStruct
from flexmbd.multibody.kernels.base.arrays import Plan, Work
from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel
from flexmbd.multibody.kernels.elements.law_pieces import changes_piece
from flexmbd.multibody.kernels.forward_dynamics.articulated_layout import (
    ArticulatedWork,
    new_articulated_work,
    refit,
)
from flexmbd.multibody.kernels.forward_dynamics.round_bodies import (
    begin_spin,
    despun_rates,
    round_axes,
    to_spinning_axes,
    vectors_to_spinning_axes,
)
from flexmbd.multibody.kernels.inverse_dynamics.residual import drive
from flexmbd.multibody.kernels.physics.time_functions import evaluate_times
from flexmbd.multibody.plan.compiled_scene import CompiledScene

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# The longest step, in characteristic times of the machine, is well below half a turn; shares of the exponent as
# Gustafsson 1991.
_RULE = Rule(
    exponent=0.0, proportional=0.7, integral=0.4, least=0.2, most=6.0, failed=0.2, worth=1.0, tight=1.0, shrunk=1.0,
    hold=1, longest=2.0,
)  # fmt: skip

_LEAST = 0.3  # the least error of order 8 over that of order 3 to the power 9/4, both relative to the machine's sizes
_SMOOTH = 4.0  # changes of accelerations at stages without weight over those at the others: more than of any motion


class Rotations(IntEnum):
    """How local coordinates turn a quaternion; see ``kernels.rotation_update``."""

    EXPONENTIAL = rotation_update.EXPONENTIAL
    CAYLEY = rotation_update.CAYLEY
    QUATERNION = rotation_update.QUATERNION


@checked()
@dataclass(frozen=True)
class ExplicitRungeKutta:
    """Choice of the method: ``pair`` of formulas, or a ``Tableau`` of one's own, and how ``rotations`` are updated.

    A step costs one forward dynamics a stage and nothing else of weight.  For machines without stiff
    springs or fast modes, which would dictate the step; and the cheapest way to many digits there.
    """

    pair: Pair | Tableau = Pair.DORMAND_PRINCE_5
    rotations: Rotations = Rotations.EXPONENTIAL

    @property
    def name(self) -> str:
        """How ``explain`` calls the method."""
        way = "" if self.rotations == Rotations.EXPONENTIAL else f", {self.rotations.name.lower()} rotations"
        return f"explicit Runge-Kutta, {self.pair.label}{way}"

    @property
    def order(self) -> int:
        """Order of positions, velocities and multipliers."""
        return self.pair.order

    def check(self, scene: CompiledScene) -> None:
        """Runs every scene without bodies that have a history."""
        refuse_interiors(scene, self.name, why="it evaluates several stages a step")

    @property
    def rule(self) -> Rule:
        """How its steps follow from its errors."""
        return _RULE.replace(exponent=self.pair.exponent)

    def stepper(self, scene: CompiledScene, state: st.State, groups: st.Groups, work: Work) -> Stepper:
        """See ``integrate.protocol.Integrator``.

        Raises:
            SceneError: error control is asked of a method without an error estimate.
        """
        if state.counts[st.FIXED_STEP] == 0 and not self.pair.estimates_error:
            raise SceneError(
                f"{self.pair.label} has no error estimate: give a step h, or take "
                "fm.Pair.DORMAND_PRINCE_5"
            )
        fixed = state.counts[st.FIXED_STEP] == 1
        noise = no_force_noise() if fixed else new_force_noise(scene.plan, scene.nv)
        memory = RungeKuttaMemory(new_loop_memory(scene.plan), noise)
        method = new_method(scene, self, self.pair.tableau, memory, work)

        def begin() -> None:
            set_row_scales(scene, method.loops, state, work)

        def refit_method() -> bool:
            axes = round_axes(scene.plan, method.quaternions)
            if bool(axes.any()) != bool(len(method.scratch.axes)):
                return False
            method.scratch.axes[:] = axes[: len(method.scratch.axes)]
            return refit(scene.plan, method.aw)

        loop = make_advance(advance, method, self.rule, state, groups)
        ask = 1.0 if fixed else float(state.numbers[st.TOLERANCE] ** (-1.0 / self.order))
        steps_a_radian = np.inf if fixed else ask
        m = method
        machine = partial(ExplicitMachine, m.plan, m.work, m.aw, m.loops, m.plain, m.quaternions)
        refuse_step = judge(scene, machine, state, groups, growth=runge_kutta_growth(self.pair, self.name))
        errors = method.scratch.errors
        return Stepper(loop, begin, no_factors, memory, refit_method, steps_a_radian, refuse_step, errors)


@dataclass(frozen=True, eq=False)
class RungeKuttaMemory(ArrayStruct):
    """What is remembered from step to step."""

    loops: LoopMemory
    noise: ForceNoise


@dataclass(frozen=True, eq=False)
class RungeKuttaMethod(ArrayStruct):
    """Arguments of an attempt."""

    plan: Plan
    work: Work
    aw: ArticulatedWork
    loops: Loops
    plain: IntArray
    quaternions: IntArray
    way: int
    tableau: TableauArrays
    scratch: RungeKuttaWorkspace


def new_method(
    scene: CompiledScene, choice: ExplicitRungeKutta, tableau: TableauArrays, memory: RungeKuttaMemory, work: Work
) -> RungeKuttaMethod:
    """Allocate the arguments of an attempt with a tableau."""
    plain, quaternions = coordinate_slots(scene.plan)
    scratch = new_workspace(scene, tableau.a.shape[1], round_axes(scene.plan, quaternions), memory.noise)
    return RungeKuttaMethod(
        scene.plan, work, new_articulated_work(scene.plan), new_loops(scene.plan, memory.loops, scene.nv),
        plain, quaternions, int(choice.rotations), tableau, scratch,
    )  # fmt: skip


@kernel
def _stage_values(tableau, i, state, scratch, h):
    """s.u, s.v: local coordinates and velocities of stage i."""
    for k in range(scratch.u.shape[0]):
        scratch.u[k] = 0.0
        scratch.v[k] = state.v[k]
    for j in range(min(i, tableau.a.shape[1])):
        share = h * tableau.a[i, j]
        if share != 0.0:
            for k in range(scratch.u.shape[0]):
                scratch.u[k] += share * scratch.rate_x[j, k]
                scratch.v[k] += share * scratch.rate_v[j, k]


@kernel
def _error(plan, work, aw, loops, quaternions, tableau, state, groups, scratch, h, rate):
    """The ratio of the step's error to the tolerance; two estimates are combined as in DOP853.

    Of a single motion the estimate of order 5 passes through zero within a turn, where the combination sees a
    thousandth of the error.  So it is no less than what the estimate of order 3, relative to the machine's sizes, makes
    of an error of order 8: e^(9/4).  Both pass through zero at once only by chance.  In a step onto another piece of a
    law, as that of a stop, all errors are of one order, and the estimate of order 3 counts itself.

    Errors across the loops do not count: projection removes them; nor what rounding makes of forces (``force_noise``).
    """
    for e in range(2):
        for k in range(scratch.u.shape[0]):
            scratch.error_x[e, k] = 0.0
            scratch.error_v[e, k] = 0.0
        for j in range(tableau.estimates.shape[1]):
            share = h * tableau.estimates[e, j]
            if share != 0.0:
                for k in range(scratch.u.shape[0]):
                    scratch.error_x[e, k] += share * scratch.rate_x[j, k]
                    scratch.error_v[e, k] += share * scratch.rate_v[j, k]
        vectors_to_spinning_axes(quaternions, scratch.axes, scratch.spins, scratch.error_x[e])
        vectors_to_spinning_axes(quaternions, scratch.axes, scratch.spins, scratch.error_v[e])
        if plan.rows.shape[0] > 0:
            project_onto_tangent(plan, work, aw, loops, scratch.error_x[e])
            project_onto_tangent(plan, work, aw, loops, scratch.error_v[e])
        put_noise(scratch.noise, tableau.estimates[e], h, scratch.noise_v[e])
    lower = st.error_ratio(
        plan.free, state, groups, scratch.error_x[1], scratch.error_v[1], scratch.noise_v[1], h, rate
    )
    ratio = st.error_ratio(
        plan.free, state, groups, scratch.error_x[0], scratch.error_v[0], scratch.noise_v[0], h, rate
    )
    if lower > 0.0:
        if plan.elements.shape[0] > 0 and changes_piece(plan, work, state.x, scratch.x, scratch.v):
            return max(lower, ratio)
        allowed = state.numbers[st.TOLERANCE] * min(1.0, h * rate)
        least = _LEAST * (lower * allowed) ** 2.25 / allowed
        return max(least, ratio * ratio / np.sqrt(ratio * ratio + 0.01 * lower * lower))
    return ratio


@kernel
def _unseen_blow(plan, tableau, state, groups, scratch, h, rate):
    """The ratio to the tolerance of what a blow does that fell into stages which neither end nor estimates weigh.

    Accelerations of a smooth motion differ there from the start's by no more than at the other stages.  What throws
    the machine out of a contact again within such a stage leaves no trace in the others.
    """
    stages = tableau.a.shape[1]
    largest = 0.0
    for i in range(plan.free.shape[0]):
        k = plan.free[i]
        seen, unseen = 0.0, 0.0
        for j in range(1, stages):
            change = abs(scratch.rate_v[j, k] - scratch.rate_v[0, k])
            weighed = tableau.a[stages, j] != 0.0 or tableau.estimates[0, j] != 0.0 or tableau.estimates[1, j] != 0.0
            if weighed:
                seen = max(seen, change)
            else:
                unseen = max(unseen, change)
        if unseen > _SMOOTH * seen:
            g = groups.of[k]
            allowed = state.numbers[st.TOLERANCE] * min(1.0, h * rate) * st.group_speed(groups, g, rate)
            largest = max(largest, h * unseen / max(allowed, st.ROUND_OFF * groups.full[g] * rate))
    return largest


@kernel
def _judge(plan, work, aw, loops, quaternions, tableau, state, groups, scratch, h, rate):
    """The ratio of the step's error to the tolerance, 1 where it passes a jump all the same (see ``jumps``)."""
    ratio = _error(plan, work, aw, loops, quaternions, tableau, state, groups, scratch, h, rate)
    if ratio <= 1.0 and plan.elements.shape[0] > 0:
        ratio = max(ratio, _unseen_blow(plan, tableau, state, groups, scratch, h, rate))
    if ratio <= 1.0:
        return ratio
    stages = tableau.a.shape[1]
    begin, widest = scratch.rate_v[0], scratch.error_v[0]
    put_widest(begin, scratch.rate_v[1:stages], widest)
    taken = take_jump(plan.free, state, groups, begin, widest, sum_of_sizes(tableau.a[stages]), h)
    return 1.0 if taken else ratio


@kernel
def _accept(state, scratch):
    """Make the step's end the current state."""
    for k in range(state.v.shape[0]):
        state.v[k] = scratch.v[k]
        state.a[k] = scratch.a[k]
    for k in range(state.x.shape[0]):
        state.x[k] = scratch.x[k]
    for i in range(state.multipliers.shape[0]):
        state.multipliers[i] = scratch.multipliers[i]


@kernel
def _finite(scratch):
    """Whether the step's end is finite."""
    total = 0.0
    for k in range(scratch.v.shape[0]):
        total += abs(scratch.v[k]) + abs(scratch.a[k])
    return np.isfinite(total)


@kernel
def _meets_piece(plan, work, tableau, state, scratch):
    """Whether a step with an estimate leads onto another piece of a law."""
    if plan.elements.shape[0] == 0 or tableau.estimates_error == 0:
        return False
    return changes_piece(plan, work, state.x, scratch.x, scratch.v)


@kernel
def _step(plan, work, aw, loops, plain, quaternions, way, tableau, state, groups, scratch, h, rate):
    """Take the step h, or find that its error is too large.

    Returns its error ratio (0 for a fixed step), infinite where loops do not close or nothing finite
    came out; ``scratch`` holds the step's end where it is at most one.
    """
    stages = tableau.a.shape[1]
    fixed = state.counts[st.FIXED_STEP] == 1
    looks = not fixed or (tableau.estimates_error == 1 and is_looked_at(state, scratch.errors))
    uses_end = tableau.estimates[0, stages] != 0.0
    ratio = 0.0
    for k in range(scratch.v.shape[0]):
        scratch.rate_x[0, k] = state.v[k]
        scratch.rate_v[0, k] = state.a[k]
    begin_spin(quaternions, scratch.axes, state.v, scratch.spins)
    despun_rates(quaternions, scratch.axes, scratch.spins, scratch.rate_x[0], scratch.rate_v[0])
    instant = np.nan
    for i in range(1, stages + 1):
        end = i == stages
        _stage_values(tableau, i, state, scratch, h)
        from_local_coordinates(plain, quaternions, way, state.x, scratch.u, scratch.x)
        node = tableau.nodes[i]
        to_spinning_axes(quaternions, scratch.axes, scratch.spins, node * h, scratch.x, scratch.v)
        if node != instant:
            t = state.numbers[st.STEP_END] if node == 1.0 else state.numbers[st.TIME] + node * h
            evaluate_times(plan, st.function_time(state.numbers, t), work.time)
            instant = node
        if plan.flag[0] != 0:
            return np.inf
        drive(plan, work, scratch.x, scratch.v, scratch.a)
        looks = looks or (end and _meets_piece(plan, work, tableau, state, scratch))
        if end and not uses_end and looks:
            ratio = _judge(plan, work, aw, loops, quaternions, tableau, state, groups, scratch, h, rate)
            if not fixed and not ratio <= 1.0:
                return ratio
        for attempt in range(2):
            if plan.rows.shape[0] > 0 and (end or attempt == 1):
                closed = project(plan, work, aw, plain, quaternions, state, groups, loops, rate, scratch.x, scratch.v)
                if end and not closed:
                    state.counts[st.OUTCOME] = st.LOOPS_OPEN
                    return np.inf
            accelerate(plan, work, aw, loops, scratch.x, scratch.v, scratch.a, scratch.multipliers)
            state.counts[st.EVALUATIONS] += 1
            if end or plan.rows.shape[0] == 0 or not is_nearly_singular(loops):
                break
        for k in range(scratch.v.shape[0]):
            scratch.rate_x[i, k] = scratch.v[k]
            scratch.rate_v[i, k] = scratch.a[k]
        despun_rates(quaternions, scratch.axes, scratch.spins, scratch.rate_x[i], scratch.rate_v[i])
        if quaternions.shape[0] > 0:
            to_local_rates(quaternions, way, scratch.u, scratch.rate_x[i])
    if uses_end and looks:
        ratio = _judge(plan, work, aw, loops, quaternions, tableau, state, groups, scratch, h, rate)
    if fixed:
        ratio = take_error(state, scratch.errors, ratio, h, rate, looks)
    return ratio if _finite(scratch) else np.inf


@kernel
def _attempt(method, state, groups, h):
    """An attempt at a step, see ``controller``."""
    plan = method.plan
    work = method.work
    aw = method.aw
    loops = method.loops
    plain = method.plain
    quaternions = method.quaternions
    way = method.way
    tableau = method.tableau
    s = method.scratch
    rate = state.numbers[st.RATE]
    if noise_is_due(s.noise):
        sample_noise(plan, work, aw, loops, plain, quaternions, way, state, groups, s, s.noise)
    ratio = _step(plan, work, aw, loops, plain, quaternions, way, tableau, state, groups, s, h, rate)
    state.numbers[st.ERROR_RATIO] = ratio
    if plan.flag[0] != 0:
        state.counts[st.OUTCOME] = st.CALLBACK_FAILED
    elif ratio <= 1.0:
        _accept(state, s)
        if plan.rows.shape[0] > 0:
            update_row_scales(loops, state)


@entry_kernel
def advance(method, rule, knots, state, groups, record):
    """Step until the end, a full record, or a failure; see ``controller``."""
    h = 0.0
    while True:
        h = next_step(method.plan, rule, knots, state, groups, record, h)
        if h == 0.0:
            return state.counts[st.OUTCOME]
        _attempt(method, state, groups, h)
