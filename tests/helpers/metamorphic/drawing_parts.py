"""Parts, joints, markers and functions of time of random machines, for hypothesis: numbers on coarse grids."""

from __future__ import annotations

import functions_of_time as of_time
import joint_motion as jm
import numpy as np
from beam_records import Beam
from hypothesis import strategies as st
from mesh_records import SHAPES, Meshed
from random_machine import Mark, Pseudo, Rigid
from scipy.interpolate import PPoly

import flexmbd as fm

grid = st.integers(-8, 8).map(lambda k: k / 8.0)
size = st.integers(1, 8).map(lambda k: k / 8.0)
point = st.tuples(grid, grid, grid).map(lambda p: 0.5 * np.array(p))
rotation = st.tuples(grid, grid, grid).map(lambda r: jm.turned(2.0 * np.array(r), 1.0))
axis = st.one_of(
    st.sampled_from(["x", "y", "z"]),
    st.tuples(grid, grid, grid).filter(any).map(lambda a: a),
)


@st.composite
def inertias(draw):
    """(3, 3) of a body of 1 kg: any that a body of some tenths of a metre may have."""
    a, b, c = (draw(size) / 16.0 for _ in range(3))
    R = draw(rotation)
    return R @ np.diag([b + c, a + c, a + b]) @ R.T


@st.composite
def rigid_bodies(draw):
    mass = 4.0 * draw(size)
    return Rigid(mass, 0.5 * draw(point), mass * draw(inertias()))


pseudo_rigid_bodies = st.builds(
    lambda a, b, c, E, damping: Pseudo(1000.0, 0.125 + 0.25 * np.array([a, b, c]), E * 2.0**22, 0.25, damping),
    size, size, size, size, st.sampled_from([0.0, 0.03125]),
)  # fmt: skip
beams = st.builds(
    lambda length, width, height, E, modes, damping, frame: Beam(
        0.5 + 0.5 * length, (1 + width) / 32.0, (1 + height) / 32.0, (1 + E) * 2.0**31, 1024.0, modes, damping, frame
    ),
    size, size, size, size, st.sampled_from([0, 2, 5]), st.sampled_from([0.0, 0.03125]),
    st.sampled_from(["a", "b", None]),
)  # fmt: skip
#: A handful, since each is reduced once.
meshed_parts = st.builds(
    lambda shape, modes, frame: Meshed(shape, 1.0, 2.0**31, 1024.0, modes, modes / 64.0, frame),
    st.sampled_from(list(SHAPES)), st.sampled_from([0, 2]), st.sampled_from(["a", "b", None]),
)  # fmt: skip
BODIES = {"rigid": rigid_bodies(), "pseudo": pseudo_rigid_bodies, "beam": beams, "mesh": meshed_parts}


def joints(draw, kinds):
    """A joint of one of these kinds."""
    name = draw(st.sampled_from(kinds))
    kind = getattr(fm.joint, name)
    if name in ("Spherical", "Fixed", "Free"):
        return kind()
    if name == "Universal":
        T = draw(rotation)
        return kind(tuple(T[:, 0]), tuple(T[:, 1]))
    if name in ("Distance", "RollingDisc"):
        return kind(0.25 + 0.5 * draw(size))
    direction = draw(axis)
    if name == "Screw":
        return kind(draw(st.sampled_from([0.125, -0.5])), direction)
    return kind(direction)


def mark_on(draw, part, *, deep=True):
    """A marker on a part: anywhere on a rigid one, on an interface of a reduced one."""
    if part is None:
        return Mark("ground", draw(point), draw(rotation))
    if part.reduced:
        return interface(part, draw(st.sampled_from(["a", "b"])))
    p = draw(point)
    if isinstance(part.body, Pseudo):
        p = p * part.body.sides if deep else np.zeros(3)
    return Mark(part.name, p, draw(rotation))


def interface(part, name):
    p, R = part.body.interface(name)
    return Mark(part.name, p, R, name)


TREE = ("Revolute", "Prismatic", "Screw", "Cylindrical", "Planar", "Universal", "Spherical", "Fixed", "Free")
GEARED = ("Revolute", "Revolute", "Prismatic", "Screw", "Cylindrical", "Universal")
LOOP = (
    "Spherical", "PointOnPlane", "Distance", "PointOnLine", "Planar", "Cylindrical", "Universal", "ConstantVelocity",
    "Revolute", "Prismatic", "Screw", "RollingDisc",
)  # fmt: skip
SMOOTH = ("constant", "sine", "table")
#: Of loads, and of motions: values that jump, slopes, and short pulses in tables; accelerations that jump, and rates,
#: for which there is an impulse.  Some are data, in which breaks are found, some functions whose breaks are declared.
STEPPED = (*SMOOTH, "jump", "pulse", "kink")
JUMPING = (*STEPPED, "spike")
BENDING = (*SMOOTH, "bend")
STOPPING = (*SMOOTH, "bend", "stop")

#: Breaks lie on this many equal shares of the duration.
SHARES = 32


@st.composite
def functions(draw, kinds, t0, duration):
    """A function of time of size about 1, interesting in ``duration`` (s) from t0 (s)."""
    kind = draw(st.sampled_from(kinds))
    if kind == "constant":
        return draw(grid)
    if kind == "sine":
        return fm.Sine(draw(grid), 8.0 * draw(size), 4.0 * draw(grid), draw(grid))
    if kind == "table":
        t = t0 + np.array([-1.0, -0.5, 0.0, 0.5, 1.0, 1.5])
        return fm.Table(t, [draw(grid) for _ in t])
    share = duration / SHARES
    if kind == "spike":
        # one point of a table, shorter than any step between slow ones
        at, width = t0 + share * draw(st.integers(1, SHARES - 1)), share * draw(st.sampled_from([0.5**8, 0.5**4]))
        t = [t0 - duration, t0, *(at + width * np.arange(-3, 4)), t0 + 2.0 * duration]
        y = [0.0, draw(grid), *[0.0] * 3, draw(grid) * share / width, *[0.0] * 3, draw(grid)]
        return fm.Table(t, y, monotone=True)  # a cubic spline would swing far beyond a pulse of one point
    begin = t0 + share * draw(st.integers(1, SHARES // 2))
    end = begin + share * draw(st.sampled_from([1, 1, 5, SHARES // 2 - 1]))
    x = [t0 - 2.0 * duration, begin, end, t0 + 2.0 * duration]
    heights = [draw(grid) for _ in range(3)]
    if kind == "jump":
        poly = PPoly([heights], x)
    elif kind == "pulse":
        poly = PPoly([[0.0, 4.0 * heights[0], 0.0], [0.0, 8.0 * heights[1], heights[2]]], x)
    else:
        # the antiderivative of levels bends once for a load; a motion's rate or its acceleration is levels
        poly = PPoly([[h / duration if kind == "kink" else 2.0 * h for h in heights]], x).antiderivative()
        if kind == "bend":
            poly = PPoly(np.array(poly.c) / duration, x).antiderivative()
    return of_time.Declared(poly) if draw(st.integers(0, 3)) == 3 else poly
