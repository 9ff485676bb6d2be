"""The compiled loop over cells, several at a time: `cell_loop` for kernels whose numbers have lanes, one of each cell.

A block's values lie in rows as those of a cell in `cell_loop`, (numbers, lanes).  The last block is filled up with its
last cell, of which nothing more is kept.  The sums of forces are in the order of the cells, so they do not depend on
the number of lanes; with several threads the forces of cells are kept and summed node by node in that order.

Local unknowns are solved for by whole Newton steps; cells where these do not end are left to `cell_loop`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.history.point_loop import (
    FORCES,
    LAW,
    LEAST,
    LOCAL,
    MEAN,
    Room,
    change_point,
    law_at_points,
)
from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel
from flexmbd.multibody.kernels.base.tabulate import call_tabulate
from flexmbd.round_off import STALLED

FloatArray = NDArray[np.float64]


class LaneRoom(NamedTuple):
    """Where a block of cells is worked on, by one thread.

    Attributes:
        cells: (lanes,) of the block.
        coordinates: (3 nodes, lanes) m.
        row: (numbers, lanes) the cells' values.
        given: (numbers, lanes) what a kernel takes of them.
        tensor: (numbers, lanes) what it returns.
        sizes: (lanes, 2, n) of the local unknowns, as in `Room`.
        before: (lanes,) the last change of the local unknowns, or what their law says is wrong; 0 where they are
            solved for.
        one: what work at one cell needs besides.
        found: (lanes,) what has become of cells with fields of their own.
        values: (lanes, m) these fields before.
        force: (lanes, n + m), change, step: (lanes, m), moved: (lanes, n), search: (lanes, 4), lacks: (lanes, 2, m), as
            in `CellUnknowns`.
    """

    cells: NDArray[np.int64]
    coordinates: FloatArray
    row: FloatArray
    given: FloatArray
    tensor: FloatArray
    sizes: FloatArray
    before: FloatArray
    one: Room
    found: NDArray[np.int64]
    values: FloatArray
    force: FloatArray
    change: FloatArray
    step: FloatArray
    moved: FloatArray
    search: FloatArray
    lacks: FloatArray


@kernel
def tabulate_lanes(kernels, k, room, size):  # type: ignore[no-untyped-def]
    """Let the kernel k add to the tensor, whose first ``size`` entries are zeroed before."""
    lanes = room.row.shape[1]
    given = room.row[kernels.begins[k, 0] :].ctypes.data
    if kernels.sizes[k, 1] > 0:
        filled = 0
        for piece in range(kernels.begins.shape[1]):
            begin = kernels.begins[k, piece]
            for i in range(kernels.sizes[k, piece]):
                for lane in range(lanes):
                    room.given[filled, lane] = room.row[begin + i, lane]
                filled += 1
        given = room.given.ctypes.data
    for i in range(size):
        for lane in range(lanes):
            room.tensor[i, lane] = 0.0
    pointers = room.tensor.ctypes.data, given, kernels.constants[k], room.coordinates.ctypes.data
    call_tabulate(kernels.addresses[k], pointers)


@kernel
def tabulate_forces_of_lanes(kernels, room, size):  # type: ignore[no-untyped-def]
    """As `tabulate_forces`."""
    for k in range(FORCES, kernels.addresses.shape[0]):
        tabulate_lanes(kernels, k, room, size if k == FORCES else 0)


@kernel
def take_block(cells, b, nodes, x, room):  # type: ignore[no-untyped-def]
    """Collect the numbers and coordinates of a block's cells; how many it has."""
    lanes = room.cells.shape[0]
    count = min(lanes, cells.shape[0] - lanes * b)
    for lane in range(lanes):
        cell = cells[lanes * b + min(lane, count - 1)]
        room.cells[lane] = cell
        for i in range(nodes.shape[1]):
            node = nodes[cell, i]
            for d in range(3):
                room.coordinates[3 * i + d, lane] = x[node, d]
    return count


@kernel
def _average(kernels, room, place, fields):  # type: ignore[no-untyped-def]
    """The means over a block's cells, which stand in their rows at ``place``."""
    tabulate_lanes(kernels, MEAN, room, 2)
    for lane in range(room.row.shape[1]):
        mean = room.tensor[0, lane] / room.tensor[1, lane]
        room.row[place, lane] = mean
        fields.mean[room.cells[lane]] = mean


