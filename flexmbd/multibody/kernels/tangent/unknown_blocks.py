"""Blocks of unknowns for a sparse matrix of a machine, and which of them its tangent joins: found once, at compile.

A block holds the free velocities of a body's joint and modes, those of massless links with the body that they lead to,
or the multipliers of the rows between two frames.  Bodies are joined with those that carry them; and a force between
two bodies, or a constraint row, joins all on the paths from both to the ground.

In a deep tree paths are cut: of a *cut body* the motion and the wrench that it requires of its joint are unknowns of
their own, and paths end there.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import chain
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.arrays import IntArray, Plan
from flexmbd.multibody.kernels.elements.table import (
    act_between_frames,
    of_surfaces,
    own_links,
    surface_groups,
    touched_modes,
)
from flexmbd.multibody.kernels.sparse.index_lists import IndexLists, distinct, flat, new_lists, owned

#: Entries of a cut body's motion (phi', phi'', alpha, r', r, phi; see ``tangent_columns``), and then of its wrench.
MOTION, WRENCH = 18, 6
CUT = MOTION + WRENCH


class UnknownGroup(NamedTuple):
    """Unknowns that move one frame alike: a joint's, or a body's modes as far as they move a frame of it.

    Attributes:
        first, size: in v, and how many.
        frame: row of ``Plan.frames`` that the modes move; -1 of a joint.
    """

    first: int
    size: int
    frame: int


class UnknownPath(NamedTuple):
    """What moves a body or a frame.

    Attributes:
        groups: nearest first, up to the ground or a cut body.
        root: the number of that cut body; -1 where the way leads to the ground.
    """

    groups: list[UnknownGroup]
    root: int


_ON_GROUND = UnknownPath([], -1)


@dataclass(frozen=True, eq=False)
class UnknownBlocks:
    """The blocks of a plan: of velocities, then of rows, then of cut bodies.

    Unknowns count on from the velocities: nv of these, prescribed ones included, one of each row, `CUT` of each cut.

    Attributes:
        first, size: (b,) the first unknown of each block, and how many.
        of: (nv + m + ...,) the block of each unknown; -1 of prescribed velocities.
        cuts: bodies that are cut, rising.
        joints, modes: of each body the group of its joint and of its modes, free or not; None: it has none.
        inward: of each body the way from its joint inwards, without the joint; outward: that which moves the body.
        row_groups: (first, one past the last) rows that join the same frames.
    """

    plan: Plan
    first: IntArray
    size: IntArray
    of: IntArray
    cuts: list[int]
    joints: list[UnknownGroup | None]
    modes: list[UnknownGroup | None]
    inward: list[UnknownPath]
    outward: list[UnknownPath]
    row_groups: list[tuple[int, int]]

    @property
    def unknowns(self) -> int:
        """How many unknowns there are, prescribed velocities included."""
        return len(self.of)

    @cached_property
    def longest_path(self) -> int:
        """The most unknowns that move either of two frames which rows join, or enter a coupling."""
        joined = self.closures
        moving = np.bincount(joined.owner, self.size[joined.items], len(self.row_groups))
        terms = [int(self.plan.data[self.plan.rows[first, at.ROW_DATA]]) for first in self._couplings]
        return int(max(moving.max(initial=0.0), *terms, 0))

    @cached_property
    def rows_begin(self) -> int:
        """The first unknown that is a row's multiplier."""
        return len(self.plan.free) + len(self.plan.driven)

    def cut(self, number: int) -> int:
        """The first unknown of a cut body."""
        return self.rows_begin + len(self.plan.rows) + CUT * number

    def path(self, frame: int) -> UnknownPath:
        """What moves a frame."""
        body = int(self.plan.frame_of[frame, at.FRAME_BODY])
        if body < 0:
            return UnknownPath([], -1)
        modes, way = self.modes[body], self.outward[body]
        if self.plan.frame_of[frame, at.FRAME_MODES] >= 0 and modes is not None:
            return UnknownPath([modes._replace(frame=frame), *way.groups], way.root)
        return way

    @cached_property
    def _moving(self) -> tuple[IntArray, IndexLists]:
        """Of each frame which list holds the blocks that move it; a block may be there more than once, or be -1."""
        frames = self.plan.frame_of
        ways = [*self.outward, UnknownPath([], -1)]
        which = np.where(frames[:, at.FRAME_BODY] >= 0, frames[:, at.FRAME_BODY], len(self.outward))
        for frame in np.flatnonzero((frames[:, at.FRAME_MODES] >= 0) & (frames[:, at.FRAME_BODY] >= 0)):
            which[frame] = len(ways)
            ways.append(self.path(int(frame)))
        firsts = [[g.first for g in way.groups] + ([self.cut(way.root)] if way.root >= 0 else []) for way in ways]
        lists = new_lists(firsts)
        return which, lists._replace(items=self.of[lists.items])

    def _between(self, frames: IntArray, own: IndexLists) -> IndexLists:
        """The blocks that move either of two frames (k, 2), -1 of none, and those of its ``own``; each once."""
        which, lists = self._moving
        which = np.where(frames >= 0, which[frames], len(self.outward))
        moving = lists.taken(which.ravel()).paired()
        owner = np.concatenate([moving.owner, own.owner])
        return owned(owner, np.concatenate([moving.items, own.items]), len(frames)).once()

    @cached_property
    def elements(self) -> IndexLists:
        """Of each force element the blocks that it joins, those of its own states included."""
        between = act_between_frames(self.plan)
        rows = self.plan.elements
        frames = np.where(between[:, None], rows[:, [at.EL_F, at.EL_G]], -1)
        links = {int(e): own_links(self.plan, rows[e]) for e in np.flatnonzero(between & (rows[:, at.EL_V] >= 0))}
        surfaces = np.flatnonzero(of_surfaces(self.plan))
        modes = {int(e): [own[0] for own in touched_modes(self.plan, rows[e]) if own] for e in surfaces}
        counts = [len(own) for own in chain(links.values(), modes.values())]
        owner = np.repeat(np.array([*links, *modes], np.int64), np.array(counts, np.int64))
        own = np.concatenate([self.plan.tree[flat(links.values()), at.JOINT_V], flat(modes.values())])
        found = self._between(frames, owned(owner, self.of[own], len(rows)))
        return self._with_groups(found)

    def _with_groups(self, found: IndexLists) -> IndexLists:
        """Let each elastic surface of a group join all that any of them does."""
        owner, items = [found.owner], [found.items]
        for rows in surface_groups(self.plan):
            all_of = found.taken(rows).items
            owner.append(np.repeat(rows, len(all_of)))
            items.append(np.tile(all_of, len(rows)))
        if len(owner) == 1:
            return found
        return owned(np.concatenate(owner), np.concatenate(items), len(found.starts) - 1).once()

    @cached_property
    def closures(self) -> IndexLists:
        """Of each group of rows the blocks that it joins, without its own."""
        rows = self.plan.rows[[first for first, _ in self.row_groups]]
        coupled = rows[:, at.ROW_KIND] == kinds.ROW_COUPLING
        frames = np.where(coupled[:, None], -1, rows[:, [at.ROW_F, at.ROW_G]])
        own: list[list[int]] = [[] for _ in rows]
        for group in np.flatnonzero(coupled):
            o = rows[group, at.ROW_DATA]
            terms = self.plan.data[o + 2 : o + 2 + 3 * int(self.plan.data[o])].reshape(-1, 3)
            velocities = self.plan.tree[terms[:, 0].astype(int), at.JOINT_V] + terms[:, 1].astype(int)
            own[group] = self.of[velocities].tolist()
        return self._between(frames, new_lists(own))

    @property
    def _couplings(self) -> list[int]:
        """First rows of groups that couple coordinates."""
        firsts = np.array([first for first, _ in self.row_groups], np.int64)
        return [int(first) for first in firsts[self.plan.rows[firsts, at.ROW_KIND] == kinds.ROW_COUPLING]]

    @cached_property
    def row_blocks(self) -> IntArray:
        """Of each group of rows its own block."""
        return self.of[[self.rows_begin + first for first, _ in self.row_groups]]

    @cached_property
    def body_pairs(self) -> IntArray:
        """(p, 6) each free group of a body with each free one that carries it, its own joint with its modes included.

        Of each group first, size and frame, of the outer one before.
        """
        owns = [(own, way) for own, way in self._owns if way.groups]
        inner = flat(chain.from_iterable(way.groups for _, way in owns)).reshape(-1, 3)
        counts = [len(way.groups) for _, way in owns]
        outer = np.repeat(flat(own for own, _ in owns).reshape(-1, 3), counts, axis=0)
        return np.concatenate([outer, inner], axis=1)[self.of[inner[:, 0]] >= 0]

    @cached_property
    def carried(self) -> IntArray:
        """(k, 6) each free group with the cut body that carries it, as ``body_pairs``."""
        return self._with_cuts([(own, way.root) for own, way in self._owns if way.root >= 0])

    @cached_property
    def carrying(self) -> IntArray:
        """(k, 6) each free group with a cut body that it carries, up to the next cut body inwards."""
        found = []
        for number, body in enumerate(self.cuts):
            joint = self.joints[body]
            groups = ([joint] if joint is not None else []) + self.inward[body].groups
            found += [(group, number) for group in groups if self.of[group.first] >= 0]
        return self._with_cuts(found)

    @cached_property
    def nested(self) -> IntArray:
        """(k, 6) each cut body with the next one inwards."""
        roots = ((q, self.inward[body].root) for q, body in enumerate(self.cuts))
        return self._with_cuts([(UnknownGroup(self.cut(q), CUT, -1), root) for q, root in roots if root >= 0])

    @cached_property
    def _owns(self) -> list[tuple[UnknownGroup, UnknownPath]]:
        """Each free group of a body with the way from there inwards."""
        found: list[tuple[UnknownGroup, UnknownPath]] = []
        is_free: Any = (self.of >= 0).tolist()
        for joint, modes, inward, outward in zip(self.joints, self.modes, self.inward, self.outward, strict=True):
            if joint is not None and is_free[joint.first]:
                found.append((joint, inward))
            if modes is not None and is_free[modes.first]:
                found.append((modes, outward))
        return found

    def _with_cuts(self, found: list[tuple[UnknownGroup, int]]) -> IntArray:
        return np.array([(*group, self.cut(q), CUT, -1) for group, q in found], np.int64).reshape(-1, 6)

    @cached_property
    def pairs(self) -> IntArray:
        """(p, 2) pairs of blocks that the matrix joins, each once, a block with itself included, ascending."""
        b = len(self.first)
        groups = np.concatenate([self.body_pairs, self.carried, self.carrying, self.nested])
        one = np.concatenate([self.of[groups[:, 0]], self.row_blocks[self.closures.owner]])
        other = np.concatenate([self.of[groups[:, 3]], self.closures.items])
        joined = [i * b + j for i, j in (self.elements.squares(), self.closures.squares())]
        keys = [np.arange(b) * (b + 1), one * b + other, other * b + one, *joined]
        return np.stack(np.divmod(distinct(np.concatenate(keys), b**2), max(b, 1)), axis=1)

    def ranks(self) -> IntArray:
        """(b,) 1 of the rows' blocks, whose diagonals are zero before others are eliminated."""
        found = np.zeros(len(self.first), np.int64)
        found[self.row_blocks] = 1
        return found

    def waits(self) -> dict[int, list[int]]:
        """Blocks that get pivots from others alone: from which.

        A cut body's joint from that body; rows from all that moves one of their two frames and not the other, of which
        they are independent as a whole.
        """
        found: dict[int, list[int]] = {}
        for number, body in enumerate(self.cuts):
            joint = self.joints[body]
            if joint is not None and self.of[joint.first] >= 0:
                found.setdefault(int(self.of[joint.first]), []).append(int(self.of[self.cut(number)]))
        starts, blocks = self.closures
        for group, (first, _) in enumerate(self.row_groups):
            row = self.plan.rows[first]
            if row[at.ROW_KIND] == kinds.ROW_COUPLING:
                moving = {int(block) for block in blocks[starts[group] : starts[group + 1]]}
            else:
                moving = self._moving_one(int(row[at.ROW_F]), int(row[at.ROW_G]))
            found[int(self.row_blocks[group])] = list(moving)
        return found

    def _moving_one(self, one: int, other: int) -> set[int]:
        """The blocks that move one of two frames alone: up to where both hang on one cut body, or on the ground."""
        ways = [self.path(one), self.path(other)]
        found = [{int(self.of[group.first]) for group in way.groups} for way in ways]
        while ways[0].root != ways[1].root:  # cut bodies count outwards
            k = int(ways[1].root > ways[0].root)
            root = ways[k].root
            body = self.cuts[root]
            joint, inward = self.joints[body], self.inward[body]
            ways[k] = UnknownPath([*([joint] if joint is not None else []), *inward.groups], inward.root)
            found[k].add(int(self.of[self.cut(root)]))
            found[k].update(int(self.of[group.first]) for group in ways[k].groups)
        return (found[0] ^ found[1]) - {-1}


