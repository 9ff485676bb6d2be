"""Closed loops for explicit methods: accelerations with multipliers, and projection onto the loops.

The multipliers nu solve C M^-1 C^T nu = C a_tree + gamma, a = a_tree - M^-1 C^T nu (Ambrosio &
Nikravesh 1992, eq. 76-77).  Positions and velocities go back onto the loops along M^-1 C^T, that is by
the shortest way in the mass metric.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy
from numpy.typing import NDArray

from flexmbd.integrate import state as st
from flexmbd.multibody.kernels.algebra.rank_revealing import RANK_FLOOR, factor_block, solve_block
from flexmbd.multibody.kernels.algebra.rotation_update import EXPONENTIAL, from_local_coordinates
from flexmbd.multibody.kernels.base.array_struct import ArrayStruct
from flexmbd.multibody.kernels.base.arrays import Plan, Work
from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel
from flexmbd.multibody.kernels.base.deferred import deferred_kernel
from flexmbd.multibody.kernels.forward_dynamics.articulated import run_forward_dynamics, solve_mass
from flexmbd.multibody.kernels.forward_dynamics.loop_layout import LoopRecursion, new_loop_recursion
from flexmbd.multibody.kernels.forward_dynamics.loop_recursion import factor_loops
from flexmbd.multibody.kernels.forward_dynamics.loop_solution import rows_times, solve_loops
from flexmbd.multibody.kernels.forward_dynamics.row_paths import (
    RowPaths,
    add_row,
    new_row_paths,
    no_row_paths,
    row_times,
    solve_rows,
)
from flexmbd.multibody.kernels.inverse_dynamics.closure import constraints
from flexmbd.multibody.kernels.inverse_dynamics.recursion import forward_kinematics
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.plan.mass_solver import mass_solver, row_mobilities
from flexmbd.multibody.plan.scene_matrices import constraint_slopes

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# Where the smallest pivot of C M^-1 C^T falls below this share of its usual size, stages are projected too,
# for a stage off the loops would cause excessive reactions.
_NEARLY_SINGULAR = 1e-2
# Below this share a stage leaves out the reaction in the nearly dependent direction: it acts across the motion
# alone, and projection makes up for it.
NO_REACTION = 1e-10

_CLOSED = 1e-13  # a correction below this share of the scales is not worth another
_ACCEPTED = 1e-9  # where round-off stops the iteration, this share still counts as closed


@dataclass(frozen=True, eq=False)
class LoopMemory(ArrayStruct):
    """What is remembered of m constraint rows from step to step.

    row_scale: (m,) the largest norms of the rows of C at a step's end, in the metric of M^-1.
    usual_pivot: (m,) the first for each block of rows: the largest value of its smallest pivot at a step's end.
    """

    row_scale: FloatArray
    usual_pivot: FloatArray


def new_loop_memory(plan: Plan) -> LoopMemory:
    """Allocate for the rows of ``plan``."""
    return LoopMemory(*np.zeros((2, len(plan.rows))))


@dataclass(frozen=True, eq=False)
class Loops(ArrayStruct):
    """Work arrays of m constraint rows.

    paths: C, U and Y of ``row_paths``.  row_factors: (m, m) factors of the blocks of C M^-1 C^T, with the pivots
    row_order (m,).  row_scale, usual_pivot: those of ``LoopMemory``.  row_norm: (m,) the norms of the rows at hand.
    rank: (blocks,) of the factors; effective_rank: (blocks,) of the directions in which reactions act.
    phi, rate, rate2: (m,) residuals of the rows and their time derivatives.  solution, scratch: (m,).
    force, moved: (1, nv) generalised forces of the rows and the motion that they cause.  move: (nv,) correction.
    no_multipliers: (0,).
    recursion: where it takes less than paths; then these and ``row_factors`` have no entries, and a block of rows are
    those that end at one body.  least_pivot: (blocks,) of what counts in it.
    """

    paths: RowPaths
    recursion: LoopRecursion
    row_factors: FloatArray
    row_order: IntArray
    row_scale: FloatArray
    usual_pivot: FloatArray
    row_norm: FloatArray
    phi: FloatArray
    rate: FloatArray
    rate2: FloatArray
    solution: FloatArray
    scratch: FloatArray
    force: FloatArray
    moved: FloatArray
    move: FloatArray
    least_pivot: FloatArray
    rank: IntArray
    effective_rank: IntArray
    no_multipliers: FloatArray


def new_loops(plan: Plan, memory: LoopMemory, nv: int, *, bounds: IntArray | None = None) -> Loops:
    """Allocate for the rows of ``plan`` with nv velocities; ``memory`` is kept and not copied.

    ``bounds``: (blocks + 1,) where other blocks of rows begin and end than those that tree and rows make.
    """
    m = len(plan.rows)
    recursion = new_loop_recursion(plan, serves=bounds is None)
    serves = len(recursion.order) > 0
    paths = no_row_paths(np.unique(recursion.ending)) if serves else new_row_paths(plan)
    if bounds is not None:
        paths = paths.replace(block=bounds)
    blocks = len(paths.block) - 1
    zeros = np.zeros
    return Loops(
        paths=paths,
        recursion=recursion,
        row_factors=zeros((0, 0) if serves else (m, m)),
        row_order=zeros(m, np.int64),
        row_scale=memory.row_scale,
        usual_pivot=memory.usual_pivot[:blocks],
        row_norm=zeros(m),
        phi=zeros(m),
        rate=zeros(m),
        rate2=zeros(m),
        solution=zeros(m),
        scratch=zeros(m),
        force=zeros((1, nv)),
        moved=zeros((1, nv)),
        move=zeros(nv),
        least_pivot=zeros(blocks),
        rank=zeros(blocks, np.int64),
        effective_rank=zeros(blocks, np.int64),
        no_multipliers=zeros(0),
    )


def set_row_scales(scene: CompiledScene, loops: Loops, state: st.State, work: Work) -> None:
    """Set the scales at the start of an integration; ``work.time`` must be up to date.

    A row that a singular start leaves without effect takes the largest scale of the others.
    """
    m = len(scene.plan.rows)
    if m == 0 or len(scene.plan.free) == 0:
        return
    if len(loops.recursion.order):
        rest = np.zeros(scene.nv)
        measure_rows(scene.plan, work, loops, state.x, rest, rest)
        loops.row_scale[loops.row_scale == 0.0] = loops.row_scale.max() or 1.0
        return
    mobilities = row_mobilities(constraint_slopes(scene, work, state.x), mass_solver(scene, work, state.x))
    norms, least = np.zeros(m), np.ones(m)
    for block, mobility in zip(scene.row_blocks, mobilities, strict=True):
        norms[block.rows] = lengths = np.sqrt(np.diag(mobility))
        unit = mobility / np.outer(*2 * [np.where(lengths > 0.0, lengths, 1.0)])
        factors, _, rank, _ = scipy.linalg.lapack.dpstrf(unit, tol=RANK_FLOOR)
        least[block.rows] = (np.diag(factors)[:rank] ** 2).min(initial=1.0)
    norms[norms == 0.0] = norms.max() if norms.any() else 1.0
    loops.row_scale[:] = norms
    for c, (first, last) in enumerate(pairwise(loops.paths.block)):
        loops.usual_pivot[c] = least[first:last].min()


@entry_kernel
def measure_rows(plan, work, loops, x, v, a):
    """Set the scales of rows that the recursion serves by their lengths and pivots at x (nx,); 0 of those without."""
    forward_kinematics(plan, work, x, v, a)
    for i in range(loops.row_scale.shape[0]):
        loops.row_scale[i] = 0.0
    for c in range(loops.rank.shape[0]):
        loops.least_pivot[c] = 0.0
    factor_loops(plan, work, loops.recursion, loops.row_scale, loops.least_pivot, loops.row_norm, loops.rank)
    for i in range(loops.row_scale.shape[0]):
        loops.row_scale[i] = loops.row_norm[i]
    for c in range(loops.rank.shape[0]):
        loops.usual_pivot[c] = _pivot(loops, c, loops.rank[c]) if loops.rank[c] > 0 else 1.0


@kernel
def accelerate(plan, work, aw, loops, x, v, a, multipliers):
    """Write the free accelerations and the multipliers at (x, v); keep the factors in ``loops``.

    Reads from ``loops.usual_pivot`` how large rows and pivots are away from singular positions.
    """
    run_forward_dynamics(plan, work, aw, x, v, a, loops.no_multipliers)
    if plan.rows.shape[0] > 0:
        _add_reactions(plan, work, aw, loops, x, v, a, multipliers)


@kernel
def _add_reactions(plan, work, aw, loops, x, v, a, multipliers):
    """Find the multipliers at the tree's accelerations ``a`` and add what they cause."""
    m = plan.rows.shape[0]
    forward_kinematics(plan, work, x, v, a)
    constraints(plan, work, loops.phi, loops.rate, loops.rate2)
    if _recurs(loops):
        _factor_recursion(plan, work, loops)
    else:
        _factor_paths(plan, work, aw, loops)
    minimum_norm_motion(plan, work, aw, loops, loops.effective_rank, loops.rate2, loops.move)
    for i in range(m):
        multipliers[i] = loops.solution[i]
    for k in range(a.shape[0]):
        a[k] -= loops.move[k]


