"""Explicit Runge-Kutta pairs on the state's manifold, with projection onto closed loops.

In each step the configuration is x = x_n moved by local coordinates u, with du/dt the inverse
differential of the move applied to v, and dv/dt the forward dynamics; so the pair keeps its order for
rotations too; of round bodies the spin is left out (``kernels.round_bodies``).  Sources: Munthe-Kaas
1999; Dormand & Prince 1980; Hairer, Norsett & Wanner 1993 (sections II.4, II.10); projection: Hairer &
Wanner 1996, section VII.2.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import SceneError
from flexmbd.integrate import state as st
from flexmbd.integrate.history import refuse_interiors
from flexmbd.integrate.loop_dynamics import (
    N_MEMORY,
    accelerate,
    drop_normal_part,
    is_nearly_singular,
    new_loops,
    note_scales,
    project,
    survey,
)
from flexmbd.integrate.protocol import Stepper
from flexmbd.integrate.tableau import Pair
from flexmbd.multibody.kernels import rotation_update
from flexmbd.multibody.kernels.articulated_layout import new_articulated_work
from flexmbd.multibody.kernels.compiling import entry_kernel, kernel, part_of_kernel
from flexmbd.multibody.kernels.layout import Work
from flexmbd.multibody.kernels.residual import drive
from flexmbd.multibody.kernels.rotation_update import coordinate_slots, move, turn_rates
from flexmbd.multibody.kernels.round_bodies import round_axes, slow_rates, spin_on, spin_vectors, steady_spin
from flexmbd.multibody.kernels.time_functions import evaluate_times
from flexmbd.multibody.plan import CompiledScene

FloatArray = NDArray[np.float64]

# The method's entries of State.numbers and State.counts: the error ratio of the last accepted step;
# whether the step before was rejected.
RATIO_BEFORE = st.METHOD
WAS_REJECTED = st.METHOD_COUNT

_LONGEST = 2.0  # the longest step in characteristic times of the machine: well below half a turn
_SAFETY = 0.9
_PROPORTIONAL, _INTEGRAL = 0.7, 0.4  # shares of the exponent (Gustafsson 1991)
_LEAST, _MOST = 0.2, 6.0  # a step's size over that of the step before


class Rotations(IntEnum):
    """How local coordinates turn a quaternion; see ``kernels.rotation_update``."""

    EXPONENTIAL = rotation_update.EXPONENTIAL
    CAYLEY = rotation_update.CAYLEY
    QUATERNION = rotation_update.QUATERNION


class Scratch(NamedTuple):
    """Work arrays of a step: the stage at hand and the derivatives of all stages.

    rate_x, rate_v: (s + 1, nv) du/dt and dv/dt.  error_x, error_v: (2, nv).
    axes, spins (k, 3): see ``round_bodies``; no rows where no body is round.
    """

    x: FloatArray
    v: FloatArray
    a: FloatArray
    u: FloatArray
    multipliers: FloatArray
    rate_x: FloatArray
    rate_v: FloatArray
    error_x: FloatArray
    error_v: FloatArray
    axes: FloatArray
    spins: FloatArray


@dataclass(frozen=True)
class ExplicitRungeKutta:
    """Choice of the method: ``pair`` of formulas, and how ``rotations`` are updated.

    A step costs one forward dynamics a stage and nothing else of weight.  For machines without stiff
    springs or fast modes, which would dictate the step; and the cheapest way to many digits there.
    """

    pair: Pair = Pair.DORMAND_PRINCE_5
    rotations: Rotations = Rotations.EXPONENTIAL

    @property
    def name(self) -> str:
        """How ``explain`` calls the method."""
        way = "" if self.rotations == Rotations.EXPONENTIAL else f", {self.rotations.name.lower()} rotations"
        return f"explicit Runge-Kutta, {self.pair.value}{way}"

    @property
    def order(self) -> int:
        """Order of positions, velocities and multipliers."""
        return self.pair.order

    @property
    def memory_rows(self) -> int:
        """The scales of the loops' rows."""
        return N_MEMORY

    def check(self, scene: CompiledScene) -> None:
        """Runs every scene without bodies that have a history."""
        refuse_interiors(scene, self.name, why="it evaluates several stages a step")

    def stepper(
        self, scene: CompiledScene, state: st.State, groups: st.Groups, work: Work
    ) -> tuple[Stepper, Callable[[], None]]:
        """See ``integrate.protocol.Integrator``.

        Raises:
            SceneError: error control is asked of a method without an error estimate.
        """
        if state.counts[st.FIXED_STEP] == 0 and not self.pair.estimates_error:
            raise SceneError(
                f"{self.pair.value} has no error estimate: give a step h, or take "
                "fm.Pair.DORMAND_PRINCE_5"
            )
        tableau = self.pair.tableau
        plain, quaternions = coordinate_slots(scene.plan)
        scratch = _new_scratch(scene, tableau.a.shape[1], round_axes(scene.plan, quaternions))
        loops = new_loops(scene.plan, state)
        articulated = new_articulated_work(scene.plan)
        if state.counts[st.STEPS] == 0:
            state.numbers[RATIO_BEFORE] = 1e-4
            evaluate_times(scene.plan, float(state.numbers[st.TIME]), work.time)
            survey(scene, state, work)
        parts = (scene.plan, work, articulated, loops, plain, quaternions, int(self.rotations), tableau)

        def advance_to(record: st.Record) -> int:
            return int(advance(*parts, state, groups, scratch, record))

        return advance_to, _nothing_to_drop


