"""One step of the energy-momentum method: its equations, their linearisation, Newton's iteration.

The unknowns are the velocities ``u`` of the step.  They give the positions in its middle and at its
end; the momenta at its end follow from p_n + p_end = 2 M(x_mid) u, and the equations ask that their
change be what the discrete gradient of the energy says.  The derivation stands in
docs/integrators.md, "Energy-momentum".
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmbd.integrate import state as st
from flexmbd.multibody.kernels import layout as at
from flexmbd.multibody.kernels.articulated import articulate, solve_mass
from flexmbd.multibody.kernels.canonical import canonical, momenta, potential_energy
from flexmbd.multibody.kernels.compiling import kernel, part_of_kernel
from flexmbd.multibody.kernels.joints import has_one_coordinate
from flexmbd.multibody.kernels.layout import Plan
from flexmbd.multibody.kernels.native import factor, solve
from flexmbd.multibody.kernels.recursion import forward
from flexmbd.multibody.kernels.so3 import (
    add3,
    cross3,
    dot3,
    load3,
    quaternion_matrix,
    quaternion_product,
    rotate,
    rotate_back,
    scale3,
    store3,
    sub3,
)

FloatArray = NDArray[np.float64]

# The method's entries of State.numbers: the step the factors belong to; the energy (J) that belongs to TIME; what
# loads and dampers did to it in the step.
STEP_FACTORED, ENERGY, WORK = range(st.METHOD, st.METHOD + 3)
# Its entries of State.counts: steps without growth left; whether the energy is kept; whether anything but what
# stores it acts.
HOLD, KEEPS_ENERGY, SPLITS = range(st.METHOD_COUNT, st.METHOD_COUNT + 3)
# Rows of State.memory: momenta; accelerations at the step before.
MOMENTUM, BEFORE, N_MEMORY = range(3)

_MAX_ITERATIONS = 25
_MANY = 6  # more iterations than this renew the factors at the next step
_EPSILON = 2.0**-52
_ROUND_OFF = 1e-10  # corrections above this are none of round-off
_DEAD = 32.0 * _EPSILON  # of all energy: what sums of it do not resolve
_STILL = 1e-8  # a motion below this share of a step's at the machine's rate counts as none


class Scratch(NamedTuple):
    """Work arrays of a step.

    u, half, none: (nv,) velocity of the step, half of it, zeros.  move: (nv,) increments over the step; of
    rotations twice the tangent of half the angle, along the axis.  x_mid, x_end: (nx,).
    p_mid, p_end: (nv,) momenta M(x_mid) u, and at the end.  v_end, right: (1, nv).  a_end: (nv,).
    force, stored: (nv,) -dT/dx + dV/dx - loads in the middle, and without loads and dampers.
    weight: (2 bodies + nv, 9) where the energy's correction may act: a matrix for the linear and one for the
    turning part of each joint, and a number for each coordinate (first column, from row 2 bodies).
    weighed: (nv,) that times the increments.
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
    right: FloatArray
    force: FloatArray
    stored: FloatArray
    balance: FloatArray
    wrench: FloatArray
    part: FloatArray
    weight: FloatArray
    weighed: FloatArray
    equation: FloatArray
    probe: FloatArray
    matrix: FloatArray
    correction: FloatArray
    mixed: FloatArray
    scale_x: FloatArray
    scale_v: FloatArray
    error_x: FloatArray
    error_v: FloatArray
    driven: FloatArray
    driving: FloatArray
    extra: FloatArray
    pivot: NDArray[np.int32]
    sizes: NDArray[np.int32]


def new_scratch(plan: Plan, nx: int, nv: int, weight: FloatArray) -> Scratch:
    """Allocate the work arrays of a step for ``plan``."""
    zeros = np.zeros
    free, bodies = len(plan.free), len(plan.tree)
    return Scratch(
        u=zeros(nv),
        half=zeros(nv),
        none=zeros(nv),
        move=zeros(nv),
        x_mid=zeros(nx),
        x_end=zeros(nx),
        p_mid=zeros(nv),
        p_end=zeros(nv),
        v_end=zeros((1, nv)),
        a_end=zeros(nv),
        right=zeros((1, nv)),
        force=zeros(nv),
        stored=zeros(nv),
        balance=zeros(nv),
        wrench=zeros((bodies, 6)),
        part=zeros(6),
        weight=weight,
        weighed=zeros(nv),
        equation=zeros(free),
        probe=zeros(free),
        matrix=zeros((free, free)),
        correction=zeros((1, free)),
        mixed=zeros((2, free)),
        scale_x=zeros(nv),
        scale_v=zeros(nv),
        error_x=zeros(nv),
        error_v=zeros(nv),
        driven=zeros((len(plan.driven), 3)),
        driving=zeros(nv),
        extra=zeros(0),
        pivot=zeros(max(1, free), np.int32),
        sizes=zeros(4, np.int32),
    )


