"""Generalized-alpha with bodies that have a history: one trial of their interiors in each of Newton's iterations.

The interiors solve for their own unknowns at the frames' trial motion and hand back wrenches and their derivatives by
the frames' displacements; with the frames' twists T per unit velocity the iteration matrix gains - T^T (dw/dx) T.
Each iteration is linearised anew.  A step that is not taken is reverted.

At the start, after a break and after a much shorter step there is no history for the auxiliary accelerations of the
machine and the interiors: such a step begins anew, see ``Scheme``.  So does a fixed step from an end of a short
stretch of data, for beyond it they go another way; with error control the steps there are as short as they must be.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import SceneError
from flexmbd.integrate import controller
from flexmbd.integrate import state as st
from flexmbd.integrate.alpha import step_history
from flexmbd.integrate.alpha.local_error import local_error
from flexmbd.integrate.alpha.matrix import linearise
from flexmbd.integrate.alpha.relation import begin_stage, take_weights
from flexmbd.integrate.alpha.step import correct, evaluate_step, predict, update_end
from flexmbd.integrate.alpha.workspace import AlphaWorkspace
from flexmbd.integrate.jumps import take_jump
from flexmbd.multibody.bodies.continuum_body import ContinuumBody, ImplicitInterior, IteratedInterior, Scheme
from flexmbd.multibody.interiors.scene_interiors import Interiors
from flexmbd.multibody.kernels.base.arrays import Plan, Work
from flexmbd.multibody.kernels.base.compiling import entry_kernel
from flexmbd.multibody.kernels.sampling.interface_frames import N_MOTION, store_motions

FloatArray = NDArray[np.float64]

_MAX_ITERATIONS = 20
_SLOW = 0.25  # a contraction above it asks interiors for tangents of their own
_STALLED = 1e-10  # a correction below which an iteration may stall: trials are solved to a tolerance of their own


@entry_kernel
def begin_step(rule, knots, state, groups, scratch):
    """The step to try (s) and the tolerance of Newton's iteration."""
    h = controller.propose_step(rule, knots, state, groups)
    return h, step_history.prepare_step(state, groups, scratch, h)


@entry_kernel
def predict_end(plan, work, state, scratch, h, anew):
    """Write the predictor; ``anew``: 1 for a step that begins anew."""
    if anew == 1:
        take_weights(scratch.relation, h, 0.0)
    begin_stage(plan, work, state, scratch, h, 0)
    predict(plan, state, scratch, h, True)


@entry_kernel
def place_end(plan, work, state, scratch, h, rows, motions):
    """Put the step's end where the unknowns say; write the motions (k, N_MOTION) of the frames in ``rows``."""
    update_end(plan, work, state, scratch, h, scratch.unknown)
    store_motions(plan, work, rows, scratch.x, scratch.v, scratch.a, motions)


@entry_kernel
def newton_iteration(plan, work, state, scratch, h):
    """One of Newton's iterations from the unknowns, with the wrenches that act: its correction's size, or NaN."""
    evaluate_step(plan, work, state, scratch, h, scratch.unknown, scratch.equation)
    state.counts[st.ITERATIONS] += 1
    if not linearise(plan, work, state, scratch, h):
        return np.nan
    size, unbalanced = correct(plan, state, scratch, h)
    return max(size, unbalanced)


@entry_kernel
def correction_beyond(plan, state, scratch, h, rounding):
    """The size of the correction by what of the last equations exceeds ``rounding``, that of the equations of motion.

    It is added to the unknowns, as ``correct`` does.
    """
    for j in range(rounding.shape[0]):
        excess = max(abs(scratch.equation[j]) - rounding[j], 0.0)
        scratch.equation[j] = excess if scratch.equation[j] > 0.0 else -excess
    size, unbalanced = correct(plan, state, scratch, h)
    return max(size, unbalanced)


@entry_kernel
def end_step(rule, plan, work, state, groups, scratch, record, h):
    """Accept or reject the step in ``scratch``, or its failure OUTCOME, by ``controller.accept_or_reject``."""
    if state.counts[st.OUTCOME] == st.DONE:
        ratio = 0.0
        if state.counts[st.FIXED_STEP] == 0:
            ratio = local_error(plan, work, state, groups, scratch, h, state.numbers[st.RATE])
            if not ratio <= 1.0 and take_jump(plan.free, state, groups, state.a, scratch.a, 1.0, h):
                ratio = 1.0
        state.numbers[st.ERROR_RATIO] = ratio
        if ratio <= 1.0:
            step_history.accept(state, scratch, h)
    return controller.accept_or_reject(plan, rule, state, groups, record, h)


