"""Characteristic constraint modes from the condensed stiffness and mass of interfaces; see `interface_modes`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from flexmbd.continuum.matrices.blocks import FloatArray, symmetric
from flexmbd.errors import ReductionError
from flexmbd.record.carrying_dofs import carrying_dofs
from flexmbd.reduction.static_shapes.statics import Statics
from flexmbd.round_off import SQUARED


@dataclass(frozen=True, eq=False)
class Candidates:
    """What may be kept of s static shapes.

    Attributes:
        following: (s, k) motions of what is kept, and those of the rest by statics.
        eigenvalues: (r,) of the interface modes, 1/s^2, ascending.
        modes: (s, r).
    """

    following: FloatArray
    eigenvalues: FloatArray
    modes: FloatArray

    def change(self, count: int) -> FloatArray:
        """(s, k + count) with so many modes."""
        return np.hstack([self.following, self.modes[:, :count]])


def interface_candidates(
    statics: Statics,
    stiffness: FloatArray,
    mass: FloatArray,
    *,
    owner: NDArray[np.int64],
    joint: NDArray[np.bool_],
    local: bool,
) -> Candidates:
    """What follows the kept motions, and the modes of the rest; not collective.

    Args:
        statics: of the body.
        stiffness: (s, s) of the static shapes.
        mass: (6 + s, 6 + s) of rigid motions and these.
        owner: (s,) the interface of each.
        joint: (interfaces,) which are kept.
        local: whether interface by interface.

    Raises:
        ReductionError: modes of a nodal interface alone, where the others do not hold the body.
    """
    s, kept, rest = len(stiffness), np.flatnonzero(joint[owner]), np.flatnonzero(~joint[owner])
    following = np.zeros((s, len(kept)))
    following[kept] = np.eye(len(kept))
    following[rest] = -scipy.linalg.solve(stiffness[np.ix_(rest, rest)], stiffness[np.ix_(rest, kept)], assume_a="pos")
    free = _carried_by_rest(statics, joint)
    if local and free and len(joint) > 1:
        return _modes_of_nodes(statics, stiffness, mass, following, joint)
    momenta = mass[6:, :6]
    inertia = mass[6:, 6:] - momenta @ np.linalg.solve(mass[:6, :6], momenta.T) if free else mass[6:, 6:]
    blocks = [np.flatnonzero(owner == i) for i in np.flatnonzero(~joint)] if local else [rest]
    eigenvalues, modes = [], []
    for block in blocks:
        values, x = _eigenmodes(stiffness[np.ix_(block, block)], inertia[np.ix_(block, block)])
        part = np.zeros((s, len(block)))
        part[block] = x
        eigenvalues.append(values)
        modes.append(part)
    values = np.concatenate(eigenvalues)
    order = np.argsort(values, kind="stable")
    return Candidates(following, values[order], np.hstack(modes)[:, order])


def _eigenmodes(stiffness: FloatArray, mass: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Ascending eigenvalues and modes of unit mass, their largest entries positive."""
    if len(mass) == 0:
        return np.zeros(0), np.zeros((0, 0))
    # mass by stiffness, so that the lowest are right to the last digits
    inverse, x = scipy.linalg.eigh(mass, stiffness)
    x = x[:, ::-1] / np.sqrt(inverse[::-1])
    return 1.0 / inverse[::-1], x * np.where(x[abs(x).argmax(axis=0), np.arange(len(x))] < 0.0, -1.0, 1.0)


def _carried_by_rest(statics: Statics, joint: NDArray[np.bool_]) -> bool:
    """Whether rigid motions are told by nodes that are not kept, so that nothing that is kept holds the body."""
    if statics.nodal is None or len(statics.nodal.carriers) == 0:
        return False
    carrying = statics.nodal.nodes.interface[statics.nodal.carriers // 3]
    return not joint[carrying].all()


def _modes_of_nodes(
    statics: Statics, stiffness: FloatArray, mass: FloatArray, following: FloatArray, joint: NDArray[np.bool_]
) -> Candidates:
    """As `interface_candidates`, interface by interface, of a body whose rigid motions are told by nodes of several.

    Each interface moves with all of its nodes, those that tell the rigid motions among them. In the static shapes,
    which are relative to these, the modes are six too many: those that depend on what goes before are left out.
    """
    nodal = statics.nodal
    assert nodal is not None  # noqa: S101
    x = (nodal.nodes.x - statics.p) @ statics.R
    rigid = np.concatenate([np.tile(np.eye(3), (len(x), 1, 1)), _turns(x)], axis=2).reshape(-1, 6)
    whole = np.zeros((6 + len(stiffness), len(rigid)))
    whole[:6, nodal.carriers] = np.linalg.inv(rigid[nodal.carriers])
    whole[6:] = -rigid[nodal.dofs] @ whole[:6]
    whole[6 + np.arange(len(stiffness)), nodal.dofs] += 1.0
    owner = np.repeat(nodal.nodes.interface, 3)
    eigenvalues, modes = [], []
    for i in np.flatnonzero(~joint):
        others = nodal.nodes.interface != i
        if carrying_dofs(x[others]) is None:
            raise ReductionError(
                f"the modes of nodal interface {statics.model.nodal[i].name!r} alone are those with the others fixed, "
                "and these do not hold the body: their nodes are none or lie in one line; leave local=True out"
            )
        block = whole[:, owner == i]
        values, own = _eigenmodes(symmetric(block[6:].T @ stiffness @ block[6:]), symmetric(block.T @ mass @ block))
        eigenvalues.append(values)
        modes.append(block[6:] @ own)
    values = np.concatenate(eigenvalues)
    order = np.argsort(values, kind="stable")
    values, found = values[order], np.hstack(modes)[:, order]
    chosen, independent = _independent(found, following, stiffness)
    return Candidates(following, values[chosen], independent)


def _turns(x: FloatArray) -> FloatArray:
    """(k, 3, 3) displacements of nodes at x (k, 3) by small rotations about the axes, one a column."""
    return np.stack([np.cross(axis, x) for axis in np.eye(3)], axis=2)


def _independent(
    shapes: FloatArray, first: FloatArray, stiffness: FloatArray
) -> tuple[NDArray[np.intp], FloatArray]:
    """Which shapes have strain energy of their own beside those before them and the first ones, and what is their own.

    That is without energy in common, so that shapes that nearly depend on others lose no digits; the first ones are
    kept motions and what follows them, and what has no energy in common with these leaves what is kept at rest.
    """
    half = np.linalg.cholesky(stiffness).T
    known, _ = np.linalg.qr(half @ first)
    chosen, given = [], known.shape[1]
    for i, shape in enumerate((half @ shapes).T):
        left = shape / np.linalg.norm(shape)
        for _ in range(2):
            left = left - known @ (known.T @ left)
        if np.linalg.norm(left) > SQUARED:
            chosen.append(i)
            known = np.column_stack([known, left / np.linalg.norm(left)])
    own: FloatArray = scipy.linalg.solve_triangular(half, known[:, given:])
    return np.array(chosen, dtype=np.intp), own
