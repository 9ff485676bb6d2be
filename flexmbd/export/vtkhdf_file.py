"""VTKHDF: pictures for ParaView of a body's modes and of a machine that moves (docs/export/vtkhdf.md).

An UnstructuredGrid of triangles (or of points alone), version 2.0 of the layout that VTK's documentation gives. A
motion has its places one instant after another in one dataset; the group Steps says where each instant begins, and
that all share the triangles.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from flexmbd.errors import ExportError
from flexmbd.export.loss import Capabilities, check_body, checked_writer
from flexmbd.files.whole_file import first_line, part_file, refuse_no_room
from flexmbd.given import checked
from flexmbd.multibody.contact.contact import Contact
from flexmbd.multibody.contact.hard_contact import Hard, HardContact
from flexmbd.multibody.contact.hard_group import HardGroup
from flexmbd.multibody.contact.surface_contact import SurfaceContact
from flexmbd.multibody.interiors.observed import InteriorMesh
from flexmbd.record.groups import FloatArray, IntArray
from flexmbd.record.reduced_body import ReducedBody
from flexmbd.run.recording import BodyRecording
from flexmbd.run.trajectory import Trajectory
from flexmbd.visual.drawn_scene import drawn_scene
from flexmbd.visual.part import Part, placed
from flexmbd.visual.pressure_skin import PressureSkin

if TYPE_CHECKING:
    import h5py

CAPABILITIES = Capabilities(interfaces=0, rotations=False, damping=False, large_motion=False, nodes=True)

# VTK's numbers of kinds of cells, and how many points each has.
_POINT, _TRIANGLE = 1, 5
_PRESSURE = "contact_pressure"
# Points of as many instants as are written at once: HDF5 takes longer for a few than to place them.
_BLOCK = 1 << 18
# Bytes of all but arrays of numbers in the file, and more.
_HEADERS = 1 << 16


@checked_writer
def vtkhdf_modes(body: ReducedBody, path: str | Path, *, lossy: bool = False) -> tuple[str, ...]:
    """Write the shapes of a body's modes as vectors on its surface, or at its nodes, for ParaView. Not collective.

    Vectors are called ``mode 1`` and so on, in m per unit of a modal coordinate, in the body frame's axes as the
    places are; the field data ``frequency`` holds their frequencies (Hz). ParaView's filter Warp By Vector shows them.

    Args:
        body: with `surface`, or else `modes`.
        path: destination.
        lossy: as of all formats; for pictures nothing is refused.

    Returns:
        The parts that are not in the file, a phrase each: all but the shapes.

    Raises:
        ExportError: the record has neither group, or the destination cannot be written.
    """
    check_body(body)
    if body.surface is not None:
        x, cells, phi = body.surface.x, body.surface.triangle, body.surface.phi
    elif body.modes is not None:
        x, cells, phi = body.modes.x, np.arange(len(body.modes.x))[:, None], body.modes.phi
    else:
        raise ExportError(
            "the record has no surface and no modes at nodes: "
            "reduce the body with keep=Keep(surface=True) or Keep(modes=True)"
        )

    def fill(file: h5py.File) -> None:
        root = _grid(file, len(x), cells)
        root["Points"] = x
        points = root.create_group("PointData")
        for i in range(body.n_modes):
            points[f"mode {i + 1}"] = phi[:, :, i]
        root.create_group("FieldData")["frequency"] = np.sqrt(body.stiffness) / (2.0 * np.pi)

    _write(path, fill, size=8 * (x.size + phi.size + 2 * cells.size))
    return ("everything but the shapes and frequencies of the modes: the file is for pictures",)


@checked(error=ExportError)
def vtkhdf(
    run: Trajectory, path: str | Path, *, t: ArrayLike | None = None, pressures: Sequence[SurfaceContact] = ()
) -> tuple[str, ...]:
    """Write a machine's motion for ParaView: its bodies as in a film. Not collective; the root writes.

    One mesh in the inertial frame, with the vector ``displacement`` (m, in inertial axes: of the deformation, without
    the body frame's motion) at its points and ``body`` at its triangles: the number, from 0, of the body in the
    dataset ``/bodies``, which holds their names.  Bodies are there by their shapes or surfaces, others by sticks and
    balls, the ground by its shape.  Bodies with history are there as they were recorded, linear between
    the instants, with their scalar fields (``von_mises`` in Pa, ``plastic_strain``, ...; not a number on other bodies).
    Of ``pressures`` reduced bodies have the field ``contact_pressure`` (Pa), even over each patch.

    Args:
        run: of any machine.
        path: destination.
        t: (k,) s, ascending instants; by default those of the recording, or without one those of the steps.
        pressures: contacts of elastic surfaces, as of ``Trajectory.animate``.

    Returns:
        The parts that are not in the file, a phrase each: bodies that are shown by symbols alone, forces of contacts.

    Raises:
        ExportError: the instants do not ascend, the machine has no body, or the destination cannot be written.
        SceneError: an instant outside the trajectory, or what is no contact of elastic surfaces.
        PictureError: a record does not say where the facets of its patches are.
    """
    own = run.recordings[0].t if run.recordings else run.t
    instants = np.atleast_1d(own if t is None else np.asarray(t, dtype=np.float64))
    if instants.ndim != 1 or len(instants) == 0 or not (np.diff(instants) > 0.0).all():
        raise ExportError("t must be instants that ascend, each once")
    frames = [part for one in run.recordings if one.body is not None for part in one.body.parts]
    shown = {name: body for name, body in run.bodies.items() if not any(body is part for part in frames)}
    pressed = (lambda t: run.contact_pressures(pressures, t=t)) if len(pressures) else None
    scene = drawn_scene(run, instants, notes=[""] * len(instants), pressures=pressed)
    parts = [part for part in (*scene.parts, *scene.fixed) if part.label in {*shown, run.scene.parts.ground.name}]
    skins: list[_Skin | _RecordedSkin] = [_Skin(part.label, part) for part in parts]
    skins += [_RecordedSkin.of(one, instants) for one in run.recordings]
    if not skins:
        raise ExportError("the machine has no body, and so nothing to be shown: add one")
    covered = [body for part in scene.parts for body in part.covers]
    bare = [name for name, body in shown.items() if not any(body is other for other in covered)]
    if run.team.is_root:
        points = len(instants) * sum(skin.size for skin in skins)
        size = points * (36 + 4 * len({name for skin in skins for name in skin.fields}))
        _write(path, lambda file: _fill(file, skins, instants), size=size)
    return (*_without_surface(bare), *_without_forces(run, pressures))


def _without_surface(bare: Sequence[str]) -> list[str]:
    return [f"bodies shown by symbols, for want of a shape or a surface: {', '.join(bare)}"] if bare else []


def _without_forces(run: Trajectory, pressures: Sequence[SurfaceContact]) -> list[str]:
    """What the file does not have of contacts."""
    kinds = (Contact, HardContact, HardGroup, SurfaceContact)
    met = [one for one in run.scene.index.forces if isinstance(one, kinds)]
    left = [one for one in met if not any(one is given for given in pressures)]
    phrases = []
    if left:
        more = f" and {len(left) - 1} more" if len(left) > 1 else ""
        elastic = any(isinstance(one, SurfaceContact) for one in left)
        remedy = "; pressures= has those of elastic surfaces" if elastic else ""
        phrases.append(f"forces of contacts ({left[0].what}{more}){remedy}")
    if any(isinstance(one.law, Hard) and one.law.mu > 0.0 for one in pressures):
        phrases.append("friction of elastic surfaces")
    return phrases


@dataclass(frozen=True, eq=False)
class _Skin:
    """What a film shows of a body."""

    name: str
    part: Part

    @property
    def fields(self) -> tuple[str, ...]:
        """The pressure, of a body that has one."""
        return (_PRESSURE,) if isinstance(self.part, PressureSkin) else ()

    @property
    def triangle(self) -> IntArray:
        """(t, 3) vertices."""
        return self.part.triangle

    @property
    def size(self) -> int:
        """How many vertices."""
        return len(self.part.x)

    def at(self, k: int) -> tuple[FloatArray, FloatArray]:
        """(v, 3) places and displacements at instant k, in the inertial frame."""
        return placed(self.part, k)[0], self.part.displacement(k) @ self.part.pose[k, :3, :3].T

    def value(self, field: str, k: int) -> FloatArray:
        """(v,) its field at instant k."""
        return self.part.at(k)[1]


@dataclass(frozen=True, eq=False)
class _RecordedSkin:
    """The surface of a recorded body with history.

    Attributes:
        shown: (v,) which of its nodes are on the surface.
        fields: names of its scalar fields.
    """

    name: str
    recording: BodyRecording
    t: FloatArray
    mesh: InteriorMesh
    shown: IntArray
    triangle: IntArray
    fields: tuple[str, ...]

    @classmethod
    def of(cls, recording: BodyRecording, t: FloatArray) -> _RecordedSkin:
        mesh = recording.mesh
        shown, triangle = np.unique(mesh.triangle, return_inverse=True)
        scalars = tuple(name for name in recording.fields if recording.values(name, row=slice(0, 1)).ndim == 2)
        return cls(recording.name, recording, t, mesh, shown, triangle.reshape(-1, 3), scalars)

    @property
    def size(self) -> int:
        """How many vertices."""
        return len(self.shown)

    def at(self, k: int) -> tuple[FloatArray, FloatArray]:
        """(v, 3) places and displacements at instant k, in the inertial frame."""
        places = self.recording.between("position", self.t[k])[0, self.shown]
        p, R = self.recording.pose()
        row = int(np.argmin(np.abs(self.recording.t - self.t[k])))
        return places, places - p[row] - self.mesh.x[self.shown] @ R[row].T

    def value(self, field: str, k: int) -> FloatArray:
        """(v,) a field at instant k."""
        return self.recording.between(field, self.t[k])[0, self.shown]


def _fill(file: h5py.File, skins: list[_Skin | _RecordedSkin], t: FloatArray) -> None:
    starts = np.cumsum([0, *(skin.size for skin in skins)])
    triangles = np.vstack([skin.triangle + start for skin, start in zip(skins, starts, strict=False)])
    n = int(starts[-1])
    root = _grid(file, n, triangles)
    points = root.create_dataset("Points", (len(t) * n, 3), dtype=np.float64)
    moves = root.create_dataset("PointData/displacement", (len(t) * n, 3), dtype=np.float32)
    names = sorted({name for skin in skins for name in skin.fields})
    values = {name: root.create_dataset(f"PointData/{name}", (len(t) * n,), dtype=np.float32) for name in names}
    at_once = max(1, _BLOCK // max(n, 1))
    for first in range(0, len(t), at_once):
        instants = range(first, min(first + at_once, len(t)))
        x, moved = np.empty((len(instants), n, 3)), np.empty((len(instants), n, 3), np.float32)
        scalars = {name: np.full((len(instants), n), np.nan, np.float32) for name in names}
        for skin, start, end in zip(skins, starts, starts[1:], strict=False):
            for i, k in enumerate(instants):
                x[i, start:end], moved[i, start:end] = skin.at(k)
                for name in skin.fields:
                    scalars[name][i, start:end] = skin.value(name, k)
        rows = slice(first * n, instants.stop * n)
        points[rows], moves[rows] = x.reshape(-1, 3), moved.reshape(-1, 3)
        for name in names:
            values[name][rows] = scalars[name].ravel()
    bodies = list(dict.fromkeys(skin.name for skin in skins))
    numbers = np.array([bodies.index(skin.name) for skin in skins], dtype=np.int32)
    root["CellData/body"] = np.repeat(numbers, [len(skin.triangle) for skin in skins])
    steps, whole = root.create_group("Steps"), np.zeros(len(t), np.int64)
    steps.attrs["NSteps"] = len(t)
    steps["Values"] = t
    steps["NumberOfParts"] = whole + 1
    steps["PartOffsets"] = whole
    steps["PointOffsets"] = steps["PointDataOffsets/displacement"] = n * np.arange(len(t))
    for name in names:
        steps[f"PointDataOffsets/{name}"] = n * np.arange(len(t))
    # the triangles are those of the first instant at all of them
    steps["CellOffsets"] = steps["ConnectivityIdOffsets"] = whole[:, None]
    steps["CellDataOffsets/body"] = whole
    file["bodies"] = bodies


def _grid(file: h5py.File, n: int, cells: IntArray) -> Any:
    """The group VTKHDF with n points and cells (c, points of each), all of one kind."""
    import h5py

    root = file.create_group("VTKHDF", track_order=True)
    root.attrs["Version"] = np.array([2, 0], np.int64)
    kind = b"UnstructuredGrid"
    root.attrs.create("Type", kind, dtype=h5py.string_dtype("ascii", len(kind)))
    count, corners = cells.shape
    root["NumberOfPoints"] = np.array([n], np.int64)
    root["NumberOfCells"] = np.array([count], np.int64)
    root["NumberOfConnectivityIds"] = np.array([cells.size], np.int64)
    root["Connectivity"] = np.ascontiguousarray(cells, np.int64).ravel()
    root["Offsets"] = corners * np.arange(count + 1, dtype=np.int64)
    root["Types"] = np.full(count, _TRIANGLE if corners == 3 else _POINT, np.uint8)
    return root


def _write(path: str | Path, fill: Callable[[h5py.File], None], *, size: int) -> None:
    """Let ``fill`` write a file of some ``size`` bytes and more; an existing file survives until it is complete."""
    import h5py

    try:
        with part_file(Path(os.path.realpath(path))) as (part, room):
            refuse_no_room(room, size + _HEADERS)
            with h5py.File(part, "w", locking=False) as file:  # the part has a lock of ours
                fill(file)
    except (OSError, RuntimeError) as error:
        raise ExportError(
            f"cannot write {path}: {first_line(error)}; nothing was changed there: choose a folder that exists, "
            "that you may write to and that has the space"
        ) from error