@kernel
def _load4(x, o):
    return (x[o], x[o + 1], x[o + 2], x[o + 3])


@kernel
def _half_turn(turn):
    """Half of the rotation of Cayley's vector ``turn`` as a unit quaternion, and kappa = 1 / cos(half the angle)."""
    kappa = math.sqrt(1.0 + 0.25 * dot3(turn, turn))
    s = 1.0 / math.sqrt(2.0 * kappa * (kappa + 1.0))
    return (s * (kappa + 1.0), 0.5 * s * turn[0], 0.5 * s * turn[1], 0.5 * s * turn[2]), kappa


@kernel
def _mean_turn(turn, kappa, v):
    """(E + E^T) v / 2, E being half of the step's rotation."""
    return add3(scale3(1.0 / kappa, v), scale3(dot3(turn, v) / (4.0 * kappa * (kappa + 1.0)), turn))


@kernel
def _turn_joint(x, o, turn, x_mid, x_end):
    half, _ = _half_turn(turn)
    middle = quaternion_product(_load4(x, o), half)
    end = quaternion_product(middle, half)
    for k in range(4):
        x_mid[o + k] = middle[k]
        x_end[o + k] = end[k]


@kernel
def _place(plan, x, s, h):
    """Positions in the middle and at the end of a step of h with velocities ``s.u``, and its increments."""
    for k in range(s.u.shape[0]):
        s.half[k] = 0.5 * s.u[k]
        s.move[k] = h * s.u[k]
    for i in range(plan.tree.shape[0]):
        row = plan.tree[i]
        kind = row[at.JOINT]
        ox = row[at.JOINT_X]
        ov = row[at.JOINT_V]
        if has_one_coordinate(kind):
            s.x_mid[ox] = x[ox] + 0.5 * s.move[ov]
            s.x_end[ox] = x[ox] + s.move[ov]
        elif kind == at.SPHERICAL:
            _turn_joint(x, ox, load3(s.move, ov), s.x_mid, s.x_end)
        elif kind == at.FREE:
            turn = load3(s.move, ov + 3)
            _turn_joint(x, ox + 3, turn, s.x_mid, s.x_end)
            _, kappa = _half_turn(turn)
            # the rotation in the middle keeps the axis that it turns about
            turn_F = rotate(quaternion_matrix(_load4(s.x_mid, ox + 3)), turn)
            shift = _mean_turn(turn_F, kappa, load3(s.move, ov))
            store3(s.move, ov, shift)
            for k in range(3):
                s.x_mid[ox + k] = x[ox + k] + 0.5 * shift[k]
                s.x_end[ox + k] = x[ox + k] + shift[k]
        if row[at.FLEX] >= 0:
            qx = row[at.MODAL_X]
            qv = row[at.MODAL_V]
            for k in range(plan.flex[row[at.FLEX], at.N_MODES]):
                s.x_mid[qx + k] = x[qx + k] + 0.5 * s.move[qv + k]
                s.x_end[qx + k] = x[qx + k] + s.move[qv + k]
    for i in range(plan.driven.shape[0]):
        s.x_end[plan.driven[i, at.DRIVEN_X]] = s.driven[i, 0]


@kernel
def _orbital(u, o, R, turn, kappa, p):
    """Rate of the step's shift times momentum p (of the parent's axes): what leaves the spin; in R's axes."""
    return cross3(_mean_turn(turn, kappa, rotate_back(R, load3(u, o))), rotate_back(R, p))


@kernel
def _balance_turn(before, middle, half, torque, h):
    """Spin at the end, and (change of the spatial spin) / h + torque in the axes of the middle."""
    end = sub3(scale3(2.0, middle), before)
    gained = sub3(rotate(half, end), rotate_back(half, before))
    return end, add3(scale3(1.0 / h, gained), torque)


