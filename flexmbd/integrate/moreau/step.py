"""A step of Moreau's and Jean's method.

    x_m = x_n moved by h/2 v_n,    v_f = v_n + h a(x_m, (v_n + v_n+1) / 2),
    v_n+1 = v_f + M^-1 J^T P,      x_n+1 = x_m moved by h/2 v_n+1,

at x_m the contacts, M and J.  Smooth motion is of order 2 (position Verlet, its velocities by the implicit midpoint
rule); the spins of bodies that fly by themselves keep their angular momentum (``free_spins``).  A contact is in the
step where it touches, or would by the end: its normal velocity then ends at e times that of its approach at least
(Newton's law of impact), and where it does not approach, or e = 0, its gap does not close beyond zero; Poisson's law
has a least impulse instead (``compression``).  Overlaps that
an impact within a step leaves are opened by a displacement, the least in the metric of the masses, which changes no
velocity (``solve_positions``); what flies apart by itself is left alone, so that an elastic impact keeps the energy.
Sources: Moreau 1988, 1999; Jean 1999; Acary & Brogliato 2008, chapter 10; Schindler & Acary 2014.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.integrate import state as st
from flexmbd.integrate.controller import Rule, next_step
from flexmbd.integrate.explicit.explicit_machine import ExplicitMachine, accept, close_loops, move
from flexmbd.integrate.explicit.loop_dynamics import LoopMemory, project_onto_tangent
from flexmbd.integrate.moreau.smooth_forces import EVALUATIONS, drive_to_end, evaluate, halfway, smooth
from flexmbd.multibody.kernels.algebra.so3 import add3, dot3, load3, load9, rotate, rotate_back, scale3, store3, sub3
from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base.array_struct import ArrayStruct
from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel
from flexmbd.multibody.kernels.contact.finding.find_contacts import TOO_SMALL
from flexmbd.multibody.kernels.elements.hard_element import LAW_FRICTION, LAW_POISSON, LAW_RESTITUTION
from flexmbd.multibody.kernels.forward_dynamics.articulated import solve_mass
from flexmbd.multibody.kernels.impulses.compression import compress, decompresses
from flexmbd.multibody.kernels.impulses.contact_rows import Contacts, enter, normal_at, velocity_at
from flexmbd.multibody.kernels.impulses.free_spins import FreeSpins, to_end
from flexmbd.multibody.kernels.impulses.gauss_seidel import solve_impulses, solve_positions
from flexmbd.multibody.kernels.impulses.group_points import ShapeGroups
from flexmbd.multibody.kernels.impulses.kept_impulses import KeptImpulses, clear, keep, recall
from flexmbd.multibody.kernels.impulses.lone_bodies import find_mobility
from flexmbd.multibody.kernels.impulses.parts import CoupledParts, size_of
from flexmbd.multibody.kernels.impulses.touching import Watched, foresee, place
from flexmbd.multibody.kernels.inverse_dynamics.recursion import forward_kinematics
from flexmbd.multibody.kernels.inverse_dynamics.residual import drive
from flexmbd.round_off import EQUAL, ROUND_OFF, TEN_DIGITS

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

#: Steps are fixed: nothing follows from it.
RULE = Rule(exponent=0.5)

_SWEEPS = 1000
_OF_TOLERANCE = 0.05  # of rtol: change in a sweep, of the speeds that impulses meet, at which they are found
_STUCK = 1e-2  # the same of the last sweep: at which they are not

#: Columns of what a step tells of each contact: the force on G (N, inertial axes), the work (J) of its normal
#: part and of friction, the slip (m/s) at its end.
TOLD_FORCE, TOLD_NORMAL, TOLD_FRICTION, TOLD_SLIP, N_TOLD = 0, 3, 4, 5, 8


@dataclass(frozen=True, eq=False)
class MoreauMemory(ArrayStruct):
    """Of the loops; impulses of the last step, where the next one begins, are forgotten as factors are."""

    loops: LoopMemory


@dataclass(frozen=True, eq=False)
class MoreauWorkspace(ArrayStruct):
    """The machine, its contacts, and the vectors of a step.

    Attributes:
        moves: (nv,) whether each velocity is free.
        follows: (2,) whether smooth forces may follow velocities that impulses change, and whether they do in the step.
        extent: (1,) m, of the machine.
        begun: (4,) of the deepest overlap with which a run begins the gap (m), the number of its element in the scene,
            and its two shapes in their table, -1 of pairs.
        told: (k, N_TOLD) of each contact.
        smooth: (rows,) 1/s^2, of the steps that the record has, see ``smooth_size``.
        x, u: the middle of the step, and a displacement.  end: its end.
        begin: the velocity at the step's begin, as of free spins in the middle.
        v: that at which forces are evaluated; free: at the end without impulses; last: with them.
        a, multipliers: of the smooth forces.
    """

    machine: ExplicitMachine
    watched: Watched
    groups: ShapeGroups
    kept: KeptImpulses
    spins: FreeSpins
    parts: CoupledParts
    contacts: Contacts
    memory: MoreauMemory
    moves: IntArray
    follows: IntArray
    extent: FloatArray
    begun: FloatArray
    told: FloatArray
    smooth: FloatArray
    multipliers: FloatArray
    x: FloatArray
    end: FloatArray
    u: FloatArray
    begin: FloatArray
    v: FloatArray
    free: FloatArray
    last: FloatArray
    a: FloatArray


@kernel
def _follow(s, state, groups, h, share, nothing):
    """Let forces that follow velocities know the impulses, and these the forces, in turns; False where that failed."""
    before = math.inf
    for _ in range(EVALUATIONS):
        halfway(s, s.last)
        change = evaluate(s, state, groups, h)
        if change < 0.0 or not drive_to_end(s, state):
            return False
        for k in range(s.last.shape[0]):
            s.last[k] = s.free[k]
        sweeps, _ = solve_impulses(s.parts, s.contacts, s.last, share, nothing, _SWEEPS)
        state.counts[st.ITERATIONS] += sweeps
        if change <= _OF_TOLERANCE * state.numbers[st.TOLERANCE] or not change < before:
            break
        before = change
    return True


@kernel
def invert(plan, work, aw, loops, parts):
    """Write the parts' inverses by the factors at hand, and how lone bodies follow wrenches.

    Unit forces act on one velocity of each part at once.  What loops hold in its place follows no force; its column
    would be round-off of what it is without them.
    """
    for j in range(parts.largest[0]):
        for k in range(parts.unit.shape[1]):
            parts.unit[0, k] = 0.0
        for c in range(parts.first.shape[0] - 1):
            if j < size_of(parts, c):
                parts.unit[0, parts.velocity[parts.first[c] + j]] = 1.0
        solve_mass(plan, work, aw, parts.unit, parts.answer)
        if plan.rows.shape[0] > 0:
            for c in range(parts.first.shape[0] - 1):
                if j < size_of(parts, c):
                    own = parts.velocity[parts.first[c] + j]
                    parts.unit[0, own] = TEN_DIGITS * parts.answer[0, own]
            project_onto_tangent(plan, work, aw, loops, parts.answer[0])
        for c in range(parts.first.shape[0] - 1):
            n = size_of(parts, c)
            if j < n:
                own = parts.velocity[parts.first[c] + j]
                held = plan.rows.shape[0] > 0 and not parts.answer[0, own] > parts.unit[0, own]
                for i in range(n):
                    value = parts.answer[0, parts.velocity[parts.first[c] + i]]
                    parts.inverse[parts.square[c] + i * n + j] = 0.0 if held else value
    for k in range(parts.unit.shape[1]):
        parts.unit[0, k] = 0.0
    find_mobility(plan, work, parts, parts.unit[0])


@kernel
def _speed(watched, i):
    """The larger of the speeds of a point at the step's begin and, without impulses, at its end (m/s)."""
    before, free = load3(watched.before[i], 0), load3(watched.free[i], 0)
    return math.sqrt(max(dot3(before, before), dot3(free, free)))


