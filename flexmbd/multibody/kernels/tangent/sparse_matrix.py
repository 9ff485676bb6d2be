"""The sparse matrix of a machine: whether it has one, where its tree is cut, its pattern; made at compile."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.array_struct import ArrayStruct
from flexmbd.multibody.kernels.base.arrays import FloatArray, IntArray, Plan
from flexmbd.multibody.kernels.elements.table import act_between_frames, call_users, couple_all
from flexmbd.multibody.kernels.sparse.block_lu import BlockMatrix, new_block_matrix
from flexmbd.multibody.kernels.sparse.block_pattern import BlockPattern, new_block_pattern
from flexmbd.multibody.kernels.sparse.index_lists import distinct
from flexmbd.multibody.kernels.tangent.sparse_places import SparsePlaces, new_sparse_places, no_sparse_places
from flexmbd.multibody.kernels.tangent.unknown_blocks import CUT, UnknownBlocks, unknown_blocks

# In operations of LAPACK's LU: what an entry of a sparse matrix costs, which is found, cleared, assembled and used by
# each solution, and an operation of its factorisation, which of loops there are two.
_ENTRY, _OPERATION = 400.0, 2.0
_SECTIONS = (8, 20, 50)  # unknowns between cuts that are tried


@dataclass(frozen=True, eq=False)
class SparseMatrix(ArrayStruct):
    """A matrix, its factors, and where the tangent writes; all are empty where the machine's matrix is dense.

    rhs: (1, unknowns) a right-hand side of all unknowns: free velocities, multipliers, then those of cut bodies.
    """

    pattern: BlockPattern
    matrix: BlockMatrix
    to: SparsePlaces
    rhs: FloatArray


@cache
def no_sparse_matrix() -> SparseMatrix:
    """That of a machine whose matrix is dense."""
    pattern = new_block_pattern(np.zeros(0, np.int64), np.zeros((0, 2), np.int64))
    return SparseMatrix(pattern, new_block_matrix(pattern), no_sparse_places(), np.zeros((1, 0)))


def sparse_blocks(
    plan: Plan, sizes: IntArray, *, cuts: bool = True
) -> tuple[UnknownBlocks, BlockPattern] | None:
    """The blocks and the pattern of a machine, where that is cheaper than dense blocks of these sizes; else None.

    ``cuts``: whether its tree may be cut.
    """
    dense = 2.0 / 3.0 * float((sizes.astype(float) ** 3).sum()) + float(len(plan.free)) ** 2
    if _ENTRY * (len(plan.free) + len(plan.rows)) >= dense or couple_all(plan).any():
        return None
    ways = _ways(plan) if cuts else [None]
    counts = [_entries(plan, way) for way in ways]
    if _ENTRY * min(counts) >= dense:
        return None
    found = []
    for k in np.argsort(counts, kind="stable")[:2]:
        blocks = unknown_blocks(plan, ways[k])
        pattern = new_pattern(blocks)
        found.append((factor_cost(pattern), blocks, pattern))
    cost, blocks, pattern = min(found, key=lambda one: one[0])
    return (blocks, pattern) if cost < dense else None


def factor_cost(pattern: BlockPattern) -> float:
    """What assembly and factors of a sparse matrix take, in operations of LAPACK's LU."""
    return _OPERATION * pattern.operations + _ENTRY * pattern.fill


def is_augmented(plan: Plan) -> bool:
    """Whether an augmented Lagrangian enforces a row."""
    return bool((plan.rows[:, at.ROW_ENFORCEMENT] > 0).any())


def new_sparse_matrix(plan: Plan, blocks: UnknownBlocks, pattern: BlockPattern) -> SparseMatrix:
    """Allocate the matrix of a plan."""
    pairs = blocks.pairs
    places = new_sparse_places(plan, blocks, pairs, *pattern.entries(*pairs.T))
    return SparseMatrix(pattern, new_block_matrix(pattern), places, np.zeros((1, pattern.unknowns)))


