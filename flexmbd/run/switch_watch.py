"""Laws that jump with the state, in a run: their sides, and the error where neither side goes on."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import SceneError
from flexmbd.integrate import state as st
from flexmbd.multibody.start.sides import changes_of_switches, switch_numbers
from flexmbd.run.stepping import Integration

FloatArray = NDArray[np.float64]

_AGAIN = 4.0  # times the time since it switched before: the first step behind a switch is no longer
_ENDLESS = 3  # times in a row that a switch is thrown back within the shortest step of the run


class SwitchWatch:
    """The switches of a scene along an integration."""

    def __init__(self, integration: Integration) -> None:
        self._integration = integration
        self.switches = integration.scene.switches
        self._last = np.full(len(self.switches), -np.inf)
        self._hurried = np.zeros(len(self.switches), np.int64)

    @property
    def sides(self) -> FloatArray:
        """(k,) on which the laws are."""
        return self._integration.state.x[[switch.place for switch in self.switches]]

    def numbers(self, t: float, x: FloatArray, v: FloatArray) -> FloatArray:
        """(k,) those whose signs the sides are.  Collective over the team."""
        if not self.switches:
            return np.zeros(0)
        return switch_numbers(self._integration.scene, self.switches, t, x, v)

    def number_now(self, k: int) -> float:
        """That of one switch where the integration stands.  Collective over the team."""
        s = self._integration.state
        return float(switch_numbers(self._integration.scene, (self.switches[k],), self._integration.t, s.x, s.v)[0])

    def change(self, changed: Sequence[int], sides: FloatArray, *, thrown: Collection[int]) -> None:
        """Let the laws of these switches take other sides.

        ``thrown``: those that were not passed, for velocities were set that lead to the other side.

        Raises:
            SceneError: one of them is thrown back from both sides, or endlessly.
        """
        integration = self._integration
        s, t = integration.state, integration.t
        before, numbers = self._changes(), self.numbers(t, s.x, s.v)
        integration.take_sides([self.switches[k].place for k in changed], sides)
        after, same = self._changes(), self.numbers(t, s.x, s.v) == numbers
        since = t - self._last[list(changed)]
        self._last[list(changed)] = t
        integration.bound_step(_AGAIN * float(since.min()))
        for k, side, between in zip(changed, sides, since, strict=True):
            if k in thrown:
                continue
            what = f"the switch of {self.switches[k].name} at t = {t:.6g} s"
            if same[k] and side * before[k] > 0.0 and side * after[k] < 0.0:
                raise SceneError(
                    f"{what}: on both sides of the switching surface the motion leads back to it, so that the machine "
                    "would slide or stick along it; let a smooth law hold it there (as fm.force.JointFriction), or end "
                    "the run there (an event with stop=True)"
                )
            soon = between <= float(s.numbers[st.STEP_FLOOR_SIZE])
            self._hurried[k] = self._hurried[k] + 1 if soon else 0
            if self._hurried[k] >= _ENDLESS:
                raise SceneError(
                    f"{what}: it switches endlessly, ever faster or to and fro at one instant, for neither side leads "
                    "away from the switching surface; give its law a hysteresis (two switches), damping or a smooth "
                    "transition, or end the run there (an event with stop=True)"
                )

    def _changes(self) -> FloatArray:
        """(k,) of the numbers along the motion at hand."""
        s = self._integration.state
        return changes_of_switches(self._integration.scene, self._integration.t, s.x, s.v, s.a)
