"""Forces from the ground in the recursion over the tree: what a body's place and speed change of the wrench on it.

The ground does not move, so that such a force belongs to its body alone, whatever joints lie between: it is part of the
body's ``answer`` (``tree_recursion``) to its twist, phi and r, and to their rates.
"""

from __future__ import annotations

from flexmbd.multibody.kernels.algebra.so3 import add3, cross3, rotate, sub3
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.deferred import deferred_kernel
from flexmbd.multibody.kernels.elements.table import element_wrench, element_wrench_variation, is_between_frames
from flexmbd.multibody.kernels.inverse_dynamics.closure import relative_motion
from flexmbd.multibody.kernels.tangent.frame_pairs import is_from_ground, pair_frames, relative_variation
from flexmbd.multibody.kernels.tangent.tree_recursion import RATE, SHIFT, TURN

_NOT_DIFFERENCED = 1.0  # the recursion does not serve laws that have no derivative


@kernel
def _unit(entry, first, size):
    """Of a motion that has 1 in one entry the vector from ``first`` on, times ``size``."""
    k = entry - first
    return (size if k == 0 else 0.0, size if k == 1 else 0.0, size if k == 2 else 0.0)


@kernel
def _add_answer(plan, work, tw, row, answer):
    """Add what an applied force, which is subtracted, changes by each entry of its body's motion."""
    f, g = row[at.EL_F], row[at.EL_G]
    pulls_G = plan.frame_of[g, at.FRAME_BODY] >= 0
    sign = 1.0 if pulls_G else -1.0
    d, R, rate, spin, _, _ = relative_motion(plan, work, f, g)
    c_F, c_G, v_G, w_F, w_G, R_F = pair_frames(plan, work, tw, f, g)
    force, torque = element_wrench(plan, work, row, d, R, rate, spin)
    pull = rotate(R_F, force)
    moment = add3(rotate(R_F, torque), cross3(c_G, pull))
    for k in range(12):
        entry = k if k < 3 else RATE - 3 + k
        phi, r, turned = _unit(entry, TURN, sign), _unit(entry, SHIFT, sign), _unit(entry, 0, sign)
        moved = _unit(entry, RATE, sign)
        dd, dtheta, drate, dspin = relative_variation(phi, r, turned, moved, c_G, v_G, w_F, w_G, R_F)
        dforce, dtorque = element_wrench_variation(
            plan, work, row, d, R, rate, spin, dd, dtheta, drate, dspin, _NOT_DIFFERENCED
        )
        dmoment = add3(dtorque, add3(cross3(dd, force), cross3(d, dforce)))
        change = rotate(R_F, dforce)
        twist = add3(rotate(R_F, dmoment), cross3(c_F, change))
        if pulls_G:  # that the wrench on a body turns with it is part of its columns already
            change = sub3(change, cross3(phi, pull))
            twist = sub3(twist, add3(cross3(phi, moment), cross3(r, pull)))
        for c in range(3):
            answer[c, entry] -= sign * change[c]
            answer[3 + c, entry] -= sign * twist[c]


@deferred_kernel()
def add_ground_forces(plan, work, tw, answer):
    """Add all forces between the ground and a body to the ``answer`` (bodies, 6, MOTION_AND_PLACE) of the bodies."""
    for i in range(plan.elements.shape[0]):
        row = plan.elements[i]
        if is_between_frames(row[at.EL_KIND]) and is_from_ground(plan, row):
            body = max(plan.frame_of[row[at.EL_F], at.FRAME_BODY], plan.frame_of[row[at.EL_G], at.FRAME_BODY])
            if body >= 0:
                _add_answer(plan, work, tw, row, answer[body])
