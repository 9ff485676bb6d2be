"""Fields of one cell in the compiled loop over cells: solved for by Newton's method with a kept inverse.

What their equations lack gives a step of the fields, and the step a change of the cell's forces. Where the change is
small, both are added, and the cell is done. The inverse learns from its steps, as where the cell begins to flow.
"""

from __future__ import annotations

import numpy as np

from flexmbd.continuum.history.point_loop import solve_points, tabulate_forces
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.round_off import ROUND_OFF

#: Most steps with one inverse, and the part of the change before above which a new one is asked for, which costs some
#: ten evaluations of a cell's forces.
CELL_SWEEPS, CONTRACTION = 24, 0.1

#: An inverse learns where the lack along the next step is such a part of that before, and is kept while steps fall to
#: that one at least.
LEARNS, SLOWEST = (-0.8, 0.95), 0.9

#: A step of theirs is halved, so often at most, while the work that it does on what their equations lack does not fall
#: to this part.
HALVINGS, WORK_RATIO = 8, 0.8

#: Smaller numbers have fewer digits.
UNDERFLOW = 1e-290


@kernel
def _product(row, x):  # type: ignore[no-untyped-def]
    """Product of a matrix's row with x; by four sums, for one would wait for itself."""
    n = x.shape[0]
    first, second, third, fourth = 0.0, 0.0, 0.0, 0.0
    for j in range(0, n - 3, 4):
        first += row[j] * x[j]
        second += row[j + 1] * x[j + 1]
        third += row[j + 2] * x[j + 2]
        fourth += row[j + 3] * x[j + 3]
    for j in range(n - n % 4, n):
        first += row[j] * x[j]
    return (first + second) + (third + fourth)


@kernel
def _solve(inverse, lack, step):  # type: ignore[no-untyped-def]
    """The step that makes up for what is lacking, by an inverse that lies column by column."""
    m = step.shape[0]
    for i in range(m):
        step[i] = 0.0
    for k in range(m):
        x = lack[k]
        for i in range(m):
            step[i] -= inverse[k, i] * x


@kernel
def gather_whole(cell, blocks, width, fields, inner, room, predicts):  # type: ignore[no-untyped-def]
    """Collect a cell's shared unknowns and its fields; ``predicts``: these as they follow those linearly.

    What was added to the fields is in ``inner.change``.
    """
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
            inner.lacks[0, k] = _product(coupling[k], inner.moved)
        _solve(inverse, inner.lacks[0], inner.change)
    for i in range(m):
        if not follows:
            inner.change[i] = 0.0
        inner.values[cell, i] += inner.change[i]
        room.row[inner.places[i]] = inner.values[cell, i]
    for i in range(fields.state.shape[1]):
        room.row[n + m + i] = fields.state[cell, i]


@kernel
def _newton_step(cell, inner):  # type: ignore[no-untyped-def]
    """A step of a cell's fields by what their equations lack, and what it moves: ``inner.step``, ``inner.moved``."""
    n, m, coupling, moved = inner.shared.shape[0], inner.places.shape[0], inner.coupling[cell], inner.moved
    for k in range(m):
        inner.lacks[0, k] = inner.force[inner.places[k]]
    _solve(inner.inverse[cell], inner.lacks[0], inner.step)
    for j in range(n):
        moved[j] = 0.0
    for k in range(m):
        x = inner.step[k]
        for j in range(n):
            moved[j] += coupling[k, j] * x


@kernel
def _largest(inner):  # type: ignore[no-untyped-def]
    """The largest change of the forces of shared unknowns by the step at hand, and the largest of these."""
    moved, largest = 0.0, 0.0
    for j in range(inner.shared.shape[0]):
        add = inner.moved[j]
        if not abs(add) <= moved:
            moved = abs(add)
        largest = max(largest, abs(inner.force[inner.shared[j]] + add))
    return moved, largest


@kernel
def _learn(cell, inner):  # type: ignore[no-untyped-def]
    """Let the inverse learn from what the whole step before did, and change the step at hand with it; whether it does.

    With lack r before and r' after a step by the inverse G, the step at hand is s = -G r'. The least symmetric change
    of G that knows of both adds s s^T / s.(r' - r), and the step becomes s s.r / s.(r - r') (the formula of rank one:
    Broyden 1967, doi:10.1090/S0025-5718-1967-0224273-2). It needs neither a definite matrix nor like units.
    """
    m, n, step, inverse = inner.places.shape[0], inner.shared.shape[0], inner.step, inner.inverse[cell]
    before, after = 0.0, 0.0
    for i in range(m):
        before += step[i] * inner.lacks[1, i]
        after += step[i] * inner.lacks[0, i]
    if before < 0.0:
        before, after = -before, -after
        sign = -1.0
    else:
        sign = 1.0
    if not (LEARNS[0] * before < after < LEARNS[1] * before):
        return False
    head = sign / (after - before)
    for k in range(m):
        x = head * step[k]
        for i in range(m):
            inverse[k, i] += step[i] * x
    share = before / (before - after)
    for i in range(m):
        step[i] *= share
    for j in range(n):
        inner.moved[j] *= share
    return True


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
                summed += abs(coupling[k, j] * room.row[inner.shared[j]])
            size += abs(inverse[k, i]) * summed
        if abs(inner.change[i]) > ROUND_OFF * size:
            return False
    return True


