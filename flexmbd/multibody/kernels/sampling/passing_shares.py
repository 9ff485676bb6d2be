"""How much of a step of statics may be gone before a contact would come out on the far side of what it meets."""

from __future__ import annotations

import math

from flexmbd.multibody.kernels.algebra.so3 import add3, dot3, load3, scale3, store3, store9
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel
from flexmbd.multibody.kernels.contact.contact_law import way_to_middle
from flexmbd.multibody.kernels.contact.normal_force import RADIUS
from flexmbd.multibody.kernels.contact.signed_distance import PROFILE, TRIANGLES, distance
from flexmbd.multibody.kernels.elements.contact_wrench import centre_motion, law_numbers
from flexmbd.multibody.kernels.inverse_dynamics.closure import relative_rates
from flexmbd.multibody.kernels.inverse_dynamics.recursion import forward_kinematics

#: Columns: the share of the step, that at which it may touch, and the gap (m) before it.
SHARE, TOUCH, GAP, N_PASSING = 0, 1, 2, 3
_HALVINGS = 50


@kernel
def _room(way, gap):
    """How far a point may come nearer (m): to half of the way to the middle, once inside by half of what is left."""
    return gap + 0.5 * way if gap > 0.0 else 0.5 * max(gap + way, 0.0)


@kernel
def _on_one_side(data, o, place, n, speed, share):
    """As much of a share as leaves a point inside on the side it is pushed out of along n, not past a middle."""
    for _ in range(_HALVINGS):
        far, normal = distance(data, o, add3(place, scale3(share, speed)))
        if not far < 0.0 or dot3(n, normal) > 0.5:
            break
        share *= 0.5
    return share


@kernel
def _write_shares(data, o, radius, depth, place, speed, beside, out):
    """Write a row, of a step by ``speed`` (m) of a point, and of its shape by ``beside`` at most.

    ``depth``: how far behind the shape's surface a point is felt (m).  The distance from a convex shape is a convex
    function along a straight line: it falls by no more than at first.
    """
    gap, n = distance(data, o, place)
    gap -= radius
    out[SHARE], out[TOUCH], out[GAP] = math.inf, math.inf, gap
    nearer = beside - dot3(n, speed)
    if not nearer > 0.0:
        return
    out[TOUCH] = max(gap, 0.0) / nearer
    if depth < math.inf:
        out[SHARE] = _room(depth, gap) / nearer
    way = way_to_middle(data, o)
    if way < math.inf:
        if data[o] == PROFILE or data[o] == TRIANGLES:
            nearer = beside + math.sqrt(dot3(speed, speed))
        out[SHARE] = min(out[SHARE], _room(way, gap) / nearer)
        if gap < 0.0:
            whole = min(out[SHARE], 1.0)
            kept = _on_one_side(data, o, place, n, speed, whole)
            if kept < whole:
                out[SHARE] = 0.5 * kept


@entry_kernel
def passing_shares(plan, work, elements, x, step, out):
    """out[k] of contact ``elements[k]`` (rows of ``plan.elements``) by a law: shares of a step (nv,), and its gap.

    Infinite where nothing is passed, as by what goes away, or before a half space, which has no far side.  Half of the
    way to the middle of what is met is allowed from outside, and half of what is left of it from inside.
    """
    forward_kinematics(plan, work, x, step, step)
    for k in range(elements.shape[0]):
        row = plan.elements[elements[k]]
        o = law_numbers(plan, row)
        d, R, rate, spin = relative_rates(plan, work, row[at.EL_F], row[at.EL_G])
        _, place, speed = centre_motion(plan, o, d, R, rate, spin)
        _write_shares(plan.data, o, plan.data[o + RADIUS], math.inf, place, speed, 0.0, out[k])


@entry_kernel
def step_between_frames(plan, work, row, x, step, out):
    """Of frame G for F of a row of ``plan.elements``, in F's axes: place (3), R (9), how a step (nv,) moves it (6)."""
    forward_kinematics(plan, work, x, step, step)
    d, R, rate, spin = relative_rates(plan, work, plan.elements[row, at.EL_F], plan.elements[row, at.EL_G])
    store3(out, 0, d)
    store9(out, 3, R)
    store3(out, 12, rate)
    store3(out, 15, spin)


@entry_kernel
def point_shares(data, o, radius, depth, places, speeds, beside, out):
    """out[k] (n, N_PASSING) as of ``passing_shares``, of points at ``places`` (n, 3) m that a step moves by ``speeds``.

    Args:
        data: float64, ``plan.data``.
        o: int64, where in it the shape's numbers are.
        radius: float64, m, of the points.
        depth: float64, m, how far behind the surface they are felt.
        places: (n, 3) float64, m, in the shape's axes.
        speeds: (n, 3) float64, m.
        beside: float64, m, by which the step moves the shape's surface at most.
        out: (n, N_PASSING) float64, output.
    """
    for k in range(places.shape[0]):
        _write_shares(data, o, radius, depth, load3(places[k], 0), load3(speeds[k], 0), beside, out[k])
