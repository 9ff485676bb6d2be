"""Random machines for hypothesis: numbers on coarse grids, so that a failure shrinks to one that can be read.

A machine is drawn as a tree with coordinates and rates, which gives all poses; loops are then closed by joints whose
markers are put where they fit, and the rates moved by the least that keeps the loops closed.
"""

from __future__ import annotations

from dataclasses import replace

import functions_of_time as of_time
import joint_motion as jm
import numpy as np
from beam_records import Beam
from hypothesis import assume
from hypothesis import strategies as st
from random_machine import (
    Bush,
    CoordinateFriction,
    CoordinateSpring,
    Gear,
    Link,
    Machine,
    Mark,
    Motor,
    Part,
    Pose,
    Pseudo,
    Push,
    Rigid,
    Spring,
)  # fmt: skip
from scipy.interpolate import PPoly

import flexmbd as fm

#: A loop's rows in the tree's rates count as dependent below the first, and as independent above the second share of
#: the largest singular value; a machine between them is near a singular position and is thrown away.
DEPENDENT, INDEPENDENT = 1e-11, 0.03

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
    """A marker on a part: anywhere on a rigid one, on an interface of a beam."""
    if part is None:
        return Mark("ground", draw(point), draw(rotation))
    if isinstance(part.body, Beam):
        return interface(part, draw(st.sampled_from(["a", "b"])))
    p = draw(point)
    if isinstance(part.body, Pseudo):
        p = p * part.body.sides if deep else np.zeros(3)
    return Mark(part.name, p, draw(rotation))


def interface(part, name):
    p, R = part.body.interface(name)
    return Mark(part.name, p, R, name)


TREE = ("Revolute", "Prismatic", "Screw", "Cylindrical", "Planar", "Universal", "Spherical", "Fixed", "Free")
LOOP = (
    "Spherical", "PointOnPlane", "Distance", "PointOnLine", "Planar", "Cylindrical", "Universal", "ConstantVelocity",
    "Revolute", "Prismatic", "Screw", "RollingDisc",
)  # fmt: skip
SMOOTH = ("constant", "sine", "table")


@st.composite
def functions(draw, kinds, around):
    """A function of time of size about 1, interesting around a time."""
    kind = draw(st.sampled_from(kinds))
    if kind == "constant":
        return draw(grid)
    if kind == "sine":
        return fm.Sine(draw(grid), 8.0 * draw(size), 4.0 * draw(grid), draw(grid))
    if kind == "table":
        t = around + np.array([-1.0, -0.5, 0.0, 0.5, 1.0, 1.5])
        return fm.Table(t, [draw(grid) for _ in t])
    begin = around + 0.0625 * draw(size)
    end = begin + 0.0625 * draw(size)
    return PPoly([[0.0, 4.0 * draw(grid), draw(grid)]], [begin - 100.0, begin, end, end + 100.0])


