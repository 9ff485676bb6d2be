"""Settings of a run: the arguments of ``System.simulate``, checked once."""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from types import NoneType
from typing import Literal

import numpy as np

from flexmbd.errors import FlexmbdError, SceneError
from flexmbd.given import checked, is_number, numbers, refuse_no_truth, refuse_other
from flexmbd.integrate.automatic import IntegratorChoice, choose
from flexmbd.integrate.protocol import Integrator
from flexmbd.multibody.linear.working_point import WorkingPoint
from flexmbd.multibody.start.consistent_start import Start
from flexmbd.multibody.team import Team
from flexmbd.run.checkpoint import Checkpoint
from flexmbd.run.event import Event
from flexmbd.run.limits import Limits
from flexmbd.run.recording import Recording

_OF_ROOT = ("checkpoint_file", "progress", "stream")
_MOST_SAVES = 1e6  # files written one after the other
_LEAST_RTOL = 100.0 * float(np.finfo(float).eps)  # as scipy's solve_ivp has it


@checked("t_start", "stream")
@dataclass(frozen=True, eq=False)
class RunSettings:
    """How long, how exactly and by which method a machine runs, for ``CompiledMachine.run``.

    Attributes:
        t_end: as of ``System.simulate``, as all others.
        rtol: error tolerated.
        h: fixed step (s).
        t_start: start time (s).
        about: where to begin.
        integrator: the method.
        events: to look for.
        checkpoints: times (s) of checkpoints to keep.
        checkpoint_file: of regular checkpoints.
        checkpoint_every: s between them.
        restart: a checkpoint to go on from.
        progress: show a progress bar.
        max_step: longest step (s).
        max_steps: steps after which the run is broken off.
        max_rows: rows after which it is.
        max_seconds: s of the wall's clock after which it is.
        recording: fields of bodies with history that are to be kept in a file.
        stream: a file that the rows go to while the machine runs.

    Raises:
        SceneError: a setting is not of its kind, or two do not go together; the message names it.
    """

    t_end: float
    rtol: float = 1e-6
    h: float | None = None
    t_start: float = 0.0
    about: WorkingPoint | None = None
    integrator: Integrator | Literal["auto"] = "auto"
    events: Sequence[Event] = ()
    checkpoints: Sequence[float] = ()
    checkpoint_file: str | Path | None = None
    checkpoint_every: float | None = None
    restart: Checkpoint | None = None
    progress: bool = False
    max_step: float | None = None
    max_steps: int | None = None
    max_rows: int | None = None
    max_seconds: float | None = None
    recording: Recording | None = None
    stream: str | Path | None = None

    def __post_init__(self) -> None:
        refuse_other(self.events, Sequence, "events", wanted="a list of events, [event]")
        for event in self.events:
            refuse_other(event, Event, "an event", wanted="an fm.Event(...)")
        refuse_other(self.about, (WorkingPoint, NoneType), "about", wanted="what scene.equilibrium() gives")
        wanted = "a checkpoint, as fm.Checkpoint.load(path) gives it"
        refuse_other(self.restart, (Checkpoint, NoneType), "restart", wanted=wanted)
        wanted = 'fm.Recording("file.h5", every=1e-3)'
        refuse_other(self.recording, (Recording, NoneType), "recording", wanted=wanted)
        refuse_other(self.stream, (str, Path, NoneType), "stream", wanted='a file, "run.h5"')
        refuse_other(self.checkpoint_file, (str, Path, NoneType), "checkpoint_file", wanted='a file, "run.npz"')
        self._refuse_times()
        if self.max_step is not None and not (self.h is None and is_number(self.max_step) and self.max_step > 0.0):
            raise SceneError(
                f"max_step = {self.max_step} s must be positive and finite, and given without a fixed step h"
            )
        if (self.checkpoint_file is None) != (self.checkpoint_every is None):
            raise SceneError("checkpoint_file and checkpoint_every go together: a path, and the time (s) between two")
        limits_of(self)
        saves_of(self)
        refuse_no_truth(progress=self.progress)
        if not (isinstance(self.integrator, str) and self.integrator == "auto"):
            refuse_no_integrator(self.integrator)
        for name in ("t_end", "rtol", "h", "t_start", "max_step"):  # numpy's and ratios as well: kernels know doubles
            if getattr(self, name) is not None:
                object.__setattr__(self, name, float(getattr(self, name)))

    def _refuse_times(self) -> None:
        """Raise SceneError for times, steps or tolerances that make no simulation."""
        t_start, t_end = self.starts, self.t_end
        # a time whose reciprocal is no number is none to divide into steps
        if not (is_number(t_start) and is_number(t_end) and t_end - t_start > 1.0 / sys.float_info.max):
            raise SceneError(f"t_end = {t_end} s must lie after the start, {t_start} s")
        if not (is_number(self.rtol) and _LEAST_RTOL <= self.rtol < 1.0):
            raise SceneError(
                f"rtol = {self.rtol} must lie between {_LEAST_RTOL:.2g}, a hundred times the round-off of doubles, "
                "and 1"
            )
        if self.h is not None and not (is_number(self.h) and 0.0 < self.h):
            raise SceneError(f"the step h = {self.h} s must be positive and finite")
        times = numbers(self.checkpoints)
        if times.ndim != 1 or not np.isfinite(times).all():
            raise SceneError(f"checkpoints must be a list of times (s), got {self.checkpoints!r}")
        outside = [t for t in self.checkpoints if not t_start < t <= t_end]
        if outside:
            raise SceneError(
                f"checkpoints at {', '.join(f'{t:g}' for t in outside)} s lie outside the simulation, "
                f"{t_start:g} to {t_end:g} s"
            )

    @property
    def stepping(self) -> tuple[object, ...]:
        """All that says how a run is stepped."""
        return self.t_start, self.t_end, self.rtol, self.h, self.max_step, self.integrator

    @property
    def is_stepping_alone(self) -> bool:
        """Whether a run is stepped from its own start to the end, and nothing is to be done or looked at on the way."""
        asked = (
            self.about, self.events or None, len(self.checkpoints) or None, self.checkpoint_file, self.restart,
            self.max_steps, self.max_rows, self.max_seconds, self.recording, self.stream,
        )  # fmt: skip
        return not self.progress and all(one is None for one in asked)

    @property
    def told(self) -> dict[str, str]:
        """Settings that must be equal on all ranks, as texts by name; files, the bar and functions are rank 0's."""
        shared = (one.name for one in fields(self) if one.name not in _OF_ROOT)
        return {name: _told(getattr(self, name)) for name in shared}

    @property
    def starts(self) -> float:
        """When this run starts (s): at the checkpoint that it goes on from, or at ``t_start``."""
        return self.t_start if self.restart is None else self.restart.t

    @property
    def begun(self) -> float:
        """When the simulation began (s) of which this run is the whole, or the rest after a checkpoint."""
        return self.t_start if self.restart is None else self.restart.t_start

    def method(self, start: Start) -> Integrator:
        """The integrator asked for, or the one that suits this start."""
        return choice_of(self, start).method


