"""The compiled loop over cells that calls, cell by cell, the kernels FFCx made of a body's forms.

The values of a cell lie in one row: unknown, history, local unknowns, mean.  Each kernel takes pieces of it.

Fields of one cell are solved for cell by cell, by Newton's method with a kept inverse of their own part of the tangent:
of what their equations lack follows their change, and of it that of the cell's forces; where this is small it is added,
and the cell is done.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel
from flexmbd.multibody.kernels.base.tabulate import call_tabulate
from flexmbd.round_off import ROUND_OFF, STALLED

FloatArray = NDArray[np.float64]

#: Places of the kernels that average, that have the equations of the local unknowns or the strain of a law, and of
#: that law; those of forces follow.
MEAN, LOCAL, LAW, FORCES = 0, 1, 2, 3

#: Local unknowns are of the size of strains; below this one they are taken to be this large, for they may vanish.
LEAST = 1e-3


#: The least part of a Newton step of local unknowns that is tried where the whole does not lessen what they lack.
SHORTEST = 2.0**-10

#: Fields of one cell: most steps with one inverse, and the part of the change before above which a new one is asked for,
#: which costs some ten evaluations of a cell's forces.
CELL_SWEEPS, CONTRACTION = 24, 0.1

#: A step of theirs is halved, so often at most, while the work that it does on what their equations lack does not fall to
#: this part.
HALVINGS, WORK_RATIO = 8, 0.8

#: Smaller numbers have fewer digits.
UNDERFLOW = 1e-290


class Kernels(NamedTuple):
    """The kernels of a group of cells.

    Attributes:
        addresses: (k,) of their code; zero where there is none.
        constants: (k,) addresses of what they take as constants.
        begins: (k, 4) of the pieces of a cell's row that they take; of one alone where they follow each other.
        sizes: (k, 4).
        weights: (points,) of the rule at whose points history and local unknowns lie.
    """

    addresses: NDArray[np.int64]
    constants: NDArray[np.int64]
    begins: NDArray[np.int64]
    sizes: NDArray[np.int64]
    weights: FloatArray


class Fields(NamedTuple):
    """The arrays that a group's kernels read and write.

    Attributes:
        u: (dofs,) trial displacement, m, and other unknowns.
        state: (cells, points * components) history at the step's begin.
        local: (cells, points * n) local unknowns, to begin with, and solved.
        slopes: (cells, points * n * n) inverses of the derivatives of their equations.
        mean: (cells,) means over the cells, or empty.
        trial: (cells, points * components) history at the step's end.
    """

    u: FloatArray
    state: FloatArray
    local: FloatArray
    slopes: FloatArray
    mean: FloatArray
    trial: FloatArray


class CellUnknowns(NamedTuple):
    """Fields of one cell, m in a cell of n shared unknowns; arrays of no size where there are none.

    Attributes:
        shared: (n,) places of the shared unknowns in the cell's unknown.
        places: (m,) those of the fields.
        values: (cells, m) of the fields, to begin with, and solved.
        before: (dofs,) shared unknown for which they were solved last.
        inverse: (cells, m * m) of their part of a tangent.
        coupling: (cells, m * n) derivatives of the shared unknowns' forces by the fields, field by field.
        known: (cells,) whether there is such a tangent.
        solved: (cells,) whether they are solved for the trial.
        force: (n + m,) room for what a cell's terms make.
        change: (m,) room for a Newton step.
        moved: (n,) room for what goes with it.
    """

    shared: NDArray[np.int64]
    places: NDArray[np.int64]
    values: FloatArray
    before: FloatArray
    inverse: FloatArray
    coupling: FloatArray
    known: NDArray[np.int64]
    solved: NDArray[np.int64]
    force: FloatArray
    change: FloatArray
    moved: FloatArray


class Room(NamedTuple):
    """Where a cell is worked on.

    Attributes:
        coordinates: (nodes, 3) m.
        row: the cell's values.
        given: what a kernel takes of them.
        tensor: what it returns.
        matrix: (n, 2 n) of the equations of n local unknowns.
        sizes: (2, n) of the local unknowns in the cell: their largest values and their last changes.
        steps: (points, n + 2) the last step of a point's unknowns where steps are shortened, how much of Newton's it
            is, and what the equations lacked before it.
        where: cell and point where they changed most.
        given_law: what a law is given at a point.
        made_by_law: what it returns.
    """

    coordinates: FloatArray
    row: FloatArray
    given: FloatArray
    tensor: FloatArray
    matrix: FloatArray
    sizes: FloatArray
    steps: FloatArray
    where: NDArray[np.int64]
    given_law: FloatArray
    made_by_law: FloatArray


@kernel
def _tabulate(kernels, k, room, size):  # type: ignore[no-untyped-def]
    """Let the kernel k write the first ``size`` entries of its tensor."""
    given = room.row[kernels.begins[k, 0] :].ctypes.data
    if kernels.sizes[k, 1] > 0:
        filled = 0
        for piece in range(kernels.begins.shape[1]):
            begin = kernels.begins[k, piece]
            for i in range(kernels.sizes[k, piece]):
                room.given[filled] = room.row[begin + i]
                filled += 1
        given = room.given.ctypes.data
    for i in range(size):
        room.tensor[i] = 0.0
    pointers = room.tensor.ctypes.data, given, kernels.constants[k], room.coordinates.ctypes.data
    call_tabulate(kernels.addresses[k], pointers)


@kernel
def _invert(matrix):  # type: ignore[no-untyped-def]
    """Invert the left half (n, n) into the right half, with exchange of rows; NaN where it is singular."""
    n = matrix.shape[0]
    for i in range(n):
        for j in range(n):
            matrix[i, n + j] = 1.0 if i == j else 0.0
    for k in range(n):
        pivot = k
        for i in range(k + 1, n):
            if abs(matrix[i, k]) > abs(matrix[pivot, k]):
                pivot = i
        if matrix[pivot, k] == 0.0:
            matrix[:, n:] = np.nan
            return
        if pivot != k:
            for j in range(2 * n):
                matrix[k, j], matrix[pivot, j] = matrix[pivot, j], matrix[k, j]
        head = 1.0 / matrix[k, k]
        for j in range(2 * n):
            matrix[k, j] *= head
        for i in range(n):
            factor = matrix[i, k]
            if i != k and factor != 0.0:
                for j in range(2 * n):
                    matrix[i, j] -= factor * matrix[k, j]


@kernel
def _note_change(room, point, i, value, change):  # type: ignore[no-untyped-def]
    """Note the size of a local unknown and of its change; written so that NaN is kept."""
    if not abs(change) <= room.sizes[1, i]:
        room.sizes[1, i] = abs(change)
        room.where[1] = point
    if not abs(value) <= room.sizes[0, i]:
        room.sizes[0, i] = abs(value)


@kernel
def _change_point(kernels, room, point, begin, slopes):  # type: ignore[no-untyped-def]
    """A Newton step of the local unknowns of one point, in the cell's row; its sizes are noted."""
    matrix = room.matrix
    n = matrix.shape[0]
    first, weight = point * n * (n + 1), kernels.weights[point]
    for i in range(n):
        for j in range(n):
            matrix[i, j] = room.tensor[first + n + n * i + j] / weight
    _invert(matrix)
    for i in range(n):
        change = 0.0
        for j in range(n):
            slopes[n * n * point + n * i + j] = matrix[i, n + j]
            change += matrix[i, n + j] * room.tensor[first + j] / weight
        value = room.row[begin + n * point + i] - change
        room.row[begin + n * point + i] = value
        room.steps[point, i] = change
        _note_change(room, point, i, value, change)


