"""Says once where a run creeps: where something much faster than the motion rules its steps.

An explicit method's, which an implicit one would step over; or those of an implicit one that was chosen to step over
it, and follows it all the same.
"""

from __future__ import annotations

import math

from flexmbd.errors import StepsWarning, warn
from flexmbd.integrate import state as st
from flexmbd.run.stepping import Integration

# Steps of a stretch that is looked at; how many times what the tolerance asks for is too many; steps that must be left.
_STRETCH, _MANY, _LEFT = 1000, 30.0, 1e5
_LOST, _LOST_LEFT = 2.0, 1e4  # the same of an implicit method, over the steps at which an explicit one is stable


class CreepWatch:
    """Looks at the steps of each stretch of a run."""

    def __init__(self, integration: Integration, t_end: float, *, explicit_steps: float) -> None:
        self._integration, self._t_end = integration, t_end
        self._ask, self._explicit_steps = integration.steps_a_radian, explicit_steps
        self._begin()

    def look(self) -> None:
        """Warn where the steps of a stretch, a thousand or more, are far too many for the motion."""
        if math.isinf(self._ask):
            self._look_at_implicit()
            return
        state = self._integration.state
        steps, time = int(state.counts[st.STEPS]) - self._steps, self._integration.t - self._t
        if steps < max(_STRETCH, _MANY * self._ask) or not time > 0.0:
            return
        radians, left = float(state.numbers[st.RATE]) * time, steps * (self._t_end - self._integration.t) / time
        if steps > _MANY * self._ask * radians and left > _LEFT:
            warn(
                f"at t = {self._integration.t:.4g} s {self._integration.method.name} takes steps of "
                f"{time / steps:.1e} s, {left:.1e} of them up to t_end, some {steps / max(radians, 1e-300):.0e} for a "
                "radian of the machine's motion. Something much faster than the motion holds them up, as thin beams, "
                "stiff springs and bushings do; integrator=fm.RadauIIA() takes longer steps unless that vibration "
                "itself is to be seen",
                StepsWarning,
            )
            self._ask = math.inf
        self._begin()

    def _look_at_implicit(self) -> None:
        """Warn where a stretch took more steps than the explicit pair would, which was taken to need more."""
        steps, time = int(self._integration.state.counts[st.STEPS]) - self._steps, self._integration.t - self._t
        if steps < _STRETCH or not time > 0.0:
            return
        left = steps * (self._t_end - self._integration.t) / time
        if steps > _LOST * self._explicit_steps * time and left > _LOST_LEFT:
            warn(
                f"at t = {self._integration.t:.4g} s {self._integration.method.name}, chosen to step over vibrations, "
                f"takes steps of {time / steps:.1e} s, {left:.1e} of them up to t_end: the vibrations are excited all "
                "the same. integrator=fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8) takes cheaper steps, which were "
                f"foreseen to be stable up to {1.0 / self._explicit_steps:.1e} s",
                StepsWarning,
            )
            self._explicit_steps = math.inf
        self._begin()

    def _begin(self) -> None:
        self._steps, self._t = int(self._integration.state.counts[st.STEPS]), self._integration.t