@kernel
def _is_round_off_of_forces(cell, room, inner, moved, extent):  # type: ignore[no-untyped-def]
    """Whether the change of a cell's forces by a step of its fields is round-off of a law in F = 1 + grad u.

    Such a law has the round-off of displacements of the ``extent`` of the cell, m. Of fields that hardly move the
    forces, as thickness strains at a small Poisson's ratio, it says nothing. Overwrites ``inner.step`` and
    ``inner.moved``.
    """
    n, m = inner.shared.shape[0], inner.places.shape[0]
    inverse, coupling, summed, largest = inner.inverse[cell], inner.coupling[cell], inner.step, inner.moved
    for k in range(m):
        summed[k] = 0.0
        for j in range(n):
            summed[k] += abs(coupling[k, j]) * (abs(room.row[inner.shared[j]]) + extent)
    for j in range(n):
        largest[j] = 0.0
    for i in range(m):
        size = abs(inner.values[cell, i])
        for k in range(m):
            size += abs(inverse[k, i]) * summed[k]
        for j in range(n):
            largest[j] += abs(coupling[i, j]) * size
    most = 0.0
    for j in range(n):
        most = max(most, largest[j])
    return moved <= ROUND_OFF * most


@kernel
def _extent(room):  # type: ignore[no-untyped-def]
    """The largest extent of the cell along an axis, m."""
    extent = 0.0
    for i in range(1, room.coordinates.shape[0]):
        for d in range(3):
            extent = max(extent, abs(room.coordinates[i, d] - room.coordinates[0, d]))
    return extent


@kernel
def _take_back(cell, room, inner, share):  # type: ignore[no-untyped-def]
    """Take back a share of the last change of the fields."""
    for i in range(inner.places.shape[0]):
        inner.values[cell, i] -= share * inner.change[i]
        inner.change[i] *= 1.0 - share
        room.row[inner.places[i]] = inner.values[cell, i]


@kernel
def begin_search(search):  # type: ignore[no-untyped-def]
    """Begin with fields that were predicted."""
    search[0], search[1], search[2], search[3] = np.inf, 0.0, 0.0, 1.0


@kernel
def change_fields(cell, room, inner, search, accuracy, extent):  # type: ignore[no-untyped-def]
    """A step of the fields of a cell by the forces at hand in ``inner.force``, which follow it.

    Args:
        cell: of them.
        room: with the cell's row.
        inner: the fields.
        search: (4,) the change of the forces by the step before, the work of that step, how often it was halved, 1
            where the fields are as they were predicted; see `begin_search`.
        accuracy: change of a cell's forces over these at which the fields end.
        extent: m, of a cell of displacements with a fresh tangent, of which a step that no longer shrinks may be
            round-off of a law in F; else 0.

    Returns:
        0 where forces are wanted anew, 1 where the fields are solved for, 2 where they want a new tangent.
    """
    n, m = inner.shared.shape[0], inner.places.shape[0]
    left = 0.0
    for i in range(m):
        left += inner.force[inner.places[i]] * inner.change[i]
    _newton_step(cell, inner)
    moved, largest = _largest(inner)
    predicted, search[3] = search[3], 0.0
    if predicted != 0.0 and not moved < np.inf:
        # no prediction across a large rotation
        _take_back(cell, room, inner, 1.0)
        return 0
    learns = search[1] != 0.0 and search[2] == 0.0 and _learn(cell, inner)
    lessened = abs(left) <= WORK_RATIO * abs(search[1]) or moved <= (1.0 - 0.25 * 0.5 ** search[2]) * search[0]
    if search[1] != 0.0 and search[2] < HALVINGS and not learns and not lessened:
        # too far: at its end the step does no less work on what is lacking than at its begin, and the next one is no
        # smaller, which is what tells where strains and stresses make a saddle (Deuflhard's natural test)
        search[1], search[2] = 0.5 * search[1], search[2] + 1.0
        _take_back(cell, room, inner, 0.5)
        return 0
    shrinks = moved <= (SLOWEST if learns else CONTRACTION) * search[0]
    if learns:
        moved, largest = _largest(inner)
    for i in range(m):
        inner.change[i] = inner.step[i]
        inner.lacks[1, i] = inner.lacks[0, i]
    for j in range(n):
        inner.force[inner.shared[j]] += inner.moved[j]
    # forces that are no numbers are told by whoever sums them
    done = moved <= accuracy * largest + UNDERFLOW or not moved < np.inf or _is_round_off(cell, room, inner)
    if extent > 0.0 and not done and not shrinks:
        done = _is_round_off_of_forces(cell, room, inner, moved, extent)
    if not done and not shrinks:
        return 2
    search[0], search[1], search[2] = moved, 0.0, 0.0
    for i in range(m):
        search[1] += inner.force[inner.places[i]] * inner.change[i]
        inner.values[cell, i] += inner.change[i]
        room.row[inner.places[i]] = inner.values[cell, i]
    return 1 if done else 0


@kernel
def solve_cell(  # type: ignore[no-untyped-def]
    cell, begin, fields, kernels, room, inner, sweeps, tolerance, accuracy, fresh, width
):
    """Forces of a cell whose fields are solved for, in ``inner.force``; ``inner.solved`` tells whether they are.

    With a ``fresh`` tangent a step that no longer shrinks may be round-off of a law in F.  Blocks of three are
    displacements.

    Returns:
        As `solve_points`.
    """
    n, m = inner.shared.shape[0], inner.places.shape[0]
    begin_search(inner.search)
    extent = _extent(room) if fresh and width == 3 else 0.0
    for _ in range(CELL_SWEEPS):
        if fields.local.shape[1] > 0:
            change = solve_points(cell, begin, fields.state.shape[1], fields, kernels, room, sweeps, tolerance)
            if change != 0.0:
                return change
        tabulate_forces(kernels, room, begin)
        for i in range(n + m):
            inner.force[i] = room.tensor[i]
        found = change_fields(cell, room, inner, inner.search, accuracy, extent)
        if found == 1:
            inner.solved[cell] = 1
        if found != 0:
            return 0.0
    return 0.0
