"""Random machines for hypothesis: numbers on coarse grids, so that a failure shrinks to one that can be read.

A machine is drawn as a tree with coordinates and rates, which gives all poses; loops are then closed by joints whose
markers are put where they fit, and the rates moved by the least that keeps the loops closed.
"""

from __future__ import annotations

from dataclasses import replace

import functions_of_time as of_time
import joint_motion as jm
import numpy as np
from drawing_parts import (
    BODIES,
    GEARED,
    JUMPING,
    LOOP,
    STOPPING,
    TREE,
    functions,
    grid,
    interface,
    joints,
    mark_on,
    point,
    size,
)
from hypothesis import assume
from hypothesis import strategies as st
from machine_loads import Bush, CoordinateFriction, CoordinateSpring, Motor, PinFriction, Push, Spring
from random_machine import Gear, Link, Machine, Mark, Part, Pose, Pseudo

import flexmbd as fm

#: A loop's rows in the tree's rates count as dependent below the first, and as independent above the second share of
#: the largest singular value; a machine between them is near a singular position and is thrown away.
DEPENDENT, INDEPENDENT = 1e-11, 0.03

#: Of the largest of the rates from which those that keep loops closed are found.
ROUND_OFF = 1e-15


@st.composite
def machines(
    draw,
    *,
    bodies=("rigid", "rigid", "rigid", "pseudo", "beam", "mesh"),
    loads_of=JUMPING,
    motions_of=STOPPING,
    loops=True,
    closed=False,
    moving=True,
    loads=True,
    damped_by=None,
):
    """A machine with a consistent start.

    A quarter of them are gearboxes: rigid bodies on joints that go by coordinates, with gears, and mostly loads on
    the coordinates.

    Args:
        draw: hypothesis's.
        bodies: kinds of parts.
        loads_of: kinds of functions of time that loads are.
        motions_of: that motions are.
        loops: whether some may be closed.
        closed: whether some are.
        moving: whether there may be gravity, speeds, motions and loads that vary in time.
        loads: whether there may be loads.
        damped_by: a kind of load of which there is one, damped where it may be so.
    """
    t0 = draw(st.sampled_from([0.0, 0.5, -1.25])) if moving else 0.0
    parts, links, charts, rates = [], [], [], []
    flavour = draw(st.sampled_from(["any", "any", "gearbox", "planar" if loops else "any"]))
    planar, gearbox = flavour == "planar", flavour == "gearbox"
    for k in range(draw(st.integers(2 if closed or gearbox else 1, 4))):
        kind = draw(st.sampled_from(["rigid"] if flavour != "any" else bodies))
        body = draw(BODIES[kind])
        part = Part(f"part {k + 1}", body, Pose(np.zeros(3), np.eye(3)))
        place = draw(st.integers(-1, k - 1))
        inner = None if place < 0 else parts[place]
        if planar:
            link, chart = _planar_link(draw, part, inner)
        else:
            joint = joints(draw, GEARED if gearbox else TREE)
            deep = draw(st.booleans())
            link = Link(f"link {k + 1}", joint, mark_on(draw, inner), mark_on(draw, part, deep=deep))
            rigid = kind == "rigid" and not (inner is not None and inner.deforms)
            if joint.reversible and rigid and (gearbox or draw(st.booleans())):
                link = replace(link, way=fm.Way.COORDINATES)  # so that springs may act on its coordinates
            chart = [draw(grid) for _ in range(jm.CHART[jm.kind(joint)])]
        links.append(link)
        charts.append(chart)
        rates.append([(2.0 * draw(grid) if moving else 0.0) for _ in link.joint.velocity_names])
        parts.append(part)
    gravity = 10.0 * np.array(draw(st.tuples(grid, grid, grid))) if moving else np.zeros(3)
    probes = {part.name: Mark(part.name) for part in parts if not part.reduced}
    arm = np.array([0.25, 0.125, -0.1875])
    probes |= {f"{name}, aside": Mark(name, arm, jm.turned(arm, 4.0)) for name in list(probes)}
    for part in parts:
        if part.reduced:
            probes |= {f"{part.name}.{end}": interface(part, end) for end in "ab"}
    # what deforms vibrates a hundred times as fast
    deforms = any(part.deforms for part in parts)
    duration = draw(st.sampled_from([0.0625, 0.125])) / (8.0 if deforms else 1.0)
    machine = Machine(tuple(parts), tuple(links), (), gravity, probes, t0, duration)
    tree = links
    if moving and draw(st.booleans()):
        machine, rates = _driven(draw, machine, charts, rates, motions_of)
        tree = machine.links
    state = np.concatenate([np.zeros(0), *map(np.array, rates)])
    machine = _geared(draw, machine)
    if machine.gears and not closed:
        state = _matched(machine, tree, charts, state)
    if closed or (loops and draw(st.integers(0, 3))):
        machine = _closed(draw, _posed(machine, tree, charts, np.zeros(len(state))), planar)
        state = _matched(machine, tree, charts, state)
    machine = _posed(machine, tree, charts, state)
    if damped_by is not None:
        machine = replace(machine, loads=(_load(draw, machine, loads_of, only=damped_by),))
    # hypothesis shrinks towards fewer
    for _ in range(draw(st.sampled_from([0, 1, 2, 2, 3])) if loads else 0):
        load = _load(draw, machine, loads_of if moving else ("constant",), on_joints=gearbox)
        machine = replace(machine, loads=(*machine.loads, load))
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


