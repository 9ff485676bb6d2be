"""Tells where a body with history is further off by its updates in time than the tolerance of the run allows."""

from __future__ import annotations

from flexmbd.errors import ToleranceWarning, warn
from flexmbd.integrate import state as st
from flexmbd.multibody.interiors.scene_interiors import Interiors
from flexmbd.multibody.interiors.updated import UpdatedInterior
from flexmbd.multibody.team import Team
from flexmbd.run.stepping import Integration


class UpdateWatch:
    """Has interiors estimate the error of their updates where steps are chosen by a tolerance."""

    def __init__(self, integration: Integration, interiors: Interiors | None) -> None:
        self._integration, self._begun = integration, integration.t
        self._watched: dict[str, UpdatedInterior] = {}
        if interiors is None or integration.state.counts[st.FIXED_STEP] == 1:
            return
        for body in interiors.bodies:
            if isinstance(body.interior, UpdatedInterior):
                body.interior.watch_updates()
                self._watched[body.name] = body.interior

    def tell(self, team: Team) -> None:
        """Warn, on the root alone, of the bodies that are further off than the tolerance lets the motion be."""
        state, passed = self._integration.state, self._integration.t - self._begun
        steps = int(state.counts[st.STEPS])
        if not (self._watched and steps and team.is_root):
            return
        rtol = float(state.numbers[st.TOLERANCE])
        allowed = rtol * max(1.0, float(state.numbers[st.RATE]) * passed)
        for name, interior in self._watched.items():
            error = interior.update_error()
            if error > allowed:
                warn(
                    f"the forces of body {name!r} are off by some {error:.1e} of their largest, by the error of the "
                    f"history's time integration, estimated by two half steps in each step; rtol = {rtol:.3g} asks for "
                    f"{allowed:.1e}. The error falls with the steps, {passed / steps:.1e} s in the mean, which error "
                    "control chooses by the machine's coordinates alone: give a smaller max_step",
                    ToleranceWarning,
                )
