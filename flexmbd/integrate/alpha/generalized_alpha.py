"""Lie-group generalized-alpha for trees and, in stabilised index-2 or in index-3 form, for closed loops.

Order 2; dissipation at high frequency set by the spectral radius rho.  Variable steps keep the
order because the auxiliary acceleration is carried over at its own instant.  Sources: Chung &
Hulbert 1993; Bruels, Cardona & Arnold 2012 (Lie group); Arnold & Hante 2017 (stabilised
index-2 form).
"""

from __future__ import annotations

from dataclasses import dataclass

from flexmbd.errors import SceneError
from flexmbd.given import checked
from flexmbd.integrate import state as st
from flexmbd.integrate.alpha import workspace as step
from flexmbd.integrate.alpha.augmented import solve_passes
from flexmbd.integrate.alpha.interiors import ImplicitInteriors
from flexmbd.integrate.alpha.local_error import local_error
from flexmbd.integrate.alpha.step_history import accept, prepare_step
from flexmbd.integrate.alpha.workspace import AlphaWorkspace, new_workspace
from flexmbd.integrate.controller import Rule, Stepper, make_advance, next_step
from flexmbd.integrate.interior_support import refuse_explicit_only, refuse_passes
from flexmbd.integrate.jumps import take_jump
from flexmbd.multibody.bodies.continuum_body import Scheme
from flexmbd.multibody.kernels.base.array_struct import ArrayStruct
from flexmbd.multibody.kernels.base.arrays import Plan, Work
from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel
from flexmbd.multibody.kernels.base.deferred import deferred_kernel
from flexmbd.multibody.plan.compiled_scene import CompiledScene

ORDER = 2

#: How its steps follow from their errors: they change seldom, for each change costs a factorisation.
RULE = Rule(exponent=0.5, shortest=1.0 / 64.0)


@dataclass(frozen=True, eq=False)
class AlphaMethod(ArrayStruct):
    """Arguments of an attempt."""

    plan: Plan
    work: Work
    scratch: AlphaWorkspace


@checked()
@dataclass(frozen=True)
class GeneralizedAlpha:
    """Choice of the method.

    Attributes:
        rho: the spectral radius at infinite frequency, in [0, 1]: 1 does not dissipate, smaller values damp what the
            step does not resolve.
        index: 2 closes loops at the level of positions and of velocities, 3 at that of positions alone, with fixed
            steps only.

    Raises:
        SceneError: rho lies outside, or there is no such index.
    """

    rho: float = 0.8
    index: int = 2

    def __post_init__(self) -> None:
        if not 0.0 <= self.rho <= 1.0:
            raise SceneError(f"rho must lie between 0 and 1, got {self.rho}")
        if self.index not in (2, 3):
            raise SceneError(f"generalized-alpha has an index of 2 or 3, got {self.index}")

    @property
    def name(self) -> str:
        """How ``explain`` calls the method."""
        form = ", index 3" if self.index == 3 else ""
        return f"generalized-alpha, rho = {self.rho:g}, order {ORDER}{form}"

    @property
    def order(self) -> int:
        """Order of positions, velocities and multipliers."""
        return ORDER

    def check(self, scene: CompiledScene) -> None:
        """Runs every scene, but that bodies with history must solve for a step's end, with no augmented Lagrangian."""
        refuse_explicit_only(scene, self.name)
        refuse_passes(scene, self.name)

    def stepper(self, scene: CompiledScene, state: st.State, groups: st.Groups, work: Work) -> Stepper:
        """See ``integrate.protocol.Integrator``.

        Raises:
            SceneError: error control is asked of index 3, whose velocities jump with the step.
        """
        if self.index == 3 and state.counts[st.FIXED_STEP] == 0 and len(scene.plan.rows) > 0:
            raise SceneError("generalized-alpha of index 3 has no error control: give a step h, or take index=2")
        interiors = scene.interiors
        scratch = new_workspace(scene.plan, work, scene.nx, scene.nv, interiors=interiors is not None)
        memory = scratch.memory

        def drop_factors() -> None:
            memory.step_factored[0] = 0.0

        def begin() -> None:
            drop_factors()
            memory.index[0] = self.index
            memory.scheme[:] = self.coefficients()
            memory.filters[0] = len(scene.plan.flex) > 0 or interiors is not None
            for part in (memory.auxiliary, memory.before, memory.earlier, memory.earliest):
                part[:] = state.a

        drop_factors()
        if interiors is not None:
            scheme = Scheme(*self.coefficients())
            machine = ImplicitInteriors(interiors, scheme, RULE, scene.plan, work, state, groups, scratch)
            return Stepper(machine.advance, begin, drop_factors, memory)
        method = AlphaMethod(scene.plan, work, scratch)
        return Stepper(make_advance(advance, method, RULE, state, groups), begin, drop_factors, memory)

    def coefficients(self) -> tuple[float, float, float, float]:
        """alpha_m, alpha_f, beta, gamma (Chung & Hulbert 1993, eq. 17, 20, 25)."""
        alpha_m = (2.0 * self.rho - 1.0) / (self.rho + 1.0)
        alpha_f = self.rho / (self.rho + 1.0)
        gamma = 0.5 + alpha_f - alpha_m
        return alpha_m, alpha_f, 0.25 * (gamma + 0.5) ** 2, gamma


