"""Checkpoints: the state of an integration, from which a restart goes on to the bit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmbd.brief import brief
from flexmbd.errors import RecordError, SceneError
from flexmbd.files.array_file import read_arrays, write_arrays
from flexmbd.given import checked
from flexmbd.integrate import state as st
from flexmbd.integrate.protocol import Integrator
from flexmbd.multibody.bodies.continuum_body import Memory
from flexmbd.multibody.interiors.scene_interiors import InteriorSnapshot
from flexmbd.multibody.kernels.base.array_struct import names_of
from flexmbd.multibody.start.consistent_start import Start
from flexmbd.run.event import EventMemory
from flexmbd.run.sampling import SamplingMemory
from flexmbd.run.snapshot import Snapshot, new_groups

_VERSION = 9
# Arrays of whole numbers; arrays (ne, 2).
_WHOLE = ("state.counts", "groups.of", "groups.kind", "rows", "sample")
_TABLES = ("newest", "turned", "stiffness", "softest", "gap_begin", "gap_end")


@dataclass(frozen=True, eq=False)
class Checkpoint:
    """The state of a simulation at one instant.

    Attributes:
        method: the integrator's name with its options.
        scene: digest of the compiled scene.
        t_start: start time (s) of the simulation.
        snapshot: the state and the method's memory; factors were dropped, in the simulation that went on too.
    """

    method: str
    scene: str
    t_start: float
    snapshot: Snapshot

    __repr__ = brief

    @property
    def t(self) -> float:
        """Time (s) of the checkpoint."""
        return float(self.snapshot.state.numbers[st.TIME])

    def of(self, start: Start, method: Integrator, *, controllers: str = "") -> Snapshot:
        """Return the snapshot if it belongs to this start's scene and method, and to controllers of this code.

        Raises:
            SceneError: it was made by another one.
            RecordError: it is damaged.
        """
        if self.method != method.name:
            raise SceneError(
                f"the checkpoint was made by {self.method}, this is {method.name}; give the same integrator"
            )
        if self.scene != start.scene.digest():
            raise SceneError("the checkpoint was made by another scene: bodies, joints, forces or functions differ")
        if self.snapshot.sampling.code != controllers:
            raise SceneError(
                "the checkpoint was made with other controllers: one is new or gone, or a law, a period, a signal or a "
                "state differs"
            )
        _refuse_damaged(self.snapshot, start)
        return self.snapshot

    @checked(error=RecordError)
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
            "event_codes": np.array(snapshot.events.codes, dtype=np.str_),
            "events": snapshot.events.followed,
            "new_pace": snapshot.events.new_pace,
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
    @checked(error=RecordError)
    def load(path: str | Path) -> Checkpoint:
        """Read a checkpoint.

        Raises:
            RecordError: no such file, none of ours, or written by a version of flexmbd that remembers other things.
        """
        file = read_arrays(path, version=_VERSION)
        _refuse_other_layout(path, file)
        try:
            state = st.State(*(_part(file, f"state.{name}", 1) for name in names_of(st.State)))
            groups = st.Groups(
                *(_part(file, f"groups.{name}", 2 if name in _TABLES else 1) for name in names_of(st.Groups))
            )
            t_start, first_step = _part(file, "times", 1)
            own = _memory(file, "method.")
            memories = tuple(_memory(file, f"body {k}.") for k in range(int(file["bodies"].item())))
            kept = InteriorSnapshot(_part(file, "wrenches", 2), memories)
            following, signals, states = (_part(file, name, 1) for name in ("sample", "signals", "controller_states"))
            sampling = SamplingMemory(str(file["controllers"]), following, signals, states)
            codes = tuple(str(code) for code in file["event_codes"])
            events = EventMemory(codes, _part(file, "events", 2), bool(file["new_pace"].item()))
            parts = state, groups, own, float(first_step), _part(file, "rows", 1), kept, sampling, events
            snapshot = Snapshot(*parts)
            return Checkpoint(str(file["method"]), str(file["scene"]), float(t_start), snapshot)
        except (KeyError, ValueError, TypeError, AttributeError, OverflowError) as reason:
            raise RecordError(f"{path} is not a checkpoint of a machine: {reason}") from reason


def _refuse_other_layout(path: str | Path, file: Mapping[str, NDArray[Any]]) -> None:
    """Raise RecordError where a file has other parts of the state than this version remembers."""
    known = {f"state.{name}" for name in names_of(st.State)} | {f"groups.{name}" for name in names_of(st.Groups)}
    found = {name for name in file if name.startswith(("state.", "groups."))}
    if not found:
        return  # none of a machine
    sizes = {"state.numbers": (st.N_NUMBER,), "state.counts": (st.N_COUNT,)}
    other = sorted(found ^ known) or [name for name, size in sizes.items() if file[name].shape != size]
    if other:
        raise RecordError(
            f"{path} was written by another version of flexmbd: {', '.join(other)} of the state is not as this one has "
            "it; go on with that version, or start anew"
        )


def _part(file: Mapping[str, NDArray[Any]], name: str, dimensions: int) -> NDArray[Any]:
    """An array as kernels take it, for they trust its type."""
    found = np.ascontiguousarray(file[name])
    kind = np.int64 if name in _WHOLE else np.float64
    if found.dtype != kind or file[name].ndim != dimensions:
        raise ValueError(f"{name} is an array {file[name].shape} of {found.dtype}")
    return found


def _refuse_damaged(snapshot: Snapshot, start: Start) -> None:
    """Raise RecordError where arrays of a snapshot are not those of a scene: kernels ask nothing."""
    state, groups, scene = snapshot.state, snapshot.groups, start.scene
    sizes = (scene.nx, scene.nv, scene.nv, len(snapshot.rows), st.N_NUMBER, st.N_COUNT)
    fresh = new_groups(scene)
    rows, all_rows = snapshot.rows, len(start.unreduced.plan.rows)
    faults = {
        "its arrays have other sizes": [len(part) for part in state.fields().values()] != list(sizes),
        "its groups are others": any(
            not np.array_equal(getattr(groups, name), getattr(fresh, name)) for name in ("of", "kind", "full", "floor")
        )
        or any(part.shape != getattr(fresh, name).shape for name, part in groups.fields().items()),
        "its rows are none of the scene": not (rows.dtype == np.int64 and rows.ndim == 1)
        or len(np.unique(rows)) != len(rows)
        or not ((rows >= 0) & (rows < all_rows)).all(),
        "it has numbers that are not finite": not all(
            np.isfinite(part).all() for part in (state.x, state.v, state.a, state.multipliers, snapshot.first_step)
        ),
    }
    if not any(faults.values()):
        counts, numbers = state.counts, state.numbers
        faults["its counts are impossible"] = bool(
            (counts < 0).any()
            or counts[st.WORST] >= max(scene.nv, 1)
            or (counts[[st.FIXED_STEP, st.AT_BREAK, st.WATCH_ROWS]] > 1).any()
            or counts[st.RESELECT_ROWS] > st.NOT_ENFORCED
            or np.isnan(numbers).any()
            or not np.isfinite(numbers[[st.TIME, st.STEP, st.TOLERANCE]]).all()
        )
        kept = () if scene.interiors is None else scene.interiors.placed
        wrenches = (sum(len(one.rows) for one in kept), 6)
        faults["its bodies with history are others"] = (
            len(snapshot.interiors.memories) != len(kept) or snapshot.interiors.wrenches.shape != wrenches
        )
    faults["its events are impossible"] = snapshot.events.is_damaged
    for what, found in faults.items():
        if found:
            raise RecordError(f"the checkpoint is damaged: {what}; take the one before, or start anew")


def _memory(file: Mapping[str, NDArray[np.generic]], prefix: str) -> Memory:
    """The arrays whose names begin with ``prefix``: the memory of a method, or of a body with history."""
    return {name.removeprefix(prefix): file[name] for name in file if name.startswith(prefix)}
