"""Data of a Radau IIA step: what the method remembers, and its work arrays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.integrate.data_loads import DataLoads, new_data_loads, with_push
from flexmbd.integrate.matrix_choice import radau_matrix
from flexmbd.integrate.radau.coefficients import STAGES
from flexmbd.multibody.kernels.algebra.rotation_update import coordinate_slots
from flexmbd.multibody.kernels.base.array_struct import ArrayStruct
from flexmbd.multibody.kernels.base.arrays import Plan, Work
from flexmbd.multibody.kernels.base.native import N_SIZES
from flexmbd.multibody.kernels.base.separate import address_of
from flexmbd.multibody.kernels.inverse_dynamics.closure import constraints
from flexmbd.multibody.kernels.inverse_dynamics.residual import residual
from flexmbd.multibody.kernels.reading.force_tables import has_smooth_contacts, stiffness_may_change
from flexmbd.multibody.kernels.tangent.diagonal_blocks import block_matrix
from flexmbd.multibody.kernels.tangent.recursion_parts import (
    ComplexRecursion,
    RecursionParts,
    new_complex_recursion,
    new_recursion_parts,
)
from flexmbd.multibody.kernels.tangent.residual_tangent import tangent_after_residual, tree_tangent_after_residual
from flexmbd.multibody.kernels.tangent.sparse_assembly import assemble_sparse
from flexmbd.multibody.kernels.tangent.sparse_matrix import SparseMatrix
from flexmbd.multibody.kernels.tangent.sparse_parts import ShiftedMatrix, new_shifted_matrix
from flexmbd.multibody.kernels.tangent.tangent_layout import TangentWork
from flexmbd.multibody.kernels.tangent.tree_recursion import TreeRecursion

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
ComplexArray = NDArray[np.complex128]

# Entries of RadauWorkspace.kernels: kernels called by their addresses.
RESIDUAL, CONSTRAINTS, TANGENT_AFTER_RESIDUAL, TREE_TANGENT, SPARSE_TANGENT, N_KERNELS = range(6)


@dataclass(frozen=True, eq=False)
class RadauMemory(ArrayStruct):
    """What the method remembers from step to step; numbers stand alone in arrays (1,).

    step_factored, step_polynomial: the steps (s) that the factors and the last polynomial belong to.  contraction: the
    error that an iteration leaves, as a share.
    renewals, next_renewals: how many steps still take a new tangent where they take new factors, because an old one
    failed, and how many next time.
    polynomial_known: whether a last polynomial is known.  tangent_serves: whether the tangent may be used again.
    newton_iterations: of the last step.  roughness_known: whether the roughness of the steps before is known.  smooth:
    whether the step at hand is as smooth as they were.
    stage_a: (3, nv), stage_reactions: (3, m) accelerations and multipliers of the last step's stages.  own_rate: (nv,)
    each coordinate's own rate (1/s).  roughness: (nv,) the estimate of its velocity's error over the fourth power of
    the step.  row_length: (m,) the largest lengths of the rows.
    """

    step_factored: FloatArray
    step_polynomial: FloatArray
    contraction: FloatArray
    renewals: IntArray
    next_renewals: IntArray
    polynomial_known: IntArray
    tangent_serves: IntArray
    newton_iterations: IntArray
    roughness_known: IntArray
    smooth: IntArray
    stage_a: FloatArray
    stage_reactions: FloatArray
    own_rate: FloatArray
    roughness: FloatArray
    row_length: FloatArray


def _new_memory(nv: int, m: int) -> RadauMemory:
    """Zeros for nv velocities and m constraint rows."""
    zeros = np.zeros
    return RadauMemory(
        step_factored=zeros(1),
        step_polynomial=zeros(1),
        contraction=zeros(1),
        renewals=zeros(1, np.int64),
        next_renewals=zeros(1, np.int64),
        polynomial_known=zeros(1, np.int64),
        tangent_serves=zeros(1, np.int64),
        newton_iterations=zeros(1, np.int64),
        roughness_known=zeros(1, np.int64),
        smooth=zeros(1, np.int64),
        stage_a=zeros((STAGES, nv)),
        stage_reactions=zeros((STAGES, m)),
        own_rate=zeros(nv),
        roughness=zeros(nv),
        row_length=zeros(m),
    )


@dataclass(frozen=True, eq=False)
class RadauWorkspace(ArrayStruct):
    """Work arrays of a step; nu free velocities, m rows, n = nu + 2 m unknowns a stage.

    x, v, a, local, local_rate: (3, ...) of the stages; local coordinates u and their rates.
    multipliers, shift: (3, m) nu and kappa; pushed: (3, nu) D kappa, (3, 0) without rows; push_real, push_complex:
    (nu,) or (0,) of a correction.  time: (3, times, 3) functions of time at the stages.  equation: (3, n).
    residual: (nv,).  full_tangent: (nv, nv).
    mass, damping, stiffness: block matrices of nu rows, the tangent.
    jacobian: (m, nu) C.  rate_jacobian: (m, nu) d(C v)/dx.
    tangent_stiffness: (ne, 2) of the force elements there, none where no element changes its own.
    tangent_touched: (ne,) 1 of those that are contacts and touch there, none where there are no contacts; touched: at
    how many of the stages they do.  gaps: (3, ne, 2) of these the gap (m) and its rate (m/s) at the stages.
    row_response: (m, nu) B^-1 C^T.  shift_direction: (m, nu) D, the same with zeros in rows that hold velocities alone.
    row_transform: (3, m, m) T_i of ``row_transforms``; uses_transform: (1,) whether it is used; transformed: (2, m).
    row_matrix: (m, m) C B^-1 C^T where the tangent was taken.  stage_row_matrix: that of the stage at hand, factored.
    real_matrix, complex_matrix: block matrices of n rows, factors of the iteration matrices.
    end_mass: factors of M at a step's end; end_jacobian, end_response: (m, nu) C and C M^-1 there.
    row_factors: (m, m) of the blocks of C M^-1 C^T, with row_order, row_length (m,) and row_rank (c,).
    bounds: (c + 1,) of the blocks of the iteration matrices; sorted_real, sorted_complex: (1, n) right-hand sides
    sorted by them.
    row_residual, reaction, row_scratch: (m,).  tree_matrix: factors of B.
    own_rate: (nv,) each coordinate's own rate (1/s) in the step at hand.
    kernels: addresses of large kernels, which are compiled once and not within each of the method's kernels.
    recursion, complex_recursion, parts: the tangent and its factors where ``tree_recursion`` serves; the matrices have
    no entries there, the others none elsewhere.  sparse, shifted: likewise, where a sparse matrix is cheaper; what
    is of (m, nu) or (m, m) has no entries there either.
    """

    x: FloatArray
    v: FloatArray
    a: FloatArray
    local: FloatArray
    local_rate: FloatArray
    multipliers: FloatArray
    shift: FloatArray
    pushed: FloatArray
    push_real: FloatArray
    push_complex: ComplexArray
    time: FloatArray
    equation: FloatArray
    residual: FloatArray
    full_tangent: FloatArray
    mass: FloatArray
    damping: FloatArray
    stiffness: FloatArray
    tangent_stiffness: FloatArray
    tangent_touched: FloatArray
    touched: FloatArray
    gaps: FloatArray
    jacobian: FloatArray
    rate_jacobian: FloatArray
    shift_direction: FloatArray
    row_response: FloatArray
    row_transform: FloatArray
    uses_transform: IntArray
    row_matrix: FloatArray
    stage_row_matrix: FloatArray
    transformed: FloatArray
    row_pivot: NDArray[np.int32]
    real_matrix: FloatArray
    complex_matrix: ComplexArray
    end_mass: FloatArray
    end_jacobian: FloatArray
    end_response: FloatArray
    row_factors: FloatArray
    row_order: IntArray
    row_length: FloatArray
    row_rank: IntArray
    row_scratch: FloatArray
    row_residual: FloatArray
    reaction: FloatArray
    tree_matrix: FloatArray
    rhs_real: FloatArray
    rhs_complex: ComplexArray
    rhs_end: FloatArray
    error_x: FloatArray
    error_v: FloatArray
    scale_x: FloatArray
    scale_v: FloatArray
    own_rate: FloatArray
    phi: FloatArray
    phi_rate: FloatArray
    phi_rate2: FloatArray
    quaternions: IntArray
    lapack_complex: IntArray
    pivot_real: NDArray[np.int32]
    pivot_complex: NDArray[np.int32]
    pivot_end: NDArray[np.int32]
    sizes: NDArray[np.int32]
    kernels: IntArray
    bounds: IntArray
    sorted_real: FloatArray
    sorted_complex: ComplexArray
    recursion: TreeRecursion
    complex_recursion: ComplexRecursion
    parts: RecursionParts
    sparse: SparseMatrix
    shifted: ShiftedMatrix
    tangent: TangentWork
    data: DataLoads
    memory: RadauMemory


def new_workspace(plan: Plan, work: Work, nx: int, nv: int, *, lapack_complex: IntArray) -> RadauWorkspace:
    """Allocate the work arrays of a step for ``plan``."""
    m, nu = len(plan.rows), len(plan.free)
    n = nu + 2 * m
    zeros = np.zeros
    scales = zeros((2, nv))
    contacts = len(plan.elements) if has_smooth_contacts(plan) else 0
    choice = radau_matrix(plan)
    recursion, found, bounds, free = choice.recursion, choice.sparse, choice.bounds, choice.side_by_side.free
    tangent, sparse = choice.new_tangent(nv, scales), choice.new_sparse()
    if no_matrix := choice.recurs or found is not None:
        bounds = free = free[:1]
    phi, full = zeros((3, m)), zeros((0, 0) if no_matrix else (nv, nv))
    pushed, dense = (nu, 0 if found else m) if m else (0, 0)
    state, kernels = (zeros(nx), zeros(nv), zeros(nv), zeros(m)), zeros(N_KERNELS, np.int64)
    kernels[RESIDUAL] = address_of(residual, (plan, work, *state, zeros(nv)))
    if m > 0:
        kernels[CONSTRAINTS] = address_of(constraints, (plan, work, *phi))
    if len(recursion.number):
        by_tree = (plan, work, tangent, recursion, *state[:3], 0.0, 0.0, 0.0)
        kernels[TREE_TANGENT] = address_of(tree_tangent_after_residual, by_tree)
    elif found:
        by_blocks = (plan, work, tangent, sparse.to, *state, 0.0, 0.0, 0.0, sparse.matrix.values)
        kernels[SPARSE_TANGENT] = address_of(assemble_sparse, by_blocks)
    else:
        whole = (plan, work, tangent, *state, 0.0, 0.0, 0.0, full)
        kernels[TANGENT_AFTER_RESIDUAL] = address_of(tangent_after_residual, whole)
    return RadauWorkspace(
        x=zeros((STAGES, nx)),
        v=zeros((STAGES, nv)),
        a=zeros((STAGES, nv)),
        local=zeros((STAGES, nv)),
        local_rate=zeros((STAGES, nv)),
        multipliers=zeros((STAGES, m)),
        shift=zeros((STAGES, m)),
        pushed=zeros((STAGES, pushed)),
        push_real=zeros(pushed),
        push_complex=zeros(pushed, np.complex128),
        time=zeros((STAGES, *work.time.shape)),
        equation=zeros((STAGES, n)),
        residual=zeros(nv),
        full_tangent=full,
        mass=block_matrix(free),
        damping=block_matrix(free),
        stiffness=block_matrix(free),
        tangent_stiffness=zeros((len(plan.elements) if stiffness_may_change(plan) else 0, 2)),
        tangent_touched=zeros(contacts),
        touched=zeros(contacts),
        gaps=zeros((STAGES, contacts, 2)),
        jacobian=zeros((dense, nu)),
        rate_jacobian=zeros((dense, nu)),
        shift_direction=zeros((dense, nu)),
        row_response=zeros((dense, nu)),
        row_transform=zeros((STAGES, dense, dense)),
        uses_transform=zeros(1, np.int64),
        row_matrix=zeros((dense, dense)),
        stage_row_matrix=block_matrix(tangent.blocks.rows if dense else free[:1]),
        transformed=zeros((2, m)),
        row_pivot=zeros(max(1, m), np.int32),
        real_matrix=block_matrix(bounds),
        complex_matrix=block_matrix(bounds, np.complex128),
        end_mass=block_matrix(free if dense else free[:1]),
        end_jacobian=zeros((dense, nu)),
        end_response=zeros((dense, nu)),
        row_factors=zeros((dense, dense)),
        row_order=zeros(m, np.int64),
        row_length=zeros(m),
        row_rank=zeros(len(tangent.blocks.velocity), np.int64),
        row_scratch=zeros(m),
        row_residual=zeros(m),
        reaction=zeros(m),
        tree_matrix=block_matrix(free),
        rhs_real=zeros((1, n)),
        rhs_complex=zeros((1, n), np.complex128),
        rhs_end=zeros((1, nu)),
        error_x=zeros(nu),
        error_v=zeros(nu),
        scale_x=scales[0],
        scale_v=scales[1],
        own_rate=zeros(nv),
        phi=phi[0],
        phi_rate=phi[1],
        phi_rate2=phi[2],
        quaternions=np.ascontiguousarray(coordinate_slots(plan)[1][:, 1]),
        lapack_complex=lapack_complex,
        pivot_real=zeros(max(1, n), np.int32),
        pivot_complex=zeros(max(1, n), np.int32),
        pivot_end=zeros(max(1, n), np.int32),
        sizes=zeros(N_SIZES, np.int32),
        kernels=kernels,
        bounds=bounds,
        sorted_real=zeros((1, n)),
        sorted_complex=zeros((1, n), np.complex128),
        recursion=recursion,
        complex_recursion=new_complex_recursion(recursion),
        parts=new_recursion_parts(recursion),
        sparse=sparse,
        shifted=new_shifted_matrix(plan, found),
        tangent=tangent,
        data=with_push(new_data_loads(plan, nv), plan, work, nx),
        memory=_new_memory(nv, m),
    )
