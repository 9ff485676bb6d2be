"""The signed distance of a point from a shape, its gradient, and how the gradient turns with the point.

Of most shapes the distance is that of the point from a core, a point, a segment, a line, a disc or a box, less a
radius; of a hollow shape it is the radius less that.  Inside the core of a box or a disc it is that of the nearest
face.  Profiles and surfaces of triangles search tables (``planar_profile``, ``triangle_distance``).  Points and
gradients are in the axes of the shape's frame.  Numbers: the kind, then a, b, c (m), or the half space's normal, or
where the table begins.
"""

from __future__ import annotations

import math

from flexmbd.multibody.kernels.algebra.so3 import add3, dot3, load3, scale3, store3, sub3
from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel
from flexmbd.multibody.kernels.contact.planar_profile import profile_distance, profile_variation
from flexmbd.multibody.kernels.contact.triangle_distance import surface_distance, surface_variation

#: Kinds of shapes: their numbers are the radius; the radius; the radius and half the length; the radius; the radius;
#: half the sides; the unit normal; of the next two the place of the table, and half the thickness, 0 where nothing is
#: behind the surface, of a profile then 1 where its second point is asked for, 0 of the nearest one; of a disc radius
#: and half the thickness of its core, and the radius that rounds its edges.
SPHERE, HOLLOW_SPHERE, CAPSULE, CYLINDER, HOLLOW_CYLINDER, BOX, HALF_SPACE, PROFILE, TRIANGLES, DISC = range(10)

#: Numbers of a shape.
SHAPE_NUMBERS = 4

#: Where among them the place of a table stands, half a thickness, and whether the second point is asked for.
TABLE, HALF_THICKNESS, SECOND = 1, 2, 3


@kernel
def _beyond(x, half):
    """How far x is beyond an interval of this half length, with its sign."""
    return math.copysign(abs(x) - half, x) if abs(x) > half else 0.0


@kernel
def _from_core(data, o, p):
    """The vector to p from the nearest point of the core, and the radius about the core."""
    kind = data[o]
    if kind == BOX:
        return (_beyond(p[0], data[o + 1]), _beyond(p[1], data[o + 2]), _beyond(p[2], data[o + 3])), 0.0
    if kind == CAPSULE:
        return (p[0], p[1], _beyond(p[2], data[o + 2])), data[o + 1]
    if kind == DISC:
        r = math.sqrt(p[0] * p[0] + p[1] * p[1])
        share = 1.0 - data[o + 1] / r if r > data[o + 1] else 0.0
        return (share * p[0], share * p[1], _beyond(p[2], data[o + 2])), data[o + 3]
    if kind == CYLINDER or kind == HOLLOW_CYLINDER:
        return (p[0], p[1], 0.0), data[o + 1]
    return p, data[o + 1]


@kernel
def _nearest_face(data, o, p):
    """Inside a box: the distance (< 0) of the nearest face, and its normal."""
    depth, axis = data[o + 1] - abs(p[0]), 0
    for k in range(1, 3):
        one = data[o + 1 + k] - abs(p[k])
        if one < depth:
            depth, axis = one, k
    sign = math.copysign(1.0, p[axis])
    normal = (sign if axis == 0 else 0.0, sign if axis == 1 else 0.0, sign if axis == 2 else 0.0)
    return -depth, normal


@kernel
def _side_is_nearest(data, o, p, r):
    """Whether from inside the core of a disc, at r from its axis, its side is nearer than its faces."""
    return data[o + 1] - r < data[o + 2] - abs(p[2])


@kernel
def _inside_disc(data, o, p):
    """Inside the core of a disc: signed distance and gradient; NaN where that has no direction.

    So it is on the axis of one that is longer than it is wide, and on a core without thickness.
    """
    r = math.sqrt(p[0] * p[0] + p[1] * p[1])
    if _side_is_nearest(data, o, p, r):
        n = (p[0] / r, p[1] / r, 0.0) if r > 0.0 else (math.nan, math.nan, math.nan)
        return r - data[o + 1] - data[o + 3] if r > 0.0 else math.nan, n
    sign = math.copysign(1.0, p[2]) if data[o + 2] > 0.0 else math.nan
    return sign * p[2] - data[o + 2] - data[o + 3], (0.0, 0.0, sign)


