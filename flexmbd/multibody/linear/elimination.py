"""Eliminating constraints from linear equations: positions and velocities by those that are independent.

Of small changes xi of the configuration and dv of the velocities, the rows that hold positions leave ny changes y
free, and all rows together nz <= ny changes z of velocities:

    xi = Xy y + Xu u,    dv = Vy y + Vz z + Vu u,    dy/dt = Ty y + Tz z + Tu u,

y and z being entries of xi and dv themselves, so that they keep their names, and u the inputs.  States of users'
equations are entries of z alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from flexmbd.errors import SceneError
from flexmbd.multibody.kernels.reading.constraint_tables import constraint_rows
from flexmbd.multibody.linear.derivatives import Derivatives
from flexmbd.multibody.plan.compiled_scene import CompiledScene

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_SINGULAR = 1e-8  # of the largest pivot: below it a row says nothing that others do not


@dataclass(frozen=True, eq=False)
class Coordinates:
    """The coordinates of small changes: those of the machine, then those of interiors.

    Attributes:
        names: (n,).
        free: which are not prescribed.
        size: (n,) what counts as large: 1 rad, the machine's extent, and of modes what moves their mass by it.
        states: which are links of states: their velocities are the states, and nothing follows from their places.
    """

    names: tuple[str, ...]
    free: IntArray
    size: FloatArray
    states: IntArray


def own_coordinates(scene: CompiledScene) -> Coordinates:
    """Those of the machine, none of interiors."""
    states = np.flatnonzero(scene.state_mask)
    return Coordinates(scene.velocity_names, scene.plan.free, scene.group_full[scene.group_of], states)


@dataclass(frozen=True, eq=False)
class Prescribed:
    """Motions and rows that inputs u (nu,) prescribe.

    Attributes:
        motion: (3, nv, nu) value, velocity and acceleration of prescribed coordinates per unit of each input.
        row: (2, m, nu) value and rate that a row is to have.
        rate: (nu, nu) the inputs' rates by the inputs: that of a displacement is the input beside it.
    """

    motion: FloatArray
    row: FloatArray
    rate: FloatArray


@dataclass(frozen=True, eq=False)
class Elimination:
    """See the module.

    Attributes:
        y, z: (ny,), (nz,) which entries of v they are.
        Xy, Xu: (nv, ny), (nv, nu).
        Vy, Vz, Vu: (nv, ny), (nv, nz), (nv, nu).
        Ty, Tz, Tu: (ny, ny), (ny, nz), (ny, nu).
    """

    y: IntArray
    z: IntArray
    Xy: FloatArray
    Xu: FloatArray
    Vy: FloatArray
    Vz: FloatArray
    Vu: FloatArray
    Ty: FloatArray
    Tz: FloatArray
    Tu: FloatArray


def eliminate(
    scene: CompiledScene, coordinates: Coordinates, of: Derivatives, turning: FloatArray, given: Prescribed
) -> Elimination:
    """Solve the rows for dependent positions and velocities.

    Args:
        scene: its rows.
        coordinates: n of them, in place of nv in what follows.
        of: the rows' derivatives.
        turning: (nv, nv) of ``derivatives.turning``.
        given: what inputs prescribe.

    Raises:
        SceneError: the rows are singular here; the message names one that says nothing new.
    """
    free, size, J = coordinates.free, coordinates.size, of.jacobian
    holds = constraint_rows(scene.plan).holds_position
    hold, roll = np.flatnonzero(holds), np.flatnonzero(~holds)
    kept, bound = _split((J * size)[np.ix_(hold, free)], [scene.row_names[k] for k in hold])
    y, bound = free[kept], free[bound]
    Xy = _solution(J[hold], y, bound)
    Xu = given.motion[0] + _particular(J[hold], bound, given.row[0][hold] - J[hold] @ given.motion[0])
    # of the velocities that go with y the rows on velocities bind some more
    kept, more = _split(J[roll] @ Xy * size[y], [scene.row_names[k] for k in roll])
    z, bound = y[kept], np.concatenate([bound, y[more]])
    order = np.concatenate([hold, roll])
    J, slope = J[order], of.rate_slope[order]
    Vz = _solution(J, z, bound)
    Vy = _particular(J, bound, -slope @ Xy)
    right = given.row[1][order] - J @ given.motion[1] - slope @ Xu
    Vu = given.motion[1] + _particular(J, bound, right)
    placed = ~np.isin(y, coordinates.states)
    y, Xy, Vy = y[placed], Xy[:, placed], Vy[:, placed]
    return Elimination(
        y=y,
        z=z,
        Xy=Xy,
        Xu=Xu,
        Vy=Vy,
        Vz=Vz,
        Vu=Vu,
        Ty=(Vy - turning @ Xy)[y],
        Tz=Vz[y],
        Tu=(Vu - turning @ Xu)[y],
    )


def _split(J: FloatArray, names: Sequence[str]) -> tuple[IntArray, IntArray]:
    """Independent and bound columns of J (m, n), which are to be of one unit; in their order, in that of pivots.

    Raises:
        SceneError: a row depends on the others.
    """
    m, n = J.shape
    if m == 0:
        return np.arange(n), np.zeros(0, np.int64)
    norms = np.linalg.norm(J, axis=1, keepdims=True)
    scaled = J / np.where(norms > 0.0, norms, 1.0)
    _, r, order = scipy.linalg.qr(scaled.T, mode="economic", pivoting=True)
    pivots = np.abs(np.diag(r))
    rank = int(np.sum(pivots > _SINGULAR))
    if rank < m:
        redundant = ", ".join(repr(names[k]) for k in order[rank:])
        raise SceneError(
            f"the constraints are singular here: {redundant} depend(s) on the others, so that linear equations "
            "cannot describe the motion of the loops; linearise about another configuration"
        )
    _, _, order = scipy.linalg.qr(scaled, mode="economic", pivoting=True)
    return np.setdiff1d(np.arange(n), order[:m]), order[:m].astype(np.int64)


def _solution(J: FloatArray, independent: IntArray, bound: IntArray) -> FloatArray:
    """(nv, n) all entries per unit of each independent one, the rows' homogeneous solutions."""
    out = np.zeros((J.shape[1], len(independent)))
    out[independent, np.arange(len(independent))] = 1.0
    if len(bound):
        out[bound] = -np.linalg.solve(J[:, bound], J[:, independent])
    return out


def _particular(J: FloatArray, bound: IntArray, right: FloatArray) -> FloatArray:
    """(nv, k) a solution of J s = right (m, k) in the bound entries alone."""
    out = np.zeros((J.shape[1], right.shape[1]))
    if len(bound):
        out[bound] = np.linalg.solve(J[:, bound], right)
    return out
