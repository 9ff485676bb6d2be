"""Many free pseudo-rigid bodies: F'' J = -V dW/dF by velocity Verlet, some bodies side by side in vector registers.

A block of ``LANES`` bodies lies in scratch as rows of ``LANES`` numbers, which all fit a core's first cache: a block
takes all its steps before the next begins.  Distances between rows are known when this is compiled, so that the
compiler sees that nothing overlaps.
"""

from __future__ import annotations

from flexmbd.multibody.kernels.base.compiling import entry_kernel, summing_kernel

LANES = 16
# Rows of scratch: F (9), its rate (9), its acceleration (9), V J^-1 xx xy xz yy yz zz, lambda and mu, the least det F
# so far, and the step in which it first was not positive (-1: none).
ROW_F, ROW_G, ROW_A, ROW_B, ROW_LAME, ROW_DET, ROW_STEP, N_ROWS = 0, 9, 18, 27, 33, 35, 36, 37


@summing_kernel
def accelerate(s, step):
    """Acceleration -dW/dF V J^-1 of a block, for St Venant-Kirchhoff; looks at det F."""
    n = LANES
    for k in range(n):
        a, b, c = s[k], s[n + k], s[2 * n + k]
        d, e, f = s[3 * n + k], s[4 * n + k], s[5 * n + k]
        g, h, i = s[6 * n + k], s[7 * n + k], s[8 * n + k]
        lam, mu = s[ROW_LAME * n + k], s[(ROW_LAME + 1) * n + k]
        # Green-Lagrange strain, doubled
        xx = a * a + d * d + g * g - 1.0
        yy = b * b + e * e + h * h - 1.0
        zz = c * c + f * f + i * i - 1.0
        trace = 0.5 * lam * (xx + yy + zz)
        # second Piola-Kirchhoff stress
        xx = trace + mu * xx
        yy = trace + mu * yy
        zz = trace + mu * zz
        yz = mu * (b * c + e * f + h * i)
        xz = mu * (a * c + d * f + g * i)
        xy = mu * (a * b + d * e + g * h)
        bxx, bxy, bxz = s[ROW_B * n + k], s[(ROW_B + 1) * n + k], s[(ROW_B + 2) * n + k]
        byy, byz, bzz = s[(ROW_B + 3) * n + k], s[(ROW_B + 4) * n + k], s[(ROW_B + 5) * n + k]
        # T = S V J^-1
        t0 = xx * bxx + xy * bxy + xz * bxz
        t1 = xx * bxy + xy * byy + xz * byz
        t2 = xx * bxz + xy * byz + xz * bzz
        t3 = xy * bxx + yy * bxy + yz * bxz
        t4 = xy * bxy + yy * byy + yz * byz
        t5 = xy * bxz + yy * byz + yz * bzz
        t6 = xz * bxx + yz * bxy + zz * bxz
        t7 = xz * bxy + yz * byy + zz * byz
        t8 = xz * bxz + yz * byz + zz * bzz
        s[ROW_A * n + k] = -(a * t0 + b * t3 + c * t6)
        s[(ROW_A + 1) * n + k] = -(a * t1 + b * t4 + c * t7)
        s[(ROW_A + 2) * n + k] = -(a * t2 + b * t5 + c * t8)
        s[(ROW_A + 3) * n + k] = -(d * t0 + e * t3 + f * t6)
        s[(ROW_A + 4) * n + k] = -(d * t1 + e * t4 + f * t7)
        s[(ROW_A + 5) * n + k] = -(d * t2 + e * t5 + f * t8)
        s[(ROW_A + 6) * n + k] = -(g * t0 + h * t3 + i * t6)
        s[(ROW_A + 7) * n + k] = -(g * t1 + h * t4 + i * t7)
        s[(ROW_A + 8) * n + k] = -(g * t2 + h * t5 + i * t8)
        det = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
        least = s[ROW_DET * n + k]
        first = s[ROW_STEP * n + k]
        s[ROW_STEP * n + k] = first if first >= 0.0 or det > 0.0 else step
        s[ROW_DET * n + k] = least if least < det else det


@summing_kernel
def _move(s, row, rate, h):
    """Add h times nine rows from ``rate`` to the nine from ``row``."""
    for k in range(9 * LANES):
        s[row * LANES + k] += h * s[rate * LANES + k]


@entry_kernel
def advance_swarm(F, G, inverse, lame, h, count, s, new_F, new_G):
    """Step all bodies ``count`` times by h (s); -1, or the first body that has det F <= 0 on the way.

    F, G: (n, 9) deformation gradients and their rates.  inverse: (n, 6) V J^-1, xx xy xz yy yz zz.  lame: (n, 2).
    s: (N_ROWS * LANES,) scratch; s[0] and s[1] hold the step and the least det F of a body that failed.
    new_F, new_G: (n, 9) output.
    """
    size = F.shape[0]
    for start in range(0, size, LANES):
        for k in range(LANES):
            body = min(start + k, size - 1)
            for j in range(9):
                s[(ROW_F + j) * LANES + k] = F[body, j]
                s[(ROW_G + j) * LANES + k] = G[body, j]
            for j in range(6):
                s[(ROW_B + j) * LANES + k] = inverse[body, j]
            s[ROW_LAME * LANES + k] = lame[body, 0]
            s[(ROW_LAME + 1) * LANES + k] = lame[body, 1]
            s[ROW_DET * LANES + k] = 1.0e300
            s[ROW_STEP * LANES + k] = -1.0
        accelerate(s, 0.0)
        _move(s, ROW_G, ROW_A, 0.5 * h)
        for step in range(count):
            _move(s, ROW_F, ROW_G, h)
            accelerate(s, step + 1.0)
            _move(s, ROW_G, ROW_A, h)
        _move(s, ROW_G, ROW_A, -0.5 * h)
        for k in range(min(LANES, size - start)):
            if s[ROW_STEP * LANES + k] >= 0.0:
                step = s[ROW_STEP * LANES + k]
                s[1] = s[ROW_DET * LANES + k]
                s[0] = step
                return start + k
            for j in range(9):
                new_F[start + k, j] = s[(ROW_F + j) * LANES + k]
                new_G[start + k, j] = s[(ROW_G + j) * LANES + k]
    return -1
