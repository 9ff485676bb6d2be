"""A run that goes to a file while it runs: a log of blocks, each whole and checksummed (`files.tree_log`).

The first tree is about the machine; each of the others holds the rows from its ``first`` on, for which it replaces what
earlier ones say, as of `Trajectory`, with what took place in them and what the run has cost so far:

about       scene (digest); coordinates, rows: names of velocities and of constraint rows
recordings  path and name
kept_rows   none: all rows are independent

first       number of the block's first row
t, x, v, a, row_multipliers
events      name, t, row
departures  row, v, a
interiors   wrenches (nt, k, 6); energies, outer_forces and ports by body (number) and name
samples     by controller (number): name, t, measurements, inputs, states, before, rows
stats       numbers by name; constraint_residual is nan until the run has ended
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import RecordError
from flexmbd.files.tree_file import FileKind, Tree
from flexmbd.files.tree_log import TreeLog, read_log
from flexmbd.multibody.interiors.scene_interiors import InteriorRecord
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.team import Alone
from flexmbd.run.event import Occurrence
from flexmbd.run.result_file import ROWS, SavedRun
from flexmbd.run.result_trees import (
    departures_of,
    events_of,
    interiors_of,
    recordings_of,
    refuse_other_machine,
    samples_of,
    shaped,
    stats_of,
)
from flexmbd.run.row_store import RowArrays, RowStore, is_affordable
from flexmbd.run.sampling import ControllerSamples
from flexmbd.run.series.departure import Departure
from flexmbd.run.stats import NOTHING_SPENT

STREAM = FileKind("flexmbd run", 1, "simulate(..., stream=)")


def load_stream(path: Path, scene: CompiledScene) -> SavedRun:
    """Read the rows of a run; of a run that goes on or was killed, the rows written so far.

    Rows that have no room in memory are copied to a file that no name leads to.

    Raises:
        RecordError: the file is missing, damaged, of another kind, or of another scene; or holds no rows yet.
    """
    store, head = RowStore(), Tree()
    events: list[Occurrence] = []
    departures: list[Departure] = []
    interiors: list[InteriorRecord] = []
    samples: list[ControllerSamples] = []
    stats = NOTHING_SPENT
    try:
        for tree, _ in read_log(path, kind=STREAM):
            if "about" in tree:
                refuse_other_machine(path, tree["about"], scene)
                head = tree
                continue
            rows, first = _rows(tree, scene), int(tree["first"].item())
            if not head or not 0 <= first <= store.count:
                raise ValueError(f"a block from row {first} on, after {store.count} rows")
            store.keep(first)
            events = [*(one for one in events if one.row < first), *events_of(path, tree["events"])]
            departures = [*(one for one in departures if one.row < first), *departures_of(tree["departures"])]
            interiors = [*interiors[:first], *interiors_of(tree["interiors"], len(rows[0]))]
            if len(rows[0]):
                now = [samples_of(tree["samples"][str(k)]) for k in range(len(tree["samples"]))]
                since = float(rows[0][0])
                pairs = zip(samples or now, now, strict=True)
                samples = [one.followed_by(other, since=since) for one, other in pairs]
            stats = stats_of(tree["stats"])
            store.append(rows)
            if not is_affordable(store.bytes, Alone()):
                store.spill()
        if not store.count:
            raise RecordError(f"{path} holds no rows yet")
        kept = head.get("kept_rows")
        t, x, v, a, multipliers = store.series()
        return SavedRun(
            t, x, v, a, multipliers,
            stats=stats,
            events=tuple(events),
            interior_rows=tuple(interiors),
            departures=tuple(departures),
            kept_rows=None if kept is None else tuple(kept.tolist()),
            recordings=recordings_of(head["recordings"], scene),
            samples=tuple(samples),
        )  # fmt: skip
    except (KeyError, ValueError, TypeError, AttributeError, IndexError) as reason:
        raise RecordError(f"{path} is not a valid {STREAM.format}: {reason}") from reason


def _rows(tree: Tree, scene: CompiledScene) -> RowArrays:
    rows = tuple(shaped(tree[name], 1 if name == "t" else 2) for name in ROWS)
    widths = [part.shape[1] for part in rows[1:]]
    if len({len(part) for part in rows}) != 1 or widths != [scene.nx, scene.nv, scene.nv, len(scene.plan.rows)]:
        raise ValueError(f"rows of other shapes, {[part.shape for part in rows]}")
    return rows


def resumed_log(path: Path, scene: CompiledScene, t: float) -> tuple[TreeLog, int, tuple[Occurrence, ...]]:
    """The log of an earlier run to go on with from t (s): the row at that time, and what took place in that.

    Raises:
        RecordError: it is missing, damaged before that time, of another machine, or has no step then.
    """
    end = 0
    instants: NDArray[np.float64] = np.zeros(0)
    events: list[Occurrence] = []
    try:
        for tree, after in read_log(path, kind=STREAM):
            if "about" in tree:
                refuse_other_machine(path, tree["about"], scene)
            else:
                first = int(tree["first"].item())
                instants = np.concatenate([instants[:first], shaped(tree["t"], 1)])
                events = [*(one for one in events if one.row < first), *events_of(path, tree["events"])]
            end = after
    except (KeyError, ValueError, TypeError, AttributeError) as reason:
        raise RecordError(f"{path} is not a valid {STREAM.format}: {reason}") from reason
    except RecordError:
        if not (instants == t).any():  # what is damaged behind the restart is written again
            raise
    found = np.flatnonzero(instants == t)
    if not len(found):
        raise RecordError(
            f"{path} holds no step at t = {t:.9g} s, where the restart begins; give the restart a file of its own"
        )
    base = int(found[-1])
    return TreeLog.resume(path, size=end, kind=STREAM), base, tuple(one for one in events if one.row == base)
