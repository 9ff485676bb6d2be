"""What the compiled loop over cells does at the points of one: local unknowns solved for, laws called; its structures.

The values of a cell lie in one row: unknown, history, local unknowns, mean.  Each kernel that FFCx made takes pieces.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.tabulate import call_tabulate
from flexmbd.round_off import STALLED

FloatArray = NDArray[np.float64]

#: Places of the kernels that average, that have the equations of the local unknowns or the strain of a law, and of
#: that law; those of forces follow.
MEAN, LOCAL, LAW, FORCES = 0, 1, 2, 3

#: Local unknowns are of the size of strains; below this one they are taken to be this large, for they may vanish.
LEAST = 1e-3


#: The least part of a Newton step of local unknowns that is tried where the whole does not lessen what they lack.
SHORTEST = 2.0**-10


class Kernels(NamedTuple):
    """The kernels of a group of cells.

    Attributes:
        addresses: (k,) of their code; zero where there is none.
        constants: (k,) addresses of what they take as constants.
        begins: (k, pieces) of the pieces of a cell's row that they take; of one alone where they follow each other.
        sizes: (k, pieces).
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
        inverse: (cells, m, m) of their part of a tangent, column by column.
        coupling: (cells, m, n) derivatives of the shared unknowns' forces by the fields, field by field.
        known: (cells,) whether there is such a tangent.
        solved: (cells,) whether they are solved for the trial.
        force: (n + m,) room for what a cell's terms make.
        change: (m,) room for a Newton step.
        step: (m,) room for the next one.
        moved: (n,) room for what goes with it.
        search: (4,) room for what is remembered of Newton's last step.
        lacks: (2, m) room for what their equations lack, and lacked before the last step.
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
    step: FloatArray
    moved: FloatArray
    search: FloatArray
    lacks: FloatArray


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
def tabulate(kernels, k, room, size):  # type: ignore[no-untyped-def]
    """Let the kernel k add to the tensor, whose first ``size`` entries are zeroed before."""
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
def tabulate_forces(kernels, room, size):  # type: ignore[no-untyped-def]
    """Let the kernels of forces write their sum, with the history behind it, the first ``size`` entries."""
    for k in range(FORCES, kernels.addresses.shape[0]):
        tabulate(kernels, k, room, size if k == FORCES else 0)  # a kernel adds to what is there


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
def change_point(kernels, room, point, begin, slopes):  # type: ignore[no-untyped-def]
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
    change_point(kernels, room, point, begin, slopes)


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
        tabulate(kernels, LOCAL, room, points * n * (n + 1))
        room.sizes[1] = 0.0
        for point in range(points):
            if shorten:
                _shorten_or_change_point(kernels, room, point, begin, slopes)
            else:
                change_point(kernels, room, point, begin, slopes)
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
    tabulate(kernels, LOCAL, room, 6 * kernels.weights.shape[0])
    return law_at_points(kernels, room, state, begin, slopes)


@kernel
def law_at_points(kernels, room, state, begin, slopes):  # type: ignore[no-untyped-def]
    """The same with the strains in the tensor."""
    points, given, made = kernels.weights.shape[0], room.given_law, room.made_by_law
    kept, size = given.shape[0] - 6, made.shape[0] - 37
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
def solve_points(cell, begin, states, fields, kernels, room, sweeps, tolerance):  # type: ignore[no-untyped-def]
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