def choice_of(settings: RunSettings, start: Start) -> IntegratorChoice:
    """The integrator asked for, or the one that suits this start, and the steps that its choice predicts."""
    if settings.integrator == "auto":
        return choose(start, t=settings.begun, rtol=settings.rtol, h=settings.h)
    return IntegratorChoice(settings.integrator, "as asked")


@dataclass(frozen=True)
class Saves:
    """A file that always holds the last of regular checkpoints.

    Attributes:
        path: of the file, as ``Checkpoint.save``.
        every: s of simulated time between them.

    Raises:
        SceneError: ``every`` is not a positive time.
    """

    path: Path
    every: float

    def __post_init__(self) -> None:
        if not (is_number(self.every) and self.every > 0.0):
            raise SceneError(f"checkpoint_every = {self.every} s must be positive and finite")

    def times(self, begun: float, t_start: float, t_end: float) -> list[float]:
        """When to save: the same instants (s) in a simulation and its restarts."""
        if (t_end - begun) / self.every > _MOST_SAVES:
            raise SceneError(
                f"checkpoint_every = {self.every:g} s would write {(t_end - begun) / self.every:.3g} files from "
                f"{begun:g} to {t_end:g} s; {_MOST_SAVES:.0e} are the most: give a longer time"
            )
        count = int((t_end - begun) / self.every)
        return [t for k in range(1, count + 1) if t_start < (t := begun + k * self.every) < t_end]

    def write(self, checkpoint: Checkpoint, team: Team) -> None:
        """Write the file, on the root.  Collective.

        Raises:
            RecordError: it cannot be written.
        """
        error: FlexmbdError | None = None
        if team.is_root:
            try:
                checkpoint.save(self.path)
            except FlexmbdError as reason:
                error = reason
        team.fail(error)


def limits_of(settings: RunSettings) -> Limits:
    """Where a run is broken off.

    Raises:
        SceneError: a limit is not positive, or a count no whole number.
    """
    return Limits(settings.max_steps, settings.max_rows, settings.max_seconds)


def saves_of(settings: RunSettings) -> Saves | None:
    """The file of regular checkpoints, if there is to be one.

    Raises:
        SceneError: the time between two is not positive.
    """
    if settings.checkpoint_file is None or settings.checkpoint_every is None:
        return None
    return Saves(Path(settings.checkpoint_file), settings.checkpoint_every)


def _told(value: object) -> str:
    """A setting in words that are the same on all ranks."""
    if isinstance(value, Checkpoint):
        return f"a checkpoint at t = {value.t!r} s of scene {value.scene[:12]}"
    if isinstance(value, WorkingPoint):
        digest = hashlib.sha256(value.x.tobytes() + value.v.tobytes() + value.multipliers.tobytes()).hexdigest()
        return f"a working point {digest[:12]}"
    if isinstance(value, Recording):
        return f"a recording every {value.every!r} s"
    if isinstance(value, Integrator):
        return value.name
    if isinstance(value, Event):
        return f"event {value.name!r}, {value.direction.name.lower()}, {'stops' if value.stop else 'goes on'}"
    if isinstance(value, Sequence) and not isinstance(value, str):
        return f"[{', '.join(map(_told, value))}]"
    return repr(value)


def refuse_no_integrator(given: object) -> None:
    """Raise SceneError unless it is an integrator."""
    refuse_other(given, Integrator, "integrator", wanted='a method, as fm.RadauIIA(), or "auto"')