@kernel
def _recurs(loops):
    """Whether rows are eliminated with the bodies."""
    return loops.recursion.order.shape[0] > 0


@deferred_kernel()
def _factor_recursion(plan, work, loops):
    for c in range(loops.rank.shape[0]):
        loops.least_pivot[c] = NO_REACTION * loops.usual_pivot[c]
    factor_loops(plan, work, loops.recursion, loops.row_scale, loops.least_pivot, loops.row_norm, loops.rank)
    for c in range(loops.rank.shape[0]):
        loops.effective_rank[c] = loops.rank[c]


@deferred_kernel()
def _solve_recursion(plan, loops, ranks, rows, out):
    solve_loops(plan, loops.recursion, ranks, rows, out, loops.solution)


@deferred_kernel()
def _recursion_rows(plan, loops, vector):
    rows_times(plan, loops.recursion, vector, loops.phi)


@kernel
def _factor_paths(plan, work, aw, loops):
    """Factor C M^-1 C^T block by block."""
    solve_rows(plan, work, aw, loops.paths, loops.row_factors)
    for i in range(plan.rows.shape[0]):
        loops.row_norm[i] = np.sqrt(loops.row_factors[i, i])
    for c in range(loops.rank.shape[0]):
        first = loops.paths.block[c]
        rank = factor_block(loops.row_factors, first, loops.paths.block[c + 1], loops.row_order, loops.row_scale)
        loops.rank[c] = rank
        while rank > 1 and _pivot(loops, c, rank) < NO_REACTION * loops.usual_pivot[c]:
            rank -= 1
        loops.effective_rank[c] = rank


