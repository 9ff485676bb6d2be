"""Fields of bodies with history, kept in a file while a machine runs, and read from it (`recorded_instants`)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.brief import brief
from flexmbd.errors import RecordError, SceneError
from flexmbd.given import checked, is_number
from flexmbd.multibody.bodies.continuum_body import ContinuumBody
from flexmbd.multibody.interiors.observed import InteriorMesh, ObservedInterior
from flexmbd.record.stress_field import StressField
from flexmbd.round_off import TEN_DIGITS
from flexmbd.run.recorded_instants import RecordedInstants, recorded_instants

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]



@checked()
@dataclass(frozen=True)
class Recording:
    """Fields of bodies with history are to be kept, at the user's rate, in a file.

    Kept is the first accepted step at each multiple of ``every`` from the start, or after it, the start itself and the
    last step.  The steps are those of a run that keeps nothing.

    Attributes:
        path: of the file, of which each block has a checksum; an existing one is replaced, or goes on where the run is
            a restart.
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
        return int(np.floor((t - begun) / self.every + TEN_DIGITS))


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

    __repr__ = brief

    @property
    def t(self) -> FloatArray:
        """(nt,) s, the instants.

        Raises:
            RecordError: the file cannot be read, or is damaged; as of all questions.
        """
        return recorded_instants(self.path).t.copy()

    @property
    def mesh(self) -> InteriorMesh:
        """The undeformed nodes, in body axes, and the surface."""
        found, k = self._found()
        return found.meshes[k]

    @property
    def fields(self) -> tuple[str, ...]:
        """Names of the fields: position, velocity, acceleration, stress, von_mises, and those of the form's history."""
        found, k = self._found()
        return found.fields[k]

    @checked()
    def values(self, field: str, *, row: int | slice = slice(None)) -> FloatArray:
        """(nt, k) or (nt, k, m), a field at all nodes and instants, or at the instants of ``row``.

        Raises:
            SceneError: there is no such field, and the message lists those there are; or no such instant.
        """
        found, k = self._field(field)
        if isinstance(row, slice):
            return np.asarray(found.series(k, lambda body: body["fields"][field])[row], dtype=np.float64)
        nt = len(found.t)
        if not -nt <= row < nt:
            raise SceneError(f"the recording has {nt} instants, and none of the row {row!r}")
        return np.asarray(found.row(k, row % nt, lambda body: body["fields"][field]), dtype=np.float64)

    @checked()
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
        found, k = self._field(field)
        values = np.asarray(found.series(k, lambda body: body["fields"][field][:, rows]), dtype=np.float64)
        return np.asarray(np.einsum("tk...,k->t...", values, weights))

    @checked()
    def position(self, *, node: int | None = None, point: ArrayLike | None = None) -> FloatArray:
        """(nt, 3) m, of a node or point, as of ``series``."""
        return self.series("position", node=node, point=point)

    @checked()
    def velocity(self, *, node: int | None = None, point: ArrayLike | None = None) -> FloatArray:
        """(nt, 3) m/s, of a node or point, as of ``series``."""
        return self.series("velocity", node=node, point=point)

    @checked()
    def acceleration(self, *, node: int | None = None, point: ArrayLike | None = None) -> FloatArray:
        """(nt, 3) m/s^2, of a node or point, as of ``series``."""
        return self.series("acceleration", node=node, point=point)

    def pose(self) -> tuple[FloatArray, FloatArray]:
        """(nt, 3) m and (nt, 3, 3): the body axes, as the first interface frame carries them."""
        found, k = self._found()
        return found.series(k, lambda body: body["body_position"]), found.series(k, lambda body: body["body_rotation"])

    def largest(self) -> FloatArray:
        """(nt,) Pa, the largest von Mises stress at any point of a cell."""
        found, k = self._found()
        return found.series(k, lambda body: body["largest"])

    @checked()
    def between(self, field: str, t: ArrayLike) -> FloatArray:
        """(k, nodes) or (k, nodes, m), a field at times (k,) s, linear between the instants and constant beyond.

        Raises:
            SceneError: there is no such field, or the times are not finite numbers (k,).
        """
        wanted, instants = np.atleast_1d(np.asarray(t, dtype=float)), self.t
        if wanted.ndim != 1:
            raise SceneError(f"t must be times (k,), got the shape {wanted.shape}")
        self._field(field)
        if len(instants) == 1:
            return np.array([self.values(field, row=0) for _ in wanted])
        found = []
        for time in wanted:
            k = int(np.clip(np.searchsorted(instants, time, side="right") - 1, 0, len(instants) - 2))
            share = np.clip((time - instants[k]) / (instants[k + 1] - instants[k]), 0.0, 1.0)
            found.append((1.0 - share) * self.values(field, row=k) + share * self.values(field, row=k + 1))
        return np.array(found)

    @checked()
    def stress(self, t: float) -> StressField:
        """Displacement and stress, in body axes, at the instant nearest to t (s).

        Raises:
            SceneError: t is no time, or no stress is kept.
        """
        found, k = self._field("stress")
        row = int(np.argmin(np.abs(found.t - t)))
        p, R, largest, nearest = (
            found.row(k, row, lambda body, name=name: body[name])  # type: ignore[misc]
            for name in ("body_position", "body_rotation", "largest", "largest_row")
        )
        mesh = found.meshes[k]
        xx, yy, zz, yz, xz, xy = self.values("stress", row=row).T
        stress = np.stack([xx, xy, xz, xy, yy, yz, xz, yz, zz], axis=1).reshape(-1, 3, 3)
        return StressField(
            node=mesh.node,
            x=mesh.x,
            triangle=mesh.triangle,
            displacement=(self.values("position", row=row) - p) @ R - mesh.x,
            stress=R.T @ stress @ R,
            von_mises=self.values("von_mises", row=row),
            max=float(largest),
            max_x=mesh.x[int(nearest)],
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

    def _found(self) -> tuple[RecordedInstants, int]:
        """What the file holds, and the body's number in it."""
        found = recorded_instants(self.path)
        return found, found.body(self.name)

    def _field(self, field: str) -> tuple[RecordedInstants, int]:
        """The same, where the body has such a field."""
        found, k = self._found()
        if field not in found.fields[k]:
            known = ", ".join(found.fields[k]) or "no instants yet"
            raise SceneError(f"body {self.name!r} has no field {field!r}; it has {known}")
        return found, k


@checked(error=RecordError)
def load_recording(path: str | Path) -> dict[str, BodyRecording]:
    """The bodies of a recording by name.

    Raises:
        RecordError: it cannot be read, is no recording, or is damaged.
    """
    found = recorded_instants(Path(path))
    return {name: BodyRecording(found.path, name) for name in found.names}