@st.composite
def machines(
    draw,
    *,
    bodies=("rigid", "rigid", "pseudo", "beam"),
    functions_of=SMOOTH,
    loops=True,
    closed=False,
    moving=True,
    loads=True,
):
    """A machine with a consistent start.

    Args:
        draw: hypothesis's.
        bodies: kinds of parts.
        functions_of: kinds of functions of time.
        loops: whether some may be closed.
        closed: whether some are.
        moving: whether there may be gravity, speeds, motions and loads that vary in time.
        loads: whether there may be loads.
    """
    t0 = draw(st.sampled_from([0.0, 0.5, -1.25])) if moving else 0.0
    parts, links, charts, rates = [], [], [], []
    planar = loops and draw(st.integers(0, 4)) == 4
    for k in range(draw(st.integers(2 if closed else 1, 4))):
        kind = draw(st.sampled_from(["rigid"] if planar else bodies))
        body = draw({"rigid": rigid_bodies(), "pseudo": pseudo_rigid_bodies, "beam": beams}[kind])
        part = Part(f"part {k + 1}", body, Pose(np.zeros(3), np.eye(3)))
        place = draw(st.integers(-1, k - 1))
        inner = None if place < 0 else parts[place]
        if planar:
            link, chart = _planar_link(draw, part, inner)
        else:
            joint = joints(draw, TREE)
            deep = draw(st.booleans())
            link = Link(f"link {k + 1}", joint, mark_on(draw, inner), mark_on(draw, part, deep=deep))
            rigid = kind == "rigid" and not (inner is not None and inner.deforms)
            if joint.reversible and rigid and draw(st.booleans()):
                link = replace(link, way=fm.Way.COORDINATES)  # so that springs may act on its coordinates
            chart = [draw(grid) for _ in range(jm.CHART[jm.kind(joint)])]
        links.append(link)
        charts.append(chart)
        rates.append([(2.0 * draw(grid) if moving else 0.0) for _ in link.joint.velocity_names])
        parts.append(part)
    gravity = 10.0 * np.array(draw(st.tuples(grid, grid, grid))) if moving else np.zeros(3)
    probes = {part.name: Mark(part.name) for part in parts if not isinstance(part.body, Beam)}
    arm = np.array([0.25, 0.125, -0.1875])
    probes |= {f"{name}, aside": Mark(name, arm, jm.turned(arm, 4.0)) for name in list(probes)}
    for part in parts:
        if isinstance(part.body, Beam):
            probes |= {f"{part.name}.{end}": interface(part, end) for end in "ab"}
    # what deforms vibrates a hundred times as fast
    deforms = any(part.deforms for part in parts)
    duration = draw(st.sampled_from([0.0625, 0.125])) / (8.0 if deforms else 1.0)
    machine = Machine(tuple(parts), tuple(links), (), gravity, probes, t0, duration)
    tree = links
    if moving and draw(st.booleans()):
        machine, rates = _driven(draw, machine, charts, rates, functions_of)
        tree = machine.links
    state = np.concatenate([np.zeros(0), *map(np.array, rates)])
    machine = _geared(draw, machine)
    if machine.gears and not closed:
        state = _matched(machine, tree, charts, state)
    if closed or (loops and draw(st.integers(0, 3))):
        machine = _closed(draw, _posed(machine, tree, charts, np.zeros(len(state))), planar)
        state = _matched(machine, tree, charts, state)
    machine = _posed(machine, tree, charts, state)
    # hypothesis shrinks towards fewer
    for _ in range(draw(st.integers(0, 3)) if loads else 0):
        load = _load(draw, machine, functions_of if moving else ("constant",))
        machine = machine if load is None else replace(machine, loads=(*machine.loads, load))
    return machine


def _planar_link(draw, part, inner):
    """One that keeps to the plane across z."""
    kind = draw(st.sampled_from(["Revolute", "Revolute", "Prismatic", "Planar"]))
    flat = np.array([1.0, 1.0, 0.0])
    turn = [jm.turned(jm.Z, 2.0 * draw(grid)) for _ in range(2)]
    ends = ["ground" if inner is None else inner.name, part.name]
    marks = [Mark(end, flat * draw(point), R) for end, R in zip(ends, turn, strict=True)]
    joint = fm.joint.Prismatic("x") if kind == "Prismatic" else getattr(fm.joint, kind)("z")
    link = Link(f"link {part.name[5:]}", joint, *marks)
    return link, [draw(grid) for _ in range(jm.CHART[kind])]


def _driven(draw, machine, charts, rates, functions_of):
    """One link of one coordinate gets a motion."""
    single = [k for k, link in enumerate(machine.links) if len(link.turns) == 1]
    if not single:
        return machine, rates
    k = draw(st.sampled_from(single))
    f = draw(functions([kind for kind in functions_of if kind != "pulse"], machine.start))
    offset = charts[k][0] - of_time.value(f, machine.start)
    if isinstance(f, fm.Sine):
        f = replace(f, offset=f.offset + offset)
    elif isinstance(f, fm.Table):
        f = fm.Table(f.t, np.asarray(f.y) + offset)
    else:
        f = f + offset
    rates = [*rates[:k], [float(of_time.value(f, machine.start, 1))], *rates[k + 1 :]]
    links = [*machine.links[:k], replace(machine.links[k], motion=f), *machine.links[k + 1 :]]
    return replace(machine, links=tuple(links)), rates


