"""A compiled scene with other numbers: bodies, frames, joints and forces replaced by ones of the same structure.

The numbers are written by the same functions that wrote the scene's own, so a variant is to the bit what the scene
would be that is built with these numbers.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import SceneError
from flexmbd.multibody.bodies.body import Body, FlexibleBody, Frame, RigidBody
from flexmbd.multibody.contact.surface_contact import SurfaceContact, refuse_other_patches, refuse_other_surfaces
from flexmbd.multibody.force.distributed_load import DistributedLoad
from flexmbd.multibody.force.protocol import Force, SwitchValue
from flexmbd.multibody.functions.callback import Callbacks
from flexmbd.multibody.functions.switched import Switched
from flexmbd.multibody.functions.time_function import TimeRow, as_row, load_row
from flexmbd.multibody.joint.connection import Connection, motion_name
from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.arrays import Plan, open_horizon
from flexmbd.multibody.kernels.reading.tree import mode_places
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.plan.force_places import ForceSpan
from flexmbd.multibody.plan.forces import ForceTable
from flexmbd.multibody.plan.numbering import Numbering, modal_sizes, rigid_row
from flexmbd.multibody.plan.time_data import data_with_integrals
from flexmbd.multibody.scene_index import ForceRows, IdentityMap, SceneIndex, StatePlaces

FloatArray = NDArray[np.float64]


def vary(scene: CompiledScene, substitutes: IdentityMap[object, Any]) -> CompiledScene:
    """The scene with other numbers.

    Args:
        scene: as it was compiled, with all its constraint rows.
        substitutes: bodies, frames, joints and forces of the scene, and what has their numbers now.

    Raises:
        SceneError: the numbers change what is computed, so that the scene must be built anew with them; or a force
            cannot have them.
    """
    return _Variation(scene, substitutes).written()


class _Variation:
    """The arrays of a scene, copied where they are first written to."""

    def __init__(self, scene: CompiledScene, substitutes: IdentityMap[object, Any]) -> None:
        self._scene, self._plan = scene, scene.plan
        self._substitutes = substitutes
        known = IdentityMap([*scene.index.substitutes.items(), *substitutes.items()])
        self._index: SceneIndex = replace(scene.index, substitutes=known)
        self._new: dict[str, NDArray[Any]] = {}
        self._times: list[TimeRow] | None = None
        self._states: list[tuple[object, StatePlaces]] = []
        self._extent = scene.extent

    def written(self) -> CompiledScene:
        """Write all numbers that differ."""
        bodies, frames, forces = self._changed()
        records = [body for body in bodies if isinstance(body, FlexibleBody)]
        if (bodies or frames or forces) and self._scene.sources.is_awaited:
            raise SceneError(
                "a scene with BearingFriction, KaneForce or KaneBody can vary initial coordinates and velocities "
                "alone, for these forces keep the numbers of the whole scene; build the scene anew"
            )
        for flexible in records:
            self._write_record(flexible)
        for frame in frames:
            self._write_frame(frame)
        for body in bodies:
            self._write_rigid(body)
        if bodies or frames:
            self._write_extent(bodies, frames)
        for force in forces:
            self._write_force(force)
        for thing in self._substitutes:
            if (
                isinstance(thing, Connection)
                and self._index.now(thing).motion is not self._scene.index.now(thing).motion
            ):
                self._write_motion(thing)
        full, floor = self._scene.group_full, self._scene.group_floor
        if self._extent != self._scene.extent or records:
            full, floor = group_sizes(self._scene, self._index, self._extent)
        callbacks = self._scene.callbacks.beside()
        return replace(
            self._scene,
            plan=self._plan.replace(**self._new, flag=callbacks.flag, horizon=open_horizon()),
            callbacks=callbacks,
            index=replace(self._index, states=IdentityMap([*self._index.states.items(), *self._states])),
            extent=self._extent,
            time_rows=self._scene.time_rows if self._times is None else tuple(self._times),
            group_full=full,
            group_floor=floor,
            varied=True,
        )

    def _changed(self) -> tuple[list[Body], list[Frame], list[Force]]:
        """Bodies whose mass or modes changed, all frames that moved, and forces."""
        bodies: list[Body] = []
        frames: list[Frame] = []
        forces: list[Force] = []
        for thing, now in self._substitutes.items():
            if isinstance(thing, Frame):
                frames.append(thing)
            elif isinstance(thing, FlexibleBody):
                if now.record is not thing.record:
                    bodies.append(thing)
                    frames += self._scene.sources.frames_of(thing)
                    forces += [f for f in self._scene.sources.forces if _hangs_on(f, thing)]
                    for force in self._scene.index.forces:
                        if isinstance(force, SurfaceContact):
                            refuse_other_patches(force, thing, now.record)
            elif isinstance(thing, RigidBody):
                bodies.append(thing)
            elif not isinstance(thing, Connection):
                forces.append(thing)  # type: ignore[arg-type]
        return bodies, frames, list(IdentityMap((force, None) for force in forces))

    def _array(self, name: str) -> NDArray[Any]:
        """An array of the plan, to be written to."""
        if name not in self._new:
            self._new[name] = getattr(self._plan, name).copy()
        return self._new[name]

    def _now(self, name: str) -> NDArray[Any]:
        """An array of the plan as it stands, to be read."""
        found: NDArray[Any] = self._new.get(name, getattr(self._plan, name))
        return found

    def _write_rigid(self, body: Body) -> None:
        self._array("rigid")[self._index.bodies[body]] = rigid_row(self._index.now(body))

    def _write_frame(self, frame: Frame) -> None:
        now, frames = self._index.frame_now(frame), self._array("frames")
        for row in self._scene.sources.rows_of.get(frame, []):
            marker = self._scene.sources.markers[row]
            if marker is None:
                continue
            frames[row] = np.concatenate([now.p_BF_B, (now.R_BF @ marker.turn).ravel()])
            place, strain = map(int, self._plan.frame_of[row, at.FRAME_MODES :])
            if (place >= 0) != (now.modes is not None):
                raise SceneError(f"frame {frame.label}: one record deforms there and the other does not")
            if now.modes is not None and mode_places(place, now.modes) != (place, strain):
                raise SceneError(f"frame {frame.label}: one record has nonlinear stiffness and the other has not")
            if now.modes is not None:
                self._array("modal")[place : place + now.modes.size] = now.modes.ravel()

    def _write_record(self, body: FlexibleBody) -> None:
        """The mass integrals, stiffness (linear and of large displacements), damping and rotors of another record."""
        row = self._plan.flex[self._plan.tree[self._index.bodies[body], at.FLEX]]
        record, label = self._index.now(body).record, f"body {body.name!r}"
        there, here = ({i.name for i in r.interfaces} for r in (record, body.record))
        if there != here:
            raise SceneError(f"{label}: the record has the interfaces {sorted(there)}, not {sorted(here)}")
        laid = Numbering(body, self._extent, Callbacks(self._scene.parts.team))
        laid.modal_size = first = int(row[at.MODAL_FIRST])
        laid.add_flex(record)
        if laid.flex[0] != row.tolist():
            raise SceneError(
                f"{label}: one record has damping, membrane strains, nonlinear stiffness or gyroscopic forces that the "
                "other has not"
            )
        self._array("modal")[first : laid.modal_size] = np.concatenate(laid.modal)

    def _write_extent(self, bodies: Sequence[Body], frames: Sequence[Frame]) -> None:
        rigid = IdentityMap((body, self._now("rigid")[self._index.bodies[body]][None]) for body in bodies)
        places = IdentityMap((frame, self._index.frame_now(frame).p_BF_B[None]) for frame in frames)
        self._extent = self._scene.sources.extents_with(rigid, places, 1)[0]
        if self._extent == self._scene.extent:
            return
        for scaled in self._scene.sources.scaled:
            numbers = scaled.numbers(self._extent)
            self._array("data")[scaled.place : scaled.place + numbers.size] = numbers

    def _write_force(self, force: Force) -> None:
        """Let a force element enter its rows anew, in their former places."""
        span, rows = self._scene.sources.forces[force], self._scene.index.forces[force]
        now = self._index.now(force)
        if isinstance(now, DistributedLoad):
            now = replace(now, body=self._index.now(now.body))
        now.check()
        if isinstance(force, SurfaceContact) and isinstance(now, SurfaceContact):
            refuse_other_surfaces(force, now)
        table = _Replay(self._scene, self._index, span.data.start, span.times.start, span, force)
        now.assemble(table)
        what = ", ".join(dict.fromkeys(self._scene.element_names[k] for k in rows.elements)) or type(force).__name__
        if not table.fits(self._plan, rows, span.data.stop, span.times.stop):
            raise SceneError(
                f"{what}: with these numbers other things are computed than in the compiled scene, or Python functions "
                "take part; build the scene anew"
            )
        self._states += [(force, places) for places in table.laid_states]
        if len(span.data):
            self._array("data")[span.data.start : span.data.stop] = np.concatenate(table.laid)
        for k, row in zip(span.times, table.laid_times, strict=True):
            self._write_time(k, row, what)

    def _write_motion(self, connection: Connection) -> None:
        what = motion_name(connection)
        row = as_row(self._index.now(connection).motion, what, motion=True)
        self._write_time(self._scene.time_names.index(what), row, what)

    def _write_time(self, k: int, row: TimeRow, what: str) -> None:
        """Write the data of a function of time in row k."""
        if self._times is None:
            self._times = list(self._scene.time_rows)
        before = self._times[k]
        shape = [(r.kind, r.count, r.data.size, r.code, r.addresses if r.call is None else ()) for r in (before, row)]
        if shape[0] != shape[1] or row.call is not before.call:
            raise SceneError(
                f"{what}: in a compiled scene {before.text} can only give way to another function of the same kind and "
                f"size, not to {row.text}"
            )
        self._times[k] = replace(row, addresses=before.addresses)
        offset = int(self._plan.times[k, at.TIME_OFFSET])
        data = data_with_integrals(row)
        self._array("time_data")[offset : offset + data.size] = data


def group_sizes(scene: CompiledScene, index: SceneIndex, extent: float) -> tuple[FloatArray, FloatArray]:
    """Full sizes and floors of the error norm's groups in a variant of a scene with this index and extent (m)."""
    lengths = scene.group_kind == kinds.GROUP_LENGTH
    full, floor = scene.group_full.copy(), scene.group_floor.copy()
    full[lengths] = floor[lengths] = extent
    for body, slots in index.modes.items():
        record = index.now(body).reduced()
        if record is not None and record.n_modes:
            group = scene.group_of[slots.v.start]
            full[group], floor[group] = modal_sizes(extent, record)
    return full, floor


