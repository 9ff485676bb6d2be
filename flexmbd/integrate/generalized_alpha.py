"""Lie-group generalized-alpha for trees and, in stabilised index-2 or in index-3 form, for closed loops.

Order 2; dissipation at high frequency set by the spectral radius rho.  Variable steps keep the
order because the auxiliary acceleration is carried over at its own instant.  Sources: Chung &
Hulbert 1993; Bruels, Cardona & Arnold 2012 (Lie group); Arnold & Hante 2017 (stabilised
index-2 form).  The loop ``advance`` runs compiled until its record is full, returns a code, and is
re-entered.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from flexmbd.errors import SceneError
from flexmbd.integrate import alpha_layout as step
from flexmbd.integrate import state as st
from flexmbd.integrate.alpha_interiors import ImplicitInteriors
from flexmbd.integrate.alpha_layout import new_scratch
from flexmbd.integrate.alpha_memory import FLOOR, KEEP, accept, judge, set_out
from flexmbd.integrate.augmented import solve_passes
from flexmbd.integrate.history import refuse_explicit_only, refuse_passes
from flexmbd.integrate.local_error import local_error
from flexmbd.integrate.protocol import Stepper
from flexmbd.multibody.kernels.compiling import entry_kernel, part_of_kernel
from flexmbd.multibody.kernels.layout import Work
from flexmbd.multibody.plan import CompiledScene

ORDER = 2



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

    @property
    def memory_rows(self) -> int:
        """The method's acceleration, three true ones, and each coordinate's rate."""
        return step.N_MEMORY

    def check(self, scene: CompiledScene) -> None:
        """Runs every scene, but that bodies with history must solve for a step's end, with no augmented Lagrangian."""
        refuse_explicit_only(scene, self.name)
        refuse_passes(scene, self.name)

    def stepper(
        self, scene: CompiledScene, state: st.State, groups: st.Groups, work: Work
    ) -> tuple[Stepper, Callable[[], None]]:
        """See ``integrate.protocol.Integrator``.

        Raises:
            SceneError: error control is asked of index 3, whose velocities jump with the step.
        """
        if self.index == 3 and state.counts[st.FIXED_STEP] == 0 and len(scene.plan.rows) > 0:
            raise SceneError("generalized-alpha of index 3 has no error control: give a step h, or take index=2")
        if state.counts[st.STEPS] == 0:
            state.counts[step.INDEX] = self.index
            state.numbers[step.ALPHA_M : step.GAMMA + 1] = self.coefficients()
            state.counts[step.FILTERS] = len(scene.plan.flex) > 0 or scene.interiors is not None
            for row in (step.AUXILIARY, step.BEFORE, step.EARLIER, step.EARLIEST):
                state.memory[row] = state.a
        interiors = scene.interiors
        scratch = new_scratch(scene.plan, work, scene.nx, scene.nv, interiors=interiors is not None)

        def advance_to(record: st.Record) -> int:
            return int(advance(scene.plan, work, state, groups, scratch, record))

        def drop_factors() -> None:
            state.numbers[step.STEP_FACTORED] = 0.0

        drop_factors()
        if interiors is not None:
            stepper = ImplicitInteriors(interiors, scene.plan, work, state, groups, scratch)
            return stepper.advance_to, drop_factors
        return advance_to, drop_factors

    def coefficients(self) -> tuple[float, float, float, float]:
        """alpha_m, alpha_f, beta, gamma (Chung & Hulbert 1993, eq. 17, 20, 25)."""
        alpha_m = (2.0 * self.rho - 1.0) / (self.rho + 1.0)
        alpha_f = self.rho / (self.rho + 1.0)
        gamma = 0.5 + alpha_f - alpha_m
        return alpha_m, alpha_f, 0.25 * (gamma + 0.5) ** 2, gamma


@part_of_kernel
def _start_auxiliary(plan, work, state, groups, s, h, tolerance):
    """Give the first step the auxiliary acceleration of its own instant, for full order.

    It belongs alpha_m - alpha_f steps after the true one; the trial's slope tells its value.
    """
    delay = state.numbers[step.ALPHA_M] - state.numbers[step.ALPHA_F]
    for _ in range(2):
        for k in range(state.a.shape[0]):
            state.memory[step.AUXILIARY, k] = state.a[k] + delay * (s.a[k] - state.a[k])
        if not solve_passes(plan, work, state, s, h, tolerance):
            return False
    return True


@entry_kernel
def advance(plan, work, state, groups, s, record):
    """Step until the end, a full record, or a failure.

    Returns a code of ``state``: DONE, OUTPUT, CALLBACK_FAILED, STEP_FLOOR or NEWTON_FAILED (the
    step STEP at TIME, worst velocity WORST).
    """
    number = state.numbers
    count = state.counts
    while number[st.TIME] < number[st.TIME_END]:
        if count[st.STORED] == record.t.shape[0]:
            return st.OUTPUT
        h, whole, rate, aim = set_out(plan, work, state, groups, s)
        solved = solve_passes(plan, work, state, s, h, aim)
        if solved and count[step.KNOWN_BEFORE] == 0:
            solved = _start_auxiliary(plan, work, state, groups, s, h, aim)
        if plan.flag[0] != 0:
            return st.CALLBACK_FAILED
        if not solved:
            count[st.REJECTED] += 1
            if count[st.FIXED_STEP] == 1:
                return st.NEWTON_FAILED
            if h <= number[st.STEP_FLOOR_SIZE]:
                return st.STEP_FLOOR
            number[st.STEP] = 0.25 * h
            continue
        if count[st.FIXED_STEP] == 1:
            accept(plan, state, groups, s, record, h)
            continue
        verdict = judge(state, local_error(plan, work, state, groups, s, h, rate), h, whole)
        if verdict == FLOOR:
            return st.STEP_FLOOR
        if verdict == KEEP:
            accept(plan, state, groups, s, record, h)
    return st.DONE
