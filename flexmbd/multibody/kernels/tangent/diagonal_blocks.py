"""Diagonal blocks of an iteration matrix: machines side by side, which nothing couples, are factored one by one.

Unknowns of two bodies are coupled where their paths to the ground share a body that is free to move, or where a
constraint row or a force acts between such paths.  The unknowns of a block lie next to each other in v, and so do its
rows; blocks that lie among each other count as one.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.array_struct import ArrayStruct
from flexmbd.multibody.kernels.base.arrays import IntArray, Plan
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.components import components
from flexmbd.multibody.kernels.base.native import factor_part, solve_part
from flexmbd.multibody.kernels.base.row_blocks import moving_branches, row_bodies, velocity_spans
from flexmbd.multibody.kernels.elements.table import act_between_frames, couple_all, own_links

_PLACES = 2**31 - 1


@dataclass(frozen=True, eq=False)
class DiagonalBlocks(ArrayStruct):
    """Where the c blocks begin and end.

    velocity: (c, 2) in v; prescribed velocities on which independent bodies stand are of no block, or of any.
    free, rows: (c + 1,) among the free unknowns and among the constraint rows.
    driven: (k,) all prescribed velocities.
    """

    velocity: IntArray
    free: IntArray
    rows: IntArray
    driven: IntArray


def diagonal_blocks(plan: Plan) -> DiagonalBlocks:
    """The blocks of ``plan``, in the order of their velocities; last what rows hold that nothing free moves."""
    if len(plan.free) + len(plan.driven) == 0 or couple_all(plan).any():
        return one_block(plan)
    return _laid_out(plan, _merged(_coupled(plan)))


def one_block(plan: Plan) -> DiagonalBlocks:
    """All in one block."""
    return _laid_out(plan, [(0, len(plan.free) + len(plan.driven), 0, len(plan.rows))])


def _laid_out(plan: Plan, stretches: list[tuple[int, int, int, int]]) -> DiagonalBlocks:
    """Blocks of stretches: first and one past the last velocity and row."""
    found = np.array(stretches, np.int64).reshape(-1, 4)
    free = np.searchsorted(plan.free, found[:, 1])
    return DiagonalBlocks(
        velocity=np.ascontiguousarray(found[:, :2]),
        free=np.concatenate([np.zeros(1, np.int64), free]),
        rows=np.maximum.accumulate(np.concatenate([np.zeros(1, np.int64), found[:, 3]])),
        driven=np.sort(plan.driven[:, at.DRIVEN_V]),
    )


def unknown_bounds(blocks: DiagonalBlocks, levels: int) -> IntArray:
    """(c + 1,) where blocks begin among the free unknowns and ``levels`` unknowns of each row, sorted by blocks."""
    return blocks.free + levels * blocks.rows


def block_matrix(bounds: IntArray, dtype: type = np.float64) -> NDArray[Any]:
    """Zeros (n, widest block) for blocks between ``bounds`` (c + 1,), one below the other."""
    return np.zeros((int(bounds[-1]), int(np.diff(bounds).max(initial=0))), dtype)


def _coupled(plan: Plan) -> list[tuple[int, int, int, int]]:
    """First and one past the last velocity and row of each set of bodies that are coupled, by what it holds."""
    nv, branch = len(plan.free) + len(plan.driven), np.array(moving_branches(plan), np.int64)
    of_rows = [row_bodies(plan, row) for row in plan.rows]
    pairs = [_moving_pairs(branch, bodies) for bodies in of_rows if len(bodies) > 2]
    pairs.append(_moving_pairs(branch, np.array([bodies for bodies in of_rows if len(bodies) == 2]).reshape(-1, 2)))
    between = plan.elements[act_between_frames(plan)]
    ends = plan.frame_of[between[:, [at.EL_F, at.EL_G]], at.FRAME_BODY]
    pairs.append(_moving_pairs(branch, ends))
    for k in np.flatnonzero(between[:, at.EL_V] >= 0):
        pairs.append(_moving_pairs(branch, [*ends[k].tolist(), *own_links(plan, between[k])]))
    joined = np.concatenate(pairs)
    of = np.where(branch >= 0, components(len(branch), *joined.T)[branch], -1)
    least, most = np.full(len(branch), nv), np.zeros(len(branch), np.int64)
    for first, count in velocity_spans(plan):
        own = (of >= 0) & (count > 0)
        np.minimum.at(least, of[own], first[own])
        np.maximum.at(most, of[own], (first + count)[own])
    rows: dict[int, list[int]] = {}
    found: list[tuple[int, int, int, int]] = []
    for r, bodies in enumerate(of_rows):
        moving = [int(of[b]) for b in bodies if b >= 0 and of[b] >= 0]
        if moving:
            rows.setdefault(moving[0], []).append(r)
        else:
            found.append((nv, nv, r, r + 1))
    for root in map(int, np.flatnonzero(most > 0)):
        held = rows.get(root, [-1])
        found.append((int(least[root]), int(most[root]), max(held[0], 0), held[-1] + 1))
    return found


def _moving_pairs(branch: IntArray, bodies: Any) -> IntArray:
    """(k, 2) pairs of branches that bodies join: two a row of (k, 2), or all of (n,); -1 is the ground."""
    found = np.append(branch, -1)[np.asarray(bodies, np.int64)]
    if found.ndim == 1:
        moving = found[found >= 0]
        return np.stack([moving[:-1], moving[1:]], axis=1)
    return found[(found >= 0).all(axis=1)]


def _merged(stretches: Iterable[tuple[int, int, int, int]]) -> list[tuple[int, int, int, int]]:
    """Stretches by their velocities; those that lie among each other, by velocities or by rows, as one."""
    found: list[tuple[int, int, int, int]] = []
    most = [0]  # one past the last row of those found so far
    for first, last, above, below in sorted(stretches):
        while found and (first < found[-1][1] or (below > above and above < most[-1])):
            inner = found.pop()
            most.pop()
            rows = [one for one in (inner[2:], (above, below)) if one[1] > one[0]] or [(0, 0)]
            first, last = inner[0], max(last, inner[1])
            above, below = min(one[0] for one in rows), max(one[1] for one in rows)
        found.append((first, last, above, below))
        most.append(max(most[-1], below))
    return found


@kernel
def between(bounds, c):
    """First and one past the last of block c: ``bounds[c]`` and ``bounds[c + 1]``.

    The mask tells LLVM that neither is negative.  Otherwise each index between them might count from an array's end, as
    Python's do, and loops over a block would take twice as long.
    """
    return bounds[c] & _PLACES, bounds[c + 1] & _PLACES


@kernel
def clear_blocks(blocks, matrix):
    """Set to zero what the tangent may write of a ``matrix`` (nv, nv)."""
    for c in range(blocks.velocity.shape[0]):
        first, last = blocks.velocity[c, 0], blocks.velocity[c, 1]
        matrix[first:last, first:last] = 0.0
    for i in range(blocks.driven.shape[0]):
        matrix[blocks.driven[i], :] = 0.0
        matrix[:, blocks.driven[i]] = 0.0


@kernel
def clear_rows(blocks, rows):
    """Set to zero what may be written of ``rows`` (m, nv)."""
    for c in range(blocks.velocity.shape[0]):
        above, below = between(blocks.rows, c)
        rows[above:below, blocks.velocity[c, 0] : blocks.velocity[c, 1]] = 0.0
    for i in range(blocks.driven.shape[0]):
        rows[:, blocks.driven[i]] = 0.0


@kernel
def factor_blocks(lapack, matrix, bounds, pivot, sizes):
    """LU-factor in place the blocks of ``matrix``, in rows between ``bounds`` (c + 1,); whether all are regular.

    Blocks lie one below the other, each from the first column (`block_matrix`).
    """
    for c in range(bounds.shape[0] - 1):
        if factor_part(lapack, matrix, bounds[c], bounds[c + 1], pivot, sizes) != 0:
            return False
    return True


@kernel
def solve_blocks(lapack, matrix, bounds, pivot, sizes, rhs):
    """Solve with the factors of ``factor_blocks``; each row of ``rhs`` (k, n) is one right-hand side, in place."""
    for c in range(bounds.shape[0] - 1):
        solve_part(lapack, matrix, bounds[c], bounds[c + 1], pivot, sizes, rhs, 0, rhs.shape[0])


@kernel
def solve_sorted(lapack, matrix, blocks, bounds, pivot, sizes, rhs, sorted_rhs):
    """As ``solve_blocks`` of right-hand sides that are not sorted by blocks, but all free unknowns, then those of rows.

    These go level by level.  ``sorted_rhs``: (1, n) scratch.
    """
    if bounds.shape[0] == 2 or blocks.rows[bounds.shape[0] - 1] == 0:
        solve_blocks(lapack, matrix, bounds, pivot, sizes, rhs)
        return
    for k in range(rhs.shape[0]):
        _sort(blocks, bounds, rhs[k], sorted_rhs[0], True)
        solve_blocks(lapack, matrix, bounds, pivot, sizes, sorted_rhs)
        _sort(blocks, bounds, sorted_rhs[0], rhs[k], False)


@kernel
def _sort(blocks, bounds, unknowns, out, forth):
    """Sort the unknowns by blocks, or undo it."""
    count = bounds.shape[0] - 1
    nu, m = blocks.free[count], blocks.rows[count]
    for c in range(count):
        k = bounds[c]
        for i in range(*between(blocks.free, c)):
            if forth:
                out[k] = unknowns[i]
            else:
                out[i] = unknowns[k]
            k += 1
        for level in range((out.shape[0] - nu) // m):
            for i in range(nu + level * m + blocks.rows[c], nu + level * m + blocks.rows[c + 1]):
                if forth:
                    out[k] = unknowns[i]
                else:
                    out[i] = unknowns[k]
                k += 1
