"""Checkpoints: what an integrator remembers, kept so that a restart goes on to the bit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import RecordError, SceneError
from flexmbd.files.array_file import read_arrays, write_arrays
from flexmbd.integrate import state as st
from flexmbd.integrate.protocol import Integrator
from flexmbd.multibody.bodies.continuum_body import Memory
from flexmbd.multibody.interiors.scene_interiors import InteriorSnapshot
from flexmbd.multibody.kernels.base.array_struct import names_of
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.run.sampling import SamplingMemory
from flexmbd.run.stepping import Snapshot

_VERSION = 8


@dataclass(frozen=True, eq=False)
class Checkpoint:
    """The state of a simulation at one instant.

    Attributes:
        method: the integrator's name with its options.
        scene: digest of the compiled scene.
        t_start: start time (s) of the simulation.
        snapshot: what the method remembers; factors were dropped, in the simulation that went on too.
    """

    method: str
    scene: str
    t_start: float
    snapshot: Snapshot

    @property
    def t(self) -> float:
        """Time (s) of the checkpoint."""
        return float(self.snapshot.state.numbers[st.TIME])

    def of(self, scene: CompiledScene, method: Integrator, *, controllers: str = "") -> Snapshot:
        """Return the snapshot if it belongs to this scene and method, and to controllers of this code.

        Raises:
            SceneError: it was made by another one.
        """
        if self.method != method.name:
            raise SceneError(
                f"the checkpoint was made by {self.method}, this is {method.name}; give the same integrator"
            )
        if self.scene != scene.digest():
            raise SceneError("the checkpoint was made by another scene: bodies, joints, forces or functions differ")
        if self.snapshot.sampling.code != controllers:
            raise SceneError(
                "the checkpoint was made with other controllers: one is new or gone, or a law, a period, a signal or a "
                "state differs"
            )
        return self.snapshot

    def save(self, path: str | Path) -> Path:
        """Write to ``path`` (.npz), under a temporary name first."""
        snapshot = self.snapshot
        parts: dict[str, Any] = {
            "version": _VERSION,
            "method": self.method,
            "scene": self.scene,
            "times": np.array([self.t_start, snapshot.first_step]),
            **{f"state.{name}": part for name, part in snapshot.state.fields().items()},
            **{f"groups.{name}": part for name, part in snapshot.groups.fields().items()},
            **{f"method.{name}": part for name, part in snapshot.memory.items()},
            "rows": snapshot.rows,
            "controllers": snapshot.sampling.code,
            "sample": snapshot.sampling.next,
            "signals": snapshot.sampling.values,
            "controller_states": snapshot.sampling.states,
            "wrenches": snapshot.interiors.wrenches,
            "bodies": len(snapshot.interiors.memories),
            **{
                f"body {k}.{name}": part
                for k, memory in enumerate(snapshot.interiors.memories)
                for name, part in memory.items()
            },
        }
        return write_arrays(path, parts)

    @staticmethod
    def load(path: str | Path) -> Checkpoint:
        """Read a checkpoint.

        Raises:
            RecordError: no such file, or none of ours.
        """
        file = read_arrays(path, version=_VERSION)
        try:
            state = st.State(*(file[f"state.{name}"] for name in names_of(st.State)))
            groups = st.Groups(*(file[f"groups.{name}"] for name in names_of(st.Groups)))
            t_start, first_step = file["times"]
            own = _memory(file, "method.")
            memories = tuple(_memory(file, f"body {k}.") for k in range(int(file["bodies"])))
            kept = InteriorSnapshot(file["wrenches"], memories)
            sampling = SamplingMemory(
                str(file["controllers"]), file["sample"], file["signals"], file["controller_states"]
            )
            snapshot = Snapshot(state, groups, own, float(first_step), file["rows"], kept, sampling)
            return Checkpoint(str(file["method"]), str(file["scene"]), float(t_start), snapshot)
        except (KeyError, ValueError) as reason:
            raise RecordError(f"{path} is not a checkpoint of a machine: {reason}") from reason


def _memory(file: Mapping[str, NDArray[np.generic]], prefix: str) -> Memory:
    """The arrays whose names begin with ``prefix``: the memory of a method, or of a body with history."""
    return {name.removeprefix(prefix): file[name] for name in file if name.startswith(prefix)}
