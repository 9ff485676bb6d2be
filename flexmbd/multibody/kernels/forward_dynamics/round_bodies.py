"""Axisymmetric bodies, whose steady spin is taken out of the unknowns of a step: despun axes.

A fast top turns much more often than its axis moves.  Its inertia is constant in the despun axes B', which follow the
body but for a steady spin s about its axis e, R = R' exp(t s e), and the motion in them is slow:

    eta = exp(t s e) w,    w' = eta - s e,    d eta/dt = exp(t s e) dw/dt + s e x eta,

where w and dw/dt are in the body's axes, eta and the angular velocity w' of B' in those of B'.  For other bodies the
axis is zero and nothing changes.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.kernels.algebra.so3 import add3, cross3, dot3, load3, quaternion_product, scale3, store3, sub3
from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.arrays import FloatArray, IntArray, Plan
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.forward_dynamics.articulated_layout import body_about_joint
from flexmbd.round_off import TEN_DIGITS

_ROUND = TEN_DIGITS  # the share of a moment of inertia by which two that are equal may differ


def round_axes(plan: Plan, quaternions: IntArray) -> FloatArray:
    """(k, 3) axes of the bodies behind ``quaternions`` (``coordinate_slots``), in the axes that their spins are in.

    Zero for a body that is not round about one axis through the origin of its joint, that bends, or carries another.
    """
    axes = np.zeros((len(quaternions), 3))
    for k, (in_x, _) in enumerate(quaternions):
        start = plan.tree[:, at.JOINT_X] + plan.tree[:, at.JOINT_ADDS]
        turning = plan.tree[:, at.JOINT_TURN] == kinds.TURN_BALL
        i = int(np.flatnonzero((start == in_x) & turning)[0])
        if plan.tree[i, at.FLEX] < 0 and not (plan.tree[:, at.PARENT] == i).any():
            axes[k] = _axis(*body_about_joint(plan, i)[1:])
    return axes


def _axis(first: NDArray[np.float64], tensor: NDArray[np.float64]) -> NDArray[np.float64]:
    values, vectors = np.linalg.eigh(tensor)
    near = np.diff(values) <= _ROUND * values[2]
    if near[0] == near[1]:
        return np.zeros(3)
    axis: NDArray[np.float64] = vectors[:, 2 if near[0] else 0]
    beside = np.abs(np.cross(first, axis)).max()
    return axis if beside <= _ROUND * np.abs(first).max() else np.zeros(3)


@kernel
def turn_about(e, c, s, v):
    """v turned about the unit vector e by the angle of cosine c and sine s; v itself where e is zero and c one."""
    return add3(add3(scale3(c, v), scale3(s, cross3(e, v))), scale3((1.0 - c) * dot3(e, v), e))


@kernel
def despun_motion(e, spin, c, s, w, dw):
    """Angular velocity of B' and d eta/dt from the body's w and dw/dt; c, s: cosine and sine of the angle t spin."""
    eta = turn_about(e, c, s, w)
    bend = scale3(spin, cross3(e, eta))
    return sub3(eta, scale3(spin, e)), add3(turn_about(e, c, s, dw), bend)


@kernel
def begin_spin(quaternions, axes, v, spins):
    """Begin a step: write the rates of the bodies about their axes into ``spins`` (k, 3), and the angle 0."""
    for i in range(spins.shape[0]):
        store3(spins[i], 0, (dot3(load3(axes[i], 0), load3(v, quaternions[i, 1])), 1.0, 0.0))


@kernel
def to_spinning_axes(quaternions, axes, spins, t, x, v):
    """From B' to the body's axes, t after the step's start: quaternions of x and velocities of v.

    Cosine and sine of the angle stay in ``spins``.
    """
    for i in range(spins.shape[0]):
        half = 0.5 * spins[i, 0] * t
        c = math.cos(half)
        s = math.sin(half)
        o = quaternions[i, 0]
        e = load3(axes[i], 0)
        turned = quaternion_product((x[o], x[o + 1], x[o + 2], x[o + 3]), (c, s * e[0], s * e[1], s * e[2]))
        x[o] = turned[0]
        store3(x, o + 1, (turned[1], turned[2], turned[3]))
        spins[i, 1] = c * c - s * s
        spins[i, 2] = 2.0 * c * s
    vectors_to_spinning_axes(quaternions, axes, spins, v)


@kernel
def vectors_to_spinning_axes(quaternions, axes, spins, v):
    """Take the bodies' entries of the tangent vector v from the axes of B' to those of the bodies."""
    for i in range(spins.shape[0]):
        o = quaternions[i, 1]
        store3(v, o, turn_about(load3(axes[i], 0), spins[i, 1], -spins[i, 2], load3(v, o)))


@kernel
def despun_rates(quaternions, axes, spins, rate_x, rate_v):
    """Make angular velocities and accelerations in the bodies' axes those of B' and of eta."""
    for i in range(spins.shape[0]):
        o = quaternions[i, 1]
        w, dw = load3(rate_x, o), load3(rate_v, o)
        w, dw = despun_motion(load3(axes[i], 0), spins[i, 0], spins[i, 1], spins[i, 2], w, dw)
        store3(rate_x, o, w)
        store3(rate_v, o, dw)