def _geared(draw, machine):
    """Perhaps a gear between two joints that go by coordinates and have one rotation each."""
    fit = [link for link in machine.links if link.way is fm.Way.COORDINATES and sum(link.turns) == 1]
    if len(fit) < 2 or not draw(st.booleans()):
        return machine
    first, second = draw(st.permutations(fit))[:2]
    return replace(machine, gears=(Gear(first.name, second.name, draw(st.sampled_from([0.5, -2.0]))),))


def _posed(machine, tree, charts, state):
    """All parts where the tree's coordinates and rates put them."""
    parts, o = {}, 0
    for link, chart in zip(tree, charts, strict=True):
        inner = Pose(np.zeros(3), np.eye(3)) if link.parent.part == "ground" else parts[link.parent.part].pose
        R, p = jm.pose_of(link.joint, chart)
        n = len(link.joint.velocity_names)
        twist = jm.free_motions(link.joint, R, p) @ state[o : o + n]
        o += n
        outer = inner.after(link.parent.p, link.parent.R).moved(R, p, twist)
        part = machine.part(link.child.part)
        parts[part.name] = replace(part, pose=outer.carrying(link.child.p, link.child.R))
    return replace(machine, parts=tuple(parts.values()))


def _closed(draw, machine, planar):
    """With one or two more joints, whose markers are put where they fit."""
    links = list(machine.links)
    for k in range(draw(st.integers(1, 2))):
        ends = draw(st.permutations(["ground", *(part.name for part in machine.parts)]))[:2]
        # the other marker is put where it fits, which an interface cannot be
        given = [end for end in ends if end != "ground" and isinstance(machine.part(end).body, Beam)]
        assume(len(given) < 2)
        fixed, fitted = (given[0], next(e for e in ends if e != given[0])) if given else ends
        pseudo = fitted != "ground" and machine.part(fitted).deforms
        assume(not pseudo or not given)
        if pseudo:
            fixed, fitted = fitted, fixed
            assume(fitted == "ground" or not machine.part(fitted).deforms)
        part = None if fixed == "ground" else machine.part(fixed)
        if planar:
            joint = draw(st.sampled_from([fm.joint.Revolute("z"), fm.joint.Prismatic("x"), fm.joint.Planar("z")]))
            mark = Mark(fixed, draw(point) * [1.0, 1.0, 0.0], jm.turned(jm.Z, 2.0 * draw(grid)))
        else:
            joint = joints(draw, LOOP)
            mark = mark_on(draw, part)
        R, p = jm.pose_of(joint, [draw(grid) for _ in range(jm.CHART[jm.kind(joint)])])
        seen = machine.pose(mark)
        other = Pose(np.zeros(3), np.eye(3)) if fitted == "ground" else machine.part(fitted).pose
        if draw(st.booleans()):
            R_new, p_new, _ = other.seen(seen.after(p, R))
            ends = mark, Mark(fitted, p_new, R_new)
        else:
            R_new, p_new, _ = other.seen(seen.carrying(p, R))
            ends = Mark(fitted, p_new, R_new), mark
        links.append(Link(f"loop {k + 1}", joint, *ends))
    return replace(machine, links=tuple(links))