@kernel
def _gather(blocks, width, fields, kernels, room):  # type: ignore[no-untyped-def]
    """Collect the displacements, history, local unknowns and means of a block's cells."""
    dofs, states = width * blocks.shape[1], fields.state.shape[1]
    for lane in range(room.row.shape[1]):
        cell = room.cells[lane]
        for i in range(blocks.shape[1]):
            block = blocks[cell, i]
            for d in range(width):
                room.row[width * i + d, lane] = fields.u[width * block + d]
        for i in range(states):
            room.row[dofs + i, lane] = fields.state[cell, i]
        for i in range(fields.local.shape[1]):
            room.row[dofs + states + i, lane] = fields.local[cell, i]
    if kernels.addresses[MEAN] != 0:
        _average(kernels, room, dofs + states + fields.local.shape[1], fields)


@kernel
def _gather_whole(blocks, width, fields, inner, own, room):  # type: ignore[no-untyped-def]
    """Collect the displacements, fields of one cell and history of a block's cells."""
    begin = inner.shared.shape[0] + inner.places.shape[0]
    for lane in range(room.row.shape[1]):
        cell = room.cells[lane]
        for i in range(inner.shared.shape[0]):
            room.row[inner.shared[i], lane] = fields.u[width * blocks[cell, i // width] + i % width]
        for i in range(inner.places.shape[0]):
            room.row[inner.places[i], lane] = own[cell, i]
        for i in range(fields.state.shape[1]):
            room.row[begin + i, lane] = fields.state[cell, i]


@kernel
def of_lane(room, lane):  # type: ignore[no-untyped-def]
    """Work at one of the cells."""
    one = room.one
    return Room(
        one.coordinates, room.row[:, lane], one.given, room.tensor[:, lane], one.matrix, room.sizes[lane], one.steps,
        one.where, one.given_law, one.made_by_law,
    )  # fmt: skip


@kernel
def _change_lane(kernels, room, lane, begin, slopes, tolerance):  # type: ignore[no-untyped-def]
    """A Newton step of the local unknowns of one cell."""
    one = of_lane(room, lane)
    sizes, before = room.sizes[lane], room.before[lane]
    sizes[1] = 0.0
    for point in range(kernels.weights.shape[0]):
        change_point(kernels, one, point, begin, slopes)
    change = 0.0
    for i in range(sizes.shape[1]):
        size = max(sizes[0, i], LEAST)
        if not sizes[1, i] <= change * size:
            change = sizes[1, i] / size
    if change <= tolerance or (change <= STALLED and change > 0.5 * before):
        change = 0.0
    room.before[lane] = change


@kernel
def _solve_local(kernels, room, fields, begin, sweeps, tolerance):  # type: ignore[no-untyped-def]
    """Solve for the local unknowns of cells of a block by whole Newton steps."""
    lanes, points, n = room.row.shape[1], kernels.weights.shape[0], room.one.matrix.shape[0]
    room.sizes[:] = 0.0
    for _ in range(sweeps):
        tabulate_lanes(kernels, LOCAL, room, points * n * (n + 1))
        goes_on = False
        for lane in range(lanes):
            if room.before[lane] > 0.0:  # neither solved for nor NaN
                _change_lane(kernels, room, lane, begin, fields.slopes[room.cells[lane]], tolerance)
                goes_on = goes_on or room.before[lane] > 0.0
        if not goes_on:
            return


@kernel
def _apply_law(kernels, room, fields, state, begin):  # type: ignore[no-untyped-def]
    """Let the law make the local unknowns of cells of a block."""
    tabulate_lanes(kernels, LOCAL, room, 6 * kernels.weights.shape[0])
    for lane in range(room.row.shape[1]):
        if room.before[lane] == 0.0:
            continue
        slopes = fields.slopes[room.cells[lane]]
        room.before[lane] = law_at_points(kernels, of_lane(room, lane), state, begin, slopes)


@kernel
def solve_points_of_lanes(kernels, room, fields, state, begin, sweeps, tolerance):  # type: ignore[no-untyped-def]
    """Solve for the local unknowns, in their rows, of those cells of a block whose change before is infinite, not 0."""
    if kernels.addresses[LAW] != 0:
        _apply_law(kernels, room, fields, state, begin)
    else:
        _solve_local(kernels, room, fields, begin, sweeps, tolerance)


@kernel
def weigh_history(room, first, fields, kernels):  # type: ignore[no-untyped-def]
    """Make of integrals over the points, in the tensor from ``first`` on, the history at the step's end."""
    points = kernels.weights.shape[0]
    each = fields.trial.shape[1] // points
    for point in range(points):
        weight = kernels.weights[point]
        for i in range(each * point, each * (point + 1)):
            for lane in range(room.tensor.shape[1]):
                room.tensor[first + i, lane] /= weight


@kernel
def keep_lane(room, lane, first, fields):  # type: ignore[no-untyped-def]
    """Keep the history of one cell at the step's end, which stands in the tensor from ``first`` on."""
    cell = room.cells[lane]
    for i in range(fields.trial.shape[1]):
        fields.trial[cell, i] = room.tensor[first + i, lane]


@kernel
def _keep(room, count, first, fields, kernels):  # type: ignore[no-untyped-def]
    """Keep the history of a block's cells."""
    weigh_history(room, first, fields, kernels)
    for lane in range(count):
        if room.before[lane] == 0.0:
            keep_lane(room, lane, first, fields)


@kernel
def _add(room, count, blocks, width, forces):  # type: ignore[no-untyped-def]
    """Add the forces of a block's cells, cell by cell."""
    for lane in range(count):
        cell = room.cells[lane]
        if room.before[lane] != 0.0:
            continue
        for i in range(blocks.shape[1]):
            block = blocks[cell, i]
            for d in range(width):
                forces[width * block + d] += room.tensor[width * i + d, lane]


@entry_kernel
def pass_blocks(  # type: ignore[no-untyped-def]
    cells, first, last, nodes, x, blocks, width, fields, kernels, room, forces, kept, left, sweeps, tolerance
):
    """Means, local unknowns, internal forces and the history at the step's end, of some blocks of cells.

    Args:
        cells: (k,) the group's.
        first: block.
        last: block behind.
        nodes: (all cells, n) of the geometry.
        x: (nodes, 3) m.
        blocks: (all cells, m) of the unknowns' dofs.
        width: dofs of a block.
        fields: what is read and written.
        kernels: of blocks; the law is that of a point.
        room: to work in.
        forces: (dofs,) N, to which they are added.
        kept: (k, dofs of a cell) N, where they are put in the place of it; without rows, not.
        left: (k,) set to 1 where local unknowns were not solved for, and nothing was added or kept.
        sweeps: the most local Newton steps.
        tolerance: change of the local unknowns over their sizes at which they end.
    """
    dofs, states, locals_ = width * blocks.shape[1], fields.state.shape[1], fields.local.shape[1]
    lanes, begin = room.row.shape[1], dofs + states
    for b in range(first, last):
        count = take_block(cells, b, nodes, x, room)
        _gather(blocks, width, fields, kernels, room)
        if locals_ > 0:
            room.before[:] = np.inf
            solve_points_of_lanes(kernels, room, fields, dofs, begin, sweeps, tolerance)
            for lane in range(count):
                if room.before[lane] != 0.0:
                    left[lanes * b + lane] = 1
                    continue
                for i in range(locals_):
                    fields.local[room.cells[lane], i] = room.row[begin + i, lane]
        tabulate_forces_of_lanes(kernels, room, begin)
        if kept.shape[0] == 0:
            _add(room, count, blocks, width, forces)
        else:
            for lane in range(count):
                for i in range(dofs):
                    kept[lanes * b + lane, i] = room.tensor[i, lane]
        if states > 0:
            _keep(room, count, dofs, fields, kernels)


@entry_kernel
def block_totals(  # type: ignore[no-untyped-def]
    cells, first, last, nodes, x, blocks, width, fields, kernels, room, inner, own, totals
):
    """What kernels integrate over each cell, of some blocks, with its mean before.

    Args:
        cells: (k,) the group's.
        first: block.
        last: block behind.
        nodes: (all cells, n) of the geometry.
        x: (nodes, 3) m.
        blocks: (all cells, m) of the unknowns' dofs.
        width: dofs of a block.
        fields: what is read and written.
        kernels: that of the mean, and in the place of those of forces what integrates.
        room: to work in.
        inner: fields of one cell: their places.
        own: (all cells, m) their values.
        totals: (k, n) of the group's cells, which are set.
    """
    lanes = room.row.shape[1]
    for b in range(first, last):
        count = take_block(cells, b, nodes, x, room)
        if inner.places.shape[0] == 0:
            _gather(blocks, width, fields, kernels, room)
        else:
            _gather_whole(blocks, width, fields, inner, own, room)
        tabulate_forces_of_lanes(kernels, room, totals.shape[1])
        for lane in range(count):
            for i in range(totals.shape[1]):
                totals[lanes * b + lane, i] = room.tensor[i, lane]


@entry_kernel
def sum_kept(first, last, starts, places, kept, width, forces):  # type: ignore[no-untyped-def]
    """Add the kept forces of cells, of some nodes.

    Args:
        first: node.
        last: node behind.
        starts: (nodes + 1,) where each node's places begin.
        places: of each node, its cells in order: their rows of ``kept`` times the nodes of a cell, plus its place.
        kept: as in `pass_blocks`.
        width: dofs of a node.
        forces: (dofs,) N.
    """
    nodes = kept.shape[1] // width
    for node in range(first, last):
        for j in range(starts[node], starts[node + 1]):
            c, i = places[j] // nodes, places[j] % nodes
            for d in range(width):
                forces[width * node + d] += kept[c, width * i + d]
