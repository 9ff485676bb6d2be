"""Says once where fixed steps became too long for the machine, by the errors that the method estimates of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import StepsWarning, warn
from flexmbd.integrate import state as st
from flexmbd.integrate.explicit.step_errors import LARGEST, SPOILING, SUM, WHEN, WHOSE
from flexmbd.integrate.protocol import Integrator

FloatArray = NDArray[np.float64]

_STRETCH = 1000  # steps whose errors are added up
_GROSS = 0.01  # error of a single step that spoils the result by itself


class FixedStepWatch:
    """Looks at the errors of stretches of a run; ``names``: of the velocities."""

    def __init__(self, names: Sequence[str], state: st.State, method: Integrator) -> None:
        self._names, self._state, self._method = names, state, method.name
        self._before, self._steps, self._told = 0.0, 0, False

    def look(self, errors: FloatArray | None) -> None:
        """Look at the errors, see ``explicit/step_errors``, of all steps so far; None: the method estimates none.

        Warns:
            StepsWarning: those of a stretch add up to a tenth of the machine's sizes, or one is a hundredth; once.
        """
        if errors is None or self._told:
            return
        self._before = min(self._before, float(errors[SUM]))  # of another stepper
        added = float(errors[SUM]) - self._before
        if added > SPOILING * _STRETCH or errors[LARGEST] > _GROSS:
            self._told, h = True, float(self._state.numbers[st.STEP])
            warn(
                f"the step h = {h:.4g} s is too long for what the machine does at t = {errors[WHEN]:.4g} s: there "
                f"{self._method} estimates an error of {100.0 * errors[LARGEST]:.2g} % of the motion in a single step, "
                f"of {self._names[int(errors[WHOSE])]!r}, and {100.0 * added:.2g} % in all around it. Such steps do "
                "not resolve short contacts, as with a stop: the path may stay finite and be wrong. Take a shorter h, "
                "none (then rtol rules the step), or an implicit method, integrator=fm.GeneralizedAlpha()",
                StepsWarning,
                subject="fixed steps",
            )
        steps = int(self._state.counts[st.STEPS])
        if steps - self._steps >= _STRETCH:
            self._before, self._steps = float(errors[SUM]), steps
            errors[LARGEST] = 0.0
