"""Central differences with bodies that have a history: the machine and the interiors step side by side.

Where the machine's positions at a step's end are known, which needs no force of the step, the interiors step towards
them; the wrenches that they reach there act in the machine's accelerations at the end.  So both take the same
trapezoidal impulse, and linear momentum is kept to round-off.  Where interiors take several steps meanwhile, the mean
of their wrenches takes the place of that of both ends.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import SceneError
from flexmbd.integrate import state as st
from flexmbd.integrate.central_step import Scratch, advance, foretell
from flexmbd.integrate.loop_dynamics import accelerate
from flexmbd.multibody.continuum_body import ContinuumBody, ExplicitInterior
from flexmbd.multibody.interiors import Interiors
from flexmbd.multibody.kernels.compiling import entry_kernel
from flexmbd.multibody.kernels.interface_frames import N_MOTION, store_motions

FloatArray = NDArray[np.float64]

#: The step taken without a given h, as a share of the shortest stable one; asked for anew every so many steps.
SHARE = 0.9
_RENEWAL = 10


@entry_kernel
def foretell_frames(plan, work, plain, quaternions, rows, state, s, h, start, end):
    """Motions (k, N_MOTION) of the frames in ``rows`` at the step's start and, as far as known, at its end."""
    store_motions(plan, work, rows, state.x, state.v, state.a, start)
    for k in range(s.a.shape[0]):
        s.a[k] = state.a[k]
    foretell(plan, work, plain, quaternions, state, s, h)
    store_motions(plan, work, rows, s.x, s.v, s.a, end)


@entry_kernel
def accelerate_anew(plan, work, aw, loops, state):
    """Accelerations and multipliers at the state, with the wrenches that act now."""
    accelerate(plan, work, aw, loops, state.x, state.v, state.a, state.multipliers)


class ExplicitInteriors:
    """Steps a machine and its interiors by central differences.

    Args:
        interiors: all of them ``ExplicitInterior``.
        parts: what ``central_step.advance`` takes before the state.
        state, groups, scratch: as there.
        subcycle: whether a step longer than an interior's stable one is the interior's affair.
    """

    def __init__(
        self, interiors: Interiors, parts: tuple[Any, ...], state: st.State, groups: st.Groups, scratch: Scratch,
        *, subcycle: bool,
    ) -> None:
        self._interiors = interiors
        self._plan, self._work, self._articulated, self._loops, self._plain, self._quaternions = parts
        self._parts = parts
        self._state, self._groups, self._scratch = state, groups, scratch
        self._subcycle = subcycle
        self._rows = interiors.rows
        self._motions = np.zeros((2, len(self._rows), N_MOTION))
        if state.counts[st.STEPS] == 0:
            self._choose_step(bool(state.counts[st.FIXED_STEP]))

    def advance_to(self, record: st.Record) -> int:
        """Step until the end, a full record, or a failure; see ``integrate.protocol.Stepper``."""
        number, count = self._state.numbers, self._state.counts
        fixed, t_end = bool(count[st.FIXED_STEP]), float(number[st.TIME_END])
        code = st.DONE
        try:
            while code == st.DONE and number[st.TIME] < t_end:
                if count[st.STORED] == len(record.t):
                    code = st.OUTPUT
                else:
                    if count[st.STEPS] % _RENEWAL == 0:
                        self._choose_step(fixed)
                    code = self._step(record, t_end)
        except SceneError as reason:
            self._interiors.failure.append(reason)
            return st.INTERIOR_FAILED
        finally:
            count[st.FIXED_STEP], number[st.TIME_END] = fixed, t_end
        return code

    def _choose_step(self, fixed: bool) -> None:
        """Set the step from the interiors' stable ones.

        Raises:
            SceneError: a given step is longer; or an interior failed to tell.
        """
        number = self._state.numbers
        answers = self._interiors.ask(
            lambda k, body: (np.array(_explicit(body).stable_step()),), doing="to tell its stable step"
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

    def _step(self, record: st.Record, t_end: float) -> int:
        """One step: the interiors towards the positions foretold, then the machine with what they push."""
        plan, state, interiors = self._plan, self._state, self._interiors
        number, t, h = state.numbers, float(state.numbers[st.TIME]), float(state.numbers[st.STEP])
        end = t_end if t_end - t <= h * (1.0 + 1e-6) else t + h
        h_taken = end - t
        before = interiors.acting(plan)
        number[st.TIME_END] = end
        slots = self._plain, self._quaternions, self._rows
        first, last = self._motions
        foretell_frames(plan, self._work, *slots, state, self._scratch, h_taken, first, last)
        starts, ends = (interiors.split_motions(part) for part in self._motions)
        answers = interiors.ask(
            lambda k, body: _explicit(body).advance(h_taken, starts[k], ends[k]),
            doing=f"in the step from t = {t:.6g} s to {end:.6g} s",
        )
        push, mean = (np.concatenate([answer[k].reshape(-1, 6) for answer in answers]) for k in range(2))
        interiors.put(plan, 2.0 * mean - before if self._subcycle else push)
        state.counts[st.FIXED_STEP] = 1
        code = int(advance(*(*self._parts, state, self._groups, self._scratch, record)))
        if code != st.DONE:
            return code
        if self._subcycle:
            interiors.put(plan, push)
            accelerate_anew(plan, self._work, self._articulated, self._loops, state)
            record.a[state.counts[st.STORED] - 1] = state.a
            record.multipliers[state.counts[st.STORED] - 1] = state.multipliers
        interiors.buffer.append(interiors.row(plan))
        return code


def _explicit(body: ContinuumBody) -> ExplicitInterior:
    """The body's interior, which ``CentralDifference.check`` found to be one that steps explicitly."""
    interior: ExplicitInterior = body.interior  # type: ignore[assignment]
    return interior
