"""What an energy-momentum step works on: its arrays, the kernels that it calls, what it remembers."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmbd.integrate import state as st
from flexmbd.integrate.explicit import loop_dynamics
from flexmbd.multibody.kernels.base.arrays import Plan, Work
from flexmbd.multibody.kernels.base.separate import address_of
from flexmbd.multibody.kernels.inverse_dynamics.canonical import canonical, momenta, write_potential
from flexmbd.multibody.kernels.inverse_dynamics.closure import constraints
from flexmbd.multibody.kernels.inverse_dynamics.residual import residual
from flexmbd.multibody.kernels.reading.tree import tree_joints
from flexmbd.multibody.kernels.tangent.residual_tangent import tangent_after_residual
from flexmbd.multibody.kernels.tangent.tangent_layout import TangentWork, new_tangent_work

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# The method's entries of State.numbers: the step the factors belong to; the energy (J) that belongs to TIME; what
# loads and dampers did to it in the step.
STEP_FACTORED, ENERGY, WORK = range(st.METHOD, st.METHOD + 3)
# Its entries of State.counts: whether the energy is kept; whether anything but what stores it acts; how many equal
# steps it remembers; which way would have foretold the last of them best.
KEEPS_ENERGY, SPLITS, KNOWN, WAY = range(st.METHOD_COUNT, st.METHOD_COUNT + 4)
# Rows of State.memory after those of ``loop_dynamics``: momenta; accelerations at the step before; each coordinate's
# own rate (1/s); velocities and multipliers of the last steps, the latest first.
REMEMBERED = 3
MOMENTUM, BEFORE, RATE, SPEED = range(loop_dynamics.N_MEMORY, loop_dynamics.N_MEMORY + 4)
REACTION = SPEED + REMEMBERED
N_MEMORY = REACTION + REMEMBERED

# Entries of Scratch.kernels: addresses of what is compiled by itself; the last are the step's own (`bind`).
CANONICAL, MOMENTA, RESIDUAL, TANGENT, CONSTRAINTS, POTENTIAL = range(6)
PLACE, WEIGH, CLOSE, EVALUATE, LINEARISE, N_KERNEL = range(6, 12)
# Entries of Scratch.energy: the potential at the end; what sums of energy do not resolve; what the kinetic energy at
# the end may be wrong by, where velocities are improved in passes; what the equations' residuals make of the energy,
# over all energy; the work of loads and dampers; unless zero the factorisation at hand failed.
STORED, DEAD, LACK, DEFECT, DONE, SINGULAR, N_ENERGY = range(7)

DEPTH = 6  # iterates that are mixed


class Scratch(NamedTuple):
    """Work arrays of a step.

    u, half, none: (nv,) velocity of the step, half of it, zeros.  move: (nv,) increments over the step; of
    rotations twice the tangent of half the angle, along the axis.  x_mid, x_end: (nx,).
    p_mid, p_end: (nv,) momenta M(x_mid) u, and at the end.  v_end, a_end: (nv,).
    force, stored: (nv,) -dT/dx + dV/dx - loads in the middle, and without loads and dampers.
    projector: (2 bodies + nv, 9) takes out what energy does not depend on: a matrix for the linear and one for the
    turning part of each joint, and 0 or 1 for each coordinate (first column, from row 2 bodies).
    plain: (1,) whether it takes out nothing, and no joint is free.
    direction, course: (nv,) where the energy's correction acts, and the part of the motion that it belongs to.
    nu, unloaded: (m,) multipliers of the step; zeros.
    phi, rate, rate2: (m,) residuals of the constraint rows and their derivatives.
    row_end: (m, 2) what prescribes a row and its rate, at the end.  nu_end: (m,) multipliers there.
    row_size: (m,) full size of each row's residual, m or rad.
    unknown, equation: (free + m,) u and nu h / 2; the step's equations times h / 2, and residuals over h.
    matrix: (free + m, free + m) factors of the iteration matrix.  floor: (1,) what round-off makes of a correction.
    full: (nv, nv) tangent, or the mass matrix.  mass: (free, free) its factors.  right: (1, free) and
    reach: (m, free) right-hand sides for it.  response: (m, nv) C M^-1.
    mixed, gained: (DEPTH, free + m) orthonormal changes of the corrections, and what they do to the unknowns.
    bend: (2, nv) derivatives of a strain.  own: (nv,) each coordinate's own rate (1/s) as the step at hand shows it.
    kernels: addresses.
    """

    u: FloatArray
    half: FloatArray
    none: FloatArray
    move: FloatArray
    x_mid: FloatArray
    x_end: FloatArray
    p_mid: FloatArray
    p_end: FloatArray
    v_end: FloatArray
    a_end: FloatArray
    out: FloatArray
    force: FloatArray
    stored: FloatArray
    balance: FloatArray
    wrench: FloatArray
    part: FloatArray
    energy: FloatArray
    projector: FloatArray
    plain: IntArray
    direction: FloatArray
    course: FloatArray
    nu: FloatArray
    unloaded: FloatArray
    phi: FloatArray
    rate: FloatArray
    rate2: FloatArray
    row_end: FloatArray
    row_size: FloatArray
    nu_end: FloatArray
    unknown: FloatArray
    equation: FloatArray
    matrix: FloatArray
    floor: FloatArray
    full: FloatArray
    mass: FloatArray
    right: FloatArray
    reach: FloatArray
    response: FloatArray
    correction: FloatArray
    before: FloatArray
    mixed: FloatArray
    gained: FloatArray
    bend: FloatArray
    scale_x: FloatArray
    scale_v: FloatArray
    error_x: FloatArray
    error_v: FloatArray
    own: FloatArray
    driven: FloatArray
    pivot: NDArray[np.int32]
    mass_pivot: NDArray[np.int32]
    sizes: NDArray[np.int32]
    kernels: IntArray
    tangent: TangentWork


def new_scratch(
    plan: Plan, work: Work, nx: int, nv: int, projector: FloatArray, row_size: FloatArray
) -> Scratch:
    """Allocate the work arrays of a step for ``plan``."""
    zeros = np.zeros
    free, bodies, m = len(plan.free), len(plan.tree), len(plan.rows)
    n = free + m
    tangent = new_tangent_work(plan, nv)
    x, v, rows, full = zeros(nx), zeros(nv), zeros(m), zeros((nv, nv))
    wrench, part, energy = zeros((bodies, 6)), zeros(6), zeros(N_ENERGY)
    whole = bool((projector[2 * bodies :, 0] == 1.0).all())
    turning = np.array([joint.spin is not None for joint in tree_joints(plan)], bool)
    return Scratch(
        u=zeros(nv),
        half=zeros(nv),
        none=zeros(nv),
        move=zeros(nv),
        x_mid=zeros(nx),
        x_end=zeros(nx),
        p_mid=zeros(nv),
        p_end=zeros(nv),
        v_end=zeros(nv),
        a_end=zeros(nv),
        out=zeros(nv),
        force=zeros(nv),
        stored=zeros(nv),
        balance=zeros(nv),
        wrench=wrench,
        part=part,
        energy=energy,
        projector=projector,
        plain=np.array([whole and not turning.any()], np.int64),
        direction=zeros(nv),
        course=zeros(nv),
        nu=zeros(m),
        unloaded=zeros(m),
        phi=zeros(m),
        rate=zeros(m),
        rate2=zeros(m),
        row_end=zeros((m, 2)),
        row_size=row_size,
        nu_end=zeros(m),
        unknown=zeros(n),
        equation=zeros(n),
        matrix=zeros((n, n)),
        floor=zeros(1),
        full=full,
        mass=zeros((free, free)),
        right=zeros((1, free)),
        reach=zeros((m, free)),
        response=zeros((m, nv)),
        correction=zeros((1, n)),
        before=zeros((2, n)),
        mixed=zeros((DEPTH, n)),
        gained=zeros((DEPTH, n)),
        bend=zeros((2, nv)),
        scale_x=zeros(nv),
        scale_v=zeros(nv),
        error_x=zeros(nv),
        error_v=zeros(nv),
        own=zeros(nv),
        driven=zeros((len(plan.driven), 3)),
        pivot=zeros(max(1, n), np.int32),
        mass_pivot=zeros(max(1, free), np.int32),
        sizes=zeros(4, np.int32),
        kernels=np.array(
            [
                address_of(canonical, (plan, work, x, v, v, v, rows, wrench, part, v, v)),
                address_of(momenta, (plan, work, x, v, v, v)),
                address_of(residual, (plan, work, x, v, v, rows, v)),
                address_of(
                    tangent_after_residual, (plan, work, tangent, x, v, v, rows, 0.0, 0.0, 0.0, full)
                ),
                address_of(constraints, (plan, work, rows, rows, rows)),
                address_of(write_potential, (plan, work, x, energy)),
                *[0] * (N_KERNEL - PLACE),
            ]
        ),
        tangent=tangent,
    )
