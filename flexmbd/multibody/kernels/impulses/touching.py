"""Where hard contacts are, how their points move against each other, and the structures that hold them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.kernels.algebra.so3 import add3, cross3, dot3, load3, rotate, rotate_back, scale3, store3, sub3
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.array_struct import ArrayStruct
from flexmbd.multibody.kernels.base.arrays import Plan
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.contact.signed_distance import distance
from flexmbd.multibody.kernels.elements.hard_element import (
    CENTRE,
    FRICTION,
    HARD_CONTACT,
    N_LAW,
    POISSON,
    RADIUS,
    RESTITUTION,
)
from flexmbd.multibody.kernels.elements.table import are_of
from flexmbd.multibody.kernels.impulses.group_points import body_velocity, find_groups, take_motions
from flexmbd.multibody.kernels.inverse_dynamics.recursion import frame_motion

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Watched(ArrayStruct):
    """The first ``count`` of k points that may touch, each of a frame G against a frame F, in inertial axes.

    Those of pairs, which are always there, stand first; behind them those of groups of shapes, as they are found.

    Attributes:
        count: (1,).  fastest: (1,) m/s, the largest speed of a point without impulses, in the inertial frame.
        element: (n,) row of ``Plan.elements`` that each of the pairs is of; number: (n,) that element's in the scene.
        frames: (k, 2) rows of ``Plan.frames`` of F and G.
        shapes: (k, 2) those of G and F in their table; -1 of pairs.
        id: (k,) what each is known by from step to step.
        law: (k, N_LAW) of each (``hard_element``).
        point, normal: (k, 3) m, midway where G is nearest to F, and out of F there.
        gap: (k,) m, negative where they overlap.
        before, free: (k, 3) m/s, velocity of G's point against F's at a step's begin, and as it would be at its end
            without impulses.
    """

    count: IntArray
    fastest: FloatArray
    element: IntArray
    number: IntArray
    frames: IntArray
    shapes: IntArray
    id: IntArray
    law: FloatArray
    point: FloatArray
    normal: FloatArray
    gap: FloatArray
    before: FloatArray
    free: FloatArray


def new_watched(plan: Plan, room: int = 0) -> Watched:
    """The hard contacts of pairs of a plan, with room for so many points of groups."""
    chosen: Any = np.flatnonzero(are_of(plan, HARD_CONTACT))
    rows = plan.elements[chosen]
    n, k, zeros = len(rows), len(rows) + room, np.zeros
    frames, law, ids = zeros((k, 2), np.int64), zeros((k, N_LAW)), zeros(k, np.int64)
    frames[:n] = rows[:, [at.EL_F, at.EL_G]]
    law[:n] = plan.data[rows[:, [at.EL_DATA]] + np.array([RESTITUTION, FRICTION, POISSON])]
    ids[:n] = -2 - np.arange(n)
    return Watched(
        np.array([n]), zeros(1), chosen.astype(np.int64), np.ascontiguousarray(rows[:, at.EL_NUMBER]), frames,
        np.full((k, 2), -1), ids, law, zeros((k, 3)), zeros((k, 3)), zeros(k), zeros((k, 3)), zeros((k, 3)),
    )  # fmt: skip


def reached_bodies(plan: Plan, frames: IntArray) -> list[int]:
    """Rows of ``Plan.tree`` of the bodies of frames; -1 of the ground."""
    found: list[int] = plan.frame_of[frames, at.FRAME_BODY].tolist()
    return found


@kernel
def nearest_point(plan, work, row):
    """The point midway between G and F, the normal out of F there (inertial axes), and the gap (m), of an element."""
    o = row[at.EL_DATA]
    p_F, R_F, _, _, _, _ = frame_motion(plan, work, row[at.EL_F])
    p_G, R_G, _, _, _, _ = frame_motion(plan, work, row[at.EL_G])
    centre = add3(p_G, rotate(R_G, load3(plan.data, o + CENTRE)))
    gap, n = distance(plan.data, o, rotate_back(R_F, sub3(centre, p_F)))
    normal = rotate(R_F, n)
    radius = plan.data[o + RADIUS]
    return sub3(centre, scale3(0.5 * (gap + radius), normal)), normal, gap - radius


@kernel
def point_velocity(plan, work, f, p):
    """Velocity (m/s, inertial axes) of a point p fixed in frame f."""
    p_F, R_F, v, w, _, _ = frame_motion(plan, work, f)
    return rotate(R_F, add3(v, cross3(w, rotate_back(R_F, sub3(p, p_F)))))


@kernel
def relative_velocity(plan, work, f, g, p):
    """Velocity (m/s, inertial axes) of the point of frame g at p against that of frame f."""
    return sub3(point_velocity(plan, work, g, p), point_velocity(plan, work, f, p))


@kernel
def _velocities(plan, work, watched, groups, i):
    """Velocities (m/s, inertial axes) of both points of i, of F and of G."""
    p, k = load3(watched.point[i], 0), i - watched.element.shape[0]
    if k < 0:
        return point_velocity(plan, work, watched.frames[i, 0], p), point_velocity(plan, work, watched.frames[i, 1], p)
    bodies = groups.out.bodies[k]
    return body_velocity(groups, bodies[1], p), body_velocity(groups, bodies[0], p)


@kernel
def place(plan, work, watched, groups, h):
    """Write where all points are and how they move against each other, by the kinematics in ``work``.

    Returns how many are of groups, or why these were not found (negative, ``contact.finding``).
    """
    n = watched.element.shape[0]
    for i in range(n):
        point, normal, gap = nearest_point(plan, work, plan.elements[watched.element[i]])
        store3(watched.point[i], 0, point)
        store3(watched.normal[i], 0, normal)
        watched.gap[i] = gap
    found = find_groups(plan, work, groups, watched, h)
    watched.count[0] = n + max(found, 0)
    for i in range(watched.count[0]):
        one, other = _velocities(plan, work, watched, groups, i)
        store3(watched.before[i], 0, sub3(other, one))
    return found


@kernel
def foresee(plan, work, watched, groups):
    """Write the velocities without impulses, by the kinematics in ``work``; the largest change since ``before``."""
    largest, fastest = 0.0, 0.0
    if groups.frame.shape[0] > 0:
        take_motions(plan, work, groups)
    for i in range(watched.count[0]):
        one, other = _velocities(plan, work, watched, groups, i)
        free = sub3(other, one)
        store3(watched.free[i], 0, free)
        fastest = max(fastest, dot3(one, one), dot3(other, other))
        change = sub3(free, load3(watched.before[i], 0))
        largest = max(largest, dot3(change, change))
    watched.fastest[0] = math.sqrt(fastest)
    return math.sqrt(largest)
