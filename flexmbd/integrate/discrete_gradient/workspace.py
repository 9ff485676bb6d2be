"""Data of an energy-momentum step: its entries of the state, its work arrays, the kernels that it calls."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.integrate.data_loads import DataLoads, new_data_loads, with_push
from flexmbd.integrate.explicit import loop_dynamics
from flexmbd.integrate.matrix_choice import momentum_matrix
from flexmbd.multibody.kernels.base.array_struct import ArrayStruct
from flexmbd.multibody.kernels.base.arrays import Plan, Work
from flexmbd.multibody.kernels.base.native import N_SIZES
from flexmbd.multibody.kernels.base.separate import address_of
from flexmbd.multibody.kernels.inverse_dynamics.canonical import canonical, momenta, write_potential
from flexmbd.multibody.kernels.inverse_dynamics.closure import constraints
from flexmbd.multibody.kernels.inverse_dynamics.residual import residual
from flexmbd.multibody.kernels.reading.tree import tree_joints
from flexmbd.multibody.kernels.sparse.block_lu import BlockMatrix, new_block_matrix
from flexmbd.multibody.kernels.tangent.diagonal_blocks import block_matrix, unknown_bounds
from flexmbd.multibody.kernels.tangent.residual_tangent import tangent_after_residual
from flexmbd.multibody.kernels.tangent.sparse_assembly import assemble_sparse
from flexmbd.multibody.kernels.tangent.sparse_matrix import SparseMatrix
from flexmbd.multibody.kernels.tangent.tangent_layout import TangentWork

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

REMEMBERED = 3  # steps whose velocities and multipliers are remembered

# Entries of EnergyMomentumWorkspace.kernels: addresses of kernels compiled by themselves; the last are the step's own
# (`bind`), but for the tangent of a sparse matrix, 0 where that is dense.
CANONICAL, MOMENTA, RESIDUAL, TANGENT, CONSTRAINTS, POTENTIAL = range(6)
PLACE, FACTOR_MASS, CLOSE_VELOCITIES, EVALUATE, LINEARISE, SPARSE_TANGENT, N_KERNEL = range(6, 13)
# Entries of EnergyMomentumWorkspace.energy (J): the potential at the end; the round-off of sums of energy; the error of
# the kinetic energy at the end, where velocities are improved in passes; the equations' residuals as energy, over all
# energy; the work of loads and dampers at the trial; unless zero the factorisation at hand failed; twice the kinetic
# energy of the motion that keeping the energy corrects.
POTENTIAL_END, UNRESOLVED, KINETIC_ERROR, DEFECT, TRIAL_WORK, SINGULAR, CAPACITY, N_ENERGY = range(8)

ANDERSON_DEPTH = 6  # iterates that Anderson's acceleration combines


@dataclass(frozen=True, eq=False)
class EnergyMomentumMemory(ArrayStruct):
    """What the method remembers from step to step; numbers stand alone in arrays (1,).

    loops: of the constraint rows.  step_factored: the step (s) the factors belong to.  energy: (J) that should be there
    at TIME.  surplus: (J) what is there beyond it, left by rounding and by Newton's iteration.  load_work: (J) of loads
    and dampers in the step.
    keeps_energy: whether the energy is kept.  nonconservative: whether loads or dampers act.  known_steps: how many
    equal steps it remembers.  predictor: which would have been best for the last of them.
    momentum: (nv,).  before: (nv,) accelerations at the step before.  own_rate: (nv,) each coordinate's own rate (1/s).
    speed: (REMEMBERED, nv), reaction: (REMEMBERED, m) velocities and multipliers of the last steps, the latest first.
    """

    loops: loop_dynamics.LoopMemory
    step_factored: FloatArray
    energy: FloatArray
    surplus: FloatArray
    load_work: FloatArray
    keeps_energy: IntArray
    nonconservative: IntArray
    known_steps: IntArray
    predictor: IntArray
    momentum: FloatArray
    before: FloatArray
    own_rate: FloatArray
    speed: FloatArray
    reaction: FloatArray


def _new_memory(plan: Plan, nv: int) -> EnergyMomentumMemory:
    """Zeros for nv velocities."""
    zeros = np.zeros
    return EnergyMomentumMemory(
        loops=loop_dynamics.new_loop_memory(plan),
        step_factored=zeros(1),
        energy=zeros(1),
        surplus=zeros(1),
        load_work=zeros(1),
        keeps_energy=zeros(1, np.int64),
        nonconservative=zeros(1, np.int64),
        known_steps=zeros(1, np.int64),
        predictor=zeros(1, np.int64),
        momentum=zeros(nv),
        before=zeros(nv),
        own_rate=zeros(nv),
        speed=zeros((REMEMBERED, nv)),
        reaction=zeros((REMEMBERED, len(plan.rows))),
    )


@dataclass(frozen=True, eq=False)
class EnergyMomentumWorkspace(ArrayStruct):
    """Work arrays of a step.

    u, half_velocity, zeros: (nv,) velocity of the step, half of it, zeros.  increment: (nv,) over the step; of
    rotations twice the tangent of half the angle, along the axis.  x_mid, x_end: (nx,).
    p_mid, p_end: (nv,) momenta M(x_mid) u, and at the end.  v_end, a_end: (nv,).  scratch_v: (nv,).
    gradient, stored_gradient: (nv,) -dT/dx + dV/dx - loads in the middle, and without loads and dampers.
    balance: (nv,) of momenta.  wrench, scratch6: (bodies, 6), (6,) of ``canonical``.
    projector: (2 bodies + nv, 9) projects out motions that energy does not depend on: a matrix for the linear and one
    for the rotational part of each joint, and 0 or 1 for each coordinate (first column, from row 2 bodies).
    no_symmetries: (1,) whether it is the identity, and no joint is free.
    correction_direction, corrected_velocity: (nv,) of the energy's correction, and the velocity that it belongs to.
    nu, zero_multipliers: (m,) multipliers of the step; zeros.
    phi, phi_rate, phi_rate2: (m,) residuals of the constraint rows and their derivatives.
    row_end: (m, 2) function of time of a row and its rate, at the end.  nu_end: (m,) multipliers there.
    row_size: (m,) full size of each row's residual, m or rad.
    unknown, equation: (free + m,) u and nu h / 2; the step's equations times h / 2, and residuals over h.
    matrix: factors of the iteration matrix, block by block in rows between ``bounds`` (c + 1,);
    sorted_rhs: (1, free + m) a right-hand side sorted by them.
    round_off_floor: (1,) a correction by round-off; round_off: (free + m,) the terms that are rounded.
    full_matrix: (nv, nv) tangent, or the mass matrix.  mass: factors of M, likewise.  mass_rhs: (1, free) a
    right-hand side for it.  response: (m, free) C M^-1.
    previous: (2, free + m) unknowns and correction of the iteration before.
    anderson_changes, anderson_moves: (ANDERSON_DEPTH, free + m) orthonormal changes of the corrections, and the moves
    of the unknowns that belong to them.
    sparse: the iteration matrix where that is cheaper, with ``end``, factors of M at the end, and ``end_mass``, M; what
    is dense then has no entries.
    modal_scratch: (2, nv).  own_rate: (nv,) each coordinate's own rate (1/s) in the step at hand.
    kernels: addresses.
    """

    u: FloatArray
    half_velocity: FloatArray
    zeros: FloatArray
    increment: FloatArray
    x_mid: FloatArray
    x_end: FloatArray
    p_mid: FloatArray
    p_end: FloatArray
    v_end: FloatArray
    a_end: FloatArray
    scratch_v: FloatArray
    gradient: FloatArray
    stored_gradient: FloatArray
    balance: FloatArray
    wrench: FloatArray
    scratch6: FloatArray
    energy: FloatArray
    projector: FloatArray
    no_symmetries: IntArray
    correction_direction: FloatArray
    corrected_velocity: FloatArray
    nu: FloatArray
    zero_multipliers: FloatArray
    phi: FloatArray
    phi_rate: FloatArray
    phi_rate2: FloatArray
    row_end: FloatArray
    row_size: FloatArray
    nu_end: FloatArray
    unknown: FloatArray
    equation: FloatArray
    matrix: FloatArray
    bounds: IntArray
    sorted_rhs: FloatArray
    round_off_floor: FloatArray
    round_off: FloatArray
    full_matrix: FloatArray
    mass: FloatArray
    mass_rhs: FloatArray
    response: FloatArray
    correction: FloatArray
    previous: FloatArray
    anderson_changes: FloatArray
    anderson_moves: FloatArray
    modal_scratch: FloatArray
    scale_x: FloatArray
    scale_v: FloatArray
    error_x: FloatArray
    error_v: FloatArray
    own_rate: FloatArray
    driven: FloatArray
    pivot: NDArray[np.int32]
    mass_pivot: NDArray[np.int32]
    sizes: NDArray[np.int32]
    kernels: IntArray
    sparse: SparseMatrix
    end: BlockMatrix
    end_mass: FloatArray
    tangent: TangentWork
    data: DataLoads
    memory: EnergyMomentumMemory


def new_workspace(
    plan: Plan, work: Work, nx: int, nv: int, projector: FloatArray, row_size: FloatArray
) -> EnergyMomentumWorkspace:
    """Allocate the work arrays of a step for ``plan``."""
    zeros = np.zeros
    free, bodies, m = len(plan.free), len(plan.tree), len(plan.rows)
    n = free + m
    scales = zeros((2, nv))
    choice = momentum_matrix(plan)
    tangent, sparse = choice.new_tangent(nv, scales), choice.new_sparse()
    is_sparse = choice.sparse is not None
    bounds = unknown_bounds(tangent.blocks, 1)
    diagonal = tangent.blocks.free
    if is_sparse:
        bounds = diagonal = bounds[:1]
    x, v, rows, full = zeros(nx), zeros(nv), zeros(m), zeros((0, 0) if is_sparse else (nv, nv))
    asked, values = (plan, work, tangent, x, v, v), sparse.matrix.values
    wrench, part, energy = zeros((bodies, 6)), zeros(6), zeros(N_ENERGY)
    whole = bool((projector[2 * bodies :, 0] == 1.0).all())
    turning = np.array([joint.spin is not None for joint in tree_joints(plan)], bool)
    return EnergyMomentumWorkspace(
        u=zeros(nv),
        half_velocity=zeros(nv),
        zeros=zeros(nv),
        increment=zeros(nv),
        x_mid=zeros(nx),
        x_end=zeros(nx),
        p_mid=zeros(nv),
        p_end=zeros(nv),
        v_end=zeros(nv),
        a_end=zeros(nv),
        scratch_v=zeros(nv),
        gradient=zeros(nv),
        stored_gradient=zeros(nv),
        balance=zeros(nv),
        wrench=wrench,
        scratch6=part,
        energy=energy,
        projector=projector,
        no_symmetries=np.array([whole and not turning.any()], np.int64),
        correction_direction=zeros(nv),
        corrected_velocity=zeros(nv),
        nu=zeros(m),
        zero_multipliers=zeros(m),
        phi=zeros(m),
        phi_rate=zeros(m),
        phi_rate2=zeros(m),
        row_end=zeros((m, 2)),
        row_size=row_size,
        nu_end=zeros(m),
        unknown=zeros(n),
        equation=zeros(n),
        matrix=block_matrix(bounds),
        bounds=bounds,
        sorted_rhs=zeros((1, n)),
        round_off_floor=zeros(1),
        round_off=zeros(n),
        full_matrix=full,
        mass=block_matrix(diagonal),
        mass_rhs=zeros((1, free)),
        response=zeros((m, free)),
        correction=zeros((1, n)),
        previous=zeros((2, n)),
        anderson_changes=zeros((ANDERSON_DEPTH, n)),
        anderson_moves=zeros((ANDERSON_DEPTH, n)),
        modal_scratch=zeros((2, nv)),
        scale_x=scales[0],
        scale_v=scales[1],
        error_x=zeros(nv),
        error_v=zeros(nv),
        own_rate=zeros(nv),
        driven=zeros((len(plan.driven), 3)),
        pivot=zeros(max(1, n), np.int32),
        mass_pivot=zeros(max(1, free), np.int32),
        sizes=zeros(N_SIZES, np.int32),
        kernels=np.array(
            [
                address_of(canonical, (plan, work, x, v, v, v, rows, wrench, part, v, v)),
                address_of(momenta, (plan, work, x, v, v, v)),
                address_of(residual, (plan, work, x, v, v, rows, v)),
                0 if is_sparse else address_of(tangent_after_residual, (*asked, rows, 0.0, 0.0, 0.0, full)),
                address_of(constraints, (plan, work, rows, rows, rows)) if m else 0,
                address_of(write_potential, (plan, work, x, energy)),
                *[0] * (SPARSE_TANGENT - PLACE),
                address_of(assemble_sparse, (*asked[:3], sparse.to, *asked[3:], rows, 0.0, 0.0, 0.0, values))
                if is_sparse
                else 0,
            ]
        ),
        sparse=sparse,
        end=new_block_matrix(sparse.pattern),
        end_mass=zeros(len(values)),
        tangent=tangent,
        data=with_push(new_data_loads(plan, nv, motions=False), plan, work, nx),
        memory=_new_memory(plan, nv),
    )
