"""Contacts that touch at instants of a step, which may let go, and the coordinates that move against them."""

from __future__ import annotations

import math

import numpy as np

from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.deferred import NUMBER, deferred_kernel
from flexmbd.multibody.kernels.elements.table import frame_gap, may_touch
from flexmbd.multibody.kernels.inverse_dynamics.closure import relative_rates
from flexmbd.multibody.kernels.inverse_dynamics.recursion import forward_kinematics

_GRAZED = 1e-6  # of the gaps at its ends: a dip that is no deeper is none
BEARS, CROSSES = 1.0, 2.0  #: A contact touches throughout the step; it sets in or lets go within it.


@deferred_kernel()
def count_touching(plan, work, x, v, touched, gaps):
    """Add one to ``touched`` (ne,) of each contact that touches at x (nx,), v (nv,).

    ``gaps``: (ne, 2) of each its gap (m) and the gap's rate (m/s) there.
    """
    forward_kinematics(plan, work, x, v, v)
    for i in range(touched.shape[0]):
        row = plan.elements[i]
        if may_touch(row[at.EL_KIND]):
            d, R, rate, spin = relative_rates(plan, work, row[at.EL_F], row[at.EL_G])
            gaps[i, 0], gaps[i, 1] = frame_gap(plan, row, d, R, rate, spin)
            if gaps[i, 0] < 0.0:
                touched[i] += 1.0


@kernel
def _dip(first, last, duration):
    """When (s) a gap, the cubic with both ends' values and rates, is least; infinite where it stays open."""
    g, r, grown = first[0], first[1] * duration, last[0] - first[0]
    if not (g > 0.0 and last[0] > 0.0 and r < 0.0 and last[1] > 0.0):
        return np.inf
    second, third = 3.0 * grown - 2.0 * r - last[1] * duration, r + last[1] * duration - 2.0 * grown
    root = math.sqrt(max(second * second - 3.0 * r * third, 0.0))
    u = -r / (second + root)  # where the rate is zero and grows
    least = g + u * (r + u * (second + u * third))
    return u * duration if least < -_GRAZED * max(g, last[0]) else np.inf


@deferred_kernel(NUMBER)
def time_of_touch(first, last, duration):
    """When (s) after ``first`` any contact touches between two looks at its gap, with none at either; else infinite.

    first, last: (ne, 2), see ``count_touching``; ``duration``: s, from one to the other.
    """
    soonest = np.inf
    for i in range(first.shape[0]):
        soonest = min(soonest, _dip(first[i], last[i], duration))
    return soonest


@deferred_kernel(NUMBER)
def time_to_touch(gaps):
    """The time (s) in which the first of the gaps (ne, 2), see ``count_touching``, closes at the rate that it has."""
    soonest = np.inf
    for i in range(gaps.shape[0]):
        if gaps[i, 0] > 0.0 and gaps[i, 1] < 0.0:
            soonest = min(soonest, gaps[i, 0] / -gaps[i, 1])
    return soonest


@kernel
def _mark_joint(plan, b, mark, held):
    """Mark the velocities of the inboard joint of link b; the link's parent."""
    link = plan.tree[b]
    for k in range(link[at.JOINT_V], link[at.JOINT_V] + link[at.JOINT_SIZE]):
        held[k] = max(held[k], mark)
    return link[at.PARENT]


@deferred_kernel()
def mark_held(plan, touched, instants, held):
    """Write into ``held`` (nv,) BEARS where a coordinate moves a contact that has ``touched`` (ne,), 0 elsewhere.

    CROSSES where the contact has not touched at all of the ``instants``.  Coordinates of the joints between both bodies
    along the tree; all where loops link them.
    """
    for k in range(held.shape[0]):
        held[k] = 0.0
    for i in range(touched.shape[0]):
        if touched[i] == 0.0:
            continue
        mark = BEARS if touched[i] == instants else CROSSES
        if plan.rows.shape[0] > 0:
            for k in range(held.shape[0]):
                held[k] = max(held[k], mark)
            continue
        row = plan.elements[i]
        b = plan.frame_of[row[at.EL_F], at.FRAME_BODY]
        c = plan.frame_of[row[at.EL_G], at.FRAME_BODY]
        while b != c:  # parents come before children, the ground is -1
            if b > c:
                b = _mark_joint(plan, b, mark, held)
            else:
                c = _mark_joint(plan, c, mark, held)
