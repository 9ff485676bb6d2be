"""A run by rank 0 alone, of which all ranks get the trajectory or the error."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

from flexmbd.multibody.bodies.body import Body
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.team import Team
from flexmbd.run.event import Occurrence
from flexmbd.run.result_trees import event_elsewhere
from flexmbd.run.sampling import with_samples
from flexmbd.run.settings import RunSettings
from flexmbd.run.stopped import SimulationError, SimulationInterrupted
from flexmbd.run.trajectory import Trajectory

# What every rank has itself; the events' functions need not pickle.
_OWN = ("scene", "bodies", "team", "events")


@dataclass(frozen=True, eq=False)
class _Outcome:
    """A run as it goes to the other ranks.

    Attributes:
        parts: of the trajectory, by name.
        occurred: number of the event among the settings', -1 of an impact, its name, time (s) and row of each
            occurrence.
        error: what it ended with, and the message; None: it reached its end.
    """

    parts: dict[str, Any]
    occurred: tuple[tuple[int, str, float, int], ...]
    error: tuple[type[SimulationError | SimulationInterrupted], str] | None = None


def run_on_root(
    scene: CompiledScene,
    bodies: Mapping[str, Body],
    *,
    settings: RunSettings,
    team: Team,
    simulate: Callable[[], Trajectory],
) -> Trajectory:
    """Let rank 0 ``simulate`` by itself; its trajectory, to the bit, on every rank.  Collective over the team.

    Raises:
        SimulationError, SimulationInterrupted: on every rank, with the trajectory up to then.
        FlexmbdError: what else ``simulate`` raised, on every rank.
    """
    mine: list[tuple[Trajectory, BaseException | None]] = []

    def run() -> _Outcome:
        error: SimulationError | SimulationInterrupted | None = None
        with scene.callbacks.alone():
            try:
                trajectory = simulate()
            except (SimulationError, SimulationInterrupted) as reason:
                trajectory, error = reason.trajectory, reason
        trajectory = replace(trajectory, team=team)
        if error is not None:
            error.trajectory = trajectory
        mine.append((trajectory, error))
        return _outcome(trajectory, settings, error)

    outcome = team.on_root(run)
    trajectory, error = mine[0] if mine else _received(outcome, scene, bodies, settings, team)
    if error is not None:
        raise error
    return trajectory


def _outcome(
    trajectory: Trajectory, settings: RunSettings, error: SimulationError | SimulationInterrupted | None
) -> _Outcome:
    number = {id(event): k for k, event in enumerate(settings.events)}
    return _Outcome(
        {one.name: getattr(trajectory, one.name) for one in fields(Trajectory) if one.name not in _OWN},
        tuple((number.get(id(one.event), -1), one.name, one.t, one.row) for one in trajectory.events),
        None if error is None else (type(error), str(error)),
    )


def _received(
    outcome: _Outcome, scene: CompiledScene, bodies: Mapping[str, Body], settings: RunSettings, team: Team
) -> tuple[Trajectory, BaseException | None]:
    events = tuple(
        Occurrence(settings.events[k] if k >= 0 else event_elsewhere(name, "rank 0"), t, row)
        for k, name, t, row in outcome.occurred
    )
    driven = with_samples(scene, outcome.parts["samples"])
    trajectory = Trajectory(scene=driven, bodies=bodies, team=team, events=events, **outcome.parts)
    if outcome.error is None:
        return trajectory, None
    kind, message = outcome.error
    return trajectory, kind(message, trajectory)
