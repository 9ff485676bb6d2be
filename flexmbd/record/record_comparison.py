"""Two records of one part side by side: where their common interfaces are, mass, responses, modes by MAC.

Both are seen from the body frame A of the first: positions, rigid motions and axes are A's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flexmbd.errors import RecordError
from flexmbd.record.groups import FloatArray, InterfaceFrame
from flexmbd.record.held_modes import cross_matrix, free_motion, held_modes, interface_motion
from flexmbd.record.reduced_body import ReducedBody
from flexmbd.round_off import SAME_PLACE


@dataclass(frozen=True, eq=False)
class PlacedRecord:
    """A record as seen from a body frame A.

    Attributes:
        body: the record.
        p_AB: (3,) m, origin of its own body frame.
        R_AB: (3, 3) axes of that.
    """

    body: ReducedBody
    p_AB: FloatArray
    R_AB: FloatArray

    def mass_matrix(self) -> FloatArray:
        """(6 + n, 6 + n) of the translation and rotation of A, and of the modal coordinates."""
        carried = self._carried()
        return np.asarray(carried.T @ self.body.mass_matrix() @ carried)

    def free_modes(self) -> FloatArray:
        """(6 + n, m) 1/kg^(1/2), free modes of unit modal mass: motion of A and modal coordinates."""
        modes = held_modes(self.body.gram, self.body.stiffness)
        there = modes.period > 0.0
        return free_motion(self.mass_matrix()) @ (modes.shape[:, there] / modes.period[there])

    def interface_motion(self, at: InterfaceFrame) -> FloatArray:
        """(6, 6 + n) motion at the place and in the axes of another record's interface, of the face of that name.

        Args:
            at: the interface of a record whose body frame is A.
        """
        own = self.body.interface(at.name)
        p, R = self.R_AB.T @ (at.p_BI_B - self.p_AB), self.R_AB.T @ at.R_BI
        modes = own.modes.copy()
        modes[:3] -= cross_matrix(p - own.p_BI_B) @ own.modes[3:]
        return interface_motion(InterfaceFrame(at.name, p, R, modes)) @ self._carried()

    def nodal_motion(self, nodes: Sequence[int]) -> FloatArray:
        """(3 k, 6 + n) displacements of k of the nodes that the record keeps the modes at, by their numbers.

        Raises:
            RecordError: it does not keep them.
        """
        kept = self.body.modes
        if kept is None:
            raise RecordError("the record does not keep its modes at nodes (--keep-modes)")
        rows = np.searchsorted(kept.node, nodes)
        x = self.p_AB + kept.x[rows] @ self.R_AB.T
        rigid = np.array([np.hstack([np.eye(3), -cross_matrix(one)]) for one in x])
        return np.concatenate([rigid, self.R_AB @ kept.phi[rows]], axis=2).reshape(3 * len(x), -1)

    def places(self, name: str) -> tuple[FloatArray, FloatArray]:
        """(3,) m and (3, 3): where an interface is."""
        frame = self.body.interface(name)
        return self.p_AB + self.R_AB @ frame.p_BI_B, self.R_AB @ frame.R_BI

    def _carried(self) -> FloatArray:
        """(6 + n, 6 + n) motion of B and the modal coordinates, per motion of A and these."""
        n = self.body.n_modes
        carried = np.eye(6 + n)
        carried[:3, :3] = carried[3:6, 3:6] = self.R_AB.T
        carried[:3, 3:6] = -self.R_AB.T @ cross_matrix(self.p_AB)
        return carried


@dataclass(frozen=True, eq=False)
class RecordComparison:
    """Two records of one part.

    Attributes:
        one, other: the records, from the first one's body frame.
        common: the interfaces that both have, as the first has them.
        by_meshes: whether the second lies where the coordinates of their meshes have it; else its first common
            interface lies on the first one's.
        nodes: numbers of the mesh's nodes at which MAC compares modes; none: it compares motions of interfaces.
    """

    one: PlacedRecord
    other: PlacedRecord
    common: tuple[InterfaceFrame, ...]
    by_meshes: bool
    nodes: Sequence[int]

    def apart(self, name: str) -> tuple[float, float]:
        """How far a common interface's origins (m) and axes (rad) are apart."""
        (p, R), (q, Q) = self.one.places(name), self.other.places(name)
        turn = R.T @ Q
        skew = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
        return float(np.linalg.norm(p - q)), float(np.arctan2(np.linalg.norm(skew), np.trace(turn) - 1.0))

    def only(self, one: PlacedRecord) -> list[str]:
        """Names of the interfaces that one of both records has and the other has not."""
        common = {frame.name for frame in self.common}
        return [frame.name for frame in one.body.interfaces if frame.name not in common]

    def mac(self) -> FloatArray:
        """(m, k) modal assurance criterion of the first record's free modes and the second one's.

        Squares of the cosines between displacements of the common nodes; or between motions of the common interfaces,
        with the displacements that their rotations make at the body's radius of gyration. NaN: of a mode that moves
        none of them.
        """
        shapes = []
        for one in (self.one, self.other):
            found = self._rows(one) @ one.free_modes()
            sizes = np.linalg.norm(found, axis=0)
            sizes[sizes < SAME_PLACE * np.sqrt(len(found) / one.body.mass)] = np.nan  # at rest but for round-off
            shapes.append(found / sizes)
        return np.asarray((shapes[0].T @ shapes[1]) ** 2)

    def _rows(self, one: PlacedRecord) -> FloatArray:
        if len(self.nodes):
            return one.nodal_motion(self.nodes)
        body = self.one.body
        gyration = np.sqrt(np.trace(body.inertia) / 2.0 / body.mass)
        weights = np.repeat([1.0, gyration], 3)[:, None]
        return np.vstack([weights * one.interface_motion(at) for at in self.common])


def compare_records(one: ReducedBody, other: ReducedBody) -> RecordComparison:
    """Two records of one part, side by side.

    Args:
        one: the first.
        other: with an interface of the same name; its body frame may be another one, its mesh, too.

    Raises:
        RecordError: no interface of the one has the name of an interface of the other.
    """
    names = {frame.name for frame in other.interfaces}
    common = tuple(frame for frame in one.interfaces if frame.name in names)
    if not common:
        told = [", ".join(repr(frame.name) for frame in body.interfaces) or "none" for body in (one, other)]
        raise RecordError(
            f"the records have no interface of the same name: the one has {told[0]}, the other {told[1]}; compare two "
            "records of one part"
        )
    meshes = [body.provenance.get("mesh") for body in (one, other)]
    by_meshes = None not in meshes
    if by_meshes:
        R = one.R_MB.T @ other.R_MB
        p = one.R_MB.T @ (other.p_MB_M - one.p_MB_M)
    else:
        there = other.interface(common[0].name)
        R = common[0].R_BI @ there.R_BI.T
        p = common[0].p_BI_B - R @ there.p_BI_B
    nodes: Sequence[int] = ()
    if by_meshes and meshes[0] == meshes[1] and one.modes is not None and other.modes is not None:
        nodes = np.intersect1d(one.modes.node, other.modes.node)  # type: ignore[assignment]
    return RecordComparison(
        PlacedRecord(one, np.zeros(3), np.eye(3)), PlacedRecord(other, p, R), common, by_meshes, nodes
    )
