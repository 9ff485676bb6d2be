"""The compiled loop over cells that calls, cell by cell, the kernels FFCx made of a body's forms."""

from __future__ import annotations

from flexmbd.continuum.history.cell_field_loop import gather_whole, solve_cell
from flexmbd.continuum.history.point_loop import FORCES, MEAN, solve_points, tabulate, tabulate_forces
from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel


@kernel
def _gather(cell, nodes, x, blocks, width, fields, room):  # type: ignore[no-untyped-def]
    """Collect a cell's coordinates, displacement and history."""
    for i in range(nodes.shape[1]):
        for d in range(3):
            room.coordinates[i, d] = x[nodes[cell, i], d]
    for i in range(blocks.shape[1]):
        for d in range(width):
            room.row[width * i + d] = fields.u[width * blocks[cell, i] + d]
    for i in range(fields.state.shape[1]):
        room.row[width * blocks.shape[1] + i] = fields.state[cell, i]


@kernel
def _keep(cell, first, fields, kernels, room):  # type: ignore[no-untyped-def]
    """Keep a cell's history at the step's end, which stands in the tensor from ``first`` on."""
    points = kernels.weights.shape[0]
    each = fields.trial.shape[1] // points
    for point in range(points):
        for i in range(each * point, each * (point + 1)):
            fields.trial[cell, i] = room.tensor[first + i] / kernels.weights[point]


@kernel
def _pass_condensed(  # type: ignore[no-untyped-def]
    cell, blocks, width, begin, fields, kernels, room, inner, forces, sweeps, tolerance, accuracy, fresh
):
    """As `pass_cells`, of a cell with fields of its own; forces and history once they are solved for."""
    inner.solved[cell] = 0
    if inner.known[cell] == 0:
        if fields.local.shape[1] == 0:
            return 0.0
        # which its tangent wants
        return solve_points(cell, begin, fields.state.shape[1], fields, kernels, room, sweeps, tolerance)
    change = solve_cell(cell, begin, fields, kernels, room, inner, sweeps, tolerance, accuracy, fresh, width)
    if change != 0.0 or inner.solved[cell] == 0:
        return change
    for i in range(blocks.shape[1]):
        for d in range(width):
            forces[width * blocks[cell, i] + d] += inner.force[inner.shared[width * i + d]]
    if fields.state.shape[1] > 0:
        _keep(cell, begin - fields.state.shape[1], fields, kernels, room)
    return 0.0


@entry_kernel
def pass_cells(  # type: ignore[no-untyped-def]
    cells, nodes, x, blocks, width, fields, kernels, room, inner, forces, sweeps, tolerance, accuracy, predicts
):
    """Means, local unknowns, internal forces and the history at the step's end, cell by cell.

    Of a table that ends before the kernels of forces, and of fields without local unknowns, the means alone.  Cells
    whose own fields are not solved for add nothing; they are told by ``inner.solved``.

    Args:
        cells: (k,) the group's.
        nodes: (all cells, n) of the geometry.
        x: (nodes, 3) m.
        blocks: (all cells, m) of the unknowns' dofs.
        width: dofs of a block.
        fields: what is read and written.
        kernels: of the group.
        room: to work in.
        inner: fields of one cell.
        forces: (dofs,) N, to which they are added.
        sweeps: the most local Newton steps: whole ones, and shortened ones where these fail.
        tolerance: change of the local unknowns over their sizes at which they end.
        accuracy: change of a cell's forces over these at which its own fields end.
        predicts: whether these begin as they follow the shared unknowns linearly from ``inner.before``; else their
            tangents are of this trial.

    Returns:
        The last change of the local unknowns of the first cell where they were not solved, or what its law says is
        wrong; or 0.
    """
    states, locals_, own = fields.state.shape[1], fields.local.shape[1], inner.places.shape[0]
    dofs = width * blocks.shape[1] + own
    begin = dofs + states
    for c in range(cells.shape[0]):
        cell = cells[c]
        _gather(cell, nodes, x, blocks, width, fields, room)
        if own > 0:
            gather_whole(cell, blocks, width, fields, inner, room, predicts)
            change = _pass_condensed(
                cell, blocks, width, begin, fields, kernels, room, inner, forces, sweeps, tolerance, accuracy,
                predicts == 0,
            )
            if change != 0.0:
                return change
            continue
        if kernels.addresses[MEAN] != 0:
            tabulate(kernels, MEAN, room, 2)
            fields.mean[cell] = room.tensor[0] / room.tensor[1]
            room.row[begin + locals_] = fields.mean[cell]
        if locals_ > 0:
            change = solve_points(cell, begin, states, fields, kernels, room, sweeps, tolerance)
            if change != 0.0:
                return change
        if kernels.addresses.shape[0] == FORCES:
            continue
        tabulate_forces(kernels, room, begin)
        for i in range(blocks.shape[1]):
            for d in range(width):
                forces[width * blocks[cell, i] + d] += room.tensor[width * i + d]
        if states > 0:
            _keep(cell, dofs, fields, kernels, room)
    return 0.0