class ImplicitInteriors:
    """Steps a machine and its interiors by generalized-alpha.

    Args:
        interiors: all of them ``ImplicitInterior``.
        scheme, rule: of the method.
        plan, work, state, groups, scratch: the machine.
    """

    def __init__(
        self, interiors: Interiors, scheme: Scheme, rule: controller.Rule, plan: Plan, work: Work, state: st.State,
        groups: st.Groups, scratch: AlphaWorkspace,
    ) -> None:
        self._interiors, self._scheme, self._rule = interiors, scheme, rule
        self._plan, self._work, self._state, self._groups, self._scratch = plan, work, state, groups, scratch
        self._rows = interiors.rows
        self._motions = np.zeros((len(self._rows), N_MOTION))
        self._rounding = np.zeros(len(plan.free))  # of the equations of motion, by that of the wrenches
        bodies = map(_implicit, interiors.bodies)
        self._iterated = [one if isinstance(one, IteratedInterior) else None for one in bodies]
        self._iterates = any(one is not None for one in self._iterated)

    def advance(self, record: st.Record, knots: FloatArray) -> int:
        """See ``controller.Stepper``."""
        number, count, memory = self._state.numbers, self._state.counts, self._scratch.memory
        machine = self._plan, self._work, self._state, self._groups, self._scratch
        while number[st.TIME] < number[st.TIME_END]:
            stored = int(count[st.STORED])
            if stored >= min(len(record.t), count[st.MOST_STORED]):
                return st.OUTPUT
            h, tolerance = begin_step(self._rule, knots, self._state, self._groups, self._scratch)
            k = int(count[st.KNOT])
            at_knot = k > 0 and knots[k - 1] == number[st.TIME] and count[st.FIXED_STEP] == 1
            scheme = self._scheme.begun_anew() if at_knot or memory.known_steps[0] == 0 else self._scheme
            failure = self._solve(h, tolerance, scheme)
            count[st.OUTCOME] = st.DONE if failure is None else failure
            if self._plan.flag[0] != 0:
                count[st.OUTCOME] = st.CALLBACK_FAILED
            code = int(end_step(self._rule, *machine, record, h))
            if count[st.STORED] == stored:
                self._revert()
            else:
                for body in self._interiors.bodies:
                    _implicit(body).commit()
                self._interiors.buffer.append(self._interiors.row(self._plan))
            if code != st.DONE or count[st.AT_BREAK] == 1:
                return code
        return st.DONE

    def _solve(self, h: float, tolerance: float, scheme: Scheme) -> int | None:
        """Newton's iteration; a code of ``state`` where it fails.  The interiors' last trial is at the step's end."""
        failure = self._iterate(h, tolerance, scheme, jointly=True)
        if failure is not None and self._state.counts[st.FIXED_STEP] == 1 and self._iterates:
            # there is no shorter step: the interiors solve for themselves, with searches along their corrections
            self._revert()
            self._interiors.failure.clear()
            failure = self._iterate(h, tolerance, scheme, jointly=False)
        return failure

    def _iterate(self, h: float, tolerance: float, scheme: Scheme, *, jointly: bool) -> int | None:
        plan, work, state, s = self._plan, self._work, self._state, self._scratch
        predict_end(plan, work, state, s, h, int(scheme.anew))
        before, slow = np.inf, False
        for _ in range(_MAX_ITERATIONS):
            place_end(plan, work, state, s, h, self._rows, self._motions)
            if plan.flag[0] != 0 or not np.isfinite(self._motions).all():
                return st.NOT_CONVERGED
            try:
                lacking = self._try_interiors(h, scheme, tolerance=tolerance, jointly=jointly, renew=slow)
            except SceneError as reason:
                self._interiors.failure.append(reason)
                return st.INTERIOR_FAILED
            size = max(float(newton_iteration(plan, work, state, s, h)), lacking)
            if size <= tolerance:
                return None
            if size > 0.5 * before and (size <= _STALLED or self._is_rounding(h, tolerance, lacking)):
                return None
            if not np.isfinite(size):
                break
            slow, before = size > _SLOW * before, size
        return st.NOT_CONVERGED

    def _is_rounding(self, h: float, tolerance: float, lacking: float) -> bool:
        """Whether what is left of the equations is no more than the rounding of wrenches, however short the step."""
        if lacking > tolerance or not self._rounding.any():
            return False
        unknown = self._scratch.unknown.copy()
        left = correction_beyond(self._plan, self._state, self._scratch, h, self._rounding)
        self._scratch.unknown[:] = unknown
        return float(left) <= tolerance

    def _try_interiors(self, h: float, scheme: Scheme, *, tolerance: float, jointly: bool, renew: bool) -> float:
        """Apply the interiors' wrenches at the frames' trial motion, and put their derivatives into the matrix.

        Returns:
            The largest correction that an interior lacks.
        """
        plan, scratch, t = self._plan, self._scratch, float(self._state.numbers[st.TIME])
        motions = self._interiors.split_motions(self._motions)

        def answer(k: int, body: ContinuumBody) -> Sequence[FloatArray]:
            iterated = self._iterated[k]
            if jointly and iterated is not None:
                found = iterated.iterate(t + h, h, scheme, motions[k], tolerance=tolerance, renew=renew)
                return found.wrenches, found.slopes, np.array(found.correction), np.array(found.rounding)
            return *_implicit(body).trial(t + h, h, scheme, motions[k]), np.array(0.0), np.array(0.0)

        answers = self._interiors.evaluate(answer, doing=f"in the step from t = {t:.6g} s to {t + h:.6g} s")
        self._interiors.apply_wrenches(plan, np.concatenate([wrenches.reshape(-1, 6) for wrenches, *_ in answers]))
        twists = self._interiors.twists(plan, self._work, scratch.x)[:, plan.free]
        scratch.interior_stiffness[:] = self._rounding[:] = 0.0
        first = 0
        for wrenches, slopes, _, rounding in answers:
            part = twists[first : first + len(slopes)]
            scratch.interior_stiffness[:] -= part.T @ slopes @ part
            self._rounding += abs(part).T @ np.broadcast_to(rounding, wrenches.shape).reshape(-1)
            first += len(slopes)
        return max(float(correction) for _, _, correction, _ in answers)

    def _revert(self) -> None:
        """Revert the interiors' trials."""
        for body in self._interiors.bodies:
            _implicit(body).revert()


def _implicit(body: ContinuumBody) -> ImplicitInterior:
    """The body's interior, which ``GeneralizedAlpha.check`` found to be one that solves for a step's end."""
    interior: ImplicitInterior = body.interior  # type: ignore[assignment]
    return interior