def _driven(draw, machine, charts, rates, kinds):
    """One link of one coordinate gets a motion."""
    single = [k for k, link in enumerate(machine.links) if len(link.turns) == 1]
    if not single:
        return machine, rates
    k = draw(st.sampled_from(single))
    f = draw(functions(kinds, machine.start, machine.duration))
    f = of_time.raised(f, charts[k][0] - of_time.value(f, machine.start))
    rates = [*rates[:k], [float(of_time.value(f, machine.start, 1))], *rates[k + 1 :]]
    links = [*machine.links[:k], replace(machine.links[k], motion=f), *machine.links[k + 1 :]]
    return replace(machine, links=tuple(links)), rates


def _geared(draw, machine):
    """Gears, or racks on pinions, between joints that go by coordinates."""
    carried = [link for link in machine.links if link.way is fm.Way.COORDINATES]
    turning = [link for link in carried if sum(link.turns) == 1]
    sliding = [link for link in carried if len(link.turns) - sum(link.turns) == 1]
    gears = []
    for _ in range(draw(st.sampled_from([0, 1, 1, 2]))):
        rack = draw(st.booleans())
        pairs = [(a, b) for a in turning for b in (sliding if rack else turning) if a is not b]
        # each pair once; a second gear may close a loop of gears, whose ratios then agree or nothing moves
        pairs = [(a, b) for a, b in pairs if {a.name, b.name} not in [{gear.first, gear.second} for gear in gears]]
        if pairs:
            a, b = draw(st.sampled_from(pairs))
            gears.append(Gear(a.name, b.name, draw(st.sampled_from([0.5, -2.0, 0.125])), rack))
    return replace(machine, gears=tuple(gears))


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
        given = [end for end in ends if end != "ground" and machine.part(end).reduced]
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

    first = np.concatenate([[0], np.cumsum([len(link.turns) for link in tree])]).astype(int)
    ends = zip(tree, first[:-1], strict=True)
    places = {(link.name, turns): o + k for link, o in ends for k, turns in enumerate(link.turns)}

    def gaps(rates):
        posed = _posed(machine, tree, charts, rates)
        found = []
        for link in machine.links[len(tree) :]:
            R, p, twist = posed.pose(link.parent).seen(posed.pose(link.child))
            found.append(jm.rows(link.joint, R, p) @ twist)
        for gear in machine.gears:
            turn, other = places[gear.first, True], places[gear.second, not gear.rack]
            found.append([gear.ratio * rates[turn] - rates[other]])
        return np.concatenate(found)

    assume(len(state))
    free = [link.motion is None for link in tree for _ in link.joint.velocity_names]
    jacobian = np.array([gaps(unit) for unit in np.eye(len(state))]).reshape(len(state), -1).T
    movable = jacobian[:, free]
    assume(movable.size)
    u, sizes, vt = np.linalg.svd(movable, full_matrices=False)
    # the rows are of unit length for twists in rad/s and m/s: where all are far below that, they are round-off
    largest = max(np.linalg.norm(jacobian, 2), INDEPENDENT)
    shares = sizes / largest
    held = shares > INDEPENDENT
    assume(not ((shares > DEPENDENT) & ~held).any())
    assume(held.sum() < movable.shape[1])  # something can move
    # what is driven must be able to move, or to stay, as its motion has it
    driven = [not isinstance(link.motion, (float, type(None))) for link in tree for _ in link.joint.velocity_names]
    forbidden = jacobian[:, driven] - u[:, held] @ (u[:, held].T @ jacobian[:, driven])
    assume(np.abs(forbidden).max(initial=0.0) < 1e-10 * largest)
    step = np.zeros(len(state))
    step[free] = -vt[held].T @ ((u[:, held].T @ (jacobian @ state)) / sizes[held])
    assume(np.abs(jacobian @ (state + step)).max() < 1e-12)  # a motion that the loops forbid
    rates = state + step
    # a machine at rest has no rate beside which what is left of these would be seen to be round-off
    rates[np.abs(rates) <= ROUND_OFF * np.abs(state).max()] = 0.0
    return rates


