"""Which rows are open at which body: the arrays of the recursion with loops (`loop_recursion`), and whether it pays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.array_struct import ArrayStruct
from flexmbd.multibody.kernels.base.arrays import FloatArray, IntArray, Plan
from flexmbd.multibody.kernels.base.row_blocks import root_of, row_bodies

_MOST = 6
_LEAST = 800.0  # operations for a body
_GAIN = 1.5  # how much fewer operations it must take than rows by their paths


@dataclass(frozen=True, eq=False)
class LoopRecursion(ArrayStruct):
    """Open rows of each node and the factors; no node where the recursion does not serve.

    The nodes are the bodies and then the ground, once for each set of branches that loops join.
    base: (bodies,) the node that carries a body.
    first: (nodes + 1,) where a node's open rows begin in ``push``, those that end there before the others.
    ending: (nodes + 1,) where the rows that end at a node begin in ``ended`` (m,), rows by nodes, outermost first.
    square: (nodes + 1,) where a node's L begins in ``mutual``.  inner: (k,) place of an open row among its parent's, -1
    where it ends.  entry: (m, 2) places of a row at the bodies of its frames F and G, -1 of the ground.
    open_joint: (bodies,) where a body's part of ``joint_rows`` begins.  yields: (nv,) 0 of prescribed velocities.
    subspace, gain: (nv, 6) S, D^-1 U^T.  joint: (nv, 6) D's Cholesky factor.  joint_rows: D^-1 (P S)^T of open rows.
    inertia: (nodes, 6, 6).  push: (k, 6) P.  solved: (k, 6) L^-1 P of ending rows.
    mutual: L of open rows; between ending rows and others, above the diagonal, L^-1 times it.
    reaction: (m, 2, 6) what a unit of nu does to the bodies of F and G.
    factors: (m, widest) of L of ending rows, with order, scale (m,), as ``rank_revealing`` has them.
    shift: (bodies, 3) from the parent's origin.  bias, moved: (nodes, 6) wrench and acceleration.  row_bias: (k,).
    open_nu: (k,) reactions.  yielded: (nv,) joints' rates without their parents' motion.  scratch: (3, widest).
    force: (6,).
    """

    base: IntArray
    first: IntArray
    ending: IntArray
    ended: IntArray
    square: IntArray
    inner: IntArray
    entry: IntArray
    open_joint: IntArray
    yields: IntArray
    subspace: FloatArray
    gain: FloatArray
    joint: FloatArray
    joint_rows: FloatArray
    inertia: FloatArray
    push: FloatArray
    solved: FloatArray
    mutual: FloatArray
    reaction: FloatArray
    factors: FloatArray
    order: IntArray
    scale: FloatArray
    shift: FloatArray
    bias: FloatArray
    moved: FloatArray
    row_bias: FloatArray
    open_nu: FloatArray
    yielded: FloatArray
    scratch: FloatArray
    force: FloatArray


def new_loop_recursion(plan: Plan, *, serves: bool = True) -> LoopRecursion:
    """Find the open rows of ``plan``; no nodes unless it ``serves`` and takes fewer operations than rows by paths."""
    serves = serves and not len(plan.flex) + len(plan.shafts)
    if serves and len(plan.rows) and _most_operations(plan) > _LEAST * len(plan.tree):
        base = _bases(plan)
        nodes = _open_rows(plan, base)
        counts = np.array([len(one) for one, _ in nodes], np.int64)
        if _GAIN * float((_LEAST + 80.0 * counts + 30.0 * counts**2).sum()) <= _most_operations(plan):
            return _of_nodes(plan, base, nodes)
    return _no_nodes()


_none: list[LoopRecursion] = []


def _no_nodes() -> LoopRecursion:
    """Without nodes nothing is written to, so that one serves all plans."""
    if not _none:
        ints, floats, columns, zero = np.zeros(0, np.int64), np.zeros(0), np.zeros((0, 6)), np.zeros(1, np.int64)
        _none.append(
            LoopRecursion(
                base=ints, first=zero, ending=zero, ended=ints, square=zero, inner=ints,
                entry=np.zeros((0, 2), np.int64), open_joint=ints, yields=ints, subspace=columns, gain=columns,
                joint=columns, joint_rows=floats, inertia=np.zeros((0, 6, 6)), push=columns, solved=columns,
                mutual=floats, reaction=np.zeros((0, 2, 6)), factors=np.zeros((0, 0)), order=ints, scale=floats,
                shift=np.zeros((0, 3)), bias=columns, moved=columns, row_bias=floats, open_nu=floats, yielded=floats,
                scratch=np.zeros((3, 0)), force=np.zeros(_MOST),
            )
        )  # fmt: skip
    return _none[0]


def _of_nodes(plan: Plan, base: IntArray, nodes: list[tuple[list[int], int]]) -> LoopRecursion:
    """Allocate for the open rows of each node, those that end there before the others, and how many those are."""
    counts = np.array([len(one) for one, _ in nodes], np.int64)
    nv, m = len(plan.free) + len(plan.driven), len(plan.rows)
    bodies = len(base)
    first = np.concatenate([np.zeros(1, np.int64), np.cumsum(counts, dtype=np.int64)])
    ended = [row for open_rows, ends in nodes for row in open_rows[:ends]]
    ends = np.array([ends for _, ends in nodes], np.int64)
    places = [{row: int(first[n]) + i for i, row in enumerate(one)} for n, (one, _) in enumerate(nodes)]
    inner = np.full(int(first[-1]), -1, np.int64)
    entry = np.full((m, 2), -1, np.int64)
    for n in range(bodies):
        parent = places[base[n]]
        for row in nodes[n][0][nodes[n][1] :]:
            inner[places[n][row]] = parent[row]
    for row in range(m):
        for end, body in enumerate(row_bodies(plan, plan.rows[row])):
            entry[row, end] = places[body][row] if body >= 0 else -1
    sizes = plan.tree[:bodies, at.JOINT_SIZE].astype(np.int64)
    joint_rows = np.concatenate([np.zeros(1, np.int64), np.cumsum(sizes * counts[:bodies], dtype=np.int64)])
    yields = np.ones(nv, np.int64)
    yields[plan.driven[:, at.DRIVEN_V]] = 0
    zeros = np.zeros
    k = int(first[-1])
    return LoopRecursion(
        base=base,
        first=first,
        ending=np.concatenate([np.zeros(1, np.int64), np.cumsum(ends, dtype=np.int64)]),
        ended=np.array(ended, np.int64),
        square=np.concatenate([np.zeros(1, np.int64), np.cumsum(counts**2, dtype=np.int64)]),
        inner=inner,
        entry=entry,
        open_joint=joint_rows[:-1],
        yields=yields,
        subspace=zeros((nv, 6)),
        gain=zeros((nv, 6)),
        joint=zeros((nv, _MOST)),
        joint_rows=zeros(int(joint_rows[-1])),
        inertia=zeros((len(nodes), 6, 6)),
        push=zeros((k, 6)),
        solved=zeros((k, 6)),
        mutual=zeros(int((counts**2).sum())),
        reaction=zeros((m, 2, 6)),
        factors=zeros((m, int(ends.max(initial=0)))),
        order=zeros(m, np.int64),
        scale=np.ones(m),
        shift=zeros((bodies, 3)),
        bias=zeros((len(nodes), 6)),
        moved=zeros((len(nodes), 6)),
        row_bias=zeros(k),
        open_nu=zeros(k),
        yielded=zeros(nv),
        scratch=zeros((3, int(ends.max(initial=0)))),
        force=zeros(_MOST),
    )


def _most_operations(plan: Plan) -> float:
    """Operations of rows by their paths (``row_paths``); 0 where rows couple coordinates, which join no frames."""
    if (plan.rows[:, at.ROW_KIND] == kinds.ROW_COUPLING).any():
        return 0.0
    parents = [int(p) for p in plan.tree[:, at.PARENT]]
    visiting = np.zeros(len(parents))  # rows of which a frame lies outboard, those of which both do but once
    for row in plan.rows:
        one, other = row_bodies(plan, row)
        visiting[[b for b in (one, other) if b >= 0]] += 1.0
        nearest = _nearest(parents, one, other)
        if nearest >= 0:
            visiting[nearest] -= 1.0
    for b in range(len(parents) - 1, -1, -1):
        if parents[b] >= 0:
            visiting[parents[b]] += visiting[b]
    # rows lie far apart in matrices that have a column for each velocity: they miss caches
    spread = 2.0 * len(plan.rows) * (len(plan.free) + len(plan.driven))
    return float((150.0 * visiting + 2.0 * visiting**2).sum()) + spread


def _nearest(parents: list[int], one: int, other: int) -> int:
    """The outermost body from which both hang, -1 for the ground."""
    while one != other:  # parents come before children
        one, other = min(one, other), parents[max(one, other)]
    return one


def _bases(plan: Plan) -> IntArray:
    """(bodies,) the node that carries each body: its parent, or the ground of the branches that loops join with it."""
    base = plan.tree[:, at.PARENT].astype(np.int64)
    root: list[int] = []
    for b, parent in enumerate(base):
        root.append(b if parent < 0 else root[parent])
    joined = {b: b for b in set(root)}
    for row in plan.rows:
        moving = [root[b] for b in row_bodies(plan, row) if b >= 0]
        for b in moving[1:]:
            joined[root_of(joined, b)] = root_of(joined, moving[0])
    grounds: dict[int, int] = {}
    for b in np.flatnonzero(base < 0):
        base[b] = grounds.setdefault(root_of(joined, int(b)), len(base) + len(grounds))
    return base


def _open_rows(plan: Plan, base: IntArray) -> list[tuple[list[int], int]]:
    """Of each node the open rows, and how many of them, the first, end there."""
    parents = [int(p) for p in plan.tree[:, at.PARENT]]
    nodes = int(base.max()) + 1
    open_rows: list[set[int]] = [set() for _ in range(nodes)]
    last: list[int] = []
    for r, row in enumerate(plan.rows):
        ends = row_bodies(plan, row)
        for body in ends:
            if body >= 0:
                open_rows[body].add(r)
        last.append(_nearest(parents, *ends))
        if max(ends) < 0:  # between frames of the ground
            open_rows[-1].add(r)
    found: list[tuple[list[int], int]] = [([], 0)] * nodes
    for n in (*range(len(base) - 1, -1, -1), *range(len(base), nodes)):
        ends_here = sorted(r for r in open_rows[n] if last[r] == (n if n < len(base) else -1))
        rest = sorted(open_rows[n].difference(ends_here))
        found[n] = ends_here + rest, len(ends_here)
        if n < len(base):
            open_rows[base[n]].update(rest)
    return found
