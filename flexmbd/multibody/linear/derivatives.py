"""Analytic derivatives of a machine's equations of motion and rows, for linearising."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.kernels.base.arrays import Plan, Work
from flexmbd.multibody.kernels.tangent.residual_tangent import tangent
from flexmbd.multibody.kernels.tangent.tangent_layout import new_tangent_work
from flexmbd.multibody.plan.scene_matrices import fastest_rate

FloatArray = NDArray[np.float64]


#: What kernels are compiled for before the first derivatives.
DERIVING = "equilibria and linear machines"


@dataclass(frozen=True, eq=False)
class Derivatives:
    """Derivatives of ``kernels.residual`` and of the rows.

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
    plan: Plan,
    work: Work,
    x: FloatArray,
    v: FloatArray,
    multipliers: FloatArray,
    *,
    size: FloatArray,
    a: FloatArray | None = None,
) -> Derivatives:
    """Derivatives at configuration x (nx,), velocities v (nv,) and multipliers (m,); ``work.time`` up to date.

    ``a``: (nv,) accelerations, zeros by default.
    ``size``: (nv,) the machine's, in each coordinate's unit: of it users' functions are moved by a share, and of what
    the machine's own rate makes of it for derivatives by velocities.
    """
    nv = len(v)
    a = np.zeros(nv) if a is None else a
    sizes = np.stack([size, np.zeros(nv)])
    tw = new_tangent_work(plan, nv, sizes=sizes)
    found = np.zeros((3, nv, nv))
    slopes = np.zeros((3, *tw.rate_jacobian.shape))
    for k in (0, 2, 1):
        if k == 1:
            sizes[1] = size * fastest_rate(found[2], found[0])
        per_x, per_v, per_a = np.eye(3)[k]
        tangent(plan, work, tw, x, v, a, multipliers, per_x, per_v, per_a, found[k])
        slopes[k] = tw.rate_jacobian
    return Derivatives(found[2], found[1], found[0], tw.jacobian.copy(), slopes[0])
