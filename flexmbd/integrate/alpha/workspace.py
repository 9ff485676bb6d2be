"""Data of an implicit step by a ``relation``: its entries of the state, its work arrays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.integrate.alpha.relation import Relation, RelationChoice, new_relation
from flexmbd.integrate.data_loads import DataLoads, new_data_loads, with_push
from flexmbd.integrate.matrix_choice import alpha_matrix
from flexmbd.multibody.kernels.base.array_struct import ArrayStruct
from flexmbd.multibody.kernels.base.arrays import Plan, Work
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.native import N_SIZES
from flexmbd.multibody.kernels.base.separate import address_of
from flexmbd.multibody.kernels.reading.force_tables import stiffness_may_change
from flexmbd.multibody.kernels.reading.plan_entries import holds_position, is_augmented
from flexmbd.multibody.kernels.tangent.diagonal_blocks import block_matrix
from flexmbd.multibody.kernels.tangent.residual_tangent import tangent_after_residual, tree_tangent_after_residual
from flexmbd.multibody.kernels.tangent.sparse_assembly import assemble_sparse
from flexmbd.multibody.kernels.tangent.sparse_matrix import SparseMatrix
from flexmbd.multibody.kernels.tangent.sparse_parts import LoopMatrices, new_loop_matrices
from flexmbd.multibody.kernels.tangent.tangent_layout import TangentWork
from flexmbd.multibody.kernels.tangent.tree_recursion import TreeRecursion

FloatArray = NDArray[np.float64]

@dataclass(frozen=True, eq=False)
class AlphaMemory(ArrayStruct):
    """What the method remembers from step to step; numbers stand alone in arrays (1,).

    scheme: (2,) position and velocity per unit of the new acceleration in the stage at hand.  step_factored: the step
    (s) that the factors belong to, 0 where there are none.  step_earlier: the step before the last.  contraction: how
    much a Newton iteration leaves of the error with the factors at hand.
    known_steps: how many accelerations it remembers.  filters: whether it filters its error.  renewals, next_renewals:
    steps left that are factored anew because old factors failed, and how many next time.  index: 2 or 3.
    remembered: (r, nv) what the method's ``relation`` carries from step to step.
    before, earlier, earliest: (nv,) the accelerations one, two and three steps ago.  own_rate: (nv,) each coordinate's
    own rate (1/s).  reactions_before, ...: (m,) multipliers of these steps.
    row_length: (m,) the largest lengths of the rows.
    """

    scheme: FloatArray
    step_factored: FloatArray
    step_earlier: FloatArray
    contraction: FloatArray
    known_steps: NDArray[np.int64]
    filters: NDArray[np.int64]
    renewals: NDArray[np.int64]
    next_renewals: NDArray[np.int64]
    index: NDArray[np.int64]
    remembered: FloatArray
    before: FloatArray
    earlier: FloatArray
    earliest: FloatArray
    own_rate: FloatArray
    reactions_before: FloatArray
    reactions_earlier: FloatArray
    reactions_earliest: FloatArray
    row_length: FloatArray


def _new_memory(nv: int, m: int, remembered: int) -> AlphaMemory:
    """Zeros for nv velocities, m constraint rows and what is remembered."""
    zeros = np.zeros
    return AlphaMemory(
        scheme=zeros(2),
        step_factored=zeros(1),
        step_earlier=zeros(1),
        contraction=zeros(1),
        known_steps=zeros(1, np.int64),
        filters=zeros(1, np.int64),
        renewals=zeros(1, np.int64),
        next_renewals=zeros(1, np.int64),
        index=zeros(1, np.int64),
        remembered=zeros((remembered, nv)),
        before=zeros(nv),
        earlier=zeros(nv),
        earliest=zeros(nv),
        own_rate=zeros(nv),
        reactions_before=zeros(m),
        reactions_earlier=zeros(m),
        reactions_earliest=zeros(m),
        row_length=zeros(m),
    )


@dataclass(frozen=True, eq=False)
class AlphaWorkspace(ArrayStruct):
    """Work arrays of a step: trial states, the iteration matrix and its factors.

    x, v, a, multipliers: of the stage's end.  displacement: (nv,) tangent vector from the step's start.
    known_reaction, row_force: (m,) of augmented rows, reaction of the passes before and what their gap adds (N or N m).
    residual: (nv,).  probe_acceleration: (nv,).  own_rate: (nv,) each coordinate's own rate (1/s) in the step at hand.
    unknown, equation: (n,) with n = free + 2 m.  matrix: factors of the iteration matrix, a
    ``block_matrix`` of n rows.
    error_x, error_v: (free,), (1, free) a step's local error.  curve: (free,) half the second derivative of a.
    full_tangent: (nv, nv).  tree_matrix: factors of the iteration matrix without rows.
    stiffness: derivatives by positions alone; both are block matrices of the free unknowns.  rate_stiffness: (m, k) of
    the rows, each in the columns of its block.
    tangent_stiffness: (ne, 2) of the force elements where factors were made, none where no element changes its own.
    interior_stiffness: (free, free) derivative by positions of the interiors' forces; (0, 0) where there are none.
    shift_direction: (m, free) B^-1 C^T, along which positions are shifted.
    row_factors: (m, m) of the blocks of C B^-1 C^T, with row_order (m,) and row_rank (c,); least_pivot: (1,) of rows of
    unit length, 1 without rows.
    bounds: (c + 1,) of the blocks of the iteration matrix; sorted_rhs: (1, n) a right-hand side sorted by them.
    phi, phi_rate, phi_rate2: (m,) residuals of the rows.
    sparse: the matrix where that is cheaper; what is dense has no entries there.  loops: see ``sparse_loops``.
    kernels: addresses of the tangent (0: of a sparse matrix), of that for the recursion where it serves, and of that of
    a sparse matrix.
    """

    x: FloatArray
    v: FloatArray
    a: FloatArray
    multipliers: FloatArray
    known_reaction: FloatArray
    row_force: FloatArray
    displacement: FloatArray
    residual: FloatArray
    probe_acceleration: FloatArray
    own_rate: FloatArray
    unknown: FloatArray
    equation: FloatArray
    matrix: FloatArray
    full_tangent: FloatArray
    tree_matrix: FloatArray
    stiffness: FloatArray
    rate_stiffness: FloatArray
    tangent_stiffness: FloatArray
    interior_stiffness: FloatArray
    shift_direction: FloatArray
    row_factors: FloatArray
    row_order: NDArray[np.int64]
    row_rank: NDArray[np.int64]
    least_pivot: FloatArray
    bounds: NDArray[np.int64]
    sorted_rhs: FloatArray
    correction: FloatArray
    error_x: FloatArray
    error_v: FloatArray
    curve: FloatArray
    scale_x: FloatArray
    scale_v: FloatArray
    phi: FloatArray
    phi_rate: FloatArray
    phi_rate2: FloatArray
    pivot: NDArray[np.int32]
    tree_pivot: NDArray[np.int32]
    sizes: NDArray[np.int32]
    recursion: TreeRecursion
    sparse: SparseMatrix
    loops: LoopMatrices
    kernels: NDArray[np.int64]
    tangent: TangentWork
    data: DataLoads
    relation: Relation
    memory: AlphaMemory


def new_workspace(
    plan: Plan,
    work: Work,
    nx: int,
    nv: int,
    relation: RelationChoice,
    *,
    interiors: bool = False,
    dense: bool = False,
) -> AlphaWorkspace:
    """Allocate the work arrays of a step for ``plan``.

    ``interiors`` couple all branches of the tree.  ``dense``: by LAPACK alone, whatever is cheaper.
    """
    m, nu = len(plan.rows), len(plan.free)
    n = nu + 2 * m
    zeros = np.zeros
    scales = zeros((2, nv))
    choice = alpha_matrix(plan, dense=dense or interiors)
    recursion, found = choice.recursion, choice.sparse
    bounds, free = choice.bounds, choice.side_by_side.free
    tangent, sparse = choice.new_tangent(nv, scales), choice.new_sparse()
    full = zeros((0, 0) if found else (nv, nv))
    state = (zeros(nx), zeros(nv), zeros(nv), zeros(m))
    kernels = [0, 0, 0]
    if found:
        arguments = (plan, work, tangent, sparse.to, *state, 0.0, 0.0, 0.0, sparse.matrix.values)
        kernels[2] = address_of(assemble_sparse, arguments)
        bounds = free = free[:1]
    else:
        kernels[0] = address_of(tangent_after_residual, (plan, work, tangent, *state, 0.0, 0.0, 0.0, full))
    if len(recursion.number):
        kernels[1] = address_of(
            tree_tangent_after_residual, (plan, work, tangent, recursion, *state[:3], 0.0, 0.0, 0.0)
        )
    return AlphaWorkspace(
        x=zeros(nx),
        v=zeros(nv),
        a=zeros(nv),
        multipliers=zeros(m),
        known_reaction=zeros(m),
        row_force=zeros(m),
        displacement=zeros(nv),
        residual=zeros(nv),
        probe_acceleration=zeros(nv),
        own_rate=zeros(nv),
        unknown=zeros(n),
        equation=zeros(n),
        matrix=block_matrix(bounds),
        full_tangent=full,
        tree_matrix=block_matrix(free),
        stiffness=block_matrix(free if m or interiors else free[:1]),
        rate_stiffness=zeros((m, int(np.diff(free).max(initial=0)))),
        tangent_stiffness=zeros((len(plan.elements) if stiffness_may_change(plan) else 0, 2)),
        interior_stiffness=zeros((nu, nu) if interiors else (0, 0)),
        shift_direction=zeros((0, 0) if found else (m, nu)),
        row_factors=zeros((0, 0) if found else (m, m)),
        row_order=zeros(m, np.int64),
        row_rank=zeros(len(tangent.blocks.velocity), np.int64),
        least_pivot=np.ones(1),
        bounds=bounds,
        sorted_rhs=zeros((1, n)),
        correction=zeros((1, n)),
        error_x=zeros(nu),
        error_v=zeros((1, nu)),
        curve=zeros(nu),
        scale_x=scales[0],
        scale_v=scales[1],
        phi=zeros(m),
        phi_rate=zeros(m),
        phi_rate2=zeros(m),
        pivot=zeros(max(1, n), np.int32),
        tree_pivot=zeros(max(1, nu), np.int32),
        sizes=zeros(N_SIZES, np.int32),
        recursion=recursion,
        sparse=sparse,
        loops=new_loop_matrices(plan, found),
        kernels=np.array(kernels),
        tangent=tangent,
        data=with_push(new_data_loads(plan, nv), plan, work, nx),
        relation=new_relation(relation, nv, m),
        memory=_new_memory(nv, m, relation.remembered),
    )


@kernel
def coefficients(scheme, h):
    """Position and velocity per unit of the new acceleration, in the stage at hand of a step h."""
    return scheme[0], scheme[1]


@kernel
def holds_position_alone(plan, scratch, i):
    """Whether row i is held at the level of positions and no other (index 3)."""
    row = plan.rows[i]
    return scratch.memory.index[0] == 3 and holds_position(row) and not is_augmented(row)


@kernel
def is_unshifted(plan, scratch, i):
    """Whether row i shifts no positions: it holds one level alone, or is augmented."""
    row = plan.rows[i]
    return scratch.memory.index[0] == 3 or is_augmented(row) or not holds_position(row)
