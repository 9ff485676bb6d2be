"""How much of a step of statics may be gone before a contact would come out on the far side of what it meets."""

from __future__ import annotations

import math

from flexmbd.multibody.kernels.algebra.so3 import add3, cross3, dot3, rotate, scale3
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.block_view import matrix_view
from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel
from flexmbd.multibody.kernels.contact.contact_law import way_to_middle
from flexmbd.multibody.kernels.contact.normal_force import RADIUS
from flexmbd.multibody.kernels.contact.signed_distance import PROFILE, TRIANGLES, distance
from flexmbd.multibody.kernels.elements import surface_layout as sl
from flexmbd.multibody.kernels.elements.contact_wrench import centre_motion, law_numbers
from flexmbd.multibody.kernels.elements.surface_points import by_modes, displaced, farthest, move_others, place_point
from flexmbd.multibody.kernels.elements.table import is_of_surface
from flexmbd.multibody.kernels.inverse_dynamics.closure import relative_rates
from flexmbd.multibody.kernels.inverse_dynamics.recursion import forward_kinematics
from flexmbd.multibody.kernels.inverse_dynamics.surface_loads import modes_of, other_modes_of

#: Columns: the share of the step, that at which it may touch, and the gap (m) before it.
SHARE, TOUCH, GAP, N_PASSING = 0, 1, 2, 3
_HALVINGS = 50


@kernel
def _room(way, gap):
    """How far a point may come nearer (m): to half of the way to the middle, once inside by half of what is left."""
    return gap + 0.5 * way if gap > 0.0 else 0.5 * (gap + way)


@kernel
def _on_one_side(data, o, place, n, speed, share):
    """As much of a share as leaves a point inside on the side it is pushed out of along n, not past an edge's middle."""
    for _ in range(_HALVINGS):
        far, normal = distance(data, o, add3(place, scale3(share, speed)))
        if not far < 0.0 or dot3(n, normal) > 0.5:
            break
        share *= 0.5
    return share


@kernel
def _shares(data, o, way, gap, place, n, speed, beside):
    """Of a step by ``speed`` (m) of a point, and of its shape by ``beside`` at most: what is allowed, where it touches.

    The distance from a convex shape is a convex function along a straight line: it falls by no more than at first.
    """
    nearer = beside - dot3(n, speed)
    if not nearer > 0.0:
        return math.inf, math.inf
    if data[o] == PROFILE or data[o] == TRIANGLES:
        nearer = beside + math.sqrt(dot3(speed, speed))
    share = math.inf if way == math.inf else _room(way, gap) / nearer
    if gap < 0.0 and way < math.inf:
        whole = min(share, 1.0)
        kept = _on_one_side(data, o, place, n, speed, whole)
        share = share if kept == whole else 0.5 * kept
    return share, max(gap, 0.0) / nearer


@kernel
def _of_patches(plan, work, row, x, step, out):
    """Write the shares and the gap of a surface's patch that allows least."""
    t, p, n = sl.table_of(plan, row)
    t_other, size, n_other = sl.other_of(plan, row)
    qx, qv, _ = modes_of(plan, row)
    rx, rv, _ = other_modes_of(plan, row)
    o = row[at.EL_DATA] + sl.SHAPE
    radius = plan.data[row[at.EL_DATA] + sl.POINT_RADIUS]
    weights = matrix_view(work.generalized, sl.weights_place(p), p, size)
    others = matrix_view(work.generalized, sl.others_place(p, size), size, sl.N_OTHER)
    d, R, rate, spin = relative_rates(plan, work, row[at.EL_F], row[at.EL_G])
    move_others(plan, work, row, x[rx : rx + n_other])
    beside, way = 0.0, way_to_middle(plan.data, o)
    if size > 0:
        beside = farthest(plan.data, t_other, n_other, step[rv : rv + n_other])
    for i in range(p):
        arm = rotate(R, displaced(plan.data, p, n, t, i, x[qx : qx + n]))
        gap, normal, foot = place_point(plan, row, d, arm, weights[0], others)
        by_mode = by_modes(plan.data, sl.displacements(p, n, t, i), n, step[qv : qv + n])
        speed = add3(add3(rate, cross3(spin, arm)), rotate(R, by_mode))
        felt = gap < math.inf
        if not felt:  # beside the other surface, or so far away that none of its patches feels it
            gap, normal = distance(plan.data, o, add3(d, arm))
            gap -= radius
            if not gap > 0.0:
                continue
        share, touch = _shares(plan.data, o, way, gap, foot, normal, speed, beside)
        nearer = beside - dot3(normal, speed)
        if size > 0 and nearer > 0.0:  # further behind its patches nothing feels it
            share = min(share, _room(plan.data[t_other + sl.SUPPORT], gap) / nearer)
        out[TOUCH] = min(out[TOUCH], touch)
        if share < out[SHARE]:
            out[SHARE], out[GAP] = share, gap


@entry_kernel
def passing_shares(plan, work, elements, x, step, out):
    """out[k] of contact ``elements[k]`` (rows of ``plan.elements``): shares of a step (nv,), and its gap.

    Infinite where nothing is passed, as by what goes away, or before a half space, which has no far side.  Half of the
    way to the middle of what is met is allowed from outside, and half of what is left of it from inside.
    """
    forward_kinematics(plan, work, x, step, step)
    for k in range(elements.shape[0]):
        row = plan.elements[elements[k]]
        out[k, SHARE], out[k, TOUCH], out[k, GAP] = math.inf, math.inf, 0.0
        if is_of_surface(row[at.EL_KIND]):
            _of_patches(plan, work, row, x, step, out[k])
            continue
        o = law_numbers(plan, row)
        d, R, rate, spin = relative_rates(plan, work, row[at.EL_F], row[at.EL_G])
        _, place, speed = centre_motion(plan, o, d, R, rate, spin)
        gap, n = distance(plan.data, o, place)
        out[k, GAP] = gap - plan.data[o + RADIUS]
        way = way_to_middle(plan.data, o)
        out[k, SHARE], out[k, TOUCH] = _shares(plan.data, o, way, out[k, GAP], place, n, speed, 0.0)