@kernel
def _pivot(loops, c, rank):
    """The pivot of block c that the last of ``rank`` rows has; 0 without any."""
    if rank == 0:
        return 0.0
    last = loops.paths.block[c] + rank - 1
    if _recurs(loops):
        return loops.recursion.factors[last, rank - 1] ** 2
    return loops.row_factors[last, last] ** 2


@kernel
def update_row_scales(loops, state):
    """Update the scales of the rows and of the smallest pivots by their last factorisation, at a step's end."""
    for i in range(loops.row_scale.shape[0]):
        loops.row_scale[i] = max(loops.row_scale[i], loops.row_norm[i])
    least = np.inf
    for c in range(loops.rank.shape[0]):
        pivot = _pivot(loops, c, loops.rank[c])
        loops.usual_pivot[c] = max(loops.usual_pivot[c], pivot)
        full = loops.rank[c] == loops.paths.block[c + 1] - loops.paths.block[c]
        least = min(least, pivot if full else 0.0)
    if loops.row_norm.shape[0] > 0:
        st.watch_pivot(state, least)


@kernel
def factor_rows(longest, matrix, first, last, order):
    """Factor the block of C B^-1 C^T from row ``first`` to before ``last``, of an implicit method; its rank.

    ``longest`` (m,) keeps the largest lengths of the rows.
    """
    for i in range(first, last):
        longest[i] = max(longest[i], np.sqrt(max(matrix[i, i], 0.0)))
        if longest[i] == 0.0:
            longest[i] = 1.0
    return factor_block(matrix, first, last, order, longest)


