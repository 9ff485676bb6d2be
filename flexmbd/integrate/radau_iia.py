"""Radau IIA of order 5 on the manifold, with error control and reuse of the iteration matrices.

Three stages, stiffly accurate; positions, velocities, and the accelerations and multipliers recorded at the step's
end are of order 5.  Sources: Hairer & Wanner 1996, section IV.8 (transformed Newton, error estimate, step control);
Gear, Leimkuhler & Gupta 1985 (stabilised index 2); Hairer, Lubich & Roche 1989 (its order).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from flexmbd.integrate import state as st
from flexmbd.integrate.history import refuse_interiors
from flexmbd.integrate.protocol import Stepper
from flexmbd.integrate.radau_coefficients import ORDER, STAGES
from flexmbd.integrate.radau_error import local_error, step_growth, widen_scales
from flexmbd.integrate.radau_newton import solve_step
from flexmbd.integrate.radau_stages import (
    END,
    HOLD,
    N_MEMORY,
    POLYNOMIAL,
    RATIO_BEFORE,
    SOLVE_STEP,
    SOLVED,
    STAGE_A,
    STAGE_NU,
    STEP_ACCEPTED,
    STEP_FACTORED,
    STEP_POLYNOMIAL,
    TANGENT,
    evaluate_stage_times,
    new_scratch,
)
from flexmbd.multibody.kernels.compiling import entry_kernel, kernel
from flexmbd.multibody.kernels.layout import Work
from flexmbd.multibody.kernels.native import complex_lapack_addresses
from flexmbd.multibody.kernels.separate import address_of, call_separate
from flexmbd.multibody.plan import CompiledScene

_NEWTON_SHARE = 0.02  # Newton's error as a share of the step's tolerance
_LONGEST = 1.0  # the longest step in characteristic times of the machine
_WORTH = 1.25  # growth that is worth new factors
_HOLD = 4  # steps without growth after a rejection
_TIGHT = 0.92  # growth below which the step had better shrink: its safety is spent


@dataclass(frozen=True)
class RadauIIA:
    """Choice of the method: order 5, stiffly accurate, for smooth motion to tight tolerance and for stiff machines.

    What vibrates faster than the step is damped out; to follow it, tighten rtol.
    """

    @property
    def name(self) -> str:
        """How ``explain`` calls the method."""
        return f"Radau IIA, order {ORDER}"

    @property
    def order(self) -> int:
        """Order of positions, velocities and multipliers."""
        return ORDER

    @property
    def memory_rows(self) -> int:
        """Accelerations and multipliers of the last step's stages, and each coordinate's rate."""
        return N_MEMORY

    def check(self, scene: CompiledScene) -> None:
        """Runs every scene without bodies that have a history."""
        refuse_interiors(scene, self.name, why="it solves for several stages of a step at once")

    def stepper(
        self, scene: CompiledScene, state: st.State, groups: st.Groups, work: Work
    ) -> tuple[Stepper, Callable[[], None]]:
        """See ``integrate.protocol.Integrator``."""
        scratch = new_scratch(scene.plan, work, scene.nx, scene.nv, lapack_complex=complex_lapack_addresses())
        scratch.kernels[SOLVE_STEP] = address_of(solve_step, (scene.plan, work, state, scratch, 0.0, 0.0))

        def advance_to(record: st.Record) -> int:
            return int(advance(scene.plan, work, state, groups, scratch, record))

        def drop_factors() -> None:
            state.counts[TANGENT] = 0
            state.counts[END] = 0
            state.numbers[STEP_FACTORED] = 0.0

        drop_factors()
        return advance_to, drop_factors


@kernel
def _accept(plan, state, groups, s, record, h):
    """Make the last stage the current state, remember the stages, write a row of the record."""
    end = STAGES - 1
    for i in range(STAGES):
        for k in range(state.v.shape[0]):
            state.memory[STAGE_A + i, k] = s.a[i, k]
        for r in range(state.multipliers.shape[0]):
            state.memory[STAGE_NU + i, r] = s.multipliers[i, r]
    for k in range(state.v.shape[0]):
        state.v[k] = s.v[end, k]
        state.a[k] = s.a[end, k]
    for k in range(state.x.shape[0]):
        state.x[k] = s.x[end, k]
    for r in range(state.multipliers.shape[0]):
        state.multipliers[r] = s.multipliers[end, r]
    state.numbers[STEP_POLYNOMIAL] = h
    state.counts[POLYNOMIAL] = 1
    st.store(plan, state, groups, record, h)


@entry_kernel
def advance(plan, work, state, groups, s, record):
    """Step until the end, a full record, or a failure.

    Returns a code of ``state``: DONE, OUTPUT, CALLBACK_FAILED, STEP_FLOOR or NEWTON_FAILED (the
    step STEP at TIME, worst velocity WORST).
    """
    number = state.numbers
    count = state.counts
    fixed = count[st.FIXED_STEP] == 1
    while number[st.TIME] < number[st.TIME_END]:
        if count[st.STORED] == record.t.shape[0]:
            return st.OUTPUT
        rate = st.machine_rate(state, groups)
        if not fixed and number[st.STEP] * rate > _LONGEST:
            number[st.STEP] = 0.8 * _LONGEST / rate  # some room: the rate may grow, and each change costs factors
        whole = number[st.STEP]
        h = st.next_step(state, whole)
        limit = max(number[st.TOLERANCE] * min(1.0, h * rate), st.ROUND_OFF)
        st.set_scales(state, groups, s, rate, limit)
        widen_scales(state, s, h, rate)
        solved = evaluate_stage_times(plan, work, state, s, h)
        if solved:
            aim = max(_NEWTON_SHARE * limit, 5e-15)
            call_separate(s.kernels[SOLVE_STEP], (plan, work, state, s, h, aim))
            solved = count[SOLVED] == 1
        if plan.flag[0] != 0:
            return st.CALLBACK_FAILED
        ratio = local_error(plan, state, groups, s, h, rate) if solved and not fixed else 0.0
        if solved and ratio <= 1.0:
            _accept(plan, state, groups, s, record, h)
            if fixed:
                continue
            growth = step_growth(state, h, ratio)
            number[RATIO_BEFORE] = max(ratio, 1e-2)
            number[STEP_ACCEPTED] = h
            if h < whole:
                number[st.STEP] = whole  # it was cut short by the end alone
            elif growth > _WORTH and count[HOLD] == 0:
                number[st.STEP] = min(number[st.STEP_CEILING], h * growth)
            else:
                number[st.STEP] = h if growth > _TIGHT else h * growth
            count[HOLD] = max(0, count[HOLD] - 1)
            continue
        count[st.REJECTED] += 1
        count[HOLD] = _HOLD
        if solved:
            number[st.STEP] = h * step_growth(state, h, ratio)
        elif fixed:
            return st.NEWTON_FAILED
        else:
            number[st.STEP] = 0.4 * h
        if h <= number[st.STEP_FLOOR_SIZE]:
            return st.STEP_FLOOR
    return st.DONE
