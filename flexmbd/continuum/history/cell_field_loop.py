"""Fields of one cell in the compiled loop over cells: solved for by Newton's method with a kept inverse.

Of what their equations lack follows their change, and of it that of the cell's forces; where this is small it is added,
and the cell is done.
"""

from __future__ import annotations

import numpy as np

from flexmbd.continuum.history.point_loop import FORCES, solve_points, tabulate
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.round_off import ROUND_OFF

#: Most steps with one inverse, and the part of the change before above which a new one is asked for, which costs some
#: ten evaluations of a cell's forces.
CELL_SWEEPS, CONTRACTION = 24, 0.1

#: A step of theirs is halved, so often at most, while the work that it does on what their equations lack does not fall
#: to this part.
HALVINGS, WORK_RATIO = 8, 0.8

#: Smaller numbers have fewer digits.
UNDERFLOW = 1e-290


@kernel
def gather_whole(cell, blocks, width, fields, inner, room, predicts):  # type: ignore[no-untyped-def]
    """Collect a cell's shared unknowns and its fields; ``predicts``: these as they follow those linearly."""
    follows = predicts != 0 and inner.known[cell] != 0
    n, m = inner.shared.shape[0], inner.places.shape[0]
    for i in range(blocks.shape[1]):
        for d in range(width):
            dof = width * blocks[cell, i] + d
            room.row[inner.shared[width * i + d]] = fields.u[dof]
            inner.moved[width * i + d] = fields.u[dof] - inner.before[dof]
    if follows:
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
def change_fields(cell, room, inner, search, accuracy):  # type: ignore[no-untyped-def]
    """A step of the fields of a cell by the forces at hand in ``inner.force``, which follow it.

    Args:
        cell: of them.
        room: with the cell's row.
        inner: the fields.
        search: (3,) the change of the forces by the step before, the work of that step, how often it was halved;
            infinite, 0 and 0 to begin with.
        accuracy: change of a cell's forces over these at which the fields end.

    Returns:
        0 where forces are wanted anew, 1 where the fields are solved for, 2 where they want a new tangent.
    """
    m = inner.places.shape[0]
    left = 0.0
    for i in range(m):
        left += inner.force[inner.places[i]] * inner.change[i]
    if search[1] != 0.0 and search[2] < HALVINGS and not abs(left) <= WORK_RATIO * abs(search[1]):
        # too far: the step does no less work on what is lacking at its end than at its begin
        search[1], search[2] = 0.5 * search[1], search[2] + 1.0
        for i in range(m):
            inner.change[i] *= 0.5
            inner.values[cell, i] -= inner.change[i]
            room.row[inner.places[i]] = inner.values[cell, i]
        return 0
    moved, largest = _newton_step(cell, inner)
    # forces that are no numbers are told by whoever sums them
    done = moved <= accuracy * largest + UNDERFLOW or not moved < np.inf or _is_round_off(cell, room, inner)
    if not done and moved > CONTRACTION * search[0]:
        return 2
    search[0], search[1], search[2] = moved, 0.0, 0.0
    for i in range(m):
        search[1] += inner.force[inner.places[i]] * inner.change[i]
        inner.values[cell, i] += inner.change[i]
        room.row[inner.places[i]] = inner.values[cell, i]
    return 1 if done else 0


@kernel
def solve_cell(cell, begin, fields, kernels, room, inner, sweeps, tolerance, accuracy):  # type: ignore[no-untyped-def]
    """Forces of a cell whose fields are solved for, in ``inner.force``; ``inner.solved`` tells whether they are.

    Returns:
        As `solve_points`.
    """
    n, m = inner.shared.shape[0], inner.places.shape[0]
    inner.search[0], inner.search[1], inner.search[2] = np.inf, 0.0, 0.0
    for _ in range(CELL_SWEEPS):
        if fields.local.shape[1] > 0:
            change = solve_points(cell, begin, fields.state.shape[1], fields, kernels, room, sweeps, tolerance)
            if change != 0.0:
                return change
        for i in range(n + m):
            inner.force[i] = 0.0
        for k in range(FORCES, kernels.addresses.shape[0]):
            tabulate(kernels, k, room, begin)
            for i in range(n + m):
                inner.force[i] += room.tensor[i]
        found = change_fields(cell, room, inner, inner.search, accuracy)
        if found == 1:
            inner.solved[cell] = 1
        if found != 0:
            return 0.0
    return 0.0
