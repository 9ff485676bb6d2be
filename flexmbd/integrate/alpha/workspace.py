"""Data of a step of generalized-alpha: its entries of the state, its work arrays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.integrate import state as st
from flexmbd.integrate.data_loads import DataLoads, new_data_loads, with_push
from flexmbd.multibody.kernels.base.array_struct import ArrayStruct
from flexmbd.multibody.kernels.base.arrays import Plan, Work
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.separate import address_of
from flexmbd.multibody.kernels.reading.plan_entries import holds_position, is_augmented
from flexmbd.multibody.kernels.tangent.residual_tangent import tangent_after_residual
from flexmbd.multibody.kernels.tangent.tangent_layout import TangentWork, new_tangent_work
from flexmbd.multibody.kernels.tangent.tree_factor import ancestors, is_cheaper_than_dense

FloatArray = NDArray[np.float64]

# The method's entries of State.numbers: its coefficients; the step the factors belong to; the step
# that the auxiliary acceleration belongs to; the step before the last; how much a Newton iteration
# leaves of the error with the factors at hand.
ALPHA_M, ALPHA_F, BETA, GAMMA = st.METHOD, st.METHOD + 1, st.METHOD + 2, st.METHOD + 3
STEP_FACTORED, STEP_AUXILIARY, STEP_EARLIER, CONTRACTION = range(st.METHOD + 4, st.METHOD + 8)
# Its entries of State.counts: how many accelerations it remembers; whether it filters its error; steps left that are
# factored anew because old factors failed, and how many next time; the index of the loops' equations, 2 or 3.
KNOWN_STEPS, FILTERS, RENEWALS, NEXT_RENEWALS, INDEX = range(st.METHOD_COUNT, st.METHOD_COUNT + 5)
# Rows of State.memory: the method's acceleration; the true one one, two and three steps ago; each
# coordinate's own rate (1/s); the multipliers one, two and three steps ago; the
# largest lengths of the rows.
AUXILIARY, BEFORE, EARLIER, EARLIEST, OWN_RATE, NU_BEFORE, NU_EARLIER, NU_EARLIEST, ROW_LENGTH, N_MEMORY = range(10)


@dataclass(frozen=True, eq=False)
class AlphaWorkspace(ArrayStruct):
    """Work arrays of a step: trial states, the iteration matrix and its factors.

    x, v, a, auxiliary, multipliers: of the step's end.  displacement: (nv,) tangent vector from the step's start.
    known_reaction, row_force: (m,) of augmented rows, reaction of the passes before and what their gap adds (N or N m).
    residual: (nv,).  probe_acceleration: (nv,).  own_rate: (nv,) each coordinate's own rate (1/s) in the step at hand.
    unknown, equation: (n,) with n = free + 2 m.  matrix: (n, n) factors of the iteration matrix.
    error_x, error_v: (free,), (1, free) a step's local error.  curve: (free,) half the second derivative of a.
    full_tangent: (nv, nv).  tree_matrix: (free, free) factors of the iteration matrix without rows.
    stiffness, rate_stiffness: (free, free), (m, free) derivatives by positions alone.
    interior_stiffness: (free, free) derivative by positions of the interiors' forces; (0, 0) where there are none.
    shift_direction: (m, free) B^-1 C^T, along which positions are shifted.
    row_factors: (m, m) of C B^-1 C^T, with row_order (m,) and row_rank (1,); least_pivot: (1,) of rows of unit length,
    1 without rows.
    phi, phi_rate, phi_rate2: (m,) residuals of the rows.  ancestors: see ``tree_factor.ancestors``.
    """

    x: FloatArray
    v: FloatArray
    a: FloatArray
    auxiliary: FloatArray
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
    interior_stiffness: FloatArray
    shift_direction: FloatArray
    row_factors: FloatArray
    row_order: NDArray[np.int64]
    row_rank: NDArray[np.int64]
    least_pivot: FloatArray
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
    ancestors: NDArray[np.int64]
    kernels: NDArray[np.int64]
    tangent: TangentWork
    data: DataLoads


def new_workspace(plan: Plan, work: Work, nx: int, nv: int, *, interiors: bool = False) -> AlphaWorkspace:
    """Allocate the work arrays of a step for ``plan``; ``interiors`` couple all branches of the tree."""
    m, nu = len(plan.rows), len(plan.free)
    n = nu + 2 * m
    zeros = np.zeros
    scales = zeros((2, nv))
    tangent = new_tangent_work(plan, nv, sizes=scales)
    full = zeros((nv, nv))
    state = (zeros(nx), zeros(nv), zeros(nv), zeros(m))
    return AlphaWorkspace(
        x=zeros(nx),
        v=zeros(nv),
        a=zeros(nv),
        auxiliary=zeros(nv),
        multipliers=zeros(m),
        known_reaction=zeros(m),
        row_force=zeros(m),
        displacement=zeros(nv),
        residual=zeros(nv),
        probe_acceleration=zeros(nv),
        own_rate=zeros(nv),
        unknown=zeros(n),
        equation=zeros(n),
        matrix=zeros((n, n)),
        full_tangent=full,
        tree_matrix=zeros((nu, nu)),
        stiffness=zeros((nu, nu) if m or interiors else (0, 0)),
        rate_stiffness=zeros((m, nu)),
        interior_stiffness=zeros((nu, nu) if interiors else (0, 0)),
        shift_direction=zeros((m, nu)),
        row_factors=zeros((m, m)),
        row_order=zeros(m, np.int64),
        row_rank=zeros(1, np.int64),
        least_pivot=np.ones(1),
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
        sizes=zeros(4, np.int32),
        ancestors=_ancestor_table(plan)[: 0 if interiors else None],
        kernels=np.array([address_of(tangent_after_residual, (plan, work, tangent, *state, 0.0, 0.0, 0.0, full))]),
        tangent=tangent,
        data=with_push(new_data_loads(plan, nv), plan, work, nx),
    )


def _ancestor_table(plan: Plan) -> NDArray[np.int64]:
    """Ancestors of the unknowns where factoring by the tree is cheaper; (0, ...) elsewhere."""
    lines = ancestors(plan)
    return lines if len(plan.rows) == 0 and is_cheaper_than_dense(lines) else lines[:0]


@kernel
def coefficients(number, h):
    """Position and velocity per unit of the new true acceleration."""
    share = (1.0 - number[ALPHA_F]) / (1.0 - number[ALPHA_M])
    return number[BETA] * share * h * h, number[GAMMA] * share * h


@kernel
def holds_position_alone(plan, state, i):
    """Whether row i is held at the level of positions and no other (index 3)."""
    row = plan.rows[i]
    return state.counts[INDEX] == 3 and holds_position(row) and not is_augmented(row)


@kernel
def is_unshifted(plan, state, i):
    """Whether row i shifts no positions: it holds one level alone, or is augmented."""
    row = plan.rows[i]
    return state.counts[INDEX] == 3 or is_augmented(row) or not holds_position(row)