def _nothing_to_drop() -> None:
    """An explicit method keeps no factors from step to step."""


def _new_scratch(scene: CompiledScene, stages: int, axes: FloatArray) -> Scratch:
    nv = scene.nv
    if not axes.any():
        axes = axes[:0]
    zeros = np.zeros
    return Scratch(
        x=zeros(scene.nx),
        v=zeros(nv),
        a=zeros(nv),
        u=zeros(nv),
        multipliers=zeros(len(scene.plan.rows)),
        rate_x=zeros((stages + 1, nv)),
        rate_v=zeros((stages + 1, nv)),
        error_x=zeros((2, nv)),
        error_v=zeros((2, nv)),
        axes=axes,
        spins=zeros((len(axes), 3)),
    )


@part_of_kernel
def _combine(tableau, i, state, s, h):
    """s.u, s.v: local coordinates and velocities of stage i."""
    for k in range(s.u.shape[0]):
        s.u[k] = 0.0
        s.v[k] = state.v[k]
    for j in range(min(i, tableau.a.shape[1])):
        share = h * tableau.a[i, j]
        if share != 0.0:
            for k in range(s.u.shape[0]):
                s.u[k] += share * s.rate_x[j, k]
                s.v[k] += share * s.rate_v[j, k]


@part_of_kernel
def _error(plan, work, aw, loops, quaternions, tableau, state, groups, s, h, rate):
    """The step's error over what is tolerated; two estimates are combined as DOP853 does.

    Errors across the loops do not count: projection takes them away.
    """
    for e in range(2):
        for k in range(s.u.shape[0]):
            s.error_x[e, k] = 0.0
            s.error_v[e, k] = 0.0
        for j in range(tableau.estimates.shape[1]):
            share = h * tableau.estimates[e, j]
            if share != 0.0:
                for k in range(s.u.shape[0]):
                    s.error_x[e, k] += share * s.rate_x[j, k]
                    s.error_v[e, k] += share * s.rate_v[j, k]
        spin_vectors(quaternions, s.axes, s.spins, s.error_x[e])
        spin_vectors(quaternions, s.axes, s.spins, s.error_v[e])
        if plan.rows.shape[0] > 0:
            drop_normal_part(plan, work, aw, loops, s.error_x[e])
            drop_normal_part(plan, work, aw, loops, s.error_v[e])
    lower = st.error_ratio(plan, state, groups, s.error_x[1], s.error_v[1], h, rate)
    ratio = st.error_ratio(plan, state, groups, s.error_x[0], s.error_v[0], h, rate)
    if lower > 0.0:
        return ratio * ratio / np.sqrt(ratio * ratio + 0.01 * lower * lower)
    return ratio


@part_of_kernel
def _accept(plan, state, groups, s, record, h):
    """Make the step's end the current state and write a row of the record."""
    for k in range(state.v.shape[0]):
        state.v[k] = s.v[k]
        state.a[k] = s.a[k]
    for k in range(state.x.shape[0]):
        state.x[k] = s.x[k]
    for i in range(state.multipliers.shape[0]):
        state.multipliers[i] = s.multipliers[i]
    st.store(plan, state, groups, record, h)


@kernel
def _finite(s):
    """Whether the step's end is a number."""
    total = 0.0
    for k in range(s.v.shape[0]):
        total += abs(s.v[k]) + abs(s.a[k])
    return np.isfinite(total)


