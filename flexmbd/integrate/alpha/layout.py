"""What a step of generalized-alpha works with: its entries of the state, its scratch space."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmbd.integrate import state as st
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
# with the factors at hand leaves of the error.
ALPHA_M, ALPHA_F, BETA, GAMMA = st.METHOD, st.METHOD + 1, st.METHOD + 2, st.METHOD + 3
STEP_FACTORED, STEP_AUXILIARY, STEP_EARLIER, CONTRACTION = range(st.METHOD + 4, st.METHOD + 8)
# Its entries of State.counts: how many accelerations it remembers; whether it filters its error;
# steps left to be linearised anew, for old factors did not serve, and how many next time; the index of the loops'
# equations, 2 or 3.
KNOWN_BEFORE, FILTERS, RENEWALS, PATIENCE, INDEX = range(st.METHOD_COUNT, st.METHOD_COUNT + 5)
# Rows of State.memory: the method's acceleration; the true one one, two and three steps ago; each
# coordinate's own rate (1/s); the multipliers one, two and three steps ago; the
# largest lengths of the rows.
AUXILIARY, BEFORE, EARLIER, EARLIEST, RATE, NU_BEFORE, NU_EARLIER, NU_EARLIEST, LENGTH, N_MEMORY = range(10)


class Scratch(NamedTuple):
    """Work arrays of a step: trial states, the iteration matrix and its factors.

    own: (nv,) each coordinate's own rate (1/s) as the step at hand shows it.
    hold: (m, m) factors of C B^-1 C^T; firmness: (1,) their smallest pivot, of rows of unit length: 1 without rows.
    added: (free, free) what interiors add to the residual's derivative by positions; (0, 0) where there are none.
    """

    x: FloatArray
    v: FloatArray
    a: FloatArray
    auxiliary: FloatArray
    multipliers: FloatArray
    known: FloatArray
    lacking: FloatArray
    move: FloatArray
    out: FloatArray
    probe: FloatArray
    own: FloatArray
    unknown: FloatArray
    equation: FloatArray
    matrix: FloatArray
    full: FloatArray
    block: FloatArray
    stiffness: FloatArray
    rate_stiffness: FloatArray
    added: FloatArray
    direction: FloatArray
    hold: FloatArray
    hold_order: NDArray[np.int64]
    firmness: FloatArray
    correction: FloatArray
    error_x: FloatArray
    error_v: FloatArray
    scale_x: FloatArray
    scale_v: FloatArray
    phi: FloatArray
    phi_rate: FloatArray
    phi_rate2: FloatArray
    pivot: NDArray[np.int32]
    block_pivot: NDArray[np.int32]
    sizes: NDArray[np.int32]
    lines: NDArray[np.int64]
    kernels: NDArray[np.int64]
    tangent: TangentWork


def new_scratch(plan: Plan, work: Work, nx: int, nv: int, *, interiors: bool = False) -> Scratch:
    """Allocate the work arrays of a step for ``plan``; with ``interiors`` what they add couples all branches."""
    m, nu = len(plan.rows), len(plan.free)
    n = nu + 2 * m
    zeros = np.zeros
    tangent = new_tangent_work(plan, nv)
    full = zeros((nv, nv))
    state = (zeros(nx), zeros(nv), zeros(nv), zeros(m))
    return Scratch(
        x=zeros(nx),
        v=zeros(nv),
        a=zeros(nv),
        auxiliary=zeros(nv),
        multipliers=zeros(m),
        known=zeros(m),
        lacking=zeros(m),
        move=zeros(nv),
        out=zeros(nv),
        probe=zeros(nv),
        own=zeros(nv),
        unknown=zeros(n),
        equation=zeros(n),
        matrix=zeros((n, n)),
        full=full,
        block=zeros((nu, nu)),
        stiffness=zeros((nu, nu) if m or interiors else (0, 0)),
        rate_stiffness=zeros((m, nu)),
        added=zeros((nu, nu) if interiors else (0, 0)),
        direction=zeros((m, nu)),
        hold=zeros((m, m)),
        hold_order=zeros(m, np.int64),
        firmness=np.ones(1),
        correction=zeros((1, n)),
        error_x=zeros(nu),
        error_v=zeros((1, nu)),
        scale_x=zeros(nv),
        scale_v=zeros(nv),
        phi=zeros(m),
        phi_rate=zeros(m),
        phi_rate2=zeros(m),
        pivot=zeros(max(1, n), np.int32),
        block_pivot=zeros(max(1, nu), np.int32),
        sizes=zeros(4, np.int32),
        lines=_lines(plan)[: 0 if interiors else None],
        kernels=np.array([address_of(tangent_after_residual, (plan, work, tangent, *state, 0.0, 0.0, 0.0, full))]),
        tangent=tangent,
    )


def _lines(plan: Plan) -> NDArray[np.int64]:
    """Ancestors of the unknowns where the tree's own factors pay; without rows elsewhere."""
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
    """Whether row i has no position to be shifted: it holds one level alone, or yields."""
    row = plan.rows[i]
    return state.counts[INDEX] == 3 or is_augmented(row) or not holds_position(row)
