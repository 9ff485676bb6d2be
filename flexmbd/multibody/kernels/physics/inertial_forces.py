"""Inertia of a rigid body: the wrench that a motion requires."""

from __future__ import annotations

from flexmbd.multibody.kernels.algebra.so3 import add3, cross3, load3, scale3, store3
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel


@entry_kernel
def rigid_second_moment(row):
    """(xx, xy, xz, yy, yz, zz), integral of rho x x^T about B.

    Args:
        row: (N_RIGID,) float64, row of Plan.rigid.
    """
    o = at.SECOND_MOMENT
    return (row[o], row[o + 1], row[o + 2], row[o + 3], row[o + 4], row[o + 5])


@entry_kernel
def inertia_times(second, w):
    """(trace(J) - J) w: the inertia tensor of the second moment J, times w.

    Args:
        second: six float64, kg m^2, as of `rigid_second_moment`.
        w: three float64.
    """
    xx, xy, xz, yy, yz, zz = second
    return (
        (yy + zz) * w[0] - xy * w[1] - xz * w[2],
        -xy * w[0] + (xx + zz) * w[1] - yz * w[2],
        -xz * w[0] - yz * w[1] + (xx + yy) * w[2],
    )


@kernel
def add_rigid_wrench(mass, first, second, row):
    """Write F, T = integral of rho a, rho r x a for a body that moves as a rigid one.

    a = a_B + dw x r + w x (w x r) (Ambrosio & Nikravesh 1992, eq. 28 without deformation).

    Args:
        mass: float64, kg.
        first: (float64, float64, float64), integral of rho r about B, kg m.
        second: six float64, integral of rho r r^T about B: `rigid_second_moment`, kg m^2.
        row: (N_BODY,) float64, the body's row of Work.body: its motion is read, its wrench written.
    """
    w = load3(row, at.B_W)
    dw = load3(row, at.B_DW)
    a = load3(row, at.B_A)
    force = add3(
        scale3(mass, a), add3(cross3(dw, first), cross3(w, cross3(w, first)))
    )
    torque = add3(cross3(first, a), add3(inertia_times(second, dw), cross3(w, inertia_times(second, w))))
    store3(row, at.B_F, force)
    store3(row, at.B_T, torque)