def unknown_blocks(plan: Plan, cut: NDArray[np.bool_] | None = None) -> UnknownBlocks:
    """The blocks of ``plan`` where the bodies ``cut`` (n,) are cut; None: none."""
    nv, m = len(plan.free) + len(plan.driven), len(plan.rows)
    driven = set(map(int, plan.driven[:, at.DRIVEN_V]))
    trees: Any = plan.tree.tolist()
    cuts = [] if cut is None else [int(i) for i in np.flatnonzero(cut)]
    number = {body: q for q, body in enumerate(cuts)}
    joints: list[UnknownGroup | None] = []
    modes: list[UnknownGroup | None] = []
    inward: list[UnknownPath] = []
    outward: list[UnknownPath] = []
    carries: Any = np.bincount(plan.tree[:, at.PARENT] + 1, minlength=len(trees) + 1)[1:].tolist()
    massless: Any = (~plan.rigid.any(axis=1)).tolist()
    of: IntArray = np.full(nv + m + CUT * len(cuts), -1, np.int64)
    first, open_at = list[int](), -1
    for i, tree in enumerate(trees):
        joint, size = tree[at.JOINT_V], tree[at.JOINT_SIZE]
        count = int(plan.flex[tree[at.FLEX], at.N_MODES]) if tree[at.FLEX] >= 0 else 0
        way = _ON_GROUND if tree[at.PARENT] < 0 else _inward(plan, tree, modes, outward)
        own = UnknownGroup(joint, size, -1) if size > 0 else None
        joints.append(own)
        modes.append(UnknownGroup(tree[at.MODAL_V], count, -1) if count else None)
        inward.append(way)
        on = way.groups if own is None else [own, *way.groups]
        outward.append(UnknownPath([], number[i]) if i in number else UnknownPath(on, way.root))
        spans = ((joint, size),) if count == 0 else ((joint, size), (tree[at.MODAL_V], count))
        for begin, n in spans:
            if n > 0 and begin not in driven:
                if open_at != begin:
                    first.append(begin)
                of[begin : begin + n] = len(first) - 1
                open_at = -1 if i in number else begin + n
        if not (massless[i] and carries[i] == 1 and i + 1 < len(trees) and trees[i + 1][at.PARENT] == i):
            open_at = -1
    of, first = _sorted(of, first)  # of joints that are turned round, links stand the other way
    groups = _row_groups(plan)
    for begin, end in groups:
        of[nv + begin : nv + end] = len(first)
        first.append(nv + begin)
    for q in range(len(cuts)):
        begin = nv + m + CUT * q
        of[begin : begin + CUT] = len(first)
        first.append(begin)
    size = np.bincount(of + 1, minlength=len(first) + 1)[1:]
    return UnknownBlocks(plan, np.array(first, np.int64), size, of, cuts, joints, modes, inward, outward, groups)


