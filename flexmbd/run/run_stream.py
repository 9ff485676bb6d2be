"""A run that goes to a file while it runs; the file is that of `run.stream_file`."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import FlexmbdError, RecordError
from flexmbd.files.tree_file import Tree
from flexmbd.files.tree_log import TreeLog
from flexmbd.multibody.interiors.scene_interiors import InteriorRecord
from flexmbd.multibody.start.consistent_start import Start
from flexmbd.multibody.team import Team
from flexmbd.run.event import Occurrence
from flexmbd.run.recording_file import kept_recordings
from flexmbd.run.result_file import ROWS
from flexmbd.run.result_trees import (
    about_tree,
    departures_tree,
    events_tree,
    interiors_tree,
    recordings_tree,
    samples_tree,
    stats_tree,
)
from flexmbd.run.row_store import RowArrays
from flexmbd.run.sampling import ControllerSamples
from flexmbd.run.series.departure import Departure
from flexmbd.run.settings import RunSettings
from flexmbd.run.stats import Stats, spent
from flexmbd.run.stepping import Integration
from flexmbd.run.stopped import SimulationError, SimulationInterrupted
from flexmbd.run.stream_file import STREAM, resumed_log
from flexmbd.run.trajectory import Trajectory

FloatArray = NDArray[np.float64]

# Seconds and bytes of rows after which a block is written.
_EVERY, _BLOCK = 1.0, 1 << 24


class RunStream:
    """The file that a run writes its rows to; rank 0 does."""

    def __init__(self, start: Start, settings: RunSettings, integration: Integration, team: Team) -> None:
        """Make the file, or of a restart go on with what it holds up to then.  Collective.

        Raises:
            RecordError: it cannot be written, or what is there is of another machine or has no step at the restart.
        """
        self._path = Path(str(settings.stream))
        self._start, self._integration, self._team = start, integration, team
        self._began = time.perf_counter()
        self._first = self._base = 0  # the row from which on the next block is; the run's first, both in the file
        self._carried: tuple[Occurrence, ...] = ()
        self._log: TreeLog | None = None
        self._written = 0.0
        self._on_root(lambda: self._open(settings))
        self.write((), lasting=True)

    def _open(self, settings: RunSettings) -> None:
        start, scene = self._start, self._start.unreduced
        if settings.restart is not None and self._path.exists():
            self._log, self._base, self._carried = resumed_log(self._path, scene, settings.restart.t)
            self._first = self._base
            return
        recordings = kept_recordings(settings.recording, scene.interiors)
        head: Tree = {"about": about_tree(scene), "recordings": recordings_tree(recordings)}
        if start.scene.redundant:
            head["kept_rows"] = np.array(start.choice.rows, dtype=np.int64)
        self._log = TreeLog.begin(self._path, head, kind=STREAM)

    def take(self, events: Sequence[Occurrence]) -> None:
        """Write the rows so far where enough came, or some time after the last ones.  Collective."""
        rows = self._integration.rows + self._base - self._first
        size = rows * sum(part[0].nbytes for part in self._integration.stored.last)
        if size >= _BLOCK or time.perf_counter() - self._written >= _EVERY:
            self.write(events)
        else:
            self._team.fail(None)

    def write(self, events: Sequence[Occurrence], *, lasting: bool = False) -> None:
        """Write the rows so far, to survive a power cut where they are ``lasting``.  Collective."""
        run, at = self._integration, self._first - self._base
        rows = run.stored.since(at)
        what = events, run.departures, run.interior_rows[at:], run.samples(since=float(rows[0][0]))
        self._write(rows, *what, self._stats(self._start), lasting=lasting)

    def end(self, run: Trajectory) -> None:
        """Write what is left of a run that has ended, and take back rows that it has not.  Collective."""
        at = min(self._first - self._base, len(run.t))
        self._first = self._base + at
        rows = tuple(getattr(run, name)[at:] for name in ROWS)
        since = rows[0][0] if len(rows[0]) else np.inf
        samples = [one.since(float(since)) for one in run.samples]
        self._write(rows, run.events, run.departures, run.interior_rows[at:], samples, run.stats, lasting=True)

    def close(self) -> None:
        """Write no more."""
        if self._log is not None:
            self._log.close()

    def _write(
        self,
        rows: RowArrays,
        events: Sequence[Occurrence],
        departures: Sequence[Departure],
        interiors: Sequence[InteriorRecord],
        samples: Sequence[ControllerSamples],
        stats: Stats,
        *,
        lasting: bool,
    ) -> None:
        """Append a block; its last row is the next one's first, for it may still change."""
        first, base = self._first, self._base
        took_place = (*self._carried, *(replace(one, row=one.row + base) for one in events))
        left = (replace(one, row=one.row + base) for one in departures)

        def append() -> None:
            if self._log is None:
                return
            tree: Tree = {
                "first": np.array(first),
                **{name: np.ascontiguousarray(part) for name, part in zip(ROWS, rows, strict=True)},
                "events": events_tree(tuple(one for one in took_place if one.row >= first)),
                "departures": departures_tree(tuple(one for one in left if one.row >= first), rows[2].shape[1]),
                "interiors": interiors_tree(tuple(interiors)),
                "samples": {str(k): samples_tree(one) for k, one in enumerate(samples)},
                "stats": stats_tree(stats),
            }
            self._log.append(tree, lasting=lasting)

        self._on_root(append)
        self._first = max(first + len(rows[0]) - 1, 0)
        self._written = time.perf_counter()

    def _stats(self, start: Start) -> Stats:
        run = self._integration
        so_far = spent(
            run.method.name, run.state.counts, seconds=time.perf_counter() - self._began, compile_seconds=float("nan")
        )
        return replace(
            so_far,
            start_moved=start.moved,
            start_residual=start.residual,
            start_elastic=start.strain.energy,
            constraint_residual=float("nan"),
        )

    def _on_root(self, function: Callable[[], None]) -> None:
        error: FlexmbdError | None = None
        if self._team.is_root:
            try:
                function()
            except FlexmbdError as reason:
                error = reason
        self._team.fail(error)


@contextmanager
def open_stream(
    start: Start, settings: RunSettings, integration: Integration, team: Team
) -> Iterator[RunStream | None]:
    """The stream of a run, if there is to be one; a run that stops early is ended in it.  Collective.

    Raises:
        RecordError: as `RunStream`.
    """
    if settings.stream is None:
        yield None
        return
    stream = RunStream(start, settings, integration, team)
    try:
        yield stream
    except (SimulationError, SimulationInterrupted) as stopped:
        try:
            stream.end(stopped.trajectory)
        except RecordError as reason:
            stopped.args = (f"{stopped}; the last rows are not in the file: {reason}", *stopped.args[1:])
        raise
    finally:
        stream.close()
