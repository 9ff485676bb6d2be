"""A simulation's rows in one HDF5 file, and from it.

about      scene (digest); coordinates, rows: names of velocities and of constraint rows
t, x, v, a, row_multipliers, kept_rows     as of `Trajectory`; no kept_rows: all are independent
stats      numbers by name; moved_names and moved (k, 2), from and to
events     name, t, row
departures row, v, a
interiors  wrenches (nt, k, 6); energies and outer_forces by body (number) and name
recordings path and name
series     the table of all joints, bodies and energies: names, units, values (nt, k)
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import FlexmbdError, RecordError, SceneError
from flexmbd.files.result_table import ResultTable
from flexmbd.files.tree_file import FileKind, Tree, read_tree, write_tree
from flexmbd.multibody.bodies.body import Body
from flexmbd.multibody.interiors.scene_interiors import InteriorRecord
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.team import Team
from flexmbd.run.departure import Departure
from flexmbd.run.event import Event, Moment, Occurrence
from flexmbd.run.recording import BodyRecording
from flexmbd.run.sampling import Samples
from flexmbd.run.stats import Stats

FloatArray = NDArray[np.float64]

TRAJECTORY = FileKind("flexmbd trajectory", 2, "Trajectory.save")
_SAMPLES = ("t", "measurements", "inputs", "states", "before")
_ROWS = ("t", "x", "v", "a", "row_multipliers")


@runtime_checkable
class Runnable(Protocol):
    """A machine that a trajectory may be of."""

    def compiled_parts(self, values: Mapping[str, Any]) -> tuple[CompiledScene, tuple[Body, ...], Team]:
        """The compiled scene with these values of its parameters, its bodies, and the processes that run it.

        Raises:
            SceneError: it cannot be compiled, or a value does not fit.
        """


@dataclass(frozen=True, eq=False)
class SavedRun:
    """What a file holds of a trajectory; attributes as there."""

    t: FloatArray
    x: FloatArray
    v: FloatArray
    a: FloatArray
    row_multipliers: FloatArray
    stats: Stats
    events: tuple[Occurrence, ...]
    interior_rows: tuple[InteriorRecord, ...]
    departures: tuple[Departure, ...]
    kept_rows: tuple[int, ...] | None
    recordings: tuple[BodyRecording, ...]
    samples: tuple[Samples, ...]


def save_run(path: Path, saved: SavedRun, series: ResultTable, *, scene: CompiledScene, team: Team) -> None:
    """Write a trajectory's file, on rank 0.  Collective over the team.

    Raises:
        RecordError: it cannot be written.
    """
    error: FlexmbdError | None = None
    if team.is_root:
        tree: Tree = {
            "about": {"scene": scene.digest(), "coordinates": scene.velocity_names, "rows": scene.row_names},
            **{name: getattr(saved, name) for name in _ROWS},
            "stats": _stats_tree(saved.stats),
            "events": _events_tree(saved.events),
            "departures": _departures_tree(saved.departures, scene.nv),
            "interiors": _interiors_tree(saved.interior_rows),
            "recordings": {
                "path": tuple(str(one.path) for one in saved.recordings),
                "name": tuple(one.name for one in saved.recordings),
            },
            "samples": {str(k): _samples_tree(one) for k, one in enumerate(saved.samples)},
            "series": {"names": series.names, "units": series.units, "values": series.values},
        }
        if saved.kept_rows is not None:
            tree["kept_rows"] = np.array(saved.kept_rows, dtype=np.int64)
        try:
            write_tree(path, tree, kind=TRAJECTORY)
        except FlexmbdError as reason:
            error = reason
    team.fail(error)


def load_run(path: Path, scene: CompiledScene) -> SavedRun:
    """Read the rows of a trajectory of a scene.

    Raises:
        RecordError: the file is missing, damaged, of another kind, or of another scene.
    """
    tree = read_tree(path, kind=TRAJECTORY)
    try:
        if tree["about"]["scene"] != scene.digest():
            raise RecordError(
                f"{path} is of another machine: bodies, joints, forces, functions or values differ "
                f"(its coordinates: {', '.join(tree['about']['coordinates'][:8])})"
            )
        rows = {name: _shaped(tree[name], 1 if name == "t" else 2) for name in _ROWS}
        if len({len(part) for part in rows.values()}) != 1 or rows["v"].shape[1] != scene.nv:
            raise ValueError("rows of different lengths")
        kept = tree.get("kept_rows")
        return SavedRun(
            **rows,
            stats=_stats(tree["stats"]),
            events=_events(path, tree["events"]),
            interior_rows=_interior_rows(tree["interiors"], len(rows["t"])),
            departures=_departures(tree["departures"]),
            kept_rows=None if kept is None else tuple(kept.tolist()),
            recordings=_recordings(tree["recordings"], scene),
            samples=tuple(_samples(tree["samples"][str(k)]) for k in range(len(tree["samples"]))),
        )
    except (KeyError, ValueError, TypeError, AttributeError, IndexError) as reason:
        raise RecordError(f"{path} does not hold what a {TRAJECTORY.format} should: {reason}") from reason


def _shaped(part: Any, dimensions: int) -> FloatArray:
    if part.ndim != dimensions or part.dtype != np.float64:
        raise ValueError(f"an array of {part.dtype} of shape {part.shape}")
    found: FloatArray = part
    return found


def _stats_tree(stats: Stats) -> Tree:
    moved = np.array([change[1:] for change in stats.start_moved]).reshape(-1, 2)
    numbers = {one.name: getattr(stats, one.name) for one in fields(stats)}
    del numbers["integrator"], numbers["start_moved"]
    return {
        "integrator": stats.integrator,
        "moved_names": tuple(change[0] for change in stats.start_moved),
        "moved": moved,
        **{name: np.array(value) for name, value in numbers.items()},
    }


def _stats(tree: Tree) -> Stats:
    moved = tuple((name, *pair) for name, pair in zip(tree["moved_names"], tree["moved"].tolist(), strict=True))
    given = {one.name: tree[one.name] for one in fields(Stats) if one.name != "start_moved"}
    return Stats(start_moved=moved, **{name: _plain(value) for name, value in given.items()})


def _plain(value: Any) -> Any:
    return value.item() if isinstance(value, np.ndarray) else value


def _events_tree(events: tuple[Occurrence, ...]) -> Tree:
    return {
        "name": tuple(one.name for one in events),
        "t": np.array([one.t for one in events]),
        "row": np.array([one.row for one in events], dtype=np.int64),
    }


def _events(path: Path, tree: Tree) -> tuple[Occurrence, ...]:
    def lost(moment: Moment) -> float:
        raise SceneError(f"the functions of events are not kept in {path}")

    events = {name: Event(lost, name=name) for name in tree["name"]}
    told = zip(tree["name"], tree["t"].tolist(), tree["row"].tolist(), strict=True)
    return tuple(Occurrence(events[name], t, row) for name, t, row in told)


def _departures_tree(departures: tuple[Departure, ...], nv: int) -> Tree:
    return {
        "row": np.array([one.row for one in departures], dtype=np.int64),
        **{name: np.array([getattr(one, name) for one in departures]).reshape(-1, nv) for name in ("v", "a")},
    }


def _departures(tree: Tree) -> tuple[Departure, ...]:
    return tuple(Departure(*parts) for parts in zip(tree["row"].tolist(), tree["v"], tree["a"], strict=True))


def _samples_tree(samples: Samples) -> Tree:
    numbers = {name: getattr(samples, name) for name in _SAMPLES}
    rows = [(k, row) for k, rows in enumerate(samples.rows) for row in rows]
    return {"name": samples.name, **numbers, "rows": np.array(rows, dtype=np.int64).reshape(-1, 2)}


def _samples(tree: Tree) -> Samples:
    rows = tuple(tuple(tree["rows"][tree["rows"][:, 0] == k, 1].tolist()) for k in range(len(tree["before"])))
    return Samples(tree["name"], **{name: tree[name] for name in _SAMPLES}, rows=rows)


def _interiors_tree(rows: tuple[InteriorRecord, ...]) -> Tree:
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
    }


def _interior_rows(tree: Tree, count: int) -> tuple[InteriorRecord, ...]:
    if not tree:
        return ()
    bodies = [str(k) for k in range(len(tree["energies"]))]
    return tuple(
        InteriorRecord(
            tree["wrenches"][row],
            tuple({name: float(part[row]) for name, part in tree["energies"][k].items()} for k in bodies),
            tuple({name: part[row] for name, part in tree["outer_forces"][k].items()} for k in bodies),
        )
        for row in range(count)
    )


def _recordings(tree: Tree, scene: CompiledScene) -> tuple[BodyRecording, ...]:
    named = {} if scene.interiors is None else {body.name: body for body in scene.interiors.bodies}
    told = zip(tree["path"], tree["name"], strict=True)
    return tuple(BodyRecording(Path(path), name, named[name]) for path, name in told)