def _load(draw, machine, functions_of, *, on_joints=False, only=None):
    """A force, a spring or something on a joint; ``only``: of this kind, and damped."""
    joined = [link for link in machine.links if len(link.joint.start) == len(link.turns) > 0]
    carried = [link for link in joined if link.way is fm.Way.COORDINATES]
    single = [link for link in joined if len(link.turns) == 1]
    # what a bearing passes on is not told where loops share it
    pins = [link for link in carried if jm.kind(link.joint) in ("Revolute", "Prismatic") and link.motion is None]
    pins = [] if any(link.name.startswith("loop") for link in machine.links) else pins
    kinds = [] if on_joints and (carried or single) else ["push", "spring", "bush"]
    kinds += ["coordinate spring", "friction", "friction"] * bool(carried)
    kinds += ["motor"] * bool(single) + ["pin"] * bool(pins)
    assume(only is None or only in kinds)
    kind = only or draw(st.sampled_from(kinds))
    damping = st.just(1.0) if only else st.sampled_from([0.0, 1.0])
    of = functions(functions_of, machine.start, machine.duration)
    if kind == "motor":
        return Motor(draw(st.sampled_from(single)).name, 0, of_time.in_units(draw(of), 4.0, 1.0))
    if kind == "pin":
        link = draw(st.sampled_from(pins))
        return PinFriction(link.name, 0, draw(size), draw(size), 0.25 * draw(size) if link.turns[0] else None)
    if kind in ("coordinate spring", "friction"):
        link = draw(st.sampled_from(carried))
        k = draw(st.integers(0, len(link.turns) - 1))
        if kind == "coordinate spring":
            return CoordinateSpring(link.name, k, 32.0 * draw(size), draw(grid), draw(damping))
        coulomb = draw(size)
        sticks = (coulomb + draw(size), draw(size)) if draw(st.booleans()) else (None, None)
        return CoordinateFriction(link.name, k, coulomb, draw(size), draw(st.sampled_from([0.0, 0.5])), *sticks)
    parts = list(machine.parts)
    one = draw(st.sampled_from(parts))
    if kind == "push":
        f = tuple(of_time.in_units(draw(of), 8.0, 1.0) for _ in range(6))
        return Push(mark_on(draw, one), f, draw(st.booleans()))
    other = draw(st.sampled_from([None, *(part for part in parts if part is not one)]))
    if kind == "spring":
        ends = mark_on(draw, other), mark_on(draw, one)
        distance = np.linalg.norm(machine.pose(ends[0]).p - machine.pose(ends[1]).p)
        assume(distance > 0.125)
        return Spring(*ends, 64.0 * draw(size), 0.5 * draw(size), draw(damping))
    return _bush(draw, machine, mark_on(draw, other), one, damping)


def _bush(draw, machine, mark, part, damping):
    """Turned by well under half a revolution, where its rotation vector is smooth."""
    if part.reduced:
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
    return Bush(mark, other, 0.5 * (stiffness + stiffness.T), 0.5 * draw(damping) * np.eye(6))