def _hangs_on(force: object, body: FlexibleBody) -> bool:
    """Whether a force element has numbers of a body's record."""
    return isinstance(force, DistributedLoad) and force.body is body


class _Replay(ForceTable):
    """Rows and parameters of one force element, from its first places in the scene."""

    def __init__(
        self, scene: CompiledScene, index: SceneIndex, first_number: int, first_time: int, span: ForceSpan, force: Force
    ) -> None:
        numbering = Numbering(scene.parts.ground, scene.extent, Callbacks(scene.parts.team))
        numbering.index = index
        numbering.data, numbering.data_size = [], first_number
        self._first_time, self._numbers = first_time, numbering
        self._of_substitutes = IdentityMap((index.now(body), body) for body in index.modes)
        self._rows, self._places, self._start = iter(span.frames), iter(span.memories), scene.start
        self._old_links, self._known = iter(span.links), scene.index.states
        self._markers, self.laid_states = scene.sources.markers, list[StatePlaces]()
        super().__init__(numbering, scene.parts.ground)
        self._force, self._may_vary = force, True  # else it would not be here

    @property
    def laid(self) -> list[FloatArray]:
        """Its numbers."""
        return self._numbers.data

    @property
    def laid_times(self) -> list[TimeRow]:
        """Its functions of time."""
        return self._numbers.times

    def _prepare_links(self) -> None:
        """They are there."""

    def frame(self, frame: Frame) -> int:
        """The row that it got for this frame before; -1 where that lies elsewhere, for frames vary by themselves."""
        row = next(self._rows, -1)
        marker = self._markers[row] if row >= 0 else None
        return row if marker is None or self._is_there(marker.frame, frame) else -1

    def _is_there(self, known: Frame, frame: Frame) -> bool:
        """Whether two frames are one, or lie at one place of one body."""
        if known is frame or (known.interface is not None and known.interface == frame.interface):
            return True
        places = (known.p_BF_B, frame.p_BF_B), (known.R_BF, frame.R_BF)
        return known.body is frame.body and all(np.array_equal(*both) for both in places)

    def ground(self) -> int:
        """The row that it got before."""
        return next(self._rows, -1)

    def memory(self, names: Mapping[str, float]) -> int:
        """The place that it got before, if it begins with the same values."""
        place = next(self._places, -1)
        first = place + at.N_MEMORY_HEAD
        same = place >= 0 and self._start[first : first + len(names)].tolist() == [*names.values()]
        return place if same else -1

    def late_memory(self, names: Sequence[str]) -> int:
        """The place that it got before."""
        return next(self._places, -1) if names else -1

    def _add_links(self, what: str, names: tuple[str, ...], initial: FloatArray, scale: FloatArray) -> tuple[int, int]:
        """The places that its states got before, if they are as many; their start and sizes may be others."""
        first, link = next(self._old_links, (-1, -1))
        known = next((p for p in self._known.values() if p.v == slice(first, first + len(names))), None)
        if known is None:
            return -1, -1
        self.laid_states.append(replace(known, scale=scale, initial=initial))
        return first, link

    def side(self, switched: Switched, value: SwitchValue, what: str) -> int:
        """The place that it got before."""
        return next(self._places, -1)

    def modes(self, body: Body) -> tuple[int, int]:
        """Places in x and v of a body's first mode."""
        return super().modes(self._of_substitutes.get(body, body))

    def time(self, function: Any, what: str, *, rate: bool = False) -> int:
        """The row that it got before; a Python function keeps its call there."""
        self._numbers.times.append(load_row(function, what, rate=rate))
        return self._first_time + len(self._numbers.times) - 1

    def fits(self, plan: Plan, rows: ForceRows, end: int, last_time: int) -> bool:
        """Whether its rows are those of before but for its numbers."""
        elements = plan.elements[rows.elements.start : rows.elements.stop]
        kept = np.delete(elements, at.EL_NUMBER, axis=1).tolist()
        forces = plan.forces[rows.forces.start : rows.forces.stop].tolist()
        own = [[*row[: at.EL_NUMBER], *row[at.EL_NUMBER + 1 :]] for row in self.elements]
        laid = (self.forces, own, self._numbers.data_size, self._first_time + len(self._numbers.times))
        return laid == (forces, kept, end, last_time) and next(self._rows, None) is None