def _sorted(of: IntArray, first: list[int]) -> tuple[IntArray, list[int]]:
    """Blocks in the order of their velocities."""
    order = np.argsort(first)
    place = np.full(len(first) + 1, -1, np.int64)
    place[order] = np.arange(len(first))
    return place[of], sorted(first)


def _inward(plan: Plan, tree: list[int], modes: list[UnknownGroup | None], outward: list[UnknownPath]) -> UnknownPath:
    """What moves the frame on which a body's joint stands."""
    parent, frame = tree[at.PARENT], tree[at.FRAME_PARENT]
    own, way = modes[parent], outward[parent]
    if plan.frame_of[frame, at.FRAME_MODES] >= 0 and own is not None:
        return UnknownPath([own._replace(frame=frame), *way.groups], way.root)
    return way


def _row_groups(plan: Plan) -> list[tuple[int, int]]:
    """Rows next to each other that join the same frames."""
    found: list[tuple[int, int]] = []
    rows: Any = plan.rows.tolist()
    for i, row in enumerate(rows):
        last = rows[i - 1] if i else row
        frames = [at.ROW_F, at.ROW_G]
        coupled = kinds.ROW_COUPLING in (row[at.ROW_KIND], last[at.ROW_KIND])
        if i and not coupled and [row[k] for k in frames] == [last[k] for k in frames]:
            found[-1] = (found[-1][0], i + 1)
        else:
            found.append((i, i + 1))
    return found
