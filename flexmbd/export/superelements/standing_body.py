"""A superelement that stands on its foundation: no free body, so its frame is the ground's, which it is to be fixed to.

Of such matrices the motions of the interface are deformations like the modes. What a record holds besides of a body
that moves as a whole is not in them: mass, centre and inertia are given, and the modes' momentum along z is that by
which the weight loads them; across it none is known, and none is taken.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexmbd.errors import ExportError
from flexmbd.export.gram_completion import completed_gram
from flexmbd.export.superelements.superelement_body import normal_form, symmetrised
from flexmbd.export.superelements.superelement_frames import ReadMatrices
from flexmbd.multibody.bodies.body import RigidBody
from flexmbd.record.groups import FRAME_DOFS, FloatArray, InterfaceFrame
from flexmbd.record.held_modes import cross_matrix
from flexmbd.record.reduced_body import ReducedBody
from flexmbd.round_off import of_solver

#: m/s^2, by which weights of files are made to masses.
GRAVITY = 9.80665


@dataclass(frozen=True, eq=False)
class Standing:
    """What a structure stands on.

    Attributes:
        foundation: name of the interface that is to be fixed.
        interface: name of the other one.
        rigid: mass, centre and inertia, from that one's place at rest.
    """

    foundation: str
    interface: str
    rigid: RigidBody


def standing_body(read: ReadMatrices, weight: FloatArray, standing: Standing, *, source: str) -> ReducedBody:
    """The record of a structure on its foundation.

    Args:
        read: K, M and D: six rows of the interface, then modes.
        weight: (N,) forces of gravity along -z at rest.
        standing: names and inertia.
        source: the file, for messages and the provenance.

    Raises:
        ExportError: the matrices are not symmetric, or not positive: the structure is free.
    """
    size = len(read.K)
    D = np.zeros_like(read.K) if read.D is None else read.D
    try:
        K, M, D = (symmetrised(matrix, name) for matrix, name in ((read.K, "K"), (read.M, "M"), (D, "D")))
        if not _is_held(K):
            raise ExportError("its stiffness holds it nowhere: a free body is read without foundation=")
        k, x = normal_form(K, M)
        one = np.eye(6 + size)
        rigid, com = standing.rigid, np.asarray(standing.rigid.com, dtype=np.float64)
        inertia = np.asarray(rigid.inertia, dtype=np.float64)
        arm = cross_matrix(com)
        one[:3, :3] = rigid.mass * np.eye(3)
        one[:3, 3:6] = -rigid.mass * arm
        one[3:6, :3] = rigid.mass * arm
        one[3:6, 3:6] = (np.diag(inertia) if inertia.ndim == 1 else inertia) - rigid.mass * arm @ arm
        one[2, 6:] = -(weight @ x) / GRAVITY
        one[3:6, 6:] = arm @ one[:3, 6:]
        one[6:, :6] = one[:6, 6:].T
        gram = completed_gram(one)
    except ExportError as error:
        raise ExportError(f"{source}: {error}") from error
    ground, origin = np.eye(3), np.zeros(3)
    frames = (
        InterfaceFrame(standing.foundation, origin, ground, np.zeros((6, size))),
        InterfaceFrame(standing.interface, origin, np.asarray(read.interfaces[standing.interface].axes), x[:6]),
    )
    modes = (f"fixed-interface {i + 1}" for i in range(size - 6))
    return ReducedBody(
        gram=gram,
        stiffness=k,
        damping=x.T @ D @ x,
        interfaces=frames,
        frame=standing.foundation,
        partition=x,
        partition_names=(*(f"{standing.interface}.{dof}" for dof in FRAME_DOFS), *modes),
        provenance={
            "reduction": "superelement of another program, on its foundation",
            "inertia of large motions": "of the weight along z alone: the foundation is to be fixed",
        },
    )


def _is_held(K: FloatArray) -> bool:
    """Whether a stiffness is positive definite, in the scale of its diagonal."""
    diagonal = np.diag(K)
    if not (diagonal > 0.0).all():
        return False
    least = np.linalg.eigvalsh(K / np.sqrt(np.outer(diagonal, diagonal)))[0]
    return bool(least > of_solver(len(K)))
