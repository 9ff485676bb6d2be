"""What the force elements of a plan exert, store and change by at a configuration, of the elements alone."""

from __future__ import annotations

import numpy as np

from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.kernels.inverse_dynamics.canonical import write_potential
from flexmbd.multibody.kernels.inverse_dynamics.recursion import forward_kinematics
from flexmbd.multibody.kernels.inverse_dynamics.residual import residual
from flexmbd.multibody.kernels.physics.joints import retract
from flexmbd.multibody.kernels.tangent.residual_tangent import tangent
from flexmbd.multibody.kernels.tangent.tangent_layout import new_tangent_work


def generalised_force(plan, x):
    """Of the elements alone."""
    nv = len(plan.free)
    rest, found = np.zeros(nv), np.zeros((2, nv))
    for out, one in zip(found, (plan, plan.replace(elements=plan.elements[:0])), strict=True):
        residual(one, new_work(plan), x, rest, rest, np.zeros(0), out)
    return found[1] - found[0]


def energy(plan, x):
    """Of the elements alone."""
    found = np.zeros((2, 1))
    for out, one in zip(found, (plan, plan.replace(elements=plan.elements[:0])), strict=True):
        work, rest = new_work(one), np.zeros(len(plan.free))
        forward_kinematics(one, work, x, rest, rest)
        write_potential(one, work, x, out)
    return found[0, 0] - found[1, 0]


def differenced(plan, x, function, step):
    """(nv, ...) derivatives of a function of the configuration, by central differences of order 4."""
    found = []
    for unit in np.eye(len(plan.free)):
        values = []
        for k in (-2, -1, 1, 2):
            place = np.empty_like(x)
            retract(plan, x, k * step * unit, place)
            values.append(np.asarray(function(plan, place)))
        found.append((values[0] - 8.0 * values[1] + 8.0 * values[2] - values[3]) / (12.0 * step))
    return np.array(found)


def analytic(plan, x):
    nv = len(plan.free)
    found, rest = np.zeros((2, nv, nv)), np.zeros(nv)
    for out, one in zip(found, (plan, plan.replace(elements=plan.elements[:0])), strict=True):
        tw = new_tangent_work(one, nv, sizes=np.ones((2, nv)))
        tangent(one, new_work(one), tw, x, rest, rest, np.zeros(0), 1.0, 0.0, 0.0, out)
    return found[1] - found[0]
