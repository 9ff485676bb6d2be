"""Central differences with bodies that have a history: the machine and the interiors step side by side.

Where the machine's positions at a step's end are known, which needs no force of the step, the interiors step towards
them; the wrenches that they reach there act in the machine's accelerations at the end.  So both take the same
trapezoidal impulse, and linear momentum is kept to round-off.  Where interiors take several steps meanwhile, the mean
of their wrenches takes the place of that of both ends.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import SceneError
from flexmbd.integrate import controller
from flexmbd.integrate import state as st
from flexmbd.integrate.explicit.central_step import CentralDifferenceMethod, attempt, predict
from flexmbd.integrate.explicit.loop_dynamics import accelerate
from flexmbd.multibody.bodies.continuum_body import ContinuumBody, ExplicitInterior, FrameMotion
from flexmbd.multibody.interiors.scene_interiors import Interiors
from flexmbd.multibody.interiors.touching_interior import PairedInterior
from flexmbd.multibody.kernels.base.compiling import entry_kernel
from flexmbd.multibody.kernels.sampling.interface_frames import N_MOTION, store_motions

FloatArray = NDArray[np.float64]

#: The step taken without a given h, as a share of the shortest stable one, which is computed every so many steps.
SHARE = 0.9
_RENEWAL = 10


@entry_kernel
def predict_frames(plan, work, plain, quaternions, corrected, rows, state, scratch, h, start, end):
    """Motions (k, N_MOTION) of the frames in ``rows`` at the step's start and, as far as predicted, at its end."""
    store_motions(plan, work, rows, state.x, state.v, state.a, start)
    for k in range(scratch.a.shape[0]):
        scratch.a[k] = state.a[k]
    predict(plan, work, plain, quaternions, corrected, state, scratch, h)
    store_motions(plan, work, rows, scratch.x, scratch.v, scratch.a, end)


@entry_kernel
def propose_step(rule, knots, state, groups):
    """The step to take, by the controller."""
    return controller.propose_step(rule, knots, state, groups)


@entry_kernel
def step_machine(method, rule, state, groups, record, h):
    """Take and store the step h of the machine with the wrenches at hand; it is not repeated; its code."""
    attempt(method, state, groups, h)
    if state.counts[st.OUTCOME] == st.DONE and not state.numbers[st.ERROR_RATIO] <= 1.0:
        state.counts[st.OUTCOME] = st.NOT_FINITE
    if state.counts[st.OUTCOME] != st.DONE:
        return state.counts[st.OUTCOME]
    return controller.accept_or_reject(method.plan, rule, state, groups, record, h)


@entry_kernel
def accelerate_again(plan, work, aw, loops, state):
    """Accelerations and multipliers at the state, with the wrenches that act now."""
    accelerate(plan, work, aw, loops, state.x, state.v, state.a, state.multipliers)


