"""What small disturbances of places and velocities make of a machine's accelerations: K and C of M y'' = -K y - C y'.

By differences of forward dynamics at a state, loops and prescribed coordinates held.  For a few velocities by all of
them; beyond by Lanczos' steps in the inner product of the mass, which meet the fastest motions first (Parlett 1998,
chapter 13).
"""

from __future__ import annotations

import numpy as np

from flexmbd.integrate.explicit.loop_dynamics import accelerate, project_onto_tangent
from flexmbd.multibody.kernels.algebra.rotation_update import EXPONENTIAL, from_local_coordinates
from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel
from flexmbd.multibody.kernels.inverse_dynamics.residual import residual

_SMALL = 1e-6  # displacement over the machine's size: its square and round-off of forces over it are both small
_EXHAUSTED = 1e-6  # of a vector's length: what is left of it beside those before is round-off

# Rows of the scratch (N_SCRATCH, nv): accelerations at the state, and disturbed; the displacement; the velocities; what
# no motion and a vector require of forces; zeros.
_AT_STATE, _DISTURBED, _MOVED, _VELOCITY, _IDLE, _REQUIRED, _REST, N_SCRATCH = range(8)


@kernel
def _respond(machine, state, groups, h, scratch, x, multipliers, y, stiff, damp):
    """Write M^-1 K y and M^-1 C y, each (nv,) and free of prescribed coordinates and of what loops forbid."""
    plan, work, aw, loops = machine.plan, machine.work, machine.aw, machine.loops
    length = 0.0
    for k in range(y.shape[0]):
        length += (y[k] / groups.full[groups.of[k]]) ** 2
        stiff[k] = 0.0
        damp[k] = 0.0
    if length == 0.0:
        return
    small = _SMALL / np.sqrt(length)
    for k in range(y.shape[0]):
        scratch[_MOVED, k] = small * y[k]
        scratch[_VELOCITY, k] = state.v[k] + small / h * y[k]
    a = scratch[_DISTURBED]
    from_local_coordinates(machine.plain, machine.quaternions, EXPONENTIAL, state.x, scratch[_MOVED], x)
    accelerate(plan, work, aw, loops, x, state.v, a, multipliers)
    for j in range(plan.free.shape[0]):
        k = plan.free[j]
        stiff[k] = (scratch[_AT_STATE, k] - a[k]) / small
    accelerate(plan, work, aw, loops, state.x, scratch[_VELOCITY], a, multipliers)
    for j in range(plan.free.shape[0]):
        k = plan.free[j]
        damp[k] = (scratch[_AT_STATE, k] - a[k]) * h / small
    if plan.rows.shape[0] > 0:
        project_onto_tangent(plan, work, aw, loops, stiff)
        project_onto_tangent(plan, work, aw, loops, damp)


@entry_kernel
def respond_to_each(machine, state, groups, h, scratch, x, multipliers, stiffness, damping):
    """Write K and C (free, free), by coordinates over their groups' full sizes; h (s): in which velocities move."""
    plan, loops = machine.plan, machine.loops
    accelerate(plan, machine.work, machine.aw, loops, state.x, state.v, scratch[_AT_STATE], multipliers)
    y, stiff, damp = scratch[_REST], scratch[_IDLE], scratch[_REQUIRED]
    for j in range(plan.free.shape[0]):
        k = plan.free[j]
        for i in range(y.shape[0]):
            y[i] = 0.0
        y[k] = groups.full[groups.of[k]]
        if plan.rows.shape[0] > 0:
            project_onto_tangent(plan, machine.work, machine.aw, loops, y)
        _respond(machine, state, groups, h, scratch, x, multipliers, y, stiff, damp)
        for i in range(plan.free.shape[0]):
            size = groups.full[groups.of[plan.free[i]]]
            stiffness[i, j] = stiff[plan.free[i]] / size
            damping[i, j] = damp[plan.free[i]] / size


@kernel
def _put_momentum(bare, work, state, scratch, y, out):
    """out (nv,) = M y."""
    rest, none = scratch[_REST], scratch[_REST][:0]
    residual(bare, work, state.x, rest, y, none, scratch[_REQUIRED])
    for k in range(out.shape[0]):
        out[k] = scratch[_REQUIRED, k] - scratch[_IDLE, k]


@entry_kernel
def respond_to_fastest(
    machine, bare, state, groups, h, scratch, x, multipliers, first, last, basis, momenta, stiff, damp
):
    """Lanczos' steps from ``first`` to before ``last`` with h^2 K + 4 h C; how many vectors there are then.

    basis, momenta: (most + 1, nv) vectors y of unit mass, and M y; the first is set here.  stiff, damp: (most, nv)
    M^-1 K y and M^-1 C y of each.
    """
    plan, work = machine.plan, machine.work
    nv = basis.shape[1]
    accelerate(plan, work, machine.aw, machine.loops, state.x, state.v, scratch[_AT_STATE], multipliers)
    for k in range(nv):
        scratch[_REST, k] = 0.0
    residual(bare, work, state.x, scratch[_REST], scratch[_REST], scratch[_REST][:0], scratch[_IDLE])
    for i in range(first, last + 1):
        y = basis[i]
        if i == 0:
            for k in range(nv):
                y[k] = 0.0
            for j in range(plan.free.shape[0]):  # of no symmetry
                k = plan.free[j]
                y[k] = groups.full[groups.of[k]] * (1.0 if j % 3 == 0 else -0.7 + 0.1 * (j % 7))
            accelerate(plan, work, machine.aw, machine.loops, state.x, state.v, scratch[_DISTURBED], multipliers)
            if plan.rows.shape[0] > 0:
                project_onto_tangent(plan, work, machine.aw, machine.loops, y)
        elif i > first:
            for k in range(nv):
                y[k] = h * (h * stiff[i - 1, k] + 4.0 * damp[i - 1, k])
        if i == 0 or i > first:
            if not _orthonormalise(bare, work, state, scratch, basis, momenta, i):
                return i
        if i < last:
            _respond(machine, state, groups, h, scratch, x, multipliers, y, stiff[i], damp[i])
    return last


@kernel
def _orthonormalise(bare, work, state, scratch, basis, momenta, i):
    """Make vector i of unit mass beside those before it; False where nothing is left of it."""
    y, p = basis[i], momenta[i]
    _put_momentum(bare, work, state, scratch, y, p)
    before = 0.0
    for k in range(y.shape[0]):
        before += y[k] * p[k]
    for _ in range(2):
        for j in range(i):
            share = 0.0
            for k in range(y.shape[0]):
                share += momenta[j, k] * y[k]
            for k in range(y.shape[0]):
                y[k] -= share * basis[j, k]
    _put_momentum(bare, work, state, scratch, y, p)
    left = 0.0
    for k in range(y.shape[0]):
        left += y[k] * p[k]
    if not left > _EXHAUSTED**2 * before:
        for k in range(y.shape[0]):
            y[k] = 0.0
            p[k] = 0.0
        return False
    for k in range(y.shape[0]):
        y[k] /= np.sqrt(left)
        p[k] /= np.sqrt(left)
    return True
