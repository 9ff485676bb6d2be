"""Displacements of a body with the motions of its interfaces' faces, and how an averaged frame turns by finite angles.

The nodes X (from its origin) of a rigid face are displaced by d + A X.  Of an averaged one [d | A] is the motion of its
frame: A = R - 1 with the rotation in whose axes the average of what the nodes have moved is none,
C (R^T (X + u - d) - X) = 0, which is C u = (d, r) in small motions: as of a loaded state, see `followed_average` of
`flexmbd.continuum.finite_elements.prestressed`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.finite_elements.interface import AveragedInterface, FoundInterface
from flexmbd.continuum.finite_elements.linear_model import LinearModel
from flexmbd.continuum.finite_elements.prestressed import followed_average
from flexmbd.continuum.matrices.blocks import FloatArray, inner
from flexmbd.record.turned_face import turned_face
from flexmbd.reduction.static_shapes.statics import Statics


@dataclass(frozen=True, eq=False)
class FaceFields:
    """Displacements with affine motions of the faces.

    Attributes:
        u: (owned dofs, k), m, in the mesh's axes.
        faces: (b, 3, 4, k) [d | A] of all b interfaces, in the mesh's axes; zero where the body frame is.
    """

    u: FloatArray
    faces: FloatArray

    def joined(self, other: FaceFields) -> FaceFields:
        """These and more."""
        u = np.asfortranarray(np.hstack([self.u, other.u]))
        return FaceFields(u, np.concatenate([self.faces, other.faces], axis=3))

    def combined(self, change: FloatArray) -> FaceFields:
        """Combinations, change (k, m)."""
        return FaceFields(np.asfortranarray(self.u @ change), self.faces @ change)

    def less(self, other: FaceFields, part: FloatArray) -> FaceFields:
        """Without combinations of others."""
        return FaceFields(np.asfortranarray(self.u - other.u @ part), self.faces - other.faces @ part)


def face_motions(statics: Statics, u: FloatArray) -> FloatArray:
    """(b, 3, 4, k) [d | A] of small displacements (owned dofs, k) that leave every rigid face rigid. Collective."""
    faces = np.zeros((len(statics.interfaces), 3, 4, u.shape[1]))
    for i in range(0 if statics.floating else 1, len(statics.interfaces)):
        motion = small_motion(statics.model, statics.interfaces[i], u)
        faces[i, :, 0], faces[i, :, 1:] = motion[:3], cross_matrices(motion[3:])
    return faces


def small_motion(model: LinearModel, interface: FoundInterface, u: FloatArray) -> FloatArray:
    """(6, k) translation (m) and small rotation (rad) of a frame about its origin, in the mesh's axes. Collective."""
    own = interface.dofs < model.n_owned
    dofs = interface.dofs[own]
    if isinstance(interface, AveragedInterface):
        return inner(model.comm, interface.average[own], u[dofs])
    motions = model.rigid_motions(interface.p, np.eye(3))[dofs]
    gram = inner(model.comm, motions, motions)
    return np.asarray(np.linalg.solve(gram, inner(model.comm, motions, u[dofs])))


def cross_matrices(turn: FloatArray) -> FloatArray:
    """(..., 3, 3, r) of vectors (..., 3, r): [w] with [w] x = w cross x."""
    found = np.zeros((*turn.shape[:-2], 3, *turn.shape[-2:]))
    for a, b, c in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        found[..., a, b, :], found[..., b, a, :] = -turn[..., c, :], turn[..., c, :]
    return found


def prescribe(model: LinearModel, interface: FoundInterface, motion: FloatArray, u: FloatArray) -> None:
    """Set the displacements d + A X of a face's nodes in u (owned dofs, r), [d | A] (3, 4, r)."""
    nodes = interface.nodes[interface.nodes < model.n_owned_nodes]
    arm = model.node_x[nodes] - interface.p
    # r of no motion of a face in all
    u[model.displacement_dofs[nodes]] = motion[None, :, 0] + np.einsum("abr,nb->nar", motion[:, 1:], arm)