@kernel
def _met(watched, i, fall):
    """The speed that impulses meet at point i (m/s): its approach without them, and what smooth forces make."""
    free = load3(watched.free[i], 0)
    made = sub3(free, load3(watched.before[i], 0))
    along = dot3(load3(watched.normal[i], 0), free)
    return math.sqrt(along * along + dot3(made, made) + fall * fall)


@kernel
def _choose(s, h, kick, fall):
    """List the contacts of the step with their bounds.

    ``kick`` (m/s): the velocity that smooth forces make in the step, by which what rests is told from what strikes.
    ``fall`` (m/s): that which weight makes of what is free.
    """
    w, c = s.watched, s.contacts
    near = ROUND_OFF * s.extent[0] + 0.5 * h * kick
    fastest = 0.0
    for i in range(w.count[0]):
        fastest = max(fastest, _speed(w, i))
    n = 0
    for i in range(w.count[0]):
        normal, gap = load3(w.normal[i], 0), w.gap[i]
        e, approach = w.law[i, LAW_RESTITUTION], dot3(normal, load3(w.before[i], 0))
        closes = gap <= near or gap + 0.5 * h * dot3(normal, load3(w.free[i], 0)) < 0.0
        if not closes and (e > 0.0 or gap > h * fastest):
            continue
        bound = -max(gap, 0.0) / h  # touching at the middle of the next step
        if e > 0.0 and approach < 0.0 and w.law[i, LAW_POISSON] == 0.0:
            bound = -e * approach
        c.watched[n], c.bound[n], c.least[n], c.friction[n] = i, bound, 0.0, w.law[i, LAW_FRICTION]
        c.speed[n] = _met(w, i, fall)
        n += 1
    c.count[0] = n


