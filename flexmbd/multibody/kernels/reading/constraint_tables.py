"""Readers of a plan's constraint rows and prescribed coordinates."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.arrays import Plan

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class ConstraintRows:
    """Constraint rows, each array (m,).

    Attributes:
        f, g: rows of ``plan.frames``; -1 where a row is on coordinates.
        kind, index: ``kinds.ROW_*`` and which component.
        time: row of ``plan.times`` that prescribes its value, or -1.
        holds_position: False of rows that hold velocities alone.
        augmented: whether an augmented Lagrangian enforces it.
    """

    f: IntArray
    g: IntArray
    kind: IntArray
    index: IntArray
    time: IntArray
    holds_position: Mask
    augmented: Mask

    @property
    def in_rad(self) -> Mask:
        """(m,) whether a row's value is an angle (rad), and its multiplier a moment (N m); else m and N."""
        return np.isin(self.kind, kinds.ROWS_IN_RAD)

    def between(self, f: int, g: int) -> Mask:
        """(m,) whether a row is between these two frames."""
        found: Mask = (self.f == f) & (self.g == g)
        return found


class DrivenCoordinates(NamedTuple):
    """Prescribed coordinates, each array (k,): entries in v and in x, and the row of ``plan.times`` that has them."""

    v: IntArray
    x: IntArray
    time: IntArray


def constraint_rows(plan: Plan) -> ConstraintRows:
    """The rows that have multipliers."""
    return _rows(plan.rows)


def penalty_rows(plan: Plan) -> ConstraintRows:
    """The rows that penalties enforce, which have no multipliers."""
    return _rows(plan.penalties)


def _rows(table: IntArray) -> ConstraintRows:
    f, g, kind, index, time = (table[:, k] for k in (at.ROW_F, at.ROW_G, at.ROW_KIND, at.ROW_INDEX, at.ROW_TIME))
    positions, augmented = table[:, at.ROW_LEVEL] == kinds.LEVEL_POSITION, table[:, at.ROW_ENFORCEMENT] > 0
    return ConstraintRows(f, g, kind, index, time, positions, augmented)


def driven_coordinates(plan: Plan) -> DrivenCoordinates:
    """The coordinates of the tree whose motion is prescribed."""
    return DrivenCoordinates(plan.driven[:, at.DRIVEN_V], plan.driven[:, at.DRIVEN_X], plan.driven[:, at.DRIVEN_TIME])


def is_driven(plan: Plan) -> bool:
    """Whether a motion is prescribed, on a coordinate, a constraint row or a penalty."""
    times = np.concatenate([plan.rows[:, at.ROW_TIME], plan.penalties[:, at.ROW_TIME]])
    return len(plan.driven) > 0 or bool((times >= 0).any())


def coupling_rows(plan: Plan) -> IntArray:
    """Which rows are couplings of coordinates, sum r_k x_k = c."""
    return np.flatnonzero(plan.rows[:, at.ROW_KIND] == kinds.ROW_COUPLING)


def coupling_terms(plan: Plan, row: int) -> tuple[IntArray, FloatArray]:
    """Of a coupling: entries in v (k,) of the coordinates, and their factors r (k,)."""
    o = int(plan.rows[row, at.ROW_DATA])
    terms = plan.data[o + 2 : o + 2 + 3 * int(plan.data[o])].reshape(-1, 3)
    rows, which = terms[:, :2].astype(int).T
    return plan.tree[rows, at.JOINT_V] + which, terms[:, 2]


def with_coupling_sums(plan: Plan, rows: IntArray, sums: FloatArray) -> Plan:
    """``plan`` with other sums c (k,) of its couplings (k,)."""
    data = plan.data.copy()
    data[plan.rows[rows, at.ROW_DATA] + 1] = sums
    return plan.replace(data=data)


def three_rows(f: int, g: int, kind: int) -> IntArray:
    """A table of the rows of one kind on all three components of frame g against f, without functions of time."""
    return np.array([[f, g, kind, k, 0, kinds.LEVEL_POSITION, -1, 0] for k in range(3)], np.int64)