@dataclass(frozen=True, eq=False)
class _FaceAverage:
    """An averaged interface on this rank's own nodes.

    Attributes:
        model: the body.
        dofs: (k, 3).
        arms: (k, 3) m, X.
        columns: (k, 3, 6) C^T.
    """

    model: LinearModel
    dofs: NDArray[np.int32]
    arms: FloatArray
    columns: FloatArray

    @staticmethod
    def of(model: LinearModel, interface: AveragedInterface) -> _FaceAverage:
        columns = np.zeros((model.layout.n_local, 6))
        columns[interface.dofs] = interface.average
        nodes = interface.nodes[interface.nodes < model.n_owned_nodes]
        dofs = model.displacement_dofs[nodes]
        return _FaceAverage(model, dofs, model.node_x[nodes] - interface.p, columns[dofs])

    def motion(self, field: FloatArray) -> FloatArray:
        """(6, r) C of displacements (k, 3, r). Collective."""
        count = 3 * len(self.dofs)
        return inner(self.model.comm, self.columns.reshape(count, 6), field.reshape(count, field.shape[2]))


@dataclass(frozen=True, eq=False)
class AveragedSeries:
    """The frame of an averaged interface along u(s) = u_1 s + u_2 s^2 + ... under a wrench, order by order.

    Attributes:
        face: its nodes.
        wrenches: (6, r) N and N m of fixed directions at s = 1, in the mesh's axes.
        moved: the nodes' displacements (k, 3, r) of the orders before.
        turned: (3, 3, r) E_k, R(s) = 1 + E_1 s + E_2 s^2 + ..., of these.
        seen: (3, r) R^T d of these.
    """

    face: _FaceAverage
    wrenches: FloatArray
    moved: tuple[FloatArray, ...] = ()
    turned: tuple[FloatArray, ...] = ()
    seen: tuple[FloatArray, ...] = ()

    @staticmethod
    def of(model: LinearModel, interface: AveragedInterface, wrenches: FloatArray) -> AveragedSeries:
        """Before the first order."""
        return AveragedSeries(_FaceAverage.of(model, interface), wrenches)

    def add_forces(self, u: FloatArray) -> None:
        """Add to nodal forces (owned dofs, r) those of the wrench that come with the turns so far: its next order.

        They turn with the face: R C^T (R^T f, R^T m).
        """
        unit = np.repeat(np.eye(3)[:, :, None], self.wrenches.shape[1], axis=2)
        turns = (unit, *self.turned)
        for i, turn in enumerate(turns):
            back = turns[len(turns) - 1 - i]
            force, moment = (np.einsum("bar,br->ar", back, part) for part in np.split(self.wrenches, 2))
            nodal = np.einsum("kaj,jr->kar", self.face.columns, np.concatenate([force, moment]))
            u[self.face.dofs] += np.einsum("abr,kbr->kar", turn, nodal)

    def next(self, u: FloatArray, finite: FloatArray) -> tuple[AveragedSeries, FloatArray, FloatArray]:
        """With u_k (owned dofs, r), given the turns' part (3, 3, r) of orders before k; [d | A] and t of order k.

        Collective.
        """
        moved = (*self.moved, u[self.face.dofs])
        # R^T (X + u) - X, but for -[t_k] X
        field = moved[-1] + np.einsum("bar,kb->kar", finite, self.face.arms)
        for turn, before in zip(self.turned, moved[-2::-1], strict=True):
            field = field + np.einsum("bar,kbr->kar", turn, before)
        found = self.face.motion(field)
        seen, turn = found[:3], found[3:]
        gradient = cross_matrices(turn) + finite
        d = seen.copy()
        for one, before in zip(self.turned, self.seen[::-1], strict=True):
            d = d + np.einsum("abr,br->ar", one, before)
        after = AveragedSeries(self.face, self.wrenches, moved, (*self.turned, gradient), (*self.seen, seen))
        return after, np.concatenate([d[:, None], gradient], axis=1), turn


def followed(
    model: LinearModel, interface: AveragedInterface, motion: FloatArray, u: FloatArray
) -> tuple[AveragedInterface, FloatArray]:
    """An averaged interface at a finite displacement (local dofs,), and its rotation (3, 3). Collective.

    Args:
        model: at rest.
        interface: at rest.
        motion: (3, 4) [d | A], nearly that of its frame.
        u: m.
    """
    R, _ = turned_face(np.eye(3) + motion[:, 1:], np.zeros((3, 3, 0)))
    near = replace(interface, p=interface.p + motion[:, 0], R=R @ interface.R)
    found = followed_average(model, interface, near, u)
    return found, found.R @ interface.R.T