@kernel
def least_pivot(matrix, first, last, rank):
    """The smallest pivot of a block of that rank, rows over the largest lengths that they had; 1 without rows."""
    if last == first:
        return 1.0
    return matrix[last - 1, last - 1] ** 2 if rank == last - first else 0.0


@kernel
def is_nearly_singular(loops):
    """Whether the smallest pivot of a block is well below its usual size."""
    for c in range(loops.rank.shape[0]):
        rank = loops.rank[c]
        full = rank == loops.paths.block[c + 1] - loops.paths.block[c]
        if not full or _pivot(loops, c, rank) < _NEARLY_SINGULAR * loops.usual_pivot[c]:
            return True
    return False


@kernel
def project_onto_tangent(plan, work, aw, loops, out):
    """Project the tangent vector ``out`` (nv,) onto C out = 0, along M^-1 C^T."""
    if _recurs(loops):
        _recursion_rows(plan, loops, out)
    else:
        for i in range(loops.phi.shape[0]):
            loops.phi[i] = row_times(loops.paths, i, out)
    minimum_norm_motion(plan, work, aw, loops, loops.rank, loops.phi, loops.move)
    for k in range(out.shape[0]):
        out[k] -= loops.move[k]


@kernel
def minimum_norm_motion(plan, work, aw, loops, ranks, rows, out):
    """out = M^-1 C^T (C M^-1 C^T)^-1 rows, with the factors that ``accelerate`` left and the ranks of the blocks."""
    if _recurs(loops):
        _solve_recursion(plan, loops, ranks, rows, out)
        return
    for c in range(ranks.shape[0]):
        first, last = loops.paths.block[c], loops.paths.block[c + 1]
        factors, order, scale = loops.row_factors, loops.row_order, loops.row_scale
        solve_block(factors, first, last, ranks[c], order, scale, rows, loops.scratch, loops.solution)
    for k in range(out.shape[0]):
        loops.force[0, k] = 0.0
    for i in range(rows.shape[0]):
        if loops.solution[i] != 0.0:
            add_row(loops.paths, i, loops.solution[i], loops.force[0])
    solve_mass(plan, work, aw, loops.force, loops.moved)
    for k in range(out.shape[0]):
        out[k] = loops.moved[0, k]


@kernel
def project(plan, work, aw, plain, quaternions, state, groups, loops, rate, x, v):
    """Move x onto phi = 0, then v onto C v = 0, with the factors of a place nearby; whether it succeeded.

    Newton's iteration with those factors; it ends where corrections vanish or round-off stops them.
    """
    before = np.inf
    while True:
        size = _correction(plan, work, aw, state, groups, loops, rate, x, v, True)
        if size <= _CLOSED or not size < 0.5 * before:
            break
        before = size
        from_local_coordinates(plain, quaternions, EXPONENTIAL, x, loops.move, x)
    return size <= _ACCEPTED and project_velocities(plan, work, aw, state, groups, loops, rate, x, v)


@kernel
def project_velocities(plan, work, aw, state, groups, loops, rate, x, v):
    """Move v onto C v = 0 at x, as `project`; whether it succeeded."""
    before = np.inf
    while True:
        size = _correction(plan, work, aw, state, groups, loops, rate, x, v, False)
        if size <= _CLOSED or not size < 0.5 * before:
            return size <= _ACCEPTED
        before = size
        for k in range(v.shape[0]):
            v[k] += loops.move[k]


@kernel
def _correction(plan, work, aw, state, groups, loops, rate, x, v, on_positions):
    """Write the correction of x or of v into ``loops.move``; its largest part over the coordinates' scales."""
    forward_kinematics(plan, work, x, v, v)
    constraints(plan, work, loops.phi, loops.rate, loops.rate2)
    minimum_norm_motion(plan, work, aw, loops, loops.rank, loops.phi if on_positions else loops.rate, loops.move)
    size = 0.0
    for k in range(v.shape[0]):
        g = groups.of[k]
        scale = groups.position[g] if on_positions else st.group_speed(groups, g, rate)
        part = abs(loops.move[k]) / scale
        loops.move[k] = -loops.move[k]
        if not part <= size:
            size = part
            state.counts[st.WORST] = k
    return size
