"""The impact of a machine at an instant: what impulses of all contacts that touch make of its velocities."""

from __future__ import annotations

import math

from flexmbd.integrate import state as st
from flexmbd.integrate.explicit.explicit_machine import accelerate
from flexmbd.integrate.moreau.step import invert
from flexmbd.multibody.kernels.algebra.so3 import add3, dot3, load3, load9, rotate, rotate_back, scale3, store3
from flexmbd.multibody.kernels.base.compiling import entry_kernel
from flexmbd.multibody.kernels.elements.hard_element import LAW_FRICTION, LAW_POISSON, LAW_RESTITUTION
from flexmbd.multibody.kernels.impulses.compression import compress, decompresses
from flexmbd.multibody.kernels.impulses.contact_rows import enter, velocity_at
from flexmbd.multibody.kernels.impulses.gauss_seidel import solve_impulses
from flexmbd.multibody.kernels.impulses.touching import place
from flexmbd.multibody.kernels.inverse_dynamics.recursion import forward_kinematics
from flexmbd.round_off import EQUAL, ROUND_OFF

_SWEEPS = 100000
_STUCK = 1e-6  # of the contacts' speed: change in the last sweep at which impulses are not found

#: Columns of what an impact tells of a contact: the impulse on G (N s, inertial axes), the work (J) of its normal
#: part and of friction.
STRUCK_IMPULSE, STRUCK_NORMAL, STRUCK_FRICTION, N_STRUCK = 0, 3, 4, 5

#: Failures of an impact.
NOT_FOUND, BLOCKED = -1, -2


@entry_kernel
def touching_gaps(s, t, x, v, gaps, speeds):
    """Write gaps (n,) m and normal velocities (n,) m/s of all pairs at t (s), x (nx,), v (nv,); what is none there (m).

    A gap is located to the round-off of the time, and so to that of the way that a contact goes in it.
    """
    m = s.machine
    forward_kinematics(m.plan, m.work, x, v, m.aw.zeros)
    place(m.plan, m.work, s.watched, s.groups, 0.0)
    fastest = 0.0
    for i in range(gaps.shape[0]):
        u = load3(s.watched.before[i], 0)
        gaps[i] = s.watched.gap[i]
        speeds[i] = dot3(load3(s.watched.normal[i], 0), u)
        fastest = max(fastest, dot3(u, u))
    return EQUAL * (s.extent[0] + math.sqrt(fastest) * abs(t))


@entry_kernel
def strike(s, state, struck, told):
    """Write the velocities after an impact into ``s.last``, and ``told`` (n, N_STRUCK) of all pairs.

    Pairs that touch take part, and number ``struck``, whatever its gap; -1: none.  Returns how many take part,
    NOT_FOUND where the impulses are not found, BLOCKED where nothing gives way to one.
    """
    m, w, c = s.machine, s.watched, s.contacts
    plan, work, t = m.plan, m.work, state.numbers[st.TIME]
    for k in range(s.x.shape[0]):
        s.x[k] = state.x[k]
    for k in range(s.last.shape[0]):
        s.last[k] = state.v[k]
    if not accelerate(m, state, t, s.x, s.last, s.a, s.multipliers):
        return NOT_FOUND
    forward_kinematics(plan, work, s.x, s.last, m.aw.zeros)
    place(plan, work, w, s.groups, 0.0)
    speed = 0.0
    for i in range(w.count[0]):
        u = load3(w.before[i], 0)
        speed = max(speed, math.sqrt(dot3(u, u)))
    near, n = EQUAL * (s.extent[0] + speed * abs(t)), 0
    for i in range(w.count[0]):
        for j in range(N_STRUCK):
            told[i, j] = 0.0
        if i != struck and w.gap[i] > near:
            continue
        e, approach = w.law[i, LAW_RESTITUTION], dot3(load3(w.normal[i], 0), load3(w.before[i], 0))
        bounces = approach < 0.0 and w.law[i, LAW_POISSON] == 0.0
        c.watched[n], c.least[n], c.friction[n] = i, 0.0, w.law[i, LAW_FRICTION]
        c.bound[n] = -e * approach if bounces else 0.0
        c.speed[n] = speed
        store3(c.impulse[n], 0, (0.0, 0.0, 0.0))
        n += 1
    c.count[0] = n
    if n == 0:
        return 0
    invert(plan, work, m.aw, m.loops, s.parts)
    for i in range(n):
        k = c.watched[i]
        enter(plan, work, s.parts, c, i, w.frames[k], w.point[k], w.normal[k])
        if not c.own[i, 0] > 0.0 and dot3(load3(w.normal[k], 0), load3(w.before[k], 0)) < 0.0:
            return BLOCKED
    if decompresses(c, w):
        for k in range(s.v.shape[0]):
            s.v[k] = s.last[k]
        compress(s.parts, c, w, s.v, ROUND_OFF, ROUND_OFF * speed, _SWEEPS)
    _, left = solve_impulses(s.parts, c, s.last, ROUND_OFF, ROUND_OFF * speed, _SWEEPS)
    for i in range(n):
        k = c.watched[i]
        basis, P = load9(c.basis[i], 0), load3(c.impulse[i], 0)
        u = scale3(0.5, add3(rotate(basis, load3(w.before[k], 0)), velocity_at(s.parts, c, i, s.last)))
        store3(told[k], STRUCK_IMPULSE, rotate_back(basis, P))
        told[k, STRUCK_NORMAL] = P[0] * u[0]
        told[k, STRUCK_FRICTION] = P[1] * u[1] + P[2] * u[2]
    return n if left <= _STUCK else NOT_FOUND