@kernel
def balance_momenta(plan, p, s, h):
    """Write ``s.p_end`` = 2 M u - p and ``s.balance`` = (p_end - p) / h + force, turned where joints turn.

    Returns the change of kinetic energy by momenta, u . (p_end - p).
    """
    work = 0.0
    for k in range(p.shape[0]):
        s.p_end[k] = 2.0 * s.p_mid[k] - p[k]
        s.balance[k] = (s.p_end[k] - p[k]) / h + s.force[k]
        work += s.u[k] * (s.p_end[k] - p[k])
    for i in range(plan.tree.shape[0]):
        row = plan.tree[i]
        kind = row[at.JOINT]
        if kind != at.SPHERICAL and kind != at.FREE:
            continue
        o = row[at.JOINT_V] + (3 if kind == at.FREE else 0)
        turn = load3(s.move, o)
        half, kappa = _half_turn(turn)
        E = quaternion_matrix(half)
        torque = load3(s.force, o)
        if kind == at.FREE:
            shift = o - 3
            R = quaternion_matrix(_load4(s.x_mid, row[at.JOINT_X] + 3))
            start = rotate_back(R, load3(p, shift))
            own = rotate(E, start)
            own_end = sub3(scale3(2.0, rotate_back(R, load3(s.p_mid, shift))), own)
            end = rotate(E, own_end)
            u = load3(s.u, shift)
            work += dot3(rotate_back(R, u), sub3(own_end, own))
            for k in range(3):
                work -= u[k] * (s.p_end[shift + k] - p[shift + k])
            store3(s.p_end, shift, rotate(R, end))
            store3(s.balance, shift, add3(scale3(1.0 / h, rotate(R, sub3(end, start))), load3(s.force, shift)))
            mean = scale3(0.5, add3(start, end))
            torque = add3(torque, cross3(_mean_turn(turn, kappa, rotate_back(R, u)), mean))
        end, rest = _balance_turn(load3(p, o), load3(s.p_mid, o), E, torque, h)
        store3(s.p_end, o, end)
        store3(s.balance, o, rest)
    return work


@kernel
def settle_momenta(plan, p, s, h):
    """Write ``s.p_end`` from the momenta's balance itself, so that what no force acts on stays to round-off."""
    for k in range(p.shape[0]):
        s.p_end[k] = p[k] - h * s.force[k]
    for i in range(plan.tree.shape[0]):
        row = plan.tree[i]
        kind = row[at.JOINT]
        if kind != at.SPHERICAL and kind != at.FREE:
            continue
        o = row[at.JOINT_V] + (3 if kind == at.FREE else 0)
        turn = load3(s.move, o)
        half, kappa = _half_turn(turn)
        E = quaternion_matrix(half)
        torque = load3(s.force, o)
        if kind == at.FREE:
            shift = o - 3
            R = quaternion_matrix(_load4(s.x_mid, row[at.JOINT_X] + 3))
            mean = scale3(0.5, add3(load3(p, shift), load3(s.p_end, shift)))
            torque = add3(torque, _orbital(s.u, shift, R, turn, kappa, mean))
        spin = sub3(rotate_back(E, load3(p, o)), scale3(h, torque))
        store3(s.p_end, o, rotate_back(E, spin))


@kernel
def velocities(plan, work, aw, s, x, p):
    """Write ``s.v_end``: the prescribed rates, and others so that M(x) v = p in their rows."""
    articulate(plan, work, aw, x, s.extra)
    if plan.driven.shape[0] == 0:
        for k in range(p.shape[0]):
            s.right[0, k] = p[k]
        solve_mass(plan, work, aw, s.right, s.v_end)
        return
    for k in range(p.shape[0]):
        s.driving[k] = 0.0
    for i in range(plan.driven.shape[0]):
        s.driving[plan.driven[i, at.DRIVEN_V]] = s.driven[i, 1]
    momenta(plan, work, x, s.driving, s.none, s.right[0])
    for k in range(p.shape[0]):
        s.right[0, k] = p[k] - s.right[0, k]
    solve_mass(plan, work, aw, s.right, s.v_end)
    for i in range(plan.driven.shape[0]):
        s.v_end[0, plan.driven[i, at.DRIVEN_V]] = s.driven[i, 1]


@kernel
def kinetic_energy(p, v):
    """p . v / 2."""
    t = 0.0
    for k in range(p.shape[0]):
        t += 0.5 * p[k] * v[k]
    return t


@kernel
def _weighed(weight, i, R, v):
    """The weight matrix i, given in the axes that R turns to, times v of R's own axes."""
    w = rotate(R, v)
    m = weight[i]
    return rotate_back(
        R,
        (
            m[0] * w[0] + m[1] * w[1] + m[2] * w[2],
            m[3] * w[0] + m[4] * w[1] + m[5] * w[2],
            m[6] * w[0] + m[7] * w[1] + m[8] * w[2],
        ),
    )


