"""Blocks of unknowns for a sparse matrix of a machine, and which of them its tangent joins: found once, at compile.

A block holds the free velocities of a body's joint and modes, those of massless links with the body that they lead to.
Bodies are joined with those that carry them; and a force between two bodies, or a constraint row, joins all on the paths
from both to the ground.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.arrays import IntArray, Plan
from flexmbd.multibody.kernels.elements.table import act_between_frames


class Group(NamedTuple):
    """Unknowns that move one frame alike: a joint's, or a body's modes as far as they move a frame of it.

    Attributes:
        first, count: in v.
        frame: row of ``Plan.frames`` that the modes move; -1 of a joint.
    """

    first: int
    count: int
    frame: int


@dataclass(frozen=True, eq=False)
class UnknownBlocks:
    """The blocks of a plan.

    Attributes:
        first, size: (b,) the first velocity of each block, and how many.
        of: (nv,) the block of each velocity; -1 of prescribed ones.
        joints, modes: of each body the group of its joint and of its modes, whether it is free or not; None: it has none.
        inward: of each body the groups on the way from it to the ground, nearest first, without its own.
    """

    plan: Plan
    first: IntArray
    size: IntArray
    of: IntArray
    joints: list[Group | None]
    modes: list[Group | None]
    inward: list[list[Group]]

    def path(self, frame: int) -> list[Group]:
        """The groups that move a frame, nearest first."""
        body = int(self.plan.frame_of[frame, at.FRAME_BODY])
        if body < 0:
            return []
        modes, joint = self.modes[body], self.joints[body]
        moving = self.plan.frame_of[frame, at.FRAME_MODES] >= 0 and modes is not None
        own = [modes._replace(frame=frame)] if moving and modes is not None else []
        return own + ([joint] if joint is not None else []) + self.inward[body]

    def of_path(self, *frames: int) -> list[int]:
        """The blocks that move any of these frames, each once."""
        found = dict.fromkeys(int(self.of[group.first]) for frame in frames for group in self.path(frame))
        return [block for block in found if block >= 0]

    @cached_property
    def elements(self) -> list[list[int]]:
        """Of each force element the blocks that it joins."""
        between = act_between_frames(self.plan).tolist()
        rows: Any = self.plan.elements[:, [at.EL_F, at.EL_G]].tolist()
        return [self.of_path(*ends) if acts else [] for ends, acts in zip(rows, between, strict=True)]

    def body_pairs(self) -> Iterator[tuple[Group, Group]]:
        """Each group of a body with each group that carries it, its own joint with its modes included."""
        for joint, modes, inward in zip(self.joints, self.modes, self.inward, strict=True):
            if joint is not None and modes is not None:
                yield modes, joint
            for inner in inward:
                for own in (joint, modes):
                    if own is not None:
                        yield own, inner

    def pairs(self) -> IntArray:
        """(p, 2) pairs of blocks that the tangent joins, each once, a block with itself included."""
        b = len(self.first)
        found = {k * b + k for k in range(b)}
        for one, other in self.body_pairs():
            i, j = int(self.of[one.first]), int(self.of[other.first])
            if i >= 0 and j >= 0:
                found.update((i * b + j, j * b + i))
        for joined in self.elements:
            found.update(i * b + j for i in joined for j in joined)
        keys = np.array(sorted(found), np.int64)
        return np.stack(np.divmod(keys, max(b, 1)), axis=1)


def unknown_blocks(plan: Plan) -> UnknownBlocks:
    """The blocks of ``plan``, in the order of their velocities."""
    nv = len(plan.free) + len(plan.driven)
    driven = set(map(int, plan.driven[:, at.DRIVEN_V]))
    trees: Any = plan.tree.tolist()
    joints: list[Group | None] = []
    modes: list[Group | None] = []
    inward: list[list[Group]] = []
    carries = np.bincount(plan.tree[:, at.PARENT] + 1, minlength=len(trees) + 1)[1:]
    massless = ~plan.rigid.any(axis=1)
    of, first, open_at = np.full(nv, -1, np.int64), [0][:0], -1
    for i, tree in enumerate(trees):
        joint, size = tree[at.JOINT_V], tree[at.JOINT_SIZE]
        joints.append(Group(joint, size, -1) if size > 0 else None)
        count = int(plan.flex[tree[at.FLEX], at.N_MODES]) if tree[at.FLEX] >= 0 else 0
        modes.append(Group(tree[at.MODAL_V], count, -1) if count else None)
        inward.append(_inward(plan, tree, joints, modes, inward))
        for begin, n in ((joint, size), (tree[at.MODAL_V], count)):
            if n == 0 or begin in driven:
                continue
            if open_at != begin:
                first.append(begin)
            of[begin : begin + n] = len(first) - 1
            open_at = begin + n
        if not (massless[i] and carries[i] == 1 and i + 1 < len(trees) and trees[i + 1][at.PARENT] == i):
            open_at = -1
    begins = np.array(first, np.int64)
    return UnknownBlocks(plan, begins, np.bincount(of + 1, minlength=len(first) + 1)[1:], of, joints, modes, inward)


def _inward(plan: Plan, tree: list[int], joints: list[Group | None], modes: list[Group | None],
            inward: list[list[Group]]) -> list[Group]:  # fmt: skip
    """The groups between a body's joint and the ground."""
    parent, frame = tree[at.PARENT], tree[at.FRAME_PARENT]
    if parent < 0:
        return []
    own, joint = modes[parent], joints[parent]
    moving = plan.frame_of[frame, at.FRAME_MODES] >= 0
    found = [own._replace(frame=frame)] if moving and own is not None else []
    return found + ([joint] if joint is not None else []) + inward[parent]
