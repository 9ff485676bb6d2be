"""The compiled loop over blocks of cells with fields of their own: `cell_field_loop` for kernels of several lanes.

Forces of a block are evaluated together until the fields of each of its cells are solved for, or wait for a new
tangent; what is done with them is done cell by cell, as there, and comes out the same to the bit.
"""

from __future__ import annotations

import numpy as np

from flexmbd.continuum.history.cell_field_loop import CELL_SWEEPS, begin_search, change_fields, gather_whole
from flexmbd.continuum.history.lane_loop import (
    keep_lane,
    of_lane,
    solve_points_of_lanes,
    tabulate_forces_of_lanes,
    take_block,
    weigh_history,
)
from flexmbd.continuum.history.point_loop import CellUnknowns
from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel

# What becomes of a cell of a block.
_GOES_ON, _SOLVED, _WAITS, _LEFT, _IS_NONE = 0, 1, 2, 3, 4


@kernel
def _inner_of_lane(inner, room, lane):  # type: ignore[no-untyped-def]
    """The fields, with room of a lane's own."""
    return CellUnknowns(
        inner.shared, inner.places, inner.values, inner.before, inner.inverse, inner.coupling, inner.known,
        inner.solved, room.force[lane], room.change[lane], room.step[lane], room.moved[lane], room.search[lane],
        room.lacks[lane],
    )  # fmt: skip


@kernel
def _gather_block(count, blocks, width, fields, inner, room):  # type: ignore[no-untyped-def]
    """Collect a block; cells without a tangent are left, and none stand behind the last."""
    for lane in range(room.row.shape[1]):
        cell = room.cells[lane]
        if lane >= count:
            room.found[lane] = _IS_NONE
            for i in range(room.row.shape[0]):
                room.row[i, lane] = room.row[i, count - 1]
            continue
        inner.solved[cell] = 0
        room.found[lane] = _GOES_ON if inner.known[cell] != 0 else _LEFT
        for i in range(inner.places.shape[0]):
            room.values[lane, i] = inner.values[cell, i]
        gather_whole(cell, blocks, width, fields, _inner_of_lane(inner, room, lane), of_lane(room, lane), 1)
        for i in range(fields.local.shape[1]):
            room.row[inner.force.shape[0] + fields.state.shape[1] + i, lane] = fields.local[cell, i]
        begin_search(room.search[lane])


@kernel
def _solve_points(begin, fields, kernels, room, inner, sweeps, tolerance):  # type: ignore[no-untyped-def]
    """Local unknowns of the cells of a block that go on; cells where they are not found are left as they began."""
    for lane in range(room.row.shape[1]):
        room.before[lane] = np.inf if room.found[lane] == _GOES_ON else 0.0
    solve_points_of_lanes(kernels, room, fields, begin - fields.state.shape[1], begin, sweeps, tolerance)
    for lane in range(room.row.shape[1]):
        if room.found[lane] != _GOES_ON:
            continue
        cell = room.cells[lane]
        if room.before[lane] != 0.0:
            room.found[lane] = _LEFT
            for i in range(inner.places.shape[0]):
                inner.values[cell, i] = room.values[lane, i]
            continue
        for i in range(fields.local.shape[1]):
            fields.local[cell, i] = room.row[begin + i, lane]


@kernel
def _solve_block(begin, fields, kernels, room, inner, sweeps, tolerance, accuracy):  # type: ignore[no-untyped-def]
    """Solve for the fields of a block; history of a cell is kept as it is done."""
    lanes, size = room.row.shape[1], inner.force.shape[0]
    for _ in range(CELL_SWEEPS):
        if fields.local.shape[1] > 0:
            _solve_points(begin, fields, kernels, room, inner, sweeps, tolerance)
        goes_on = False
        for lane in range(lanes):
            goes_on = goes_on or room.found[lane] == _GOES_ON
        if not goes_on:
            return
        tabulate_forces_of_lanes(kernels, room, begin)
        is_solved = False
        for lane in range(lanes):
            if room.found[lane] == _GOES_ON:
                for i in range(size):
                    room.force[lane, i] = room.tensor[i, lane]
                cell, own = room.cells[lane], _inner_of_lane(inner, room, lane)
                room.found[lane] = change_fields(cell, of_lane(room, lane), own, own.search, accuracy, 0.0)
                room.before[lane] = 1.0 if room.found[lane] == _SOLVED else 0.0
                is_solved = is_solved or room.found[lane] == _SOLVED
            else:
                room.before[lane] = 0.0
        if is_solved and fields.trial.shape[1] > 0:
            weigh_history(room, size, fields, kernels)
            for lane in range(lanes):
                if room.before[lane] != 0.0:
                    keep_lane(room, lane, size, fields)


@entry_kernel
def pass_field_blocks(  # type: ignore[no-untyped-def]
    cells, first, last, nodes, x, blocks, width, fields, kernels, room, inner, forces, kept, left, sweeps, tolerance,
    accuracy,
):
    """As `pass_blocks`, of cells with fields of their own; those that wait for a new tangent add nothing.

    Args:
        cells: (k,) the group's.
        first: block.
        last: block behind.
        nodes: (all cells, n) of the geometry.
        x: (nodes, 3) m.
        blocks: (all cells, m) of the shared unknowns' dofs.
        width: dofs of a block.
        fields: what is read and written.
        kernels: of blocks; the law is that of a point.
        room: to work in.
        inner: fields of one cell; ``solved`` tells of those that are.
        forces: (dofs,) N, to which they are added.
        kept: (k, dofs of a cell) N, where they are put in the place of it; without rows, not.
        left: (k,) set to 1 where there is no tangent yet, or local unknowns were not solved for; these are as before.
        sweeps: the most local Newton steps.
        tolerance: change of the local unknowns over their sizes at which they end.
        accuracy: change of a cell's forces over these at which its own fields end.
    """
    shared, lanes, begin = width * blocks.shape[1], room.row.shape[1], inner.force.shape[0] + fields.state.shape[1]
    for b in range(first, last):
        count = take_block(cells, b, nodes, x, room)
        _gather_block(count, blocks, width, fields, inner, room)
        _solve_block(begin, fields, kernels, room, inner, sweeps, tolerance, accuracy)
        for lane in range(count):
            c, cell, is_solved = lanes * b + lane, room.cells[lane], room.found[lane] == _SOLVED
            inner.solved[cell] = 1 if is_solved else 0
            left[c] = 1 if room.found[lane] == _LEFT else 0
            for j in range(shared):
                force = room.force[lane, inner.shared[j]] if is_solved else 0.0
                if kept.shape[0] > 0:
                    kept[c, j] = force
                elif is_solved:
                    forces[width * blocks[cell, j // width] + j % width] += force
