"""Elimination of a joint's coordinates from the inertia and the bias force of all that it carries.

A body with what it carries moves by f = I a + p, (I, p) its articulated inertia and bias force, and the joint's
coordinate adds s qdd to the acceleration a that its inner side gives.  With U = I s, D = s^T U and u the coordinate's
own force less s^T p (Featherstone 2008, section 7.3; Rodriguez, Jain & Kreutz-Delgado 1991)

    the inner side meets  I - U D^-1 U^T  and  p + U D^-1 u,    and    qdd = D^-1 (u - U^T a).

A joint of several coordinates is eliminated one by one, as if massless bodies stood between them: the last that is
eliminated is the innermost and moves first.  So this is all that forward dynamics knows of elimination; shorter ways
through the same equations have hinges along their parent's axes (``forward_dynamics.hinge``) and trees of parallel
ones (``forward_dynamics.parallel_hinges``).

Inertias are blocks (A, B, M) of I = (A, B; B^T, M): tensors of six numbers and B of nine, row by row.  Six numbers of
a motion or force are angular first; all is about the joint's outer frame G in its axes.
"""

from __future__ import annotations

from flexmbd.multibody.kernels.algebra.so3 import add3, rotate, rotate_back, scale3
from flexmbd.multibody.kernels.algebra.spatial import subtract_outer, symmetric_times
from flexmbd.multibody.kernels.base.compiling import kernel


@kernel
def inertia_column(a, b, m, s):
    """U = I s of a motion s (6,)."""
    angular, linear = (s[0], s[1], s[2]), (s[3], s[4], s[5])
    torque = add3(symmetric_times(a, angular), rotate(b, linear))
    force = add3(rotate_back(b, angular), symmetric_times(m, linear))
    return torque[0], torque[1], torque[2], force[0], force[1], force[2]


@kernel
def screw_column(a, b, m, turn, slide):
    """U = I s of a motion that turns about z and slides along it."""
    return (
        turn * a[2] + slide * b[2],
        turn * a[4] + slide * b[5],
        turn * a[5] + slide * b[8],
        turn * b[6] + slide * m[2],
        turn * b[7] + slide * m[4],
        turn * b[8] + slide * m[5],
    )


@kernel
def dot6(u, angular, linear):
    """u^T (angular, linear)."""
    return u[0] * angular[0] + u[1] * angular[1] + u[2] * angular[2] + (
        u[3] * linear[0] + u[4] * linear[1] + u[5] * linear[2]
    )


@kernel
def eliminate_inertia(a, b, m, u, over):
    """I - U D^-1 U^T; ``u`` (6,) is U and ``over`` 1/D."""
    return subtract_outer(a, b, m, u, (over * u[0], over * u[1], over * u[2], over * u[3], over * u[4], over * u[5]))


@kernel
def eliminate_force(torque, force, u, acceleration):
    """p + U D^-1 u; ``acceleration``: D^-1 u, that of the coordinate against an inner side at rest."""
    return (
        add3(torque, scale3(acceleration, (u[0], u[1], u[2]))),
        add3(force, scale3(acceleration, (u[3], u[4], u[5]))),
    )


@kernel
def coordinate_acceleration(u, over, joint_force, angular, linear):
    """qdd = D^-1 (u - U^T a), the inner side accelerating by (angular, linear)."""
    return over * (joint_force - dot6(u, angular, linear))
