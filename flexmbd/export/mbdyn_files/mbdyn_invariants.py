"""MBDyn's inertia invariants, and the Gram matrix of a record: the same integrals in other words.

With s = x and the modes' displacements f, over the mass: 3 int f_j, 4 int s x f_j, 5 int f_j x f_k, 8 - int s~ f_j~,
9 int f_j~ f_k~, a~ b = a x b.  Since a~ b~ = b a^T - (a . b) 1, the trace of 8 and 9 gives back all of s_a f_b and
f_a f_b.  Groups 14 to 18 of a file hold 3, 4, 8, 5 and 9, row by row: mode by mode, then columns.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flexmbd.errors import ExportError
from flexmbd.export.gram_completion import completed_gram
from flexmbd.record.groups import FRAME_DOFS, FloatArray
from flexmbd.record.inertia_loads import ACCELERATIONS, ANGULAR_ACCELERATIONS, CENTRIFUGAL

#: Of what should agree in a file: five digits, as hand-made ones have.
AGREE = 1e-5


@dataclass(frozen=True, eq=False)
class RigidInertia:
    """Group 12.

    Attributes:
        mass: kg.
        com: (3,) m, from the origin.
        inertia: (3, 3) kg m^2 about the centre of mass.
    """

    mass: float
    com: FloatArray
    inertia: FloatArray

    def fill(self, gram: FloatArray) -> None:
        """Write the integrals of 1 and x into a Gram matrix."""
        at = self.com
        about = self.inertia + self.mass * (at @ at * np.eye(3) - np.outer(at, at))
        gram[0, 0] = self.mass
        gram[0, 1:4] = gram[1:4, 0] = self.mass * at
        gram[1:4, 1:4] = 0.5 * np.trace(about) * np.eye(3) - about


@dataclass(frozen=True, eq=False)
class Invariants:
    """Groups 14 to 18; None: not in the file.

    Attributes:
        i3: (3, n).
        i4: (3, n).
        i8: (3, n, 3).
        i5: (3, n, n).
        i9: (3, n, n, 3).
    """

    i3: FloatArray | None = None
    i4: FloatArray | None = None
    i8: FloatArray | None = None
    i5: FloatArray | None = None
    i9: FloatArray | None = None


def shapes(n: int) -> dict[int, tuple[str, tuple[int, ...]]]:
    """Attribute and shape of each of groups 14 to 18, for n modes."""
    return {
        14: ("i3", (3, n)),
        15: ("i4", (3, n)),
        16: ("i8", (3, n, 3)),
        17: ("i5", (3, n, n)),
        18: ("i9", (3, n, n, 3)),
    }


def invariants(gram: FloatArray) -> Invariants:
    """Of the Gram matrix of a record."""
    n = (len(gram) - 4) // 3
    levers = gram[1:4, 4:].reshape(3, n, 3)
    fields = gram[4:, 4:].reshape(n, 3, n, 3)
    one = np.eye(3)
    return Invariants(
        i3=gram[0, 4:].reshape(n, 3).T,
        i4=_axial(levers.transpose(1, 2, 0)).T,
        i8=np.einsum("aja,bc->bjc", levers, one) - np.einsum("cjb->bjc", levers),
        i5=np.moveaxis(_axial(np.einsum("jakb->jkba", fields)), -1, 0),
        i9=np.einsum("jakb->bjka", fields) - np.einsum("jaka,bc->bjkc", fields, one),
    )


def gram_of(rigid: RigidInertia, found: Invariants, modal_mass: FloatArray) -> FloatArray:
    """The Gram matrix (4 + 3 n, 4 + 3 n) of groups 9, 12 and 14 to 18; missing groups are completed.

    Args:
        rigid: group 12.
        found: what there is of the others; without 3, 4 and 8 the modes have no momentum.
        modal_mass: (n, n) group 9.

    Raises:
        ExportError: groups contradict each other, or are those of no mass distribution.
    """
    n = len(modal_mass)
    size = np.sqrt(abs(np.diag(modal_mass)))
    arm = np.sqrt(max(np.trace(rigid.inertia), 0.0) / 2.0 + rigid.mass * (rigid.com @ rigid.com))
    linear = np.zeros((3, n)) if found.i3 is None else found.i3
    levers = None if found.i8 is None else _levers(found.i8)
    angular = np.zeros((3, n)) if found.i4 is None else found.i4
    if levers is not None:
        told = _axial(levers.transpose(1, 2, 0)).T
        if found.i4 is not None:
            _check_same(told, found.i4, arm * size, "15, invariant 4, and 16, invariant 8,")
        angular = told
    gram = np.zeros((4 + 3 * n, 4 + 3 * n))
    rigid.fill(gram)
    if levers is None or found.i9 is None:
        mass = np.zeros((6 + n, 6 + n))
        mass[:3, :3] = rigid.mass * np.eye(3)
        S = gram[0, 1:4]
        mass[:3, 3:6] = [[0.0, S[2], -S[1]], [-S[2], 0.0, S[0]], [S[1], -S[0], 0.0]]
        mass[3:6, :3] = mass[:3, 3:6].T
        mass[3:6, 3:6] = np.trace(gram[1:4, 1:4]) * np.eye(3) - gram[1:4, 1:4]
        mass[:3, 6:], mass[3:6, 6:], mass[6:, 6:] = linear, angular, modal_mass
        mass[6:, :6] = mass[:6, 6:].T
        return completed_gram(mass, levers=levers)
    fields = np.moveaxis(found.i9, (1, 2), (0, 1))  # (j, k, 3, 3): f_k f_j^T - (f_j . f_k) 1
    fields = fields - 0.5 * np.einsum("jkaa,bc->jkbc", fields, np.eye(3))
    _check_same(np.einsum("jkaa->jk", fields), modal_mass, np.outer(size, size), "9, modal mass, and 18, invariant 9,")
    if found.i5 is not None:
        told = np.moveaxis(_axial(fields), -1, 0)
        _check_same(told, found.i5, np.outer(size, size), "17, invariant 5, and 18, invariant 9,")
    gram[0, 4:] = gram[4:, 0] = linear.T.ravel()
    gram[1:4, 4:] = levers.reshape(3, 3 * n)
    gram[4:, 1:4] = gram[1:4, 4:].T
    among = np.einsum("jkba->jakb", fields).reshape(3 * n, 3 * n)
    gram[4:, 4:] = 0.5 * (among + among.T)
    return gram


def stiffening_loads(interfaces: Sequence[str]) -> list[str]:
    """The record's names of the loads of group 19, in its order.

    Products of angular velocities, angular accelerations, accelerations, then force and moment on each interface.
    """
    products = [CENTRIFUGAL[at] for at in (0, 1, 2, 3, 5, 4)]  # xx yy zz xy yz xz
    on = [f"{name}.{dof}" for name in interfaces for dof in FRAME_DOFS]
    return [*products, *ANGULAR_ACCELERATIONS, *ACCELERATIONS, *on]


def _levers(i8: FloatArray) -> FloatArray:
    """(3, n, 3) integrals of s_a f_b, of invariant 8."""
    return np.einsum("aja,bc->cjb", i8, 0.5 * np.eye(3)) - np.einsum("bjc->cjb", i8)


def _axial(matrices: FloatArray) -> FloatArray:
    """(..., 3) a x b of matrices (..., 3, 3) b a^T."""
    return np.stack(
        [
            matrices[..., 2, 1] - matrices[..., 1, 2],
            matrices[..., 0, 2] - matrices[..., 2, 0],
            matrices[..., 1, 0] - matrices[..., 0, 1],
        ],
        axis=-1,
    )


def _check_same(one: FloatArray, other: FloatArray, size: FloatArray, what: str) -> None:
    apart = float((abs(one - other) / np.where(size > 0.0, size, 1.0)).max(initial=0.0))
    if not apart <= AGREE:
        raise ExportError(f"groups {what} are {apart:.1e} apart, so they are of two bodies")