def _ways(plan: Plan) -> list[NDArray[np.bool_] | None]:
    """Ways to cut the tree, each another one, and first not to cut it at all."""
    found: list[NDArray[np.bool_] | None] = [None]
    if call_users(plan)[act_between_frames(plan)].any():  # laws that have to be differenced, by unknowns' sizes
        return found
    known = {b""}
    for size in _SECTIONS:
        way = _cut(plan, size)
        key = way.tobytes() if way.any() else b""
        if key not in known:
            known.add(key)
            found.append(way)
    return found


def new_pattern(blocks: UnknownBlocks) -> BlockPattern:
    """The pattern by minimum degree, but that blocks come after those that they wait for."""
    pairs, waits = blocks.pairs, blocks.waits()
    pattern = new_block_pattern(blocks.size, pairs, ranks=blocks.ranks())
    if not waits:
        return pattern
    number = np.repeat(np.arange(len(blocks.first)), blocks.size)
    eliminated: Any = number[pattern.unknown].tolist()
    return new_block_pattern(blocks.size, pairs, order=_in_turn(dict.fromkeys(eliminated), waits))


def _in_turn(order: Iterable[int], waits: dict[int, list[int]]) -> list[int]:
    """An order in which blocks come as soon as those that they wait for have come."""
    left = {block: set(others) for block, others in waits.items()}
    followers: dict[int, list[int]] = {}
    for block, others in waits.items():
        for other in others:
            followers.setdefault(other, []).append(block)
    found: list[int] = []
    ready: set[int] = set()  # that come when nothing keeps them any more
    for block in order:
        ready.add(block)
        come = [block]
        while come:
            one = come.pop()
            if one in ready and not left.get(one):
                ready.remove(one)
                found.append(one)
                for follower in followers.get(one, ()):
                    left[follower].discard(one)
                    come.append(follower)
    return found


def _own_unknowns(plan: Plan) -> IntArray:
    """(bodies,) unknowns of each body's joint and modes, prescribed ones included."""
    modes = np.concatenate([plan.flex[:, at.N_MODES], np.zeros(1, np.int64)])
    return np.asarray(plan.tree[:, at.JOINT_SIZE] + modes[plan.tree[:, at.FLEX]], np.int64)


def _cut(plan: Plan, size: int) -> NDArray[np.bool_]:
    """(bodies,) cuts that leave some ``size`` unknowns between one and the next ones outwards."""
    own: Any = _own_unknowns(plan).tolist()
    massless: Any = (~plan.rigid.any(axis=1)).tolist()
    parents: Any = plan.tree[:, at.PARENT].tolist()
    cut = np.zeros(len(own), np.bool_)
    for i in range(len(own) - 1, -1, -1):
        if parents[i] < 0:
            continue
        if own[i] >= size and not massless[i]:
            cut[i] = True
        else:
            own[parents[i]] += own[i]
    return cut


def _entries(plan: Plan, cut: NDArray[np.bool_] | None) -> float:
    """How many entries the matrix has, about: full blocks of sections, each what one cut body or the ground carries.

    And of sections that a cut body, a force or a row joins.
    """
    own = _own_unknowns(plan)
    sizes: Any = own.astype(float).tolist()
    sections, joined = list[int](), list[int]()
    parents: Any = plan.tree[:, at.PARENT].tolist()
    for i, parent in enumerate(parents):
        inner = sections[parent] if parent >= 0 else i
        sections.append(inner)
        if inner != i:
            sizes[inner] += sizes[i]
            sizes[i] = 0.0
        if cut is not None and cut[i]:
            sections[i] = i
            sizes[i] = float(CUT)
            joined.append(inner * len(own) + i)
    section, size = np.array(sections, np.int64), np.array(sizes)
    found = [np.array(joined, np.int64)]
    between = plan.elements[act_between_frames(plan)]
    for rows, f, g in ((between, at.EL_F, at.EL_G), (plan.rows, at.ROW_F, at.ROW_G)):
        ends = plan.frame_of[rows[:, [f, g]], at.FRAME_BODY]
        ends = section[ends[(ends >= 0).all(axis=1)]]
        found.append(ends[:, 0] * len(own) + ends[:, 1])
    one, other = np.divmod(distinct(np.concatenate(found), len(own) ** 2), max(len(own), 1))
    apart = one != other
    return float((size**2).sum() + 2.0 * (size[one] * size[other])[apart].sum())
