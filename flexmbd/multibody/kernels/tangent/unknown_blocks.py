"""Blocks of unknowns for a sparse matrix of a machine, and which of them its tangent joins: found once, at compile.

A block holds the free velocities of a body's joint and modes, those of massless links with the body that they lead to,
or the multipliers of the rows between two frames.  Bodies are joined with those that carry them; and a force between
two bodies, or a constraint row, joins all on the paths from both to the ground.

In a deep tree paths are cut: of a *cut body* the motion and the wrench that it requires of its joint are unknowns of
their own, and paths end there.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.arrays import IntArray, Plan
from flexmbd.multibody.kernels.elements.table import act_between_frames, own_links

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
        most = 0
        for (first, _), joined in zip(self.row_groups, self.closures, strict=True):
            coupled = self.plan.rows[first, at.ROW_KIND] == kinds.ROW_COUPLING
            terms = int(self.plan.data[self.plan.rows[first, at.ROW_DATA]]) if coupled else 0
            most = max(most, terms, int(self.size[joined].sum()))
        return most

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

    def of_path(self, frames: Sequence[int]) -> list[int]:
        """The blocks that move any of these frames, each once."""
        found: dict[int, None] = {}
        for way in map(self.path, frames):
            found.update((int(self.of[group.first]), None) for group in way.groups)
            if way.root >= 0:
                found[int(self.of[self.cut(way.root)])] = None
        found.pop(-1, None)
        return list(found)

    @cached_property
    def elements(self) -> list[list[int]]:
        """Of each force element the blocks that it joins, those of its own states included."""
        between: Any = act_between_frames(self.plan)
        rows: Any = self.plan.elements[:, [at.EL_F, at.EL_G]].tolist()
        found = [self.of_path(ends) if acts else [] for ends, acts in zip(rows, between, strict=True)]
        for e in np.flatnonzero(between & (self.plan.elements[:, at.EL_V] >= 0)):
            links = own_links(self.plan, self.plan.elements[e])
            found[e] += [int(self.of[self.plan.tree[link, at.JOINT_V]]) for link in links]
        return found

    @cached_property
    def closures(self) -> list[list[int]]:
        """Of each group of rows the blocks that it joins, without its own."""
        found = []
        for first, _ in self.row_groups:
            row = self.plan.rows[first]
            if row[at.ROW_KIND] == kinds.ROW_COUPLING:
                o, n = row[at.ROW_DATA], int(self.plan.data[row[at.ROW_DATA]])
                terms = self.plan.data[o + 2 : o + 2 + 3 * n].reshape(n, 3)
                velocities = self.plan.tree[terms[:, 0].astype(int), at.JOINT_V] + terms[:, 1].astype(int)
                found.append([k for k in dict.fromkeys(self.of[velocities].tolist()) if k >= 0])
            else:
                found.append(self.of_path([int(row[at.ROW_F]), int(row[at.ROW_G])]))
        return found

    def body_pairs(self) -> Iterator[tuple[UnknownGroup, UnknownGroup]]:
        """Each free group of a body with each free one that carries it, its own joint with its modes included."""
        for joint, modes, inward, outward in zip(self.joints, self.modes, self.inward, self.outward, strict=True):
            for own, way in ((joint, inward), (modes, outward)):
                if own is not None and self.of[own.first] >= 0:
                    yield from ((own, inner) for inner in way.groups if self.of[inner.first] >= 0)

    def carried(self) -> Iterator[tuple[UnknownGroup, int]]:
        """Each free group with the number of the cut body that carries it."""
        for joint, modes, inward, outward in zip(self.joints, self.modes, self.inward, self.outward, strict=True):
            for own, way in ((joint, inward), (modes, outward)):
                if own is not None and way.root >= 0 and self.of[own.first] >= 0:
                    yield own, way.root

    def carrying(self) -> Iterator[tuple[UnknownGroup, int]]:
        """Each free group with the number of a cut body that it carries, up to the next cut body inwards."""
        for number, body in enumerate(self.cuts):
            joint = self.joints[body]
            for group in ([joint] if joint is not None else []) + self.inward[body].groups:
                if self.of[group.first] >= 0:
                    yield group, number

    def pairs(self) -> IntArray:
        """(p, 2) pairs of blocks that the matrix joins, each once, a block with itself included; symmetric."""
        b = len(self.first)
        found = {k * b + k for k in range(b)}

        def join(i: int, j: int) -> None:
            found.update((i * b + j, j * b + i))

        for one, other in self.body_pairs():
            join(int(self.of[one.first]), int(self.of[other.first]))
        for group, number in (*self.carried(), *self.carrying()):
            join(int(self.of[group.first]), int(self.of[self.cut(number)]))
        for number, body in enumerate(self.cuts):
            if self.inward[body].root >= 0:
                join(*(int(self.of[self.cut(k)]) for k in (number, self.inward[body].root)))
        for (first, _), joined in zip(self.row_groups, self.closures, strict=True):
            for k in joined:
                join(int(self.of[self.rows_begin + first]), k)
        for joined in (*self.elements, *self.closures):
            found.update(i * b + j for i in joined for j in joined)
        keys = np.array(sorted(found), np.int64)
        return np.stack(np.divmod(keys, max(b, 1)), axis=1)

    def ranks(self) -> IntArray:
        """(b,) 1 of the rows' blocks, whose diagonals are zero before others are eliminated."""
        found = np.zeros(len(self.first), np.int64)
        for first, _ in self.row_groups:
            found[self.of[self.rows_begin + first]] = 1
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
        for (first, _), joined in zip(self.row_groups, self.closures, strict=True):
            row = self.plan.rows[first]
            own = int(self.of[self.rows_begin + first])
            if row[at.ROW_KIND] == kinds.ROW_COUPLING:
                found[own] = joined
                continue
            one, other = ([*self._whole_path(int(row[k]))] for k in (at.ROW_F, at.ROW_G))
            found[own] = [k for k in dict.fromkeys([*one, *other]) if (k in one) != (k in other)]
        return found

    def _whole_path(self, frame: int) -> Iterator[int]:
        """The blocks that move a frame, through cut bodies to the ground."""
        way = self.path(frame)
        while True:
            yield from (int(self.of[group.first]) for group in way.groups if self.of[group.first] >= 0)
            if way.root < 0:
                return
            yield int(self.of[self.cut(way.root)])
            body = self.cuts[way.root]
            joint, inward = self.joints[body], self.inward[body]
            way = UnknownPath([*([joint] if joint is not None else []), *inward.groups], inward.root)


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
        joints.append(UnknownGroup(joint, size, -1) if size > 0 else None)
        modes.append(UnknownGroup(tree[at.MODAL_V], count, -1) if count else None)
        inward.append(_inward(plan, tree, modes, outward))
        on = [joints[i], *inward[i].groups] if size > 0 else inward[i].groups
        outward.append(UnknownPath([], number[i]) if i in number else UnknownPath(on, inward[i].root))  # type: ignore[arg-type]
        for begin, n in ((joint, size), (tree[at.MODAL_V], count)):
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
    if parent < 0:
        return UnknownPath([], -1)
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