def _matched(machine, tree, charts, state):
    """The rates nearest to these that keep the loops closed."""

    owners = [link for link in tree for _ in link.turns]
    angular = [turns for link in tree for turns in link.turns]

    def gaps(rates):
        posed = _posed(machine, tree, charts, rates)
        found = []
        for link in machine.links[len(tree) :]:
            R, p, twist = posed.pose(link.parent).seen(posed.pose(link.child))
            found.append(jm.rows(link.joint, R, p) @ twist)
        angles = {link.name: rate for link, rate, turns in zip(owners, rates, angular, strict=True) if turns}
        found += [[gear.ratio * angles[gear.first] - angles[gear.second]] for gear in machine.gears]
        return np.concatenate(found)

    assume(len(state))
    free = [link.motion is None for link in tree for _ in link.joint.velocity_names]
    jacobian = np.array([gaps(unit) for unit in np.eye(len(state))]).reshape(len(state), -1).T
    movable = jacobian[:, free]
    assume(movable.size)
    shares = np.linalg.svd(movable, compute_uv=False)
    shares = shares / max(shares[0], 1e-300)
    assume(not ((shares > DEPENDENT) & (shares < INDEPENDENT)).any())
    assume((shares > INDEPENDENT).sum() < movable.shape[1])  # something can move
    step = np.zeros(len(state))
    step[free] = -np.linalg.lstsq(movable, jacobian @ state, rcond=1e-6)[0]
    assume(np.abs(jacobian @ (state + step)).max() < 1e-12)  # a motion that the loops forbid
    matched = state + step
    matched[np.abs(matched) < 1e-13] = 0.0  # at rest, and not all but for rounding
    return matched


def _load(draw, machine, functions_of):
    """A force, a spring or something on a joint; None where the kind does not fit."""
    kind = draw(st.sampled_from(["push", "spring", "bush", "coordinate spring", "friction", "motor"]))
    parts = list(machine.parts)
    one = draw(st.sampled_from(parts))
    if kind == "push":
        f = [draw(functions(functions_of, machine.start)) for _ in range(6)]
        f = tuple(of_time.in_units(c, 8.0, 1.0) for c in f)
        return Push(mark_on(draw, one), f, draw(st.booleans()))
    other = draw(st.sampled_from([None, *(part for part in parts if part is not one)]))
    if kind == "spring":
        ends = mark_on(draw, other), mark_on(draw, one)
        distance = np.linalg.norm(machine.pose(ends[0]).p - machine.pose(ends[1]).p)
        assume(distance > 0.125)
        return Spring(*ends, 64.0 * draw(size), 0.5 * draw(size), draw(st.sampled_from([0.0, 1.0])))
    if kind == "bush":
        return _bush(draw, machine, mark_on(draw, other), one)
    links = [link for link in machine.links if link.joint.velocity_names and len(link.joint.start) == len(link.turns)]
    if not links:
        return None
    link = draw(st.sampled_from(links))
    if kind == "motor":
        if len(link.turns) != 1:
            return None
        return Motor(link.name, 0, of_time.in_units(draw(functions(functions_of, machine.start)), 4.0, 1.0))
    if link.way is not fm.Way.COORDINATES:
        return None
    coordinate = draw(st.integers(0, len(link.turns) - 1))
    if kind == "coordinate spring":
        return CoordinateSpring(link.name, coordinate, 32.0 * draw(size), draw(grid), draw(st.sampled_from([0.0, 1.0])))
    return CoordinateFriction(link.name, coordinate, draw(size), draw(size), draw(size))


def _bush(draw, machine, mark, part):
    """Turned by well under half a revolution, where its rotation vector is smooth."""
    if isinstance(part.body, Beam):
        other = interface(part, "b")
    else:
        R, p, _ = part.pose.seen(machine.pose(mark))
        other = Mark(part.name, p + 0.25 * draw(point), R @ jm.turned(0.5 * draw(point), 1.0))
        if isinstance(part.body, Pseudo):
            other = replace(other, p=0.25 * draw(point))
    R, _, _ = machine.pose(mark).seen(machine.pose(other))
    assume(np.trace(R) > 0.0)
    root = np.array([[draw(grid) for _ in range(6)] for _ in range(2)])
    stiffness = 32.0 * (root.T @ root + np.diag([draw(size) for _ in range(6)]))
    return Bush(mark, other, 0.5 * (stiffness + stiffness.T), np.diag([draw(st.sampled_from([0.0, 0.5]))] * 6))