@kernel
def _weigh(plan, s, out):
    """out = W move: the direction of the energy's correction."""
    bodies = plan.tree.shape[0]
    for k in range(out.shape[0]):
        out[k] = s.weight[2 * bodies + k, 0] * s.move[k]
    for i in range(bodies):
        row = plan.tree[i]
        kind = row[at.JOINT]
        o = row[at.JOINT_V]
        if kind == at.FREE:
            store3(out, o, _weighed(s.weight, 2 * i, (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0), load3(s.move, o)))
            R = quaternion_matrix(_load4(s.x_mid, row[at.JOINT_X] + 3))
            store3(out, o + 3, _weighed(s.weight, 2 * i + 1, R, load3(s.move, o + 3)))
        elif kind == at.SPHERICAL:
            R = quaternion_matrix(_load4(s.x_mid, row[at.JOINT_X]))
            store3(out, o, _weighed(s.weight, 2 * i + 1, R, load3(s.move, o)))


@part_of_kernel
def _missing_energy(plan, stored_plan, work, aw, number, s, gained):
    """What the gradient in the middle lacks of the energy's change (J); 0 where sums do not resolve it."""
    velocities(plan, work, aw, s, s.x_end, s.p_end)
    forward(plan, work, s.x_end, s.none, s.none)
    kinetic = kinetic_energy(s.p_end, s.v_end[0])
    potential = potential_energy(stored_plan, work, s.x_end)
    missing = kinetic + potential - number[ENERGY] - gained
    for k in range(s.move.shape[0]):
        missing -= s.stored[k] * s.move[k]
    dead = _DEAD * (abs(kinetic) + abs(potential) + abs(number[ENERGY]))
    return missing - min(max(missing, -dead), dead)


@kernel
def _middle(plan, stored_plan, work, s, x, p, h, split):
    """Forces in the middle of the step and the momenta's balance; returns what ``balance_momenta`` does."""
    _place(plan, x, s, h)
    canonical(plan, work, s.x_mid, s.u, s.half, s.none, s.wrench, s.part, s.p_mid, s.force)
    if split:
        canonical(stored_plan, work, s.x_mid, s.u, s.half, s.none, s.wrench, s.part, s.p_mid, s.stored)
    else:
        for k in range(s.force.shape[0]):
            s.stored[k] = s.force[k]
    return balance_momenta(plan, p, s, h)


@part_of_kernel
def evaluate(plan, stored_plan, work, aw, state, s, h, still):
    """Evaluate the step's equations at ``s.u``; returns the work (J) of all that does not store energy.

    The energy's correction goes along the step's motion, but for directions that energy does not depend on.
    ``still`` is a motion, in the machine's sizes, that counts as none.
    """
    count = state.counts
    p = state.memory[MOMENTUM]
    gained = _middle(plan, stored_plan, work, s, state.x, p, h, count[SPLITS] == 1)
    count[st.EVALUATIONS] += 1
    done = 0.0
    if count[KEEPS_ENERGY] == 1:
        for k in range(s.move.shape[0]):
            done += (s.stored[k] - s.force[k]) * s.move[k]
        missing = _missing_energy(plan, stored_plan, work, aw, state.numbers, s, gained)
        _weigh(plan, s, s.weighed)
        size = still * still
        for k in range(s.move.shape[0]):
            size += s.weighed[k] * s.move[k]
        for k in range(s.move.shape[0]):
            correction = missing / size * s.weighed[k]
            s.force[k] += correction
            s.balance[k] += correction
    for j in range(plan.free.shape[0]):
        s.equation[j] = s.balance[plan.free[j]]
    return done


@part_of_kernel
def _linearise(plan, stored_plan, work, state, groups, s, h):
    """Build and factor the iteration matrix at ``s.u`` by differences, without the energy's correction."""
    number = state.numbers
    free = plan.free
    p = state.memory[MOMENTUM]
    state.counts[st.FACTORISATIONS] += 1
    number[STEP_FACTORED] = h
    for column in range(-1, free.shape[0]):
        delta = 1.0
        if column >= 0:
            k = free[column]
            kept = s.u[k]
            delta = 1e-5 * groups.floor[groups.of[k]] / h
            s.u[k] = kept + delta
        _middle(plan, stored_plan, work, s, state.x, p, h, False)
        for i in range(free.shape[0]):
            if column < 0:
                s.probe[i] = s.balance[free[i]]
            else:
                s.matrix[i, column] = (s.balance[free[i]] - s.probe[i]) / delta
        if column >= 0:
            s.u[k] = kept
    for i in range(free.shape[0]):
        for j in range(free.shape[0]):
            if not np.isfinite(s.matrix[i, j]):
                return False
    return factor(plan.lapack, s.matrix, s.pivot, s.sizes) == 0


