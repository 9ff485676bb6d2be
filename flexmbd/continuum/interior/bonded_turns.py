"""Unknowns that turn with the body, as micro-rotations, at nodes on its frames: there they turn as the frames do.

They are small, in the body's axes, and without mass: between the frames they are solved for as other unknowns without
mass are.  What holds them on a frame is a couple.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from flexmbd.continuum.finite_elements.interface import AveragedInterface
from flexmbd.continuum.history.nonlinear_model import NonlinearModel
from flexmbd.errors import FormulationError, InterfaceError

FloatArray = NDArray[np.float64]


class BondedTurns:
    """Those of all interfaces of a body. Constructing one is collective; of a body without them it costs nothing.

    Attributes:
        dofs: (m,) local, ghosts included.
        own: (m,) whether this rank owns them.
        frame_of: (m,) the number of each one's frame.
        any: whether the body has such unknowns at all.
    """

    def __init__(self, body: NonlinearModel) -> None:
        """Find them.

        Raises:
            InterfaceError: on all ranks: an averaged interface of a body with such unknowns.
        """
        self.any, self._comm, count = body.turns, body.comm, len(body.interfaces)
        self.dofs: NDArray[np.int32] = np.zeros(0, dtype=np.int32)
        self.frame_of: NDArray[np.int64] = np.zeros(0, dtype=np.int64)
        self._rows: FloatArray = np.zeros((0, 3))
        self._axes = np.array([found.R for found in body.interfaces]).reshape(count, 3, 3)
        if self.any:
            self._find(body)
        self.own = self.dofs < body.n_owned

    def _find(self, body: NonlinearModel) -> None:
        layout = body.layout
        if any(isinstance(found, AveragedInterface) for found in body.interfaces):
            raise InterfaceError(
                f"{body.form_name} has unknowns that turn with the body, which an averaged interface does not hold; "
                "give its interfaces Coupling.RIGID"
            )
        columns = layout.rigid_columns(np.zeros(3), np.eye(3))
        parts = [np.setdiff1d(found.dofs, layout.displacement_dofs) for found in body.interfaces]
        self.dofs = np.concatenate([np.zeros(0, dtype=np.int32), *parts]).astype(np.int32)
        self.frame_of = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
        self._rows = columns[self.dofs, 3:]

    def values(self, frames: FloatArray, R: FloatArray) -> FloatArray:
        """(m,) what they are where the frames have the axes ``frames`` (k, 3, 3) and the body R (3, 3)."""
        turned = R.T @ frames @ self._axes.transpose(0, 2, 1)
        vectors = Rotation.from_matrix(turned).as_rotvec().reshape(-1, 3)
        return np.einsum("ma,ma->m", self._rows, vectors[self.frame_of])

    def follow(self, turn: FloatArray, frame: int, R: FloatArray) -> FloatArray:
        """(m,) how they change, against the body's axes R, where a frame turns by a small vector (3,), inertial."""
        carried = (self.frame_of == frame).astype(float) - float(frame == 0)
        return np.asarray(carried * (self._rows @ (R.T @ turn)))

    def wrenches(self, held: FloatArray, R: FloatArray) -> FloatArray:
        """(k, 6) wrenches on the frames, inertial, of what holds them: minus forces (owned dofs,). Collective."""
        count, found = len(self._axes), np.zeros((len(self._axes), 6))
        if not self.any:
            return found
        couples = -held[self.dofs[self.own], None] * self._rows[self.own]
        for k in range(count):
            found[k, 3:] = couples[self.frame_of[self.own] == k].sum(axis=0)
        total = np.asarray(sum(self._comm.allgather(found)))
        total[:, 3:] = total[:, 3:] @ R.T
        return total


def refuse_turning_unknowns(body: NonlinearModel) -> None:
    """Refuse unknowns besides the displacement that rigid motions move, but micro-rotations of solids. Collective.

    Raises:
        FormulationError: on all ranks: the cells are no solids, or a translation moves such unknowns.
    """
    if not body.turns:
        return
    columns = body.layout.rigid_columns(np.zeros(3), np.eye(3))
    shifted = bool(columns[body.layout.further_dofs, :3].any())
    if body.mesh.dim < 3 or any(body.comm.allgather(shifted)):
        raise FormulationError(
            f"{body.groups[0].form_name} has unknowns besides the displacement that turn with the body (rigid_motion), "
            "and is no solid of micro-rotations, which alone move as full bodies; load it slowly "
            "(flexmbd.continuum.follow), reduce it (craig_bampton, or CorotatedInterior with condensed_rotations for "
            "explicit steps), or, where it moves in its plane, make it of a solid's form (plane_form)"
        )