@kernel
def _shorten_or_change_point(kernels, room, point, begin, slopes):  # type: ignore[no-untyped-def]
    """Take half of the last step of one point back if the equations lack no less after it, else a new Newton step."""
    n = room.matrix.shape[0]
    first, step = point * n * (n + 1), room.steps[point]
    lack, moved = 0.0, 0.0
    for i in range(n):
        lack += (room.tensor[first + i] / kernels.weights[point]) ** 2
        moved = max(moved, abs(step[i]) / max(room.sizes[0, i], LEAST))
    share = step[n]
    if not lack <= (1.0 - 1e-4 * share) * step[n + 1] and share > SHORTEST and not moved <= STALLED:
        step[n] = 0.5 * share
        for i in range(n):
            step[i] *= 0.5
            room.row[begin + n * point + i] += step[i]
            _note_change(room, point, i, room.row[begin + n * point + i], step[i])
        return
    step[n], step[n + 1] = 1.0, lack
    _change_point(kernels, room, point, begin, slopes)


@kernel
def _solve_local(kernels, room, begin, slopes, sweeps, tolerance, shorten):  # type: ignore[no-untyped-def]
    """Solve for the local unknowns of a cell, in its row; ``shorten``: steps where they do not lessen what is lacking.

    Returns:
        The last change, each unknown's over its size in the cell; 0 where they are solved.
    """
    points, n = kernels.weights.shape[0], room.matrix.shape[0]
    room.sizes[0] = 0.0
    room.steps[:, n] = 1.0
    room.steps[:, n + 1] = np.inf
    before = np.inf
    for _ in range(sweeps):
        _tabulate(kernels, LOCAL, room, points * n * (n + 1))
        room.sizes[1] = 0.0
        for point in range(points):
            if shorten:
                _shorten_or_change_point(kernels, room, point, begin, slopes)
            else:
                _change_point(kernels, room, point, begin, slopes)
        change = 0.0
        for i in range(n):
            size = max(room.sizes[0, i], LEAST)
            if not room.sizes[1, i] <= change * size:
                change = room.sizes[1, i] / size
        if change <= tolerance or (change <= STALLED and change > 0.5 * before):
            return 0.0
        if not np.isfinite(change):
            return change
        before = change
    return before


