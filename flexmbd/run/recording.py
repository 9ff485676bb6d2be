"""Fields of bodies with history, kept in an HDF5 file while a machine runs, and read from it.

    /                                        attributes format = "flexmbd recording", version
    /t                                       (nt,) s
    /bodies/<body>/node, x, triangle                undeformed, in body axes (`InteriorMesh`)
    /bodies/<body>/fields/<name>                    (nt, k), (nt, k, m): position, velocity, von_mises, ...
    /bodies/<body>/body_position, body_rotation     (nt, 3), (nt, 3, 3)
    /bodies/<body>/largest, largest_row             (nt,)

The file is closed between blocks of instants, so that a run that is killed leaves what was written.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.errors import RecordError, SceneError
from flexmbd.given import is_number
from flexmbd.multibody.bodies.continuum_body import ContinuumBody
from flexmbd.multibody.interiors.observed import InteriorMesh, ObservedInterior
from flexmbd.record.stress_field import StressField

if TYPE_CHECKING:
    import h5py

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

FORMAT, VERSION = "flexmbd recording", 1

# Instants are multiples of a time, to round-off.
_ROUND_OFF = 1e-9


@dataclass(frozen=True)
class Recording:
    """Fields of bodies with history are to be kept, at the user's rate, in a file.

    Kept is the first accepted step at each multiple of ``every`` from the start, or after it, the start itself and the
    last step.  The steps are those of a run that keeps nothing.

    Attributes:
        path: of the HDF5 file; an existing one is replaced, or goes on where the run is a restart.
        every: s of simulated time.

    Raises:
        SceneError: ``every`` is not a positive time.
    """

    path: str | Path
    every: float

    def __post_init__(self) -> None:
        if not isinstance(self.path, (str, Path)):
            raise SceneError(f"a recording needs the path of a file, got {self.path!r}")
        if not (is_number(self.every) and self.every > 0.0):
            raise SceneError(f"a recording every {self.every!r} s: that must be positive and finite")

    def index(self, t: float, begun: float) -> int:
        """How many multiples have passed at t (s) of a simulation that began at ``begun`` (s)."""
        return int(np.floor((t - begun) / self.every + _ROUND_OFF))


@dataclass(frozen=True, eq=False)
class BodyRecording:
    """The fields of one body, read from a recording; vectors and tensors in inertial axes.

    Attributes:
        path: of the file.
        name: of the body.
        body: where it is at hand; points of its mesh are found by it.
    """

    path: Path
    name: str
    body: ContinuumBody | None = None

    @property
    def t(self) -> FloatArray:
        """(nt,) s, the instants."""
        with opened(self.path) as file:
            return np.asarray(file["t"][()])

    @property
    def mesh(self) -> InteriorMesh:
        """The undeformed nodes, in body axes, and the surface."""
        with opened(self.path) as file:
            group = _group(file, self)
            return InteriorMesh(group["node"][()], group["x"][()], group["triangle"][()])

    @property
    def fields(self) -> tuple[str, ...]:
        """Names of the fields: position, velocity, acceleration, stress, von_mises, and those of the form's history."""
        with opened(self.path) as file:
            return tuple(_group(file, self)["fields"])

    def values(self, field: str, *, row: int | slice = slice(None)) -> FloatArray:
        """(nt, k) or (nt, k, m), a field at all nodes and instants, or at the instants of ``row``.

        Raises:
            SceneError: there is no such field; the message lists those there are.
        """
        with opened(self.path) as file:
            return np.asarray(self._dataset(file, field)[row], dtype=np.float64)

    def series(self, field: str, *, node: int | None = None, point: ArrayLike | None = None) -> FloatArray:
        """(nt,) or (nt, m), a field at a node or a point of the undeformed mesh.

        Args:
            field: its name.
            node: number in the mesh's input.
            point: (3,) m of the undeformed body, in body axes; collective over the body's ranks.  Between nodes go the
                shape functions of its cell.

        Raises:
            SceneError: no such field or node, or both or none are given.
            MeshError: no cell holds the point.
        """
        rows, weights = self._place(node, point)
        order = np.argsort(rows)
        with opened(self.path) as file:
            found = np.asarray(self._dataset(file, field)[:, rows[order]], dtype=np.float64)
        return np.asarray(np.einsum("tk...,k->t...", found, weights[order]))

    def position(self, *, node: int | None = None, point: ArrayLike | None = None) -> FloatArray:
        """(nt, 3) m, of a node or point, as of ``series``."""
        return self.series("position", node=node, point=point)

    def velocity(self, *, node: int | None = None, point: ArrayLike | None = None) -> FloatArray:
        """(nt, 3) m/s, of a node or point, as of ``series``."""
        return self.series("velocity", node=node, point=point)

    def acceleration(self, *, node: int | None = None, point: ArrayLike | None = None) -> FloatArray:
        """(nt, 3) m/s^2, of a node or point, as of ``series``."""
        return self.series("acceleration", node=node, point=point)

    def pose(self) -> tuple[FloatArray, FloatArray]:
        """(nt, 3) m and (nt, 3, 3): the body axes, as the first interface frame carries them."""
        with opened(self.path) as file:
            group = _group(file, self)
            return np.asarray(group["body_position"][()]), np.asarray(group["body_rotation"][()])

    def largest(self) -> FloatArray:
        """(nt,) Pa, the largest von Mises stress at any point of a cell."""
        with opened(self.path) as file:
            return np.asarray(_group(file, self)["largest"][()])

    def between(self, field: str, t: ArrayLike) -> FloatArray:
        """(k, nodes) or (k, nodes, m), a field at times (k,) s, linear between the instants."""
        wanted, instants = np.atleast_1d(np.asarray(t, dtype=float)), self.t
        found = []
        with opened(self.path) as file:
            data = self._dataset(file, field)
            for time in wanted:
                k = int(np.clip(np.searchsorted(instants, time, side="right") - 1, 0, max(len(instants) - 2, 0)))
                if len(instants) == 1:
                    found.append(np.asarray(data[0], dtype=np.float64))
                    continue
                share = np.clip((time - instants[k]) / (instants[k + 1] - instants[k]), 0.0, 1.0)
                found.append((1.0 - share) * data[k].astype(np.float64) + share * data[k + 1].astype(np.float64))
        return np.array(found)

    def stress(self, t: float) -> StressField:
        """Displacement and stress, in body axes, at the instant nearest to t (s)."""
        k = int(np.argmin(np.abs(self.t - t)))
        p, R = (part[k] for part in self.pose())
        mesh = self.mesh
        with opened(self.path) as file:
            group = _group(file, self)
            largest, row = float(group["largest"][k]), int(group["largest_row"][k])
        xx, yy, zz, yz, xz, xy = self.values("stress", row=k).T
        stress = np.stack([xx, xy, xz, xy, yy, yz, xz, yz, zz], axis=1).reshape(-1, 3, 3)
        return StressField(
            node=mesh.node,
            x=mesh.x,
            triangle=mesh.triangle,
            displacement=(self.values("position", row=k) - p) @ R - mesh.x,
            stress=R.T @ stress @ R,
            von_mises=self.values("von_mises", row=k),
            max=largest,
            max_x=mesh.x[row],
        )

    def _place(self, node: int | None, point: ArrayLike | None) -> tuple[IntArray, FloatArray]:
        """Rows of nodes, and their weights."""
        if (node is None) == (point is None):
            raise SceneError("give a node or a point, node=12 or point=(x, y, z)")
        if node is not None:
            rows = np.flatnonzero(self.mesh.node == node)
            if not len(rows):
                raise SceneError(f"body {self.name!r} has no node of the number {node!r}")
            return rows, np.ones(1)
        place = np.asarray(point, dtype=float)
        if place.shape != (3,) or not np.isfinite(place).all():
            raise SceneError(f"a point is three finite numbers (m), got {point!r}")
        if self.body is None or not isinstance(self.body.interior, ObservedInterior):
            raise SceneError("points are found by the body itself; ask the trajectory's recording, or for a node")
        return self.body.interior.locate(place)

    def _dataset(self, file: Any, field: str) -> Any:
        known = _group(file, self)["fields"]
        if field not in known:
            raise SceneError(f"body {self.name!r} has no field {field!r}; it has {', '.join(known)}")
        return known[field]


def load_recording(path: str | Path) -> dict[str, BodyRecording]:
    """The bodies of a recording by name.

    Raises:
        RecordError: it cannot be read, or is no recording.
    """
    with opened(Path(path)) as file:
        return {name: BodyRecording(Path(path), name) for name in file["bodies"]}


def _group(file: Any, recording: BodyRecording) -> Any:
    if recording.name not in file["bodies"]:
        raise RecordError(f"{recording.path} holds no body {recording.name!r}")
    return file["bodies"][recording.name]


def opened(path: Path, mode: str = "r") -> h5py.File:
    """The file.

    Raises:
        RecordError: it cannot be read, or is no recording.
    """
    try:
        file = hdf5().File(path, mode)
    except OSError as reason:
        raise RecordError(f"{path} cannot be read as a recording: {reason}") from reason
    if file.attrs.get("format") != FORMAT or file.attrs.get("version") != VERSION:
        file.close()
        raise RecordError(f"{path} is no recording of version {VERSION}")
    return file


def hdf5() -> Any:
    """The HDF5 library."""
    import h5py  # loads only where something is recorded

    return h5py