@kernel
def _begin(s, i):
    """The impulse of contact i in the last step, within the friction cone."""
    c, k = s.contacts, s.contacts.watched[i]
    P = rotate(load9(c.basis[i], 0), recall(s.kept, s.watched.id[k]))
    most, size = c.friction[i] * max(P[0], 0.0), math.sqrt(P[1] * P[1] + P[2] * P[2])
    share = most / size if size > most else 1.0
    store3(c.impulse[i], 0, (max(P[0], 0.0), share * P[1], share * P[2]))


@kernel
def _number_of(s, k):
    """The number in the scene of the element that watched point k is of."""
    of_pairs = s.watched.number.shape[0]
    return s.watched.number[k] if k < of_pairs else s.groups.number[s.groups.out.law[k - of_pairs]]


@kernel
def _is_blocked(s, state, i, h, kick):
    """Whether a contact closes by more than ``kick`` (m/s), a step's change of speed, and nothing gives way."""
    c, k = s.contacts, s.contacts.watched[i]
    if c.own[i, 0] > 0.0:
        return False
    away = normal_at(s.parts, c, i, s.last)
    if away >= -EQUAL * s.watched.fastest[0] or (away >= c.bound[i] - kick and s.watched.gap[k] >= -h * kick):
        return False
    state.counts[st.OUTCOME] = st.BLOCKED
    state.counts[st.WORST] = _number_of(s, k)
    return True


@kernel
def _is_painleve(s, state, i, kick):
    """Whether a contact that rests and slides would be pressed the more it is pushed apart (Painlevé 1895)."""
    c, w, k = s.contacts, s.watched, s.contacts.watched[i]
    u = rotate(load9(c.basis[i], 0), load3(w.before[k], 0))
    f = rotate(load9(c.basis[i], 0), load3(w.free[k], 0))
    slip = math.sqrt(u[1] * u[1] + u[2] * u[2])
    if abs(u[0]) > kick or not slip > kick or f[0] >= 0.0:
        return False
    across = (c.own[i, 1] * u[1] + c.own[i, 2] * u[2]) / slip
    if c.own[i, 0] > c.friction[i] * across:
        return False
    state.counts[st.OUTCOME] = st.PAINLEVE
    state.counts[st.WORST] = _number_of(s, k)
    state.numbers[st.ERROR_RATIO] = math.atan2(across, c.own[i, 0])
    return True


