"""Analytic derivatives of a machine's equations of motion and rows, for linearising."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.kernels.base.arrays import Plan, Work
from flexmbd.multibody.kernels.reading.tree import tree_joints
from flexmbd.multibody.kernels.tangent.residual_tangent import tangent
from flexmbd.multibody.kernels.tangent.tangent_layout import new_tangent_work
from flexmbd.multibody.plan.scene_matrices import fastest_rate

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Derivatives:
    """Derivatives of ``kernels.residual`` and of the rows, accelerations zero.

    Small changes of the configuration are tangent vectors of ``kernels.joints.retract``: rotations in the axes of the
    frame that they turn.

    Attributes:
        mass, damping, stiffness: (nv, nv) by accelerations, velocities, configuration; those of the reactions
            J^T nu by the configuration included.
        jacobian: (m, nv) J, of the rows by the configuration, and of their rates by velocities.
        rate_slope: (m, nv) of the rows' rates by the configuration.
    """

    mass: FloatArray
    damping: FloatArray
    stiffness: FloatArray
    jacobian: FloatArray
    rate_slope: FloatArray


def derive(
    plan: Plan, work: Work, x: FloatArray, v: FloatArray, multipliers: FloatArray, *, size: FloatArray
) -> Derivatives:
    """Derivatives at configuration x (nx,), velocities v (nv,) and multipliers (m,); ``work.time`` up to date.

    ``size``: (nv,) the machine's, in each coordinate's unit: of it users' functions are moved by a share, and of what
    the machine's own rate makes of it for derivatives by velocities.
    """
    nv = len(v)
    sizes = np.stack([size, np.zeros(nv)])
    tw = new_tangent_work(plan, nv, sizes=sizes)
    found = np.zeros((3, nv, nv))
    slopes = np.zeros((3, *tw.rate_jacobian.shape))
    for k in (0, 2, 1):
        if k == 1:
            sizes[1] = size * fastest_rate(found[2], found[0])
        per_x, per_v, per_a = np.eye(3)[k]
        tangent(plan, work, tw, x, v, np.zeros(nv), multipliers, per_x, per_v, per_a, found[k])
        slopes[k] = tw.rate_jacobian
    return Derivatives(found[2], found[1], found[0], tw.jacobian.copy(), slopes[0])


def angular_rate_matrix(plan: Plan, v: FloatArray) -> FloatArray:
    """A (nv, nv) of d xi/dt = dv - A xi, for small changes xi and dv of configuration and velocities v (nv,).

    R exp(xi) has the angular velocity w + d xi/dt + w x xi in its own axes.
    """
    A = np.zeros((len(v), len(v)))
    if not v.any():
        return A
    for joint in tree_joints(plan):
        if joint.spin is not None:
            x, y, z = v[joint.spin]
            A[joint.spin, joint.spin] = [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]
    return A
