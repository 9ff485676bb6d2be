"""Writing a recording: which instants of a run are kept, and the file that they go to."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from flexmbd.errors import FlexmbdError, RecordError, SceneError
from flexmbd.files.tree_file import Tree
from flexmbd.files.tree_log import TreeLog
from flexmbd.integrate import state as st
from flexmbd.multibody.bodies.continuum_body import FrameMotion
from flexmbd.multibody.interiors.observed import InteriorFields, ObservedInterior
from flexmbd.multibody.interiors.scene_interiors import Interiors
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.team import Team
from flexmbd.run.recorded_instants import ONCE, RECORDING, head_tree, resumed_recording
from flexmbd.run.recording import BodyRecording, Recording
from flexmbd.run.settings import RunSettings
from flexmbd.run.stepping import Integration

# Fields of an `InteriorFields` that are vectors of the nodes' motion; doubles, the others single precision.
_MOTION = ("position", "velocity", "acceleration")


class Recorder:
    """Keeps the instants of one run that a recording asks for.

    What is seen in steps that an event's search takes back is dropped before it reaches the file.
    """

    def __init__(self, recording: Recording, integration: Integration, team: Team, *, begun: float) -> None:
        """Make the file.  Collective.

        Args:
            recording: what is asked for.
            integration: the run, at its start.
            team: of the machine.
            begun: s, when the simulation began, of which this run may be the rest.

        Raises:
            SceneError: no body of the machine shows its fields.
            RecordError: on all ranks: the file cannot be written.
        """
        interiors = integration.scene.interiors
        observed = {} if interiors is None else _observed(interiors)
        if interiors is None or not observed:
            raise SceneError(
                "a recording is of bodies with history that show their fields (ExplicitContinuum, ImplicitContinuum), "
                "and this machine has none"
            )
        self._recording, self._integration, self._interiors, self._begun = recording, integration, interiors, begun
        self._bodies = observed
        self._work = new_work(integration.scene.plan)
        self._file = RecordingFile(recording, observed, team)
        self._pending: list[tuple[float, Mapping[str, InteriorFields]]] = []
        self._written = self._file.begin(integration.t if integration.t > begun else None)
        self.watch()
        interiors.watchers.append(self.watch)

    def watch(self) -> None:
        """Look at the bodies where an instant is due.  Collective."""
        t = self._integration.t
        # what was seen within the step that ends here was taken back
        begin = t - 0.5 * float(self._integration.state.numbers[st.STEP_BEFORE])
        self._drop(lambda kept: kept < begin)
        last = self._pending[-1][0] if self._pending else self._written
        if last is None or self._recording.index(t, self._begun) > self._recording.index(last, self._begun):
            self._look(t)

    def write(self) -> None:
        """Write what is kept for good: what was seen up to where the integration stands.  Collective."""
        t = self._integration.t
        self._drop(lambda kept: kept <= t)
        if self._pending:
            self._file.append(self._pending)
            self._written = self._pending[-1][0]
            self._pending = []

    def stop(self) -> None:
        """Watch no longer, and write no more."""
        self._interiors.watchers.remove(self.watch)
        self._file.close()

    def end(self) -> None:
        """Write the last step as well.  Collective."""
        self.write()
        if self._written is None or self._written < self._integration.t:
            self._look(self._integration.t)
            self.write()

    @property
    def recordings(self) -> tuple[BodyRecording, ...]:
        """The recordings written, by body."""
        return kept_recordings(self._recording, self._interiors)

    def _look(self, t: float) -> None:
        motions = self._motions()
        self._pending.append((t, {name: body.observe(motions[name]) for name, body in self._bodies.items()}))

    def _motions(self) -> dict[str, FrameMotion]:
        state, plan = self._integration.state, self._integration.scene.plan
        found = self._interiors.motions(plan, self._work, state.x, state.v, state.a)
        return {body.name: motion for body, motion in zip(self._interiors.bodies, found, strict=True)}

    def _drop(self, keep: Callable[[float], bool]) -> None:
        self._pending = [one for one in self._pending if keep(one[0])]


@contextmanager
def open_recorder(settings: RunSettings, integration: Integration, team: Team) -> Iterator[Recorder | None]:
    """The recorder of a run, if there is to be one; at the end it has written the last step.  Collective.

    Raises:
        SceneError, RecordError: as `Recorder`.
    """
    if settings.recording is None:
        yield None
        return
    recorder = Recorder(settings.recording, integration, team, begun=settings.begun)
    try:
        yield recorder
        recorder.end()
    finally:
        recorder.stop()


def kept_recordings(recording: Recording | None, interiors: Interiors | None) -> tuple[BodyRecording, ...]:
    """The recording of these bodies, by body."""
    if recording is None or interiors is None:
        return ()
    bodies = {body.name: body for body in interiors.bodies}
    path = Path(recording.path).absolute()
    return tuple(BodyRecording(path, name, bodies[name]) for name in _observed(interiors))


def _observed(interiors: Interiors) -> dict[str, ObservedInterior]:
    """The bodies that show their fields, by name."""
    pairs = zip(interiors.bodies, interiors.observed, strict=True)
    return {body.name: one for body, one in pairs if one is not None}


class RecordingFile:
    """The file that a run records to; rank 0 writes it."""

    def __init__(self, recording: Recording, bodies: Mapping[str, ObservedInterior], team: Team) -> None:
        """Every rank makes one."""
        self._recording, self._bodies, self._team = recording, bodies, team
        self._log: TreeLog | None = None

    def begin(self, t: float | None) -> float | None:
        """Make the file, or of a restart at t (s) go on with what it holds up to then.  Collective.

        Returns:
            The last instant (s) that it holds.

        Raises:
            RecordError: it cannot be written, or the one that is there is of other bodies.
        """
        meshes = {name: body.outline() for name, body in self._bodies.items()}
        last = np.array([np.nan])
        error: FlexmbdError | None = None
        if self._team.is_root:
            path = Path(self._recording.path)
            try:
                if t is not None and path.exists():
                    self._log, last[0] = resumed_recording(path, meshes, t)
                else:
                    self._log = TreeLog.begin(path, head_tree(meshes), kind=RECORDING)
            except RecordError as reason:
                error = reason
        self._team.fail(error)
        found = float(self._team.agree(last)[0])
        return None if np.isnan(found) else found

    def append(self, instants: list[tuple[float, Mapping[str, InteriorFields]]]) -> None:
        """Write instants.  Collective.

        Raises:
            RecordError: on all ranks: it cannot be written.
        """
        error: FlexmbdError | None = None
        if self._log is not None and instants:
            try:
                self._log.append(_block(instants, tuple(self._bodies)))
            except RecordError as reason:
                error = reason
        self._team.fail(error)

    def close(self) -> None:
        """Write no more."""
        if self._log is not None:
            self._log.close()


def _block(instants: list[tuple[float, Mapping[str, InteriorFields]]], names: tuple[str, ...]) -> Tree:
    return {
        "t": np.array([t for t, _ in instants], np.float64),
        "bodies": {str(k): _fields([fields[name] for _, fields in instants]) for k, name in enumerate(names)},
    }


def _fields(instants: list[InteriorFields]) -> Tree:
    fields: Tree = {name: np.array([getattr(one, name) for one in instants], np.float64) for name in _MOTION}
    fields |= {name: np.array([one.values[name] for one in instants], np.float32) for name in instants[0].values}
    position, rotation, largest, nearest = ONCE
    return {
        "fields": fields,
        position: np.array([one.p for one in instants], np.float64),
        rotation: np.array([one.R for one in instants], np.float64),
        largest: np.array([one.largest for one in instants], np.float64),
        nearest: np.array([one.largest_row for one in instants], np.int64),
    }