@kernel
def distance(data, o, p):
    """Signed distance (m) of p from the shape at ``data[o]``, and its gradient, a unit vector out of the shape.

    NaN where p is on the core of a solid shape, whose gradient has no direction.
    """
    if data[o] == HALF_SPACE:
        n = (data[o + 1], data[o + 2], data[o + 3])
        return dot3(n, p), n
    if data[o] == PROFILE:
        return profile_distance(data, int(data[o + TABLE]), data[o + SECOND], p)
    if data[o] == TRIANGLES:
        return surface_distance(data, int(data[o + TABLE]), p)
    q, radius = _from_core(data, o, p)
    length = math.sqrt(dot3(q, q))
    hollow = data[o] == HOLLOW_SPHERE or data[o] == HOLLOW_CYLINDER
    if length == 0.0:
        if hollow:  # in the middle, as far from the wall on all sides
            return radius, (1.0, 0.0, 0.0)
        if data[o] == DISC:
            return _inside_disc(data, o, p)
        return _nearest_face(data, o, p) if data[o] == BOX else (math.nan, (math.nan, math.nan, math.nan))
    sign = -1.0 if hollow else 1.0
    return sign * (length - radius), scale3(sign / length, q)


@kernel
def _disc_variation(data, o, p, dp):
    """``gradient_variation`` of a disc."""
    r = math.sqrt(p[0] * p[0] + p[1] * p[1])
    out, across = (p[0] / r, p[1] / r, 0.0) if r > 0.0 else (1.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    away = dot3(out, dp)
    if r > 0.0:
        across = (dp[0] - away * out[0], dp[1] - away * out[1], 0.0)
    q, _ = _from_core(data, o, p)
    length = math.sqrt(dot3(q, q))
    if length == 0.0:
        return scale3(1.0 / r, across) if r > 0.0 and _side_is_nearest(data, o, p, r) else (0.0, 0.0, 0.0)
    dq = (0.0, 0.0, dp[2] if q[2] != 0.0 else 0.0)
    if r > data[o + 1]:  # the core's nearest point goes around with p
        dq = add3(dq, add3(scale3(away, out), scale3(1.0 - data[o + 1] / r, across)))
    n = scale3(1.0 / length, q)
    return scale3(1.0 / length, sub3(dq, scale3(dot3(n, dq), n)))


@kernel
def gradient_variation(data, o, p, dp):
    """How much the gradient at p changes for p + dp."""
    if data[o] == HALF_SPACE:
        return (0.0, 0.0, 0.0)
    if data[o] == PROFILE:
        return profile_variation(data, int(data[o + TABLE]), data[o + SECOND], p, dp)
    if data[o] == TRIANGLES:
        return surface_variation(data, int(data[o + TABLE]), p, dp)
    if data[o] == DISC:
        return _disc_variation(data, o, p, dp)
    q, _ = _from_core(data, o, p)
    length = math.sqrt(dot3(q, q))
    if length == 0.0:
        return (0.0, 0.0, 0.0)
    # the core's nearest point moves along with p in directions in which p is not beyond it
    dq = (dp[0] if q[0] != 0.0 else 0.0, dp[1] if q[1] != 0.0 else 0.0, dp[2] if q[2] != 0.0 else 0.0)
    if data[o] != BOX:
        along = 0.0 if data[o] == CYLINDER or data[o] == HOLLOW_CYLINDER else dp[2]
        if data[o] == CAPSULE and abs(p[2]) <= data[o + 2]:
            along = 0.0
        dq = (dp[0], dp[1], along)
    n = scale3(1.0 / length, q)
    hollow = data[o] == HOLLOW_SPHERE or data[o] == HOLLOW_CYLINDER
    return scale3((-1.0 if hollow else 1.0) / length, sub3(dq, scale3(dot3(n, dq), n)))


@entry_kernel
def distances(data, points, out):
    """Signed distances and gradients, out (n, 4), of points (n, 3) from the shape with which ``data`` begins."""
    for k in range(points.shape[0]):
        far, n = distance(data, 0, load3(points[k], 0))
        out[k, 0] = far
        store3(out[k], 1, n)