class ExplicitInteriors:
    """Steps a machine and its interiors by central differences.

    All steps are fixed ones, which cannot be tried again: of the length given, or of a share of the interiors' stable
    one, which is computed every few steps.

    Args:
        interiors: all of them ``ExplicitInterior``.
        method: arguments of an attempt of the machine.
        rule: how steps follow each other.
        state, groups: where it stands.
        subcycle: whether an interior divides a step that is longer than its stable one.
    """

    def __init__(
        self, interiors: Interiors, method: CentralDifferenceMethod, rule: controller.Rule, state: st.State,
        groups: st.Groups, *, subcycle: bool,
    ) -> None:
        self._interiors = interiors
        self._method, self._rule, self._state, self._groups = method, rule, state, groups
        self._plan, self._work = method.plan, method.work
        self._subcycle = subcycle
        self._paired = {id(one.body) for one in interiors.placed if one.is_paired}
        self._rows = interiors.rows
        self._motions = np.zeros((2, len(self._rows), N_MOTION))

    def advance(self, record: st.Record, knots: FloatArray) -> int:
        """See ``controller.Stepper``."""
        number, count = self._state.numbers, self._state.counts
        fixed, room = bool(count[st.FIXED_STEP]), int(count[st.MOST_STORED])
        code = st.DONE
        count[st.FIXED_STEP] = 1
        try:
            while code == st.DONE and number[st.TIME] < number[st.TIME_END]:
                if count[st.STORED] == min(len(record.t), room):
                    code = st.OUTPUT
                else:
                    if count[st.STEPS] % _RENEWAL == 0:
                        self._choose_step(fixed)
                    code = self._step(record, knots)
                    if not fixed:
                        number[st.STEP_REMAINDER] = 0.0
        except SceneError as reason:
            self._interiors.failure.append(reason)
            return st.INTERIOR_FAILED
        finally:
            count[st.FIXED_STEP] = fixed
        return code

    def choose_step(self) -> None:
        """Set the first step from the interiors' stable ones; raises SceneError as ``_choose_step``."""
        self._choose_step(bool(self._state.counts[st.FIXED_STEP]))

    def _choose_step(self, fixed: bool) -> None:
        """Set the step from the interiors' stable ones.

        Raises:
            SceneError: a given step is longer; or an interior failed to compute it.
        """
        number = self._state.numbers
        answers = self._interiors.evaluate(
            lambda k, body: (np.array(_explicit(body).stable_step()),), doing="to compute its stable step"
        )
        limits = [float(answer) for (answer,) in answers]
        limit = min(limits)
        if not fixed:
            number[st.STEP] = SHARE * limit
        elif number[st.STEP] > limit and not self._subcycle:
            raise SceneError(
                f"the step h = {number[st.STEP]:.4g} s is above the stable step at t = {number[st.TIME]:.6g} s of body "
                f"{self._interiors.bodies[limits.index(limit)].name!r}, {limit:.4g} s; take a smaller h, none (then "
                "the step follows the body's), or fm.CentralDifference(subcycle=True)"
            )

    def _plan_body(self, body: ContinuumBody, h: float, start: FrameMotion, end: FrameMotion) -> tuple[FloatArray, ...]:
        """Let a body that touches another one say where it will be."""
        if isinstance(body.interior, PairedInterior) and id(body) in self._paired:
            body.interior.plan(h, start, end)
        return ()

    def _step(self, record: st.Record, knots: FloatArray) -> int:
        """One step: the interiors towards the predicted positions, then the machine with their wrenches."""
        plan, state, groups, interiors = self._plan, self._state, self._groups, self._interiors
        method = self._method
        before = interiors.applied_wrenches(plan)
        h = float(propose_step(self._rule, knots, state, groups))
        slots = method.plain, method.quaternions, method.corrected, self._rows
        first, last = self._motions
        predict_frames(plan, self._work, *slots, state, method.scratch, h, first, last)
        starts, ends = (interiors.split_motions(part) for part in self._motions)
        if self._paired:
            interiors.evaluate(
                lambda k, body: self._plan_body(body, h, starts[k], ends[k]),
                doing=f"at the beginning of the step from t = {state.numbers[st.TIME]:.6g} s",
            )
        answers = interiors.evaluate(
            lambda k, body: _explicit(body).advance(h, starts[k], ends[k]),
            doing=f"in the step from t = {state.numbers[st.TIME]:.6g} s to {state.numbers[st.STEP_END]:.6g} s",
        )
        wrenches, mean = (np.concatenate([answer[k].reshape(-1, 6) for answer in answers]) for k in range(2))
        interiors.apply_wrenches(plan, 2.0 * mean - before if self._subcycle else wrenches)
        code = int(step_machine(method, self._rule, state, groups, record, h))
        if code != st.DONE:
            return code
        if self._subcycle:
            interiors.apply_wrenches(plan, wrenches)
            accelerate_again(plan, self._work, method.aw, method.loops, state)
            record.a[state.counts[st.STORED] - 1] = state.a
            record.multipliers[state.counts[st.STORED] - 1] = state.multipliers
        interiors.buffer.append(interiors.row(plan))
        return code


def _explicit(body: ContinuumBody) -> ExplicitInterior:
    """The body's interior, which ``CentralDifference.check`` found to be one that steps explicitly."""
    interior: ExplicitInterior = body.interior  # type: ignore[assignment]
    return interior
