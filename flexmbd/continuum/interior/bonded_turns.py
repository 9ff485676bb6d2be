"""Unknowns that turn with the body, as rotations of sections, at nodes on its frames, which turn as the frames do.

They are in the body's axes, and write a rotation as the formulation's `TurnLaw` says; between the frames they are
solved for as all other unknowns are.  What holds them on a frame is a couple.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.finite_elements.interface import AveragedInterface
from flexmbd.continuum.history.nonlinear_model import NonlinearModel
from flexmbd.continuum.interior.turn_law import SMALL_TURNS, TurnLaw
from flexmbd.errors import FormulationError, InterfaceError

FloatArray = NDArray[np.float64]


class BondedTurns:
    """Those of all interfaces of a body. Constructing one is collective; of a body without them it costs nothing.

    Attributes:
        dofs: (m,) local, ghosts included.
        own: (m,) whether this rank owns them.
        frame_of: (m,) the number of each one's frame.
        any: whether the body has such unknowns at all.
        accepted: (k, 3, 3) rotations of the frames against the body's axes when its last step was accepted.
    """

    def __init__(self, body: NonlinearModel, law: TurnLaw = SMALL_TURNS) -> None:
        """Find them; ``law`` is that of the body.

        Raises:
            InterfaceError: on all ranks: an averaged interface of a body with such unknowns.
        """
        self.any, self._comm, self._law, count = body.turns, body.comm, law, len(body.interfaces)
        self.dofs: NDArray[np.int32] = np.zeros(0, dtype=np.int32)
        self.frame_of: NDArray[np.int64] = np.zeros(0, dtype=np.int64)
        self._rows: FloatArray = np.zeros((0, 3))
        self._axes = np.array([found.R for found in body.interfaces]).reshape(count, 3, 3)
        if self.any:
            self._find(body)
        self.own = self.dofs < body.n_owned
        self.accepted: FloatArray = np.tile(np.eye(3), (count, 1, 1))

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

    def accept(self, frames: FloatArray, R: FloatArray) -> None:
        """A step is accepted, or the body begins, with the frames and the body as of `increments`."""
        self.accepted = self._rotations(frames, R)

    def increments(self, frames: FloatArray, R: FloatArray, accepted: FloatArray) -> FloatArray:
        """(m,) how far they have turned since the last accepted step.

        Args:
            frames: (k, 3, 3) axes of the frames.
            R: (3, 3) axes of the body.
            accepted: (local dofs,) the body's unknowns in that step.
        """
        if not self.any:
            return np.zeros(0)
        turned = np.einsum("ma,ma->m", self._rows, self._vectors(frames, R)[self.frame_of])
        return turned if self._law.by_steps else turned - accepted[self.dofs]

    def follow(self, turn: FloatArray, frame: int, frames: FloatArray, R: FloatArray) -> FloatArray:
        """(m,) how they change, against the body's axes R, where a frame turns by a small vector (3,), inertial.

        Args:
            turn: the vector.
            frame: that turns.
            frames: (k, 3, 3) axes of the frames.
            R: (3, 3) axes of the body, which the first frame carries.
        """
        carried = (self.frame_of == frame).astype(float) - float(frame == 0)
        changes = self._law.vector.tangents(self._vectors(frames, R)) @ (R.T @ turn)
        return np.asarray(carried * np.einsum("ma,ma->m", self._rows, changes[self.frame_of]))

    def wrenches(self, held: FloatArray, frames: FloatArray, R: FloatArray) -> FloatArray:
        """(k, 6) wrenches on the frames, inertial, of what holds them: minus forces (owned dofs,). Collective."""
        count, found = len(self._axes), np.zeros((len(self._axes), 6))
        if not self.any:
            return found
        couples = -held[self.dofs[self.own], None] * self._rows[self.own]
        for k in range(count):
            found[k, 3:] = couples[self.frame_of[self.own] == k].sum(axis=0)
        total = np.asarray(sum(self._comm.allgather(found)))
        tangents = self._law.vector.tangents(self._vectors(frames, R))
        total[:, 3:] = np.einsum("kba,kb->ka", tangents, total[:, 3:]) @ R.T
        return total

    def couple_changes(
        self, couples: FloatArray, turn: FloatArray, frame: int, frames: FloatArray, R: FloatArray
    ) -> FloatArray:
        """(k, 3) changes of couples (k, 3), as of `wrenches`, whose forces stay, where a frame turns as in `follow`."""
        vectors, law = self._vectors(frames, R), self._law.vector
        forces = np.linalg.solve(law.tangents(vectors).transpose(0, 2, 1), (couples @ R)[..., None])[..., 0]
        against = (np.arange(len(couples)) == frame).astype(float) - float(frame == 0)
        turns: FloatArray = against[:, None] * (R.T @ turn)
        changes = law.moment_changes(vectors, np.asarray(forces), turns) @ R.T
        return changes + np.cross(turn, couples) if frame == 0 else changes  # they are in the body's axes

    def _rotations(self, frames: FloatArray, R: FloatArray) -> FloatArray:
        """(k, 3, 3) of the frames against the body's axes."""
        return np.asarray(R.T @ frames[: len(self._axes)] @ self._axes.transpose(0, 2, 1))

    def _vectors(self, frames: FloatArray, R: FloatArray) -> FloatArray:
        """(k, 3) of the rotations, or of those since the last accepted step."""
        turned = self._rotations(frames, R)
        if self._law.by_steps:
            turned = turned @ self.accepted.transpose(0, 2, 1)
        return self._law.vector.vectors(turned)


def refuse_turning_unknowns(body: NonlinearModel) -> None:
    """Refuse unknowns besides the displacement that rigid motions move, but micro-rotations of solids. Collective.

    Explicit steps divide forces by masses, of which rotations of beams and plates have next to none.

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
            "and is no solid of micro-rotations, which alone move as full bodies in explicit steps; take implicit ones "
            "(ImplicitContinuum, fm.GeneralizedAlpha), CorotatedInterior with condensed_rotations for small linear "
            "deformations, load it slowly (flexmbd.continuum.follow), reduce it (craig_bampton), or, where it moves in "
            "its plane, make it of a solid's form (plane_form)"
        )