@part_of_kernel
def _improve(plan, s, iteration):
    """Move ``s.u`` by the correction, mixed with the one before so that their difference tells least.

    Anderson's acceleration of depth one: the iteration matrix lacks the energy's correction, which is of
    rank one but for small terms.
    """
    share = 0.0
    if iteration > 0:
        along = 0.0
        size = 0.0
        for j in range(s.equation.shape[0]):
            weight = 1.0 / (s.scale_v[plan.free[j]] * s.scale_v[plan.free[j]])
            change = s.correction[0, j] - s.mixed[1, j]
            along += weight * s.correction[0, j] * change
            size += weight * change * change
        if size > 0.0 and abs(along) < size:
            share = along / size
    for j in range(s.equation.shape[0]):
        k = plan.free[j]
        u = s.u[k]
        d = s.correction[0, j]
        s.u[k] = u - d - share * ((u - s.mixed[0, j]) - (d - s.mixed[1, j]))
        s.mixed[0, j] = u
        s.mixed[1, j] = d


@part_of_kernel
def _newton(plan, stored_plan, work, aw, state, s, h, still, tolerance):
    """Iterate with the factors at hand until ``s`` holds a solution.

    Returns 1 if converged, 0 if too slow, -1 if not finite.
    """
    number = state.numbers
    least = np.inf
    stuck = 0
    for iteration in range(_MAX_ITERATIONS):
        number[WORK] = evaluate(plan, stored_plan, work, aw, state, s, h, still)
        state.counts[st.ITERATIONS] += 1
        for i in range(s.equation.shape[0]):
            s.correction[0, i] = s.equation[i]
        solve(plan.lapack, s.matrix, s.pivot, s.sizes, s.correction)
        size = 0.0
        for j in range(s.equation.shape[0]):
            k = plan.free[j]
            move = abs(s.correction[0, j])
            part = max(move * h / s.scale_x[k], move / s.scale_v[k])
            if not part <= size:
                size = part
                state.counts[st.WORST] = k
        if not np.isfinite(size):
            return -1
        stuck = stuck + 1 if size > 0.5 * least else 0
        least = min(least, size)
        # round-off is reached where small corrections shrink no more
        if size <= tolerance or (stuck > 2 and size <= _ROUND_OFF):
            if iteration > _MANY:
                number[STEP_FACTORED] = 0.0
            return 1
        if stuck > 3:
            return 0
        _improve(plan, s, iteration)
    return 0


@part_of_kernel
def _guess(plan, state, s, h, share):
    """First guess of the step's velocity, a share of the step on; and the prescribed ones."""
    for k in range(s.u.shape[0]):
        s.u[k] = state.v[k] + share * h * state.a[k]
    for i in range(plan.driven.shape[0]):
        row = plan.driven[i]
        s.u[row[at.DRIVEN_V]] = (s.driven[i, 0] - state.x[row[at.DRIVEN_X]]) / h


@kernel
def solve_step(plan, stored_plan, work, aw, state, groups, s, h, rate, tolerance):
    """Newton with the old factors where they still serve, with new ones otherwise.

    ``work.time`` must hold the middle of the step, ``s.driven`` its end.  Returns whether it converged; if so
    ``s`` holds the step's end, momenta settled and velocities in ``s.v_end``.
    """
    still = _STILL * min(1.0, h * rate)
    for attempt in range(5):
        if attempt == 0 and state.numbers[STEP_FACTORED] != h:
            continue
        # attempts 2 and 4 linearise where the iterations led; 3 for vibrations that the step does not resolve
        if attempt != 2 and attempt != 4:
            _guess(plan, state, s, h, 0.5 if attempt < 2 else 0.0)
        finite = True
        for k in range(s.u.shape[0]):
            finite = finite and np.isfinite(s.u[k])
        if not finite or (attempt > 0 and not _linearise(plan, stored_plan, work, state, groups, s, h)):
            continue
        if _newton(plan, stored_plan, work, aw, state, s, h, still, tolerance) == 1:
            settle_momenta(plan, state.memory[MOMENTUM], s, h)
            velocities(plan, work, aw, s, s.x_end, s.p_end)
            return True
    state.numbers[STEP_FACTORED] = 0.0
    return False
