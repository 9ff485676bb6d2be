"""Generalized-alpha with bodies that have a history: one trial of their interiors in each of Newton's iterations.

The interiors solve for their own unknowns at the frames' trial motion and hand back wrenches and their derivatives by
the frames' displacements; with the frames' twists T per unit velocity the iteration matrix gains - T^T (dw/dx) T.
Each iteration is linearised anew.  A step that is not taken is reverted.
"""

from __future__ import annotations

import numpy as np

from flexmbd.errors import SceneError
from flexmbd.integrate import alpha_layout as step
from flexmbd.integrate import alpha_memory as memory
from flexmbd.integrate import state as st
from flexmbd.integrate.alpha_layout import Scratch
from flexmbd.integrate.alpha_matrix import linearise
from flexmbd.integrate.alpha_step import correct, start_newton, trial, update
from flexmbd.integrate.local_error import local_error
from flexmbd.multibody.continuum_body import ContinuumBody, ImplicitInterior, Scheme
from flexmbd.multibody.interiors import Interiors
from flexmbd.multibody.kernels.compiling import entry_kernel
from flexmbd.multibody.kernels.interface_frames import N_MOTION, store_motions
from flexmbd.multibody.kernels.layout import Plan, Work

_MAX_ITERATIONS = 20
_STALLED = 1e-10  # a correction below which an iteration may stall: interiors are solved to a tolerance of their own


@entry_kernel
def set_out(plan, work, state, groups, s):
    """``alpha_memory.set_out``, and the first guess."""
    h, whole, rate, aim = memory.set_out(plan, work, state, groups, s)
    start_newton(plan, state, s, h, True)
    return h, whole, rate, aim


@entry_kernel
def place(plan, work, state, s, h, rows, motions):
    """Put the step's end where the unknowns say, and tell the motions (k, N_MOTION) of the frames in ``rows``."""
    update(plan, work, state, s, h, s.unknown)
    store_motions(plan, work, rows, s.x, s.v, s.a, motions)


@entry_kernel
def iterate(plan, work, state, s, h):
    """One of Newton's iterations from the unknowns, with the wrenches that act: its correction's size, or NaN."""
    trial(plan, work, state, s, h, s.unknown, s.equation)
    state.counts[st.ITERATIONS] += 1
    if not linearise(plan, work, state, s, h):
        return np.nan
    return correct(plan, state, s, h)


@entry_kernel
def judge(plan, work, state, groups, s, h, whole, rate):
    """What becomes of the step that ``s`` holds, by its error; sets the next."""
    return memory.judge(state, local_error(plan, work, state, groups, s, h, rate), h, whole)


@entry_kernel
def accept(plan, state, groups, s, record, h):
    """Make the step that ``s`` holds the current state and write a row of the record."""
    memory.accept(plan, state, groups, s, record, h)


class ImplicitInteriors:
    """Steps a machine and its interiors by generalized-alpha.

    Args:
        interiors: all of them ``ImplicitInterior``.
        plan, work, state, groups, scratch: the machine.
    """

    def __init__(
        self, interiors: Interiors, plan: Plan, work: Work, state: st.State, groups: st.Groups, scratch: Scratch
    ) -> None:
        self._interiors = interiors
        self._plan, self._work, self._state, self._groups, self._scratch = plan, work, state, groups, scratch
        self._scheme = Scheme(*(float(c) for c in state.numbers[step.ALPHA_M : step.GAMMA + 1]))
        self._rows = interiors.rows
        self._motions = np.zeros((len(self._rows), N_MOTION))

    def advance_to(self, record: st.Record) -> int:
        """Step until the end, a full record, or a failure; see ``integrate.protocol.Stepper``."""
        number, count = self._state.numbers, self._state.counts
        machine = self._plan, self._work, self._state, self._groups, self._scratch
        fixed = count[st.FIXED_STEP] == 1
        while number[st.TIME] < number[st.TIME_END]:
            if count[st.STORED] == len(record.t):
                return st.OUTPUT
            h, whole, rate, aim = set_out(*machine)
            failure = self._solve(h, aim)
            if self._plan.flag[0] != 0:
                self._revert()
                return st.CALLBACK_FAILED
            if failure is not None:
                self._revert()
                count[st.REJECTED] += 1
                if fixed or h <= number[st.STEP_FLOOR_SIZE]:
                    return failure if fixed or failure == st.INTERIOR_FAILED else st.STEP_FLOOR
                number[st.STEP] = 0.25 * h
                continue
            verdict = memory.KEEP if fixed else judge(*machine, h, whole, rate)
            if verdict != memory.KEEP:
                self._revert()
                if verdict == memory.FLOOR:
                    return st.STEP_FLOOR
                continue
            for body in self._interiors.bodies:
                _implicit(body).commit()
            accept(self._plan, self._state, self._groups, self._scratch, record, h)
            self._interiors.buffer.append(self._interiors.row(self._plan))
        return st.DONE

    def _solve(self, h: float, aim: float) -> int | None:
        """Newton's iteration; a code of ``state`` where it fails.  The interiors' last trial is at the step's end."""
        plan, work, state, s = self._plan, self._work, self._state, self._scratch
        before = np.inf
        for _ in range(_MAX_ITERATIONS):
            place(plan, work, state, s, h, self._rows, self._motions)
            if plan.flag[0] != 0 or not np.isfinite(self._motions).all():
                return st.NEWTON_FAILED
            try:
                self._try_interiors(h)
            except SceneError as reason:
                self._interiors.failure.append(reason)
                return st.INTERIOR_FAILED
            size = float(iterate(plan, work, state, s, h))
            if size <= aim or (size <= _STALLED and size > 0.5 * before):
                return None
            if not np.isfinite(size):
                break
            before = size
        return st.NEWTON_FAILED

    def _try_interiors(self, h: float) -> None:
        """Let the interiors' wrenches at the frames' trial motion act, and put their slopes into the matrix."""
        plan, s, t = self._plan, self._scratch, float(self._state.numbers[st.TIME])
        motions = self._interiors.split_motions(self._motions)
        answers = self._interiors.ask(
            lambda k, body: _implicit(body).trial(t + h, h, self._scheme, motions[k]),
            doing=f"in the step from t = {t:.6g} s to {t + h:.6g} s",
        )
        self._interiors.put(plan, np.concatenate([wrenches.reshape(-1, 6) for wrenches, _ in answers]))
        twists = self._interiors.twists(plan, self._work, s.x)[:, plan.free]
        s.added[:] = 0.0
        first = 0
        for _, slopes in answers:
            part = twists[first : first + len(slopes)]
            s.added[:] -= part.T @ slopes @ part
            first += len(slopes)

    def _revert(self) -> None:
        """Let the interiors forget their trials."""
        for body in self._interiors.bodies:
            _implicit(body).revert()


def _implicit(body: ContinuumBody) -> ImplicitInterior:
    """The body's interior, which ``GeneralizedAlpha.check`` found to be one that solves for a step's end."""
    interior: ImplicitInterior = body.interior  # type: ignore[assignment]
    return interior