@kernel
def _start_auxiliary(plan, work, state, groups, scratch, h, tolerance):
    """Give the first step the auxiliary acceleration of its own instant, for full order.

    It belongs alpha_m - alpha_f steps after the true one and follows from the trial's slope.
    """
    delay = scratch.memory.scheme[step.ALPHA_M] - scratch.memory.scheme[step.ALPHA_F]
    for _ in range(2):
        for k in range(state.a.shape[0]):
            scratch.memory.auxiliary[k] = state.a[k] + delay * (scratch.a[k] - state.a[k])
        if not solve_passes(plan, work, state, scratch, h, tolerance):
            return False
    return True


@kernel
def _attempt(method, state, groups, h):
    """An attempt at a step, see ``controller``."""
    plan = method.plan
    work = method.work
    scratch = method.scratch
    count = state.counts
    tolerance = prepare_step(plan, work, state, groups, scratch, h)
    solved = solve_passes(plan, work, state, scratch, h, tolerance)
    if solved and scratch.memory.known_steps[0] == 0:
        solved = _start_auxiliary(plan, work, state, groups, scratch, h, tolerance)
    if plan.flag[0] != 0:
        count[st.OUTCOME] = st.CALLBACK_FAILED
    elif solved:
        count[st.OUTCOME] = st.DONE  # whatever failed on the way
        ratio = 0.0
        if count[st.FIXED_STEP] == 0:
            ratio = local_error(plan, work, state, groups, scratch, h, state.numbers[st.RATE])
        state.numbers[st.ERROR_RATIO] = ratio
        if ratio <= 1.0:
            accept(state, scratch, h)
    elif count[st.OUTCOME] == st.DONE:
        count[st.OUTCOME] = st.NOT_CONVERGED


@deferred_kernel()
def _pass_jump(method, state, groups, h):
    """Accept an attempt whose error is too large where it passes a jump (see ``jumps``)."""
    scratch = method.scratch
    if take_jump(method.plan.free, state, groups, state.a, scratch.a, 1.0, h):
        state.numbers[st.ERROR_RATIO] = 1.0
        accept(state, scratch, h)


@entry_kernel
def advance(method, rule, knots, state, groups, record):
    """Step until the end, a full record, or a failure; see ``controller``."""
    h = 0.0
    while True:
        h = next_step(method.plan, rule, knots, state, groups, record, h)
        if h == 0.0:
            return state.counts[st.OUTCOME]
        _attempt(method, state, groups, h)
        if not state.numbers[st.ERROR_RATIO] <= 1.0:
            _pass_jump(method, state, groups, h)