@kernel
def _apply_law(kernels, room, state, begin, slopes):  # type: ignore[no-untyped-def]
    """Let the law make the local unknowns of a cell, in its row, of strain and history, which begins at ``state``.

    Returns:
        What the law says is wrong, or 0.
    """
    points, given, made = kernels.weights.shape[0], room.given_law, room.made_by_law
    kept, size = given.shape[0] - 6, made.shape[0] - 37
    _tabulate(kernels, LOCAL, room, 6 * points)
    for point in range(points):
        for i in range(6):
            given[i] = room.tensor[6 * point + i] / kernels.weights[point]
        for i in range(kept):
            given[6 + i] = room.row[state + kept * point + i]
        address = given.ctypes.data
        call_tabulate(kernels.addresses[LAW], (made.ctypes.data, address, kernels.constants[LAW], address))
        if made[size + 36] != 0.0:
            room.where[1] = point
            return made[size + 36]
        for i in range(size):
            room.row[begin + size * point + i] = made[i]
        for i in range(36):
            slopes[36 * point + i] = made[size + i]
    return 0.0


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
def _gather_whole(cell, blocks, width, fields, inner, room, predicts):  # type: ignore[no-untyped-def]
    """Collect a cell's shared unknowns and fields in their places; ``predicts``: these as they follow those linearly."""
    n, m = inner.shared.shape[0], inner.places.shape[0]
    for i in range(blocks.shape[1]):
        for d in range(width):
            dof = width * blocks[cell, i] + d
            room.row[inner.shared[width * i + d]] = fields.u[dof]
            inner.moved[width * i + d] = fields.u[dof] - inner.before[dof]
    if predicts:
        coupling, inverse = inner.coupling[cell], inner.inverse[cell]
        for k in range(m):
            lack = 0.0
            for j in range(n):
                lack += coupling[n * k + j] * inner.moved[j]
            inner.change[k] = lack
        for i in range(m):
            for k in range(m):
                inner.values[cell, i] -= inverse[m * i + k] * inner.change[k]
    for i in range(m):
        room.row[inner.places[i]] = inner.values[cell, i]
    for i in range(fields.state.shape[1]):
        room.row[n + m + i] = fields.state[cell, i]


@kernel
def _keep(cell, first, fields, kernels, room):  # type: ignore[no-untyped-def]
    """Keep a cell's history at the step's end, which stands in the tensor from ``first`` on."""
    points = kernels.weights.shape[0]
    each = fields.trial.shape[1] // points
    for point in range(points):
        for i in range(each * point, each * (point + 1)):
            fields.trial[cell, i] = room.tensor[first + i] / kernels.weights[point]


@kernel
def _solve_points(cell, begin, states, fields, kernels, room, sweeps, tolerance):  # type: ignore[no-untyped-def]
    """Solve for the local unknowns of a cell, which are kept; the change, or what a law says, where they are not."""
    locals_ = fields.local.shape[1]
    for i in range(locals_):
        room.row[begin + i] = fields.local[cell, i]
    if kernels.addresses[LAW] != 0:
        change = _apply_law(kernels, room, begin - states, begin, fields.slopes[cell])
    else:
        change = _solve_local(kernels, room, begin, fields.slopes[cell], sweeps[0], tolerance, False)
    if change != 0.0 and kernels.addresses[LAW] == 0:
        for i in range(locals_):
            room.row[begin + i] = fields.local[cell, i]
        change = _solve_local(kernels, room, begin, fields.slopes[cell], sweeps[1], tolerance, True)
    if change != 0.0:
        room.where[0] = cell
        return change
    for i in range(locals_):
        fields.local[cell, i] = room.row[begin + i]
    return 0.0


@kernel
def _newton_step(cell, inner):  # type: ignore[no-untyped-def]
    """A step of the fields of a cell by what their equations lack, which is added to the forces of shared unknowns.

    Returns:
        The largest change of these forces by it, and the largest of them.
    """
    n, m, force, change = inner.shared.shape[0], inner.places.shape[0], inner.force, inner.change
    inverse, coupling = inner.inverse[cell], inner.coupling[cell]
    for i in range(m):
        step = 0.0
        for k in range(m):
            step -= inverse[m * i + k] * force[inner.places[k]]
        change[i] = step
    for j in range(n):
        inner.moved[j] = 0.0
    for k in range(m):
        for j in range(n):
            inner.moved[j] += coupling[n * k + j] * change[k]
    moved, largest = 0.0, 0.0
    for j in range(n):
        add = inner.moved[j]
        force[inner.shared[j]] += add
        if not abs(add) <= moved:
            moved = abs(add)
        largest = max(largest, abs(force[inner.shared[j]]))
    return moved, largest


