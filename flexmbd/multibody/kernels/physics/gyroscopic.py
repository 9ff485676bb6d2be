"""Forces of the angular momentum h + H q that rotors inside a reduced body carry (`record.Gyroscopic`).

The motion requires the moment w x (h + H q) + H qd on B and the modal forces -H^T w; those among the modes, G qd, stand
with the damping.  They take no power.
"""

from __future__ import annotations

from flexmbd.multibody.kernels.algebra.so3 import add3, cross3, load3
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.deferred import TUPLE3, deferred_kernel


@kernel
def momentum_slope(modal, flex, j):
    """Column j of H, N m s per unit of mode j, in B."""
    n = flex[at.N_MODES]
    o = flex[at.GYROSCOPIC] + 3
    return modal[o + j], modal[o + n + j], modal[o + 2 * n + j]


@kernel
def _change(modal, flex, q):
    """H q."""
    x = y = z = 0.0
    for j in range(flex[at.N_MODES]):
        slope = momentum_slope(modal, flex, j)
        x += slope[0] * q[j]
        y += slope[1] * q[j]
        z += slope[2] * q[j]
    return x, y, z


@deferred_kernel(TUPLE3)
def rotor_momentum(modal, flex, q):
    """h + H q, in B."""
    return add3(load3(modal, flex[at.GYROSCOPIC]), _change(modal, flex, q))


@deferred_kernel(TUPLE3)
def rotor_forces(modal, flex, w, q, qd, out):
    """Add the modal forces that rotors require to ``out`` (n,); return the moment on B. ``w``: of B, in B."""
    for j in range(flex[at.N_MODES]):
        slope = momentum_slope(modal, flex, j)
        out[j] -= slope[0] * w[0] + slope[1] * w[1] + slope[2] * w[2]
    return add3(cross3(w, rotor_momentum(modal, flex, q)), _change(modal, flex, qd))
