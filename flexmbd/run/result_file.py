"""A simulation's rows in one HDF5 file, and from it.

about      scene (digest); coordinates, rows: names of velocities and of constraint rows
t, x, v, a, row_multipliers, kept_rows     as of `Trajectory`; no kept_rows: all are independent
stats      numbers by name; moved_names and moved (k, 2), from and to
events     name, t, row
departures row, v, a
interiors  wrenches (nt, k, 6); energies, outer_forces and ports by body (number) and name
recordings path and name
series     the table of all joints, bodies and energies: names, units, values (nt, k)
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import RecordError
from flexmbd.files.result_table import ResultTable
from flexmbd.files.tree_file import FileKind, Tree, read_tree, write_tree
from flexmbd.multibody.bodies.body import Body
from flexmbd.multibody.interiors.scene_interiors import InteriorRecord
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.team import Team
from flexmbd.run.event import Occurrence
from flexmbd.run.recording import BodyRecording
from flexmbd.run.result_trees import (
    about_tree,
    departures_of,
    departures_tree,
    events_of,
    events_tree,
    interiors_of,
    interiors_tree,
    recordings_of,
    recordings_tree,
    refuse_other_machine,
    samples_of,
    samples_tree,
    shaped,
    stats_of,
    stats_tree,
)
from flexmbd.run.sampling import ControllerSamples
from flexmbd.run.series.departure import Departure
from flexmbd.run.stats import Stats

FloatArray = NDArray[np.float64]

TRAJECTORY = FileKind("flexmbd trajectory", 2, "Trajectory.save")
#: Names of the arrays that have a row for each instant.
ROWS = ("t", "x", "v", "a", "row_multipliers")


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
    """A trajectory in a file; attributes as there."""

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
    samples: tuple[ControllerSamples, ...]


def save_run(
    path: Path, saved: SavedRun, series: Callable[[], ResultTable], *, scene: CompiledScene, team: Team
) -> None:
    """Write a trajectory's file, on rank 0, which does not wait for the others; one that calls waits for the file.

    Raises:
        RecordError: it cannot be written.
    """
    error: Exception | None = None
    if team.is_root:
        try:
            with scene.callbacks.alone():
                _write(path, saved, series(), scene)
        except Exception as reason:  # noqa: BLE001  (whatever it is, ranks that wait must hear of it)
            error = reason
    team.tell(f"{TRAJECTORY.format} {_digest(saved)}", error)


def _digest(saved: SavedRun) -> str:
    """Of the times and the last row, which are the same to the bit on all ranks."""
    rows = hashlib.sha256()
    for part in (saved.t, saved.x[-1:], saved.v[-1:]):
        rows.update(np.ascontiguousarray(part))
    return rows.hexdigest()


def _write(path: Path, saved: SavedRun, series: ResultTable, scene: CompiledScene) -> None:
    tree: Tree = {
        "about": about_tree(scene),
        **{name: getattr(saved, name) for name in ROWS},
        "stats": stats_tree(saved.stats),
        "events": events_tree(saved.events),
        "departures": departures_tree(saved.departures, scene.nv),
        "interiors": interiors_tree(saved.interior_rows),
        "recordings": recordings_tree(saved.recordings),
        "samples": {str(k): samples_tree(one) for k, one in enumerate(saved.samples)},
        "series": {"names": series.names, "units": series.units, "values": series.values},
    }
    if saved.kept_rows is not None:
        tree["kept_rows"] = np.array(saved.kept_rows, dtype=np.int64)
    write_tree(path, tree, kind=TRAJECTORY)


def load_run(path: Path, scene: CompiledScene) -> SavedRun:
    """Read the rows of a trajectory of a scene.

    Raises:
        RecordError: the file is missing, damaged, of another kind, or of another scene.
    """
    tree = read_tree(path, kind=TRAJECTORY)
    try:
        refuse_other_machine(path, tree["about"], scene)
        rows = {name: shaped(tree[name], 1 if name == "t" else 2) for name in ROWS}
        if len({len(part) for part in rows.values()}) != 1 or rows["v"].shape[1] != scene.nv:
            raise ValueError("rows of different lengths")
        kept = tree.get("kept_rows")
        return SavedRun(
            **rows,
            stats=stats_of(tree["stats"]),
            events=events_of(path, tree["events"]),
            interior_rows=interiors_of(tree["interiors"], len(rows["t"])),
            departures=departures_of(tree["departures"]),
            kept_rows=None if kept is None else tuple(kept.tolist()),
            recordings=recordings_of(tree["recordings"], scene),
            samples=tuple(samples_of(tree["samples"][str(k)]) for k in range(len(tree["samples"]))),
        )
    except (KeyError, ValueError, TypeError, AttributeError, IndexError) as reason:
        raise RecordError(f"{path} is not a valid {TRAJECTORY.format}: {reason}") from reason
