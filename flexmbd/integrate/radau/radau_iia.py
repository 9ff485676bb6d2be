"""Radau IIA of order 5 on the manifold, with error control and reuse of the iteration matrices.

Three stages, stiffly accurate; positions, velocities, and the accelerations and multipliers recorded at the step's
end are of order 5.  Sources: Hairer & Wanner 1996, section IV.8 (transformed Newton, error estimate, step control);
Gear, Leimkuhler & Gupta 1985 (stabilised index 2); Hairer, Lubich & Roche 1989 (its order).
"""

from __future__ import annotations

from dataclasses import dataclass

from flexmbd.integrate import state as st
from flexmbd.integrate.controller import Rule, Stepper, make_advance, next_step, settle
from flexmbd.integrate.interior_support import refuse_interiors
from flexmbd.integrate.jumps import put_widest, take_jump
from flexmbd.integrate.radau.coefficients import ORDER, STAGES
from flexmbd.integrate.radau.error import (
    bound_next_step,
    local_error,
    remember_roughness,
    set_safety,
    widen_vibration_scales,
)
from flexmbd.integrate.radau.newton import solve_step
from flexmbd.integrate.radau.stages import evaluate_stage_times
from flexmbd.integrate.radau.workspace import RadauWorkspace, new_workspace
from flexmbd.multibody.kernels.base.array_struct import ArrayStruct
from flexmbd.multibody.kernels.base.arrays import Plan, Work
from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel
from flexmbd.multibody.kernels.base.native import complex_lapack_addresses
from flexmbd.multibody.plan.compiled_scene import CompiledScene

_NEWTON_SHARE = 0.02  # Newton's error as a share of the step's tolerance
# The loosest rtol for Newton's iteration in loops: accelerations at their steps' ends follow from forces, in which
# stiff parts multiply what the iteration leaves; it would pass for motion and shorten the steps.
_LOOSEST = 1e-6
# The ratio to the power 3/2 goes with the step's fifth power.  Some room below the longest step: the rate may grow,
# and each change costs factors.
_RULE = Rule(
    exponent=0.3, trend=1.0, least_before=1e-2, most=8.0, failed=0.4, tight=0.92, shrunk=1.0, hold=4, longest=1.0,
    room=0.8, shortest=1.0 / 64.0,
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class RadauMethod(ArrayStruct):
    """Arguments of an attempt."""

    plan: Plan
    work: Work
    scratch: RadauWorkspace


@dataclass(frozen=True)
class RadauIIA:
    """Choice of the method: order 5, stiffly accurate, for smooth motion to tight tolerance and for stiff machines.

    Vibrations faster than the step are damped out; to follow them, tighten rtol.
    """

    @property
    def name(self) -> str:
        """How ``explain`` calls the method."""
        return f"Radau IIA, order {ORDER}"

    @property
    def order(self) -> int:
        """Order of positions, velocities and multipliers."""
        return ORDER

    def check(self, scene: CompiledScene) -> None:
        """Runs every scene without bodies that have a history."""
        refuse_interiors(scene, self.name, why="it solves for several stages of a step at once")

    def stepper(self, scene: CompiledScene, state: st.State, groups: st.Groups, work: Work) -> Stepper:
        """See ``integrate.protocol.Integrator``."""
        scratch = new_workspace(scene.plan, work, scene.nx, scene.nv, lapack_complex=complex_lapack_addresses())
        memory = scratch.memory

        def drop_factors() -> None:
            memory.tangent_serves[0] = 0
            memory.step_factored[0] = 0.0

        drop_factors()
        method = RadauMethod(scene.plan, work, scratch)
        return Stepper(make_advance(advance, method, _RULE, state, groups), drop_factors, drop_factors, memory)


@kernel
def _accept(state, scratch, h):
    """Make the last stage the current state, and remember the stages."""
    end = STAGES - 1
    for i in range(STAGES):
        for k in range(state.v.shape[0]):
            scratch.memory.stage_a[i, k] = scratch.a[i, k]
        for r in range(state.multipliers.shape[0]):
            scratch.memory.stage_reactions[i, r] = scratch.multipliers[i, r]
    for k in range(state.v.shape[0]):
        state.v[k] = scratch.v[end, k]
        state.a[k] = scratch.a[end, k]
    for k in range(state.x.shape[0]):
        state.x[k] = scratch.x[end, k]
    for r in range(state.multipliers.shape[0]):
        state.multipliers[r] = scratch.multipliers[end, r]
    scratch.memory.step_polynomial[0] = h
    scratch.memory.polynomial_known[0] = 1


@kernel
def _attempt(method, state, groups, h):
    """An attempt at a step, see ``controller``."""
    plan = method.plan
    work = method.work
    s = method.scratch
    number = state.numbers
    count = state.counts
    rate = number[st.RATE]
    limit = max(number[st.TOLERANCE] * min(1.0, h * rate), st.ROUND_OFF)
    st.set_scales(state, groups, s, rate, limit)
    widen_vibration_scales(state, groups, s, h, rate)
    share = _NEWTON_SHARE
    if plan.rows.shape[0] > 0:
        share *= min(1.0, _LOOSEST / number[st.TOLERANCE])
    solved = False
    if evaluate_stage_times(plan, work, state, s, h):
        solved = solve_step(plan, work, state, s, h, max(share * limit, 5e-15))
    set_safety(state, s)
    if settle(plan, state, solved):
        ratio = 0.0 if count[st.FIXED_STEP] == 1 else local_error(plan, work, state, groups, s, h, rate)
        if not ratio <= 1.0:
            put_widest(state.a, s.a, s.residual)
            if take_jump(plan.free, state, groups, state.a, s.residual, 1.0, h):
                ratio = 1.0
        number[st.ERROR_RATIO] = ratio
        if ratio <= 1.0:
            _accept(state, s, h)
            if count[st.FIXED_STEP] == 0:
                remember_roughness(plan, state, groups, s, h)
                bound_next_step(plan, groups, s)


@entry_kernel
def advance(method, rule, knots, state, groups, record):
    """Step until the end, a full record, or a failure; see ``controller``."""
    h = 0.0
    while True:
        h = next_step(method.plan, rule, knots, state, groups, record, h)
        if h == 0.0:
            return state.counts[st.OUTCOME]
        _attempt(method, state, groups, h)
