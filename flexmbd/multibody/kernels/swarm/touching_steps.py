"""Steps of pseudo-rigid bodies that touch: half a step of motion, the forces there, half a step of motion.

Second order without friction and damping; forces that depend on velocities take those before the step.
"""

from __future__ import annotations

import math

from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel
from flexmbd.multibody.kernels.swarm.free_flight import LANES, ROW_A, ROW_B, ROW_F, ROW_LAME, accelerate
from flexmbd.multibody.kernels.swarm.stone_forces import DONE, TOO_LONG, find_points, push_apart
from flexmbd.multibody.kernels.swarm.stones import BEFORE, BODY, DRIFTED, POINTS, STEP, VALUE


@kernel
def _drift(r, v, F, G, h):
    """Move all bodies on by h (s) as they go."""
    for b in range(r.shape[0]):
        for k in range(3):
            r[b, k] += h * v[b, k]
        for k in range(9):
            F[b, k] += h * G[b, k]


@kernel
def _stress(stones, work, F):
    """Begin the accelerations: weight, and the elastic ones of F."""
    s, n = work.lanes, F.shape[0]
    for start in range(0, n, LANES):
        for k in range(LANES):
            b = min(start + k, n - 1)
            for j in range(9):
                s[(ROW_F + j) * LANES + k] = F[b, j]
            for j in range(6):
                s[(ROW_B + j) * LANES + k] = stones.inverse[b, j]
            s[ROW_LAME * LANES + k] = stones.lame[b, 0]
            s[(ROW_LAME + 1) * LANES + k] = stones.lame[b, 1]
        accelerate(s, 0.0)
        for k in range(min(LANES, n - start)):
            b = start + k
            for j in range(9):
                work.pull[b, j] = s[(ROW_A + j) * LANES + k]
            for j in range(3):
                work.push[b, j] = stones.gravity[j]
            work.stiff[b], work.damp[b] = stones.stiffest[b], stones.retardation * stones.stiffest[b]


@kernel
def _damp(stones, work, F, G):
    """Add what the material's damping does: the stress of the strain rate E' times the retardation."""
    tau = stones.retardation
    for b in range(F.shape[0]):
        f, g, J = F[b], G[b], stones.inverse[b]
        xx, yy, zz = f[0] * g[0] + f[3] * g[3] + f[6] * g[6], f[1] * g[1] + f[4] * g[4] + f[7] * g[7], \
            f[2] * g[2] + f[5] * g[5] + f[8] * g[8]  # fmt: skip
        xy = 0.5 * (f[0] * g[1] + f[3] * g[4] + f[6] * g[7] + f[1] * g[0] + f[4] * g[3] + f[7] * g[6])
        xz = 0.5 * (f[0] * g[2] + f[3] * g[5] + f[6] * g[8] + f[2] * g[0] + f[5] * g[3] + f[8] * g[6])
        yz = 0.5 * (f[1] * g[2] + f[4] * g[5] + f[7] * g[8] + f[2] * g[1] + f[5] * g[4] + f[8] * g[7])
        mean, mu = tau * stones.lame[b, 0] * (xx + yy + zz), 2.0 * tau * stones.lame[b, 1]
        xx, yy, zz, xy, xz, yz = mean + mu * xx, mean + mu * yy, mean + mu * zz, mu * xy, mu * xz, mu * yz
        for i in range(3):
            p, q, t = f[3 * i], f[3 * i + 1], f[3 * i + 2]
            x, y, z = p * xx + q * xy + t * xz, p * xy + q * yy + t * yz, p * xz + q * yz + t * zz
            work.pull[b, 3 * i] -= x * J[0] + y * J[1] + z * J[2]
            work.pull[b, 3 * i + 1] -= x * J[1] + y * J[3] + z * J[4]
            work.pull[b, 3 * i + 2] -= x * J[2] + y * J[4] + z * J[5]


@kernel
def longest_step(stiff, damp):
    """The longest stable step (s) of x'' = -damp x' - stiff x, the damping by the velocity before."""
    return 2.0 / (0.5 * damp + math.sqrt(0.25 * damp * damp + stiff))


@kernel
def _bears(work, h):
    """Whether all bodies are stable in steps of h."""
    for b in range(work.stiff.shape[0]):
        longest = longest_step(work.stiff[b], work.damp[b])
        if not h <= longest:
            work.whole[BODY], work.told[VALUE] = b, longest
            return False
    return True


@entry_kernel
def touch(stones, work, finding, points, r, v, F, G):
    """Find where bodies touch as they are, and the forces there, in ``points`` and ``work``; how it ended."""
    code = find_points(stones, work, finding, points, r, v, F, G, 0.0)
    if code == DONE:
        _stress(stones, work, F)
        push_apart(stones, work, points, r, v, G, 0.0)
    return code


@entry_kernel
def advance_stones(stones, work, finding, points, r, v, F, G, h, count):
    """Step all bodies until ``count`` steps of h (s) are taken; how it ended.

    r, v: (n, 3).  F, G: (n, 9) deformation gradients and their rates.  All four are changed.  After TOO_SMALL
    ``finding.needed`` says what room there is to be, and another call goes on where this one ended.
    """
    while work.whole[STEP] < count:
        if work.whole[DRIFTED] == 0:
            _drift(r, v, F, G, 0.5 * h)
            work.whole[DRIFTED] = 1
        code = find_points(stones, work, finding, points, r, v, F, G, h)
        if code != DONE:
            return code
        _stress(stones, work, F)
        if stones.retardation > 0.0:
            _damp(stones, work, F, G)
        push_apart(stones, work, points, r, v, G, h)
        if not _bears(work, h):
            return TOO_LONG
        for b in range(r.shape[0]):
            for k in range(3):
                v[b, k] += h * work.push[b, k]
            for k in range(9):
                G[b, k] += h * work.pull[b, k]
        _drift(r, v, F, G, 0.5 * h)
        for k in range(work.whole[POINTS]):
            work.id_before[k] = points.id[k]
            for i in range(3):
                work.z_before[k, i] = work.z[k, i]
        work.whole[BEFORE] = work.whole[POINTS]
        work.whole[DRIFTED] = 0
        work.whole[STEP] += 1
    return DONE
