"""Parts of a trajectory as trees of arrays and texts, for its files, and back."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import RecordError, SceneError
from flexmbd.files.tree_file import Tree
from flexmbd.multibody.interiors.scene_interiors import InteriorRecord
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.run.event import Event, Moment, Occurrence
from flexmbd.run.recording import BodyRecording
from flexmbd.run.sampling import ControllerSamples
from flexmbd.run.series.departure import Departure
from flexmbd.run.stats import Stats

FloatArray = NDArray[np.float64]

_SAMPLES = ("t", "measurements", "inputs", "states", "before")


def shaped(part: Any, dimensions: int) -> FloatArray:
    """An array of doubles of so many dimensions.

    Raises:
        ValueError: it is none.
    """
    if part.ndim != dimensions or part.dtype != np.float64:
        raise ValueError(f"an array of {part.dtype} of shape {part.shape}")
    found: FloatArray = part
    return found


def stats_tree(stats: Stats) -> Tree:
    """Statistics of a run, as a file has them."""
    moved = np.array([change[1:] for change in stats.start_moved]).reshape(-1, 2)
    numbers = {one.name: getattr(stats, one.name) for one in fields(stats)}
    del numbers["integrator"], numbers["start_moved"]
    return {
        "integrator": stats.integrator,
        "moved_names": tuple(change[0] for change in stats.start_moved),
        "moved": moved,
        **{name: np.array(value) for name, value in numbers.items()},
    }


def stats_of(tree: Tree) -> Stats:
    """The statistics of a `stats_tree`."""
    moved = tuple((name, *pair) for name, pair in zip(tree["moved_names"], tree["moved"].tolist(), strict=True))
    given = {one.name: tree[one.name] for one in fields(Stats) if one.name != "start_moved"}
    return Stats(start_moved=moved, **{name: _plain(value) for name, value in given.items()})


def _plain(value: Any) -> Any:
    return value.item() if isinstance(value, np.ndarray) else value


def events_tree(events: tuple[Occurrence, ...]) -> Tree:
    """Events that took place, as a file has them."""
    return {
        "name": tuple(one.name for one in events),
        "t": np.array([one.t for one in events]),
        "row": np.array([one.row for one in events], dtype=np.int64),
    }


def event_elsewhere(name: str, place: str) -> Event:
    """An event whose function is not here."""

    def lost(moment: Moment) -> float:
        raise SceneError(f"the functions of events are not kept in {place}")

    return Event(lost, name=name)


def events_of(path: Path, tree: Tree) -> tuple[Occurrence, ...]:
    """The events of an `events_tree`, without their functions."""
    events = {name: event_elsewhere(name, str(path)) for name in tree["name"]}
    told = zip(tree["name"], tree["t"].tolist(), tree["row"].tolist(), strict=True)
    return tuple(Occurrence(events[name], t, row) for name, t, row in told)


def departures_tree(departures: tuple[Departure, ...], nv: int) -> Tree:
    """Departures of a machine with so many velocities, as a file has them."""
    return {
        "row": np.array([one.row for one in departures], dtype=np.int64),
        **{
            name: np.array([getattr(one, name) for one in departures]).reshape(len(departures), nv)
            for name in ("v", "a")
        },
    }


def departures_of(tree: Tree) -> tuple[Departure, ...]:
    """The departures of a `departures_tree`."""
    return tuple(Departure(*parts) for parts in zip(tree["row"].tolist(), tree["v"], tree["a"], strict=True))


def samples_tree(samples: ControllerSamples) -> Tree:
    """The samples of a controller, as a file has them."""
    numbers = {name: getattr(samples, name) for name in _SAMPLES}
    rows = [(k, row) for k, rows in enumerate(samples.rows) for row in rows]
    return {"name": samples.name, **numbers, "rows": np.array(rows, dtype=np.int64).reshape(-1, 2)}


def samples_of(tree: Tree) -> ControllerSamples:
    """The samples of a `samples_tree`."""
    rows = tuple(tuple(tree["rows"][tree["rows"][:, 0] == k, 1].tolist()) for k in range(len(tree["before"])))
    return ControllerSamples(tree["name"], **{name: tree[name] for name in _SAMPLES}, rows=rows)


def interiors_tree(rows: tuple[InteriorRecord, ...]) -> Tree:
    """Rows of bodies with history, as a file has them."""
    if not rows:
        return {}
    bodies = range(len(rows[0].energies))
    return {
        "wrenches": np.array([row.wrenches for row in rows]),
        "energies": {
            str(k): {name: np.array([row.energies[k][name] for row in rows]) for name in rows[0].energies[k]}
            for k in bodies
        },
        "outer_forces": {
            str(k): {name: np.array([row.outer_forces[k][name] for row in rows]) for name in rows[0].outer_forces[k]}
            for k in bodies
        },
        "ports": {
            str(k): {name: np.array([row.ports[k][name] for row in rows]) for name in rows[0].ports[k]} for k in bodies
        },
    }


def interiors_of(tree: Tree, count: int) -> tuple[InteriorRecord, ...]:
    """The so many rows that `interiors_tree` was made of."""
    if not tree:
        return ()
    bodies = [str(k) for k in range(len(tree["energies"]))]
    ports = tree.get("ports", {k: {} for k in bodies})  # which files of earlier versions have not
    return tuple(
        InteriorRecord(
            tree["wrenches"][row],
            tuple({name: float(part[row]) for name, part in tree["energies"][k].items()} for k in bodies),
            tuple({name: part[row] for name, part in tree["outer_forces"][k].items()} for k in bodies),
            tuple({name: part[row] for name, part in ports[k].items()} for k in bodies),
        )
        for row in range(count)
    )


def recordings_tree(recordings: tuple[BodyRecording, ...]) -> Tree:
    """Recordings, as a file has them."""
    return {
        "path": tuple(str(one.path) for one in recordings),
        "name": tuple(one.name for one in recordings),
    }


def recordings_of(tree: Tree, scene: CompiledScene) -> tuple[BodyRecording, ...]:
    """The recordings of a `recordings_tree`, with the bodies of the scene."""
    named = {} if scene.interiors is None else {body.name: body for body in scene.interiors.bodies}
    told = zip(tree["path"], tree["name"], strict=True)
    return tuple(BodyRecording(Path(path), name, named[name]) for path, name in told)


def about_tree(scene: CompiledScene) -> Tree:
    """Which machine a file is of, and the names of its coordinates."""
    return {"scene": scene.digest(), "coordinates": scene.velocity_names, "rows": scene.row_names}


def refuse_other_machine(path: Path, about: Tree, scene: CompiledScene) -> None:
    """Raise RecordError unless a file is of this scene."""
    if about["scene"] != scene.digest():
        raise RecordError(
            f"{path} is of another machine: bodies, joints, forces, functions or values differ "
            f"(its coordinates: {', '.join(about['coordinates'][:8])})"
        )