@part_of_kernel
def _step(plan, work, aw, loops, plain, quaternions, way, tableau, state, groups, s, h, rate):
    """Take the step h, or find that its error is too large.

    Returns its error ratio (0 for a fixed step), infinite where loops do not close or nothing finite
    came out; ``s`` holds the step's end where it is at most one.
    """
    stages = tableau.a.shape[1]
    fixed = state.counts[st.FIXED_STEP] == 1
    uses_end = tableau.estimates[0, stages] != 0.0
    ratio = 0.0
    for k in range(s.v.shape[0]):
        s.rate_x[0, k] = state.v[k]
        s.rate_v[0, k] = state.a[k]
    steady_spin(quaternions, s.axes, state.v, s.spins)
    slow_rates(quaternions, s.axes, s.spins, s.rate_x[0], s.rate_v[0])
    instant = np.nan
    for i in range(1, stages + 1):
        end = i == stages
        _combine(tableau, i, state, s, h)
        move(plain, quaternions, way, state.x, s.u, s.x)
        node = tableau.nodes[i]
        spin_on(quaternions, s.axes, s.spins, node * h, s.x, s.v)
        if node != instant:
            t = st.end_of_step(state, h) if node == 1.0 else state.numbers[st.TIME] + node * h
            evaluate_times(plan, t, work.time)
            instant = node
        if plan.flag[0] != 0:
            return np.inf
        drive(plan, work, s.x, s.v, s.a)
        if end and not uses_end and not fixed:
            ratio = _error(plan, work, aw, loops, quaternions, tableau, state, groups, s, h, rate)
            if not ratio <= 1.0:
                return ratio
        for attempt in range(2):
            if plan.rows.shape[0] > 0 and (end or attempt == 1):
                closed = project(plan, work, aw, plain, quaternions, state, groups, loops, rate, s.x, s.v)
                if end and not closed:
                    return np.inf
            accelerate(plan, work, aw, loops, s.x, s.v, s.a, s.multipliers)
            state.counts[st.EVALUATIONS] += 1
            if end or plan.rows.shape[0] == 0 or not is_nearly_singular(loops):
                break
        for k in range(s.v.shape[0]):
            s.rate_x[i, k] = s.v[k]
            s.rate_v[i, k] = s.a[k]
        slow_rates(quaternions, s.axes, s.spins, s.rate_x[i], s.rate_v[i])
        if quaternions.shape[0] > 0:
            turn_rates(quaternions, way, s.u, s.rate_x[i])
    if uses_end and not fixed:
        ratio = _error(plan, work, aw, loops, quaternions, tableau, state, groups, s, h, rate)
    return ratio if _finite(s) else np.inf


@entry_kernel
def advance(plan, work, aw, loops, plain, quaternions, way, tableau, state, groups, s, record):
    """Step until the end, a full record, or a failure.

    Returns a code of ``state``: DONE, OUTPUT, CALLBACK_FAILED, STEP_FLOOR or NOT_FINITE (the step
    STEP at TIME, worst velocity WORST).
    """
    number = state.numbers
    count = state.counts
    exponent = 8.0 if tableau.a.shape[1] > 7 else 5.0
    exponent = 1.0 / exponent
    while number[st.TIME] < number[st.TIME_END]:
        if count[st.STORED] == record.t.shape[0]:
            return st.OUTPUT
        h = number[st.STEP]
        rate = st.machine_rate(state, groups)
        if count[st.FIXED_STEP] == 0:
            h = min(h, _LONGEST / rate)
        whole = h
        h = st.next_step(state, whole)
        ratio = _step(plan, work, aw, loops, plain, quaternions, way, tableau, state, groups, s, h, rate)
        if plan.flag[0] != 0:
            return st.CALLBACK_FAILED
        if not ratio <= 1.0:
            count[st.REJECTED] += 1
            if count[st.FIXED_STEP] == 1:
                return st.NOT_FINITE
            if h <= number[st.STEP_FLOOR_SIZE]:
                return st.STEP_FLOOR
            shrink = _SAFETY * ratio**-exponent if np.isfinite(ratio) else 0.0
            number[st.STEP] = h * max(_LEAST, shrink)
            count[WAS_REJECTED] = 1
            continue
        _accept(plan, state, groups, s, record, h)
        if plan.rows.shape[0] > 0:
            note_scales(loops)
        if count[st.FIXED_STEP] == 1:
            continue
        size = max(ratio, 1e-10)
        growth = _SAFETY * size ** (-_PROPORTIONAL * exponent) * number[RATIO_BEFORE] ** (_INTEGRAL * exponent)
        growth = min(max(growth, _LEAST), 1.0 if count[WAS_REJECTED] == 1 else _MOST)
        count[WAS_REJECTED] = 0
        number[RATIO_BEFORE] = max(ratio, 1e-4)
        number[st.STEP] = whole if h < whole else min(number[st.STEP_CEILING], h * growth)
    return st.DONE