@kernel
def _touch(s, state, groups, h):
    """Write the velocity at the end, the impulses in ``contacts``; False where they are not found."""
    m, c = s.machine, s.contacts
    plan, work = m.plan, m.work
    c.count[0] = 0
    if s.watched.gap.shape[0] == 0:
        return 0.0
    forward_kinematics(plan, work, s.x, s.begin, m.aw.zeros)
    found = place(plan, work, s.watched, s.groups, h)
    if found < 0:
        state.counts[st.OUTCOME] = st.NO_ROOM if found == TOO_SMALL else st.NOT_FINITE
        return -1.0
    for i in range(s.watched.element.shape[0]):
        if s.watched.gap[i] != s.watched.gap[i]:
            plan.flag[0] = kinds.FLAG_ELEMENT + s.watched.number[i]
            state.counts[st.OUTCOME] = st.CALLBACK_FAILED
            return -1.0
    forward_kinematics(plan, work, s.x, s.free, m.aw.zeros)
    weight = load3(plan.gravity, 0)
    fall = h * math.sqrt(dot3(weight, weight))
    kick = foresee(plan, work, s.watched, s.groups) + fall
    _choose(s, h, kick, fall)
    n = c.count[0]
    if n == 0:
        return kick
    invert(plan, work, m.aw, m.loops, s.parts)
    for i in range(n):
        k = c.watched[i]
        enter(plan, work, s.parts, c, i, s.watched.frames[k], s.watched.point[k], s.watched.normal[k])
        if c.friction[i] > 0.0 and _is_painleve(s, state, i, 2.0 * kick):
            return -1.0
        _begin(s, i)
    share, nothing = _OF_TOLERANCE * state.numbers[st.TOLERANCE], EQUAL * s.watched.fastest[0]
    if decompresses(c, s.watched):
        sweeps, left = compress(s.parts, c, s.watched, s.v, share, nothing, _SWEEPS)
        state.counts[st.ITERATIONS] += sweeps
        if not left <= _STUCK:
            state.counts[st.OUTCOME] = st.NOT_CONVERGED if math.isfinite(left) else st.NOT_FINITE
            return -1.0
    sweeps, left = solve_impulses(s.parts, c, s.last, share, nothing, _SWEEPS)
    state.counts[st.ITERATIONS] += sweeps
    if not left <= _STUCK:
        state.counts[st.OUTCOME] = st.NOT_CONVERGED if math.isfinite(left) else st.NOT_FINITE
        return -1.0
    for i in range(n):
        if _is_blocked(s, state, i, h, kick):
            return -1.0
    if s.follows[0] == 1 and s.follows[1] == 1 and not _follow(s, state, groups, h, share, nothing):
        return -1.0
    return kick


@kernel
def _note_overlap(s, h, i):
    """Keep how deep contact i of the first step was at the start, if it is the deepest."""
    w, k, of_pairs = s.watched, s.contacts.watched[i], s.watched.number.shape[0]
    gap = w.gap[k] - 0.5 * h * dot3(load3(w.normal[k], 0), load3(w.before[k], 0))
    if gap < s.begun[0]:
        s.begun[0] = gap
        s.begun[1] = w.number[k] if k < of_pairs else s.groups.number[s.groups.out.law[k - of_pairs]]
        s.begun[2], s.begun[3] = w.shapes[k, 0], w.shapes[k, 1]


@kernel
def _overlap(s, state, h, kick):
    """Write the gaps at the step's end, none of what flies apart by itself; whether there are overlaps."""
    c = s.contacts
    overlaps = False
    for i in range(c.count[0]):
        away = normal_at(s.parts, c, i, s.last)
        gap = s.watched.gap[c.watched[i]] + 0.5 * h * away
        c.shift[i] = max(gap, 0.0) if away > kick else gap
        overlaps = overlaps or c.shift[i] < -EQUAL * s.extent[0]
        if state.counts[st.STEPS] == 0:
            _note_overlap(s, h, i)
    return overlaps


