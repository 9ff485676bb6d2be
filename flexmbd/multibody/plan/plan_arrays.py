"""The flat arrays of a plan, out of the numbered coordinates and the tables of rows and forces."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.functions.time_function import TimeRow
from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.arrays import Plan, open_horizon
from flexmbd.multibody.kernels.base.native import lapack_addresses
from flexmbd.multibody.plan.forces import ForceTable
from flexmbd.multibody.plan.numbering import Numbering
from flexmbd.multibody.plan.rows import RowTable
from flexmbd.multibody.plan.time_data import data_with_integrals

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


def fill_plan(
    b: Numbering, rows: RowTable, table: ForceTable, driven: Sequence[Sequence[int]], gravity: FloatArray
) -> Plan:
    """The plan of what was numbered.

    Args:
        b: coordinates, frames, bodies and functions of time.
        rows: of constraints and penalties.
        table: of force elements.
        driven: rows of prescribed coordinates.
        gravity: (3,) m/s^2.
    """
    driven_v = {row[at.DRIVEN_V] for row in driven}
    free = [k for k in range(len(b.names)) if k not in driven_v]
    times, time_data = time_table(b.times)
    tree, frame_of = _int_table(b.tree, at.N_TREE), _int_table(b.frame_of, at.N_FRAME_OF)
    rigid = np.array(b.rigid, float).reshape(-1, at.N_RIGID)
    tree[:, at.ROTATION] = classify_rotations(tree, frame_of)
    plan = Plan(
        tree=tree,
        frames=b.frame_rows(),
        frame_of=frame_of,
        rigid=rigid,
        shafts=np.array(table.shafts, float).reshape(-1, at.N_SHAFT),
        flex=_int_table(b.flex, at.N_FLEX),
        modal=np.concatenate([*b.modal, np.zeros(1)]),
        rows=_int_table(rows.table, at.N_ROW),
        forces=_int_table(table.forces, at.N_FORCE),
        times=times,
        time_data=time_data,
        driven=_int_table(driven, at.N_DRIVEN),
        free=np.array(free, np.int64),
        gravity=gravity,
        lapack=lapack_addresses(),
        flag=b.callbacks.flag,
        wrenches=np.zeros((sum(len(one.rows) for one in table.interiors), 6)),
        elements=_elements(table),
        penalties=_int_table(rows.penalties, at.N_ROW),
        data=np.concatenate(b.data),
        horizon=open_horizon(),
    )
    return plan


def classify_rotations(tree: IntArray, frame_of: IntArray) -> IntArray:
    """(bodies,) of each row of ``Plan.tree`` whether its frame may rotate: ``kinds.NONROTATING`` or ``ROTATING``.

    No frame rotates behind joints that do not turn; on a frame that deforms it may.
    """
    deforms = frame_of[tree[:, at.FRAME_PARENT], at.FRAME_MODES] >= 0
    own = (tree[:, at.JOINT_TURN] != kinds.TURN_NONE) | deforms
    rotates: list[bool] = []
    for parent, turns in zip(map(int, tree[:, at.PARENT]), map(bool, own), strict=True):
        rotates.append(turns or (parent >= 0 and rotates[parent]))
    return np.where(np.array(rotates, bool), kinds.ROTATING, kinds.NONROTATING)


def time_table(rows: Sequence[TimeRow]) -> tuple[IntArray, FloatArray]:
    """``Plan.times`` and ``Plan.time_data`` of rows of functions of time."""
    table, data, offset = [], [], 0
    for row in rows:
        table.append([row.kind, offset, row.count, *row.addresses])
        data.append(data_with_integrals(row))
        offset += data[-1].size
    return _int_table(table, at.N_TIME), np.concatenate([*data, np.zeros(1)])


def _elements(table: ForceTable) -> IntArray:
    """(k, N_ELEMENT) ``Plan.elements``."""
    found, done = [], 0
    for first, rows in table.alike:
        found += [_int_table(table.elements[done:first], at.N_ELEMENT), rows]
        done = first + len(rows)
    return np.concatenate([*found, _int_table(table.elements[done:], at.N_ELEMENT)])


def _int_table(rows: Sequence[Sequence[int]], columns: int) -> IntArray:
    return np.fromiter(chain.from_iterable(rows), np.int64).reshape(-1, columns)
