"""A frame's motion by the modes of its body, and the modal forces of a wrench on it, in vector registers.

A frame's modes are six rows of n numbers in Plan.modal: translations first, then rotations.
"""

from __future__ import annotations

from flexmbd.multibody.kernels.base.compiling import summing_kernel


@summing_kernel
def modal_sum(modal, o, n, q):
    """Translation and rotation rows of a frame's modes, which stand from ``o``, times q."""
    # indices from a range need no look whether they count from the end, which would hold up the vector registers
    rows = modal[o : o + 6 * n].reshape((6, n))
    t0 = t1 = t2 = r0 = r1 = r2 = 0.0
    for k in range(n):
        f = q[k]
        t0 += rows[0, k] * f
        t1 += rows[1, k] * f
        t2 += rows[2, k] * f
        r0 += rows[3, k] * f
        r1 += rows[4, k] * f
        r2 += rows[5, k] * f
    return (t0, t1, t2), (r0, r1, r2)


@summing_kernel
def add_frame_forces(modal, o, n, force, turn, out):
    """Add the modal forces of a frame's force, and of its torque as the rotation rows take it."""
    rows = modal[o : o + 6 * n].reshape((6, n))
    for j in range(n):
        out[j] += (
            rows[0, j] * force[0]
            + rows[1, j] * force[1]
            + rows[2, j] * force[2]
            + rows[3, j] * turn[0]
            + rows[4, j] * turn[1]
            + rows[5, j] * turn[2]
        )
