"""A frame on a face that the modes turn by a finite angle: rotations and strain of the face's affine motion.

The face of an interface moves by u = d + A X with A = [theta] + S, theta and S linear in the modal coordinates; the
frame's rotation is the polar rotation of 1 + A.  Its rows in Plan.modal: six as of any frame, then six of S.
"""

from __future__ import annotations

from flexmbd.multibody.kernels.algebra.polar_decomposition import symmetric6, twice_axial
from flexmbd.multibody.kernels.base.compiling import kernel, summing_kernel


@summing_kernel
def strain_sum(modal, o, n, q):
    """S, xx yy zz yz xz xy, of rows that stand from ``o``, times q."""
    rows = modal[o : o + 6 * n].reshape((6, n))
    xx = yy = zz = yz = xz = xy = 0.0
    for k in range(n):
        f = q[k]
        xx += rows[0, k] * f
        yy += rows[1, k] * f
        zz += rows[2, k] * f
        yz += rows[3, k] * f
        xz += rows[4, k] * f
        xy += rows[5, k] * f
    return xx, yy, zz, yz, xz, xy


@kernel
def strain_of(modal, o, n, k):
    """S of mode k."""
    return (modal[o + k], modal[o + n + k], modal[o + 2 * n + k],
            modal[o + 3 * n + k], modal[o + 4 * n + k], modal[o + 5 * n + k])  # fmt: skip


@summing_kernel
def _add_rows(modal, o, n, share, turn, strain, out):
    rows = modal[o : o + 9 * n].reshape((9, n))
    for k in range(n):
        out[k] += share * (
            rows[0, k] * turn[0]
            + rows[1, k] * turn[1]
            + rows[2, k] * turn[2]
            + rows[3, k] * strain[0]
            + rows[4, k] * strain[1]
            + rows[5, k] * strain[2]
            + rows[6, k] * strain[3]
            + rows[7, k] * strain[4]
            + rows[8, k] * strain[5]
        )


@kernel
def add_face_forces(modal, o, n, share, B, out):
    """Add the modal forces of ``share`` B, forces along the entries of A (9-tuple); the frame's rows stand from o."""
    _add_rows(modal, o + 3 * n, n, share, twice_axial(B), symmetric6(B), out)


@kernel
def add_translation_forces(modal, o, n, force, out):
    """Add the modal forces of a frame's force."""
    for k in range(n):
        out[k] += modal[o + k] * force[0] + modal[o + n + k] * force[1] + modal[o + 2 * n + k] * force[2]
