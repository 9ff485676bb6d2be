"""Blocks of constraint rows: rows of two blocks share no free coordinate, and neither's reactions move the other.

Two rows are coupled, by C or by C M^-1 C^T, where the paths from their frames to the ground share a body that is free
to move.  So the branches that stand on the ground, joined where a loop runs through two of them, are the blocks: C,
C M^-1 C^T and their factors are found block by block, at a cost that grows with the number of blocks.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.arrays import IntArray, Plan


@dataclass(frozen=True, eq=False)
class RowBlock:
    """A block of rows.

    Attributes:
        rows: (k,) rising.
        free, driven: velocities of the bodies on the rows' paths, each rising.  The free ones are of no other block.
    """

    rows: IntArray
    free: IntArray
    driven: IntArray

    @property
    def velocities(self) -> IntArray:
        """(n,) the free ones, then the driven ones."""
        return np.concatenate([self.free, self.driven])


def row_bodies(plan: Plan, row: IntArray) -> tuple[int, ...]:
    """Tree rows of the bodies, -1 for the ground, that a constraint row is about."""
    if row[at.ROW_KIND] == kinds.ROW_COUPLING:
        o = row[at.ROW_DATA]
        return tuple(int(b) for b in plan.data[o + 2 :: 3][: int(plan.data[o])])
    return int(plan.frame_of[row[at.ROW_F], at.FRAME_BODY]), int(plan.frame_of[row[at.ROW_G], at.FRAME_BODY])


def row_blocks(plan: Plan) -> tuple[RowBlock, ...]:
    """The blocks of the rows of ``plan``, by their first rows.  Rows that nothing free moves are one block more."""
    if len(plan.rows) == 0:
        return ()
    velocities = body_velocities(plan)
    driven = set(map(int, plan.driven[:, at.DRIVEN_V]))
    parents: Any = plan.tree[:, at.PARENT].tolist()
    branch = moving_branches(plan)
    ends = [row_bodies(plan, row) for row in plan.rows]
    joined = {i: i for i in (-1, *branch)}
    for bodies in ends:
        moving = [branch[b] for b in bodies if b >= 0 and branch[b] >= 0]
        for b in moving[1:]:
            joined[root_of(joined, b)] = root_of(joined, moving[0])
    members: dict[int, list[int]] = {}
    for r, bodies in enumerate(ends):
        moving = [branch[b] for b in bodies if b >= 0 and branch[b] >= 0]
        members.setdefault(root_of(joined, moving[0]) if moving else -1, []).append(r)
    found = []
    for rows in members.values():
        path = bodies_on_paths(parents, {b for r in rows for b in ends[r]})
        own = sorted(k for b in path for k in velocities[b])
        free = [k for k in own if k not in driven]
        held = [k for k in own if k in driven]
        found.append(RowBlock(*(np.array(part, np.int64) for part in (rows, free, held))))
    return tuple(found)


def moving_branches(plan: Plan) -> list[int]:
    """Of each body, that nearest to the ground on its path that is free to move; -1 where none is.

    Two bodies move each other, but for what acts between them, where they have it in common.
    """
    moves = np.zeros(len(plan.tree), np.bool_)
    free = np.zeros(len(plan.free) + len(plan.driven) + 1, np.int64)
    free[plan.free + 1] = 1
    before = np.cumsum(free)  # how many free velocities
    for first, count in velocity_spans(plan):
        moves |= (count > 0) & (before[np.where(count > 0, first + count, 0)] > before[np.where(count > 0, first, 0)])
    branch: list[int] = []
    parents: Any = plan.tree[:, at.PARENT].tolist()
    for i, (parent, is_moved) in enumerate(zip(parents, map(bool, moves), strict=True)):
        inner = branch[parent] if parent >= 0 else -1
        branch.append(inner if inner >= 0 else i if is_moved else -1)
    return branch


def velocity_spans(plan: Plan) -> list[tuple[IntArray, IntArray]]:
    """First velocities (bodies,) and how many, of the joints and of the modes of all bodies."""
    modes = np.append(plan.flex[:, at.N_MODES], 0)[plan.tree[:, at.FLEX]]
    return [(plan.tree[:, at.JOINT_V], plan.tree[:, at.JOINT_SIZE]), (plan.tree[:, at.MODAL_V], modes)]


def blockwise_order(plan: Plan) -> IntArray:
    """(m,) the rows of ``plan``, those of one block next to each other, blocks in the order of their velocities."""
    blocks = row_blocks(plan)
    if len(blocks) < 2:
        return np.arange(len(plan.rows))
    ordered = sorted(blocks, key=lambda block: (len(block.free) == 0, *block.free[:1]))
    return np.concatenate([block.rows for block in ordered])


def block_bounds(blocks: tuple[RowBlock, ...], count: int) -> IntArray:
    """(c + 1,) where stretches of the ``count`` rows begin and end, none of which parts a block."""
    if len(blocks) == 1:
        return np.array([0, count])
    last = np.zeros(count, np.int64)
    for block in blocks:
        last[block.rows] = block.rows[-1]
    ends = np.flatnonzero(np.maximum.accumulate(last) == np.arange(count)) + 1
    return np.concatenate([np.zeros(1, np.int64), ends])


def body_velocities(plan: Plan) -> list[list[int]]:
    """The velocities of each body of the tree: of its joint and its modes."""
    found = []
    trees: Any = plan.tree.tolist()
    for tree in trees:
        first = tree[at.JOINT_V]
        count = tree[at.JOINT_SIZE]
        own = [*range(first, first + count)]
        if tree[at.FLEX] >= 0:
            own += range(tree[at.MODAL_V], tree[at.MODAL_V] + int(plan.flex[tree[at.FLEX], at.N_MODES]))
        found.append(own)
    return found


def root_of(joined: dict[int, int], b: int) -> int:
    """Who stands for all that b is joined with."""
    while joined[b] != b:
        joined[b] = joined[joined[b]]
        b = joined[b]
    return b


def bodies_on_paths(parents: list[int], ends: Iterable[int]) -> set[int]:
    """The bodies between these and the ground."""
    path: set[int] = set()
    for body in ends:
        while body >= 0 and body not in path:
            path.add(body)
            body = parents[body]
    return path