@kernel
def _is_round_off(cell, room, inner):  # type: ignore[no-untyped-def]
    """Whether a step of the fields of a cell is round-off of their equations, as where the cell has no stress."""
    n, m = inner.shared.shape[0], inner.places.shape[0]
    inverse, coupling = inner.inverse[cell], inner.coupling[cell]
    for i in range(m):
        size = abs(inner.values[cell, i])
        for k in range(m):
            summed = 0.0
            for j in range(n):
                summed += abs(coupling[n * k + j] * room.row[inner.shared[j]])
            size += abs(inverse[m * i + k]) * summed
        if abs(inner.change[i]) > ROUND_OFF * size:
            return False
    return True


@kernel
def _solve_cell(cell, begin, fields, kernels, room, inner, sweeps, tolerance, accuracy):  # type: ignore[no-untyped-def]
    """Forces of a cell whose fields are solved for, in ``inner.force``; ``inner.solved`` tells whether they are.

    Returns:
        As `_solve_points`.
    """
    n, m = inner.shared.shape[0], inner.places.shape[0]
    before, work, halved = np.inf, 0.0, 0
    for _ in range(CELL_SWEEPS):
        if fields.local.shape[1] > 0:
            change = _solve_points(cell, begin, fields.state.shape[1], fields, kernels, room, sweeps, tolerance)
            if change != 0.0:
                return change
        for i in range(n + m):
            inner.force[i] = 0.0
        for k in range(FORCES, kernels.addresses.shape[0]):
            _tabulate(kernels, k, room, begin)
            for i in range(n + m):
                inner.force[i] += room.tensor[i]
        left = 0.0
        for i in range(m):
            left += inner.force[inner.places[i]] * inner.change[i]
        if work != 0.0 and halved < HALVINGS and not abs(left) <= WORK_RATIO * abs(work):
            # too far: the step does no less work on what is lacking at its end than at its begin
            work, halved = 0.5 * work, halved + 1
            for i in range(m):
                inner.change[i] *= 0.5
                inner.values[cell, i] -= inner.change[i]
                room.row[inner.places[i]] = inner.values[cell, i]
            continue
        moved, largest = _newton_step(cell, inner)
        # forces that are no numbers are told by whoever sums them
        done = moved <= accuracy * largest + UNDERFLOW or not moved < np.inf or _is_round_off(cell, room, inner)
        if not done and moved > CONTRACTION * before:
            return 0.0
        before, work, halved = moved, 0.0, 0
        for i in range(m):
            work += inner.force[inner.places[i]] * inner.change[i]
            inner.values[cell, i] += inner.change[i]
            room.row[inner.places[i]] = inner.values[cell, i]
        if done:
            inner.solved[cell] = 1
            return 0.0
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
        predicts: whether these begin as they follow the shared unknowns linearly from ``inner.before``.

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
            inner.solved[cell] = 0
            _gather_whole(cell, blocks, width, fields, inner, room, predicts != 0 and inner.known[cell] != 0)
            if inner.known[cell] == 0:
                change = 0.0
                if locals_ > 0:  # which its tangent wants
                    change = _solve_points(cell, begin, states, fields, kernels, room, sweeps, tolerance)
                if change != 0.0:
                    return change
                continue
            change = _solve_cell(cell, begin, fields, kernels, room, inner, sweeps, tolerance, accuracy)
            if change != 0.0:
                return change
            if inner.solved[cell] == 0:
                continue
            for i in range(blocks.shape[1]):
                for d in range(width):
                    forces[width * blocks[cell, i] + d] += inner.force[inner.shared[width * i + d]]
            if states > 0:
                _keep(cell, dofs, fields, kernels, room)
            continue
        if kernels.addresses[MEAN] != 0:
            _tabulate(kernels, MEAN, room, 2)
            fields.mean[cell] = room.tensor[0] / room.tensor[1]
            room.row[begin + locals_] = fields.mean[cell]
        if locals_ > 0:
            change = _solve_points(cell, begin, states, fields, kernels, room, sweeps, tolerance)
            if change != 0.0:
                return change
        for k in range(FORCES, kernels.addresses.shape[0]):
            _tabulate(kernels, k, room, begin)
            for i in range(blocks.shape[1]):
                for d in range(width):
                    forces[width * blocks[cell, i] + d] += room.tensor[width * i + d]
        if states > 0 and kernels.addresses.shape[0] > FORCES:
            _keep(cell, dofs, fields, kernels, room)
    return 0.0