@kernel
def _tell(s, h):
    """Keep the impulses; write what they are as forces and do as work."""
    c = s.contacts
    clear(s.kept)
    for i in range(c.count[0]):
        k = c.watched[i]
        basis, P = load9(c.basis[i], 0), load3(c.impulse[i], 0)
        whole = rotate_back(basis, P)
        keep(s.kept, s.watched.id[k], whole)
        store3(s.told[i], TOLD_FORCE, scale3(1.0 / h, whole))
        after = velocity_at(s.parts, c, i, s.last)
        u = scale3(0.5, add3(rotate(basis, load3(s.watched.before[k], 0)), after))
        s.told[i, TOLD_NORMAL] = P[0] * u[0]
        s.told[i, TOLD_FRICTION] = P[1] * u[1] + P[2] * u[2]
        store3(s.told[i], TOLD_SLIP, rotate_back(basis, (0.0, after[1], after[2])))


@kernel
def attempt(s, state, groups, h):
    """An attempt at a step, see ``controller``."""
    state.numbers[st.ERROR_RATIO] = math.inf
    m = s.machine
    for k in range(s.u.shape[0]):
        s.u[k] = 0.5 * h * state.v[k]
    move(m, state.x, s.u, s.x)
    if not smooth(s, state, groups, h):
        return
    for k in range(s.last.shape[0]):
        s.last[k] = s.free[k]
    kick = _touch(s, state, groups, h)
    if kick < 0.0:
        return
    overlaps = _overlap(s, state, h, kick)
    _tell(s, h)
    if not to_end(s.spins, h, s.last):
        state.counts[st.OUTCOME] = st.NOT_CONVERGED
        return
    for k in range(s.u.shape[0]):
        s.u[k] = 0.5 * h * s.last[k]
    move(m, s.x, s.u, s.end)
    if overlaps:
        solve_positions(s.parts, s.contacts, s.u, h * kick * _OF_TOLERANCE * state.numbers[st.TOLERANCE])
        move(m, s.end, s.u, s.end)
    _finish(s, state, groups, h)


@kernel
def _finish(s, state, groups, h):
    """Bring prescribed coordinates and loops to the step's end, and accept it."""
    m = s.machine
    drive(m.plan, m.work, s.end, s.last, s.a)
    if not close_loops(m, state, groups, s.end, s.last):
        return
    for k in range(s.a.shape[0]):
        if s.moves[k] == 1:
            s.a[k] = (s.last[k] - state.v[k]) / h
    state.numbers[st.ERROR_RATIO] = 0.0
    accept(m, state, s.end, s.last, s.a, s.multipliers)


@kernel
def smooth_size(s, groups, h):
    """The largest acceleration of the last attempt by smooth forces, over the machine's size (1/s^2)."""
    largest = 0.0
    for k in range(s.free.shape[0]):
        if s.moves[k] == 1:
            largest = max(largest, abs(s.free[k] - s.begin[k]) / groups.full[groups.of[k]])
    return largest / h


@entry_kernel
def advance(s, rule, knots, state, groups, record):
    """Step until the end, a full record, or a failure; see ``controller``."""
    h = 0.0
    while True:
        h = next_step(s.machine.plan, rule, knots, state, groups, record, h)
        if h == 0.0:
            return state.counts[st.OUTCOME]
        attempt(s, state, groups, h)
        s.smooth[state.counts[st.STORED]] = smooth_size(s, groups, h)


@entry_kernel
def repeat(s, state, groups, t, end, x, v):
    """Take the step from t to ``end`` (s) that began at x (nx,), v (nv,) once more; the outcome."""
    for k in range(state.x.shape[0]):
        state.x[k] = x[k]
    for k in range(state.v.shape[0]):
        state.v[k] = v[k]
    state.numbers[st.TIME] = t
    state.numbers[st.STEP_END] = end
    state.numbers[st.RATE] = st.machine_rate(state, groups)
    state.counts[st.OUTCOME] = st.DONE
    attempt(s, state, groups, end - t)
    return state.counts[st.OUTCOME]
