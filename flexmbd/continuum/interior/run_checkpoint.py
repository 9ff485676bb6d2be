"""Checkpoints of a body that runs by itself (`ExplicitRun`): files from which it goes on to the bit."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum import parallel
from flexmbd.continuum.history.history_file import fingerprint
from flexmbd.continuum.interior.nodal_motion import NodalMotion
from flexmbd.errors import RecordError, SceneError
from flexmbd.files.array_file import read_arrays, write_arrays
from flexmbd.given import checked

FloatArray = NDArray[np.float64]

_VERSION = 2


@checked()
@dataclass(frozen=True)
class RegularCheckpoints:
    """A file that always holds the last of regular checkpoints.

    Attributes:
        path: of the file (.npz).
        every: s of simulated time between them, counted from where `simulate` began.

    Raises:
        SceneError: `every` is not a positive time.
    """

    path: str | Path
    every: float

    def __post_init__(self) -> None:
        if not 0.0 < self.every < float("inf"):
            raise SceneError(f"checkpoints every {self.every!r} s: that must be positive and finite")

    def next(self, begun: float, t: float) -> float:
        """The first instant (s) for one after t."""
        return float(begun + (np.floor((t - begun) / self.every) + 1.0) * self.every)


@dataclass(frozen=True, eq=False)
class RunState:
    """A run at the end of one of its steps, over the whole body.

    Attributes:
        times: s, the present instant, and where the call of `simulate` that is at work began.
        steps: taken so far.
        instants: (m,) s, the outputs so far.
        names: (k,) of the energies.
        energies: (m, k + 1) J at the outputs, and last the internal work.
        places: (m, nodes, 3) m, at the outputs, by the nodes' numbers.
        motion: `NodalMotion.snapshot`.
    """

    times: tuple[float, float]
    steps: int
    instants: FloatArray
    names: tuple[str, ...]
    energies: FloatArray
    places: FloatArray
    motion: dict[str, FloatArray]

    def save(self, path: str | Path, motion: NodalMotion) -> None:
        """Write to a file, on the root. Collective.

        Raises:
            RecordError: on all ranks: it cannot be written.
        """
        arrays: dict[str, Any] = {
            "version": _VERSION,
            "run": fingerprint(motion.body, **motion.surroundings),
            "times": np.array(self.times),
            "steps": self.steps,
            "instants": self.instants,
            "names": np.array(self.names),
            "energies": self.energies,
            "places": self.places,
            **{f"motion.{name}": part for name, part in self.motion.items()},
        }
        parallel.on_root(motion.body.comm, lambda: write_arrays(path, arrays))

    @staticmethod
    def load(path: str | Path, motion: NodalMotion) -> RunState:
        """Read a file. Collective.

        Raises:
            RecordError: on all ranks: no such file, or none of ours.
            SceneError: on all ranks: it is of another run.
        """
        file: dict[str, Any] = parallel.on_root(motion.body.comm, lambda: read_arrays(path, version=_VERSION))
        if "run" not in file:
            raise RecordError(f"{path} is not a checkpoint of a body that runs by itself")
        if str(file["run"]) != fingerprint(motion.body, **motion.surroundings):
            raise SceneError(
                f"{path}: the checkpoint was made by another run: mesh, materials, planes, supports or damping differ"
            )
        t, begun = (float(value) for value in file["times"])
        memory = {name.removeprefix("motion."): part for name, part in file.items() if name.startswith("motion.")}
        names = tuple(str(name) for name in file["names"])
        return RunState(
            (t, begun), int(file["steps"]), file["instants"], names, file["energies"], file["places"], memory
        )
