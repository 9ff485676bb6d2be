"""What may be done to a machine without any matter to it, each as a function from description to description.

Each draws what it needs, and gives None where it does not apply.
"""

from __future__ import annotations

from dataclasses import replace

import functions_of_time as of_time
import joint_motion as jm
import numpy as np
from drawing_parts import point, rotation
from hypothesis import strategies as st
from mesh_records import Meshed
from observation import MIRROR
from random_machine import Link, Mark, Part, Pose, Rigid, Units

import flexmbd as fm


def order(draw, machine):
    """Bodies, joints and loads in another order; what touches named the other way round."""
    parts, links, loads = (draw(st.permutations(seq)) for seq in (machine.parts, machine.links, machine.loads))
    touches = tuple(touch.swapped() for touch in machine.touches[::-1])
    return replace(machine, parts=tuple(parts), links=tuple(links), loads=tuple(loads), touches=touches)


def turned_round(draw, machine):
    """Joints that lead from what was their child to what was their parent."""
    turned = {link.name for link in machine.links if _may_turn(machine, link) and draw(st.booleans())}
    links = [_turned_round(link) if link.name in turned else link for link in machine.links]
    loads = [_on_turned(machine, links, load) for load in machine.loads]
    gears = [
        replace(gear, ratio=-gear.ratio if (gear.first in turned) != (gear.second in turned) else gear.ratio)
        for gear in machine.gears
    ]
    return replace(machine, links=tuple(links), loads=tuple(loads), gears=tuple(gears)) if turned else None


def _may_turn(machine, link):
    if jm.inverse(link.joint) is None or (link.way is fm.Way.COORDINATES and not link.joint.reversible):
        return False
    places = [load.coordinate for load in machine.loads if link.name in load.links]
    places += [0] if link.motion is not None else []
    return all(jm.exchanged(link.joint, k) is not None for k in places)


def _turned_round(link):
    motion = None if link.motion is None else of_time.in_units(link.motion, -1.0, 1.0)
    joint = jm.inverse(link.joint)
    return replace(link, joint=joint, parent=link.child, child=link.parent, motion=motion, swapped=not link.swapped)


def _on_turned(machine, links, load):
    for name in load.links:
        new, old = next(link for link in links if link.name == name), machine.link(name)
        if new is not old:
            return load.negated(jm.exchanged(old.joint, load.coordinate))
    return load


def cut(draw, machine):
    """A loop cut elsewhere: one of the joints that closed it goes by coordinates."""
    held = {name for load in machine.loads for name in load.links}
    held |= {name for gear in machine.gears for name in (gear.first, gear.second)}
    free = [link if link.name in held else replace(link, way=None) for link in machine.links]
    loops = [
        link
        for link in free
        if link.name.startswith("loop") and _carries(machine, link) and not _joined(link, free)
    ]
    if not loops:
        return None
    chosen = draw(st.sampled_from(loops))
    links = [replace(link, way=fm.Way.COORDINATES) if link is chosen else link for link in free]
    return replace(machine, links=tuple(links))


def _joined(link, links):
    """Whether joints that go by coordinates in any case lead from one end of a link to the other."""
    reached = {link.parent.part}
    for _ in links:
        for other in links:
            ends = {other.parent.part, other.child.part}
            if other.way is fm.Way.COORDINATES and ends & reached:
                reached |= ends
    return link.child.part in reached


def _carries(machine, link):
    """Whether a joint may go by coordinates in either direction."""
    rigid = all(m.part == "ground" or not machine.part(m.part).deforms for m in (link.parent, link.child))
    return rigid and bool(link.joint.steps) and link.joint.reversible


def ways(draw, machine):
    """Joints by constraints in place of coordinates."""
    links = [
        replace(link, way=fm.Way.CONSTRAINTS) if link.way is None and draw(st.booleans()) else link
        for link in machine.links
    ]
    gone = all(a is b for a, b in zip(links, machine.links, strict=True))
    return None if gone else replace(machine, links=tuple(links))


def markers(draw, machine):
    """A joint's markers moved along what the joint leaves free, and both turned by the same, its axis with them."""
    links = []
    for link in machine.links:
        ends = link.parent, link.child
        if any(m.interface for m in ends):
            links.append(link)
            continue
        if not any(m.part != "ground" and machine.part(m.part).deforms for m in ends):
            d = jm.slid(link.joint, draw(point))
            ends = tuple(replace(m, p=m.p + m.R @ d) for m in ends)
        S = draw(rotation)
        joint = jm.with_axes_turned(link.joint, S)
        acted_on = any(link.name in load.links for load in machine.loads)
        if joint is None or (acted_on and jm.kind(joint) == "Planar"):  # whose displacements turn with the frames
            links.append(replace(link, parent=ends[0], child=ends[1]))
        else:
            ends = tuple(replace(m, R=m.R @ S) for m in ends)
            links.append(replace(link, joint=joint, parent=ends[0], child=ends[1]))
    return replace(machine, links=tuple(links))


def body_frames(draw, machine):
    """Rigid bodies described in other axes, from another origin."""
    changes = {
        part.name: (draw(point), draw(rotation)) for part in machine.parts if not part.deforms and draw(st.booleans())
    }
    if not changes:
        return None

    def on(mark):
        if mark.part not in changes:
            return mark
        p, R = changes[mark.part]
        return replace(mark, p=R.T @ (mark.p - p), R=R.T @ mark.R)

    parts = []
    for part in machine.parts:
        if part.name in changes:
            p, R = changes[part.name]
            inertia = R.T @ part.body.inertia @ R
            body = Rigid(part.body.mass, R.T @ (part.body.com - p), 0.5 * (inertia + inertia.T))
            part = Part(part.name, body, part.pose.after(p, R))
        parts.append(part)
    return _remarked(replace(machine, parts=tuple(parts)), on)


def _remarked(machine, on):
    """With every marker changed by ``on``."""
    return replace(
        machine,
        links=tuple(replace(link, parent=on(link.parent), child=on(link.child)) for link in machine.links),
        loads=tuple(load.on(tuple(map(on, load.marks)), load.links) for load in machine.loads),
        touches=tuple(touch.on(tuple(map(on, touch.marks)), touch.links) for touch in machine.touches),
        probes={name: on(mark) for name, mark in machine.probes.items()},
    )


def mirrored(draw, machine):
    """The machine in the mirror, without loads: rigid parts, joints of the other hand, shapes that are their own image.

    Turns about an axis go the other way about its image.
    """
    def on(mark):
        return replace(mark, p=MIRROR @ mark.p, R=MIRROR @ mark.R @ MIRROR)

    parts = []
    for part in machine.parts:
        body, pose = part.body, part.pose
        image = Rigid(body.mass, MIRROR @ body.com, MIRROR @ body.inertia @ MIRROR)
        seen = Pose(MIRROR @ pose.p, MIRROR @ pose.R @ MIRROR, MIRROR @ pose.v, -MIRROR @ pose.w)
        parts.append(Part(part.name, image, seen))
    links = []
    for link in machine.links:
        back = link.motion is not None and link.turns[0]
        motion = of_time.in_units(link.motion, -1.0, 1.0) if back else link.motion
        links.append(replace(link, joint=jm.mirrored(link.joint, MIRROR), motion=motion))
    gears = tuple(replace(gear, ratio=-gear.ratio) if gear.rack else gear for gear in machine.gears)
    seen = replace(machine, parts=tuple(parts), links=tuple(links), gears=gears, gravity=MIRROR @ machine.gravity)
    return _remarked(seen, on)


def flying(machine):
    """The machine with its first part set free of the ground; no motions, no gears."""
    first, *others = (replace(link, motion=None) for link in machine.links)
    first = replace(first, joint=fm.joint.Free(), way=None)
    return replace(machine, links=(first, *others), gears=())


def rooted_elsewhere(draw, machine):
    """A machine that is `flying`, its free joint on another part whose coordinates lead to the first one, or place."""
    first, *others = machine.links
    near = {first.child.part}
    for _ in others:
        for link in others:
            ends = {link.parent.part, link.child.part}
            carries = link.joint.reversible and not link.name.startswith("loop")
            if carries and "ground" not in ends and ends & near:
                near |= ends
    chosen = draw(st.sampled_from(sorted(near, key=lambda name: (name == first.child.part, name))))
    parent, child = Mark("ground", draw(point), draw(rotation)), Mark(chosen, draw(point), draw(rotation))
    return replace(machine, links=(replace(first, parent=parent, child=child), *others))


def units(draw):
    """Other units, by powers of two; that of mass by powers of four, whose root modal coordinates carry."""
    length, mass, time = (draw(st.integers(-most, most)) for most in (12, 6, 12))
    return Units(2.0**length, 4.0**mass, 2.0**time)


def in_units(machine, u):
    """The machine in other units."""
    return replace(
        machine,
        parts=tuple(part.in_units(u) for part in machine.parts),
        links=tuple(link.in_units(u) for link in machine.links),
        loads=tuple(load.in_units(u, machine.turns(load)) for load in machine.loads),
        touches=tuple(touch.in_units(u) for touch in machine.touches),
        gravity=machine.gravity * u.speed / u.time,
        probes={name: mark.in_units(u) for name, mark in machine.probes.items()},
        start=machine.start * u.time,
        duration=machine.duration * u.time,
        gears=tuple(gear.in_units(u) for gear in machine.gears),
    )


def welded(draw, machine):
    """A rigid body in two parts, Fixed to each other, its markers shared out."""
    rigid = [part for part in machine.parts if not part.deforms]
    if not rigid:
        return None
    part = draw(st.sampled_from(rigid))
    body, share = part.body, draw(st.sampled_from([0.25, 0.5, 0.875]))
    # two centres apart take from the second moment of mass along their line at most half of the least there is
    low, mid, high = np.linalg.eigvalsh(body.inertia)
    reduced = body.mass * share * (1.0 - share)
    apart = np.sqrt(0.25 * (low + mid - high) / reduced) * draw(rotation)[:, 0]
    own = body.inertia - reduced * (apart @ apart * np.eye(3) - np.outer(apart, apart))
    p, R = draw(point), draw(rotation)
    first = Rigid((1.0 - share) * body.mass, body.com - share * apart, (1.0 - share) * own)
    turned = R.T @ own @ R
    second = Rigid(share * body.mass, R.T @ (body.com + (1.0 - share) * apart - p), share * 0.5 * (turned + turned.T))
    other = Part("second half", second, part.pose.after(p, R))

    def on(mark):
        if mark.part != part.name or not draw(st.booleans()):
            return mark
        return Mark(other.name, R.T @ (mark.p - p), R.T @ mark.R)

    at = draw(point), draw(rotation)
    weld = Link("weld", fm.joint.Fixed(), Mark(part.name, *at), Mark(other.name, R.T @ (at[0] - p), R.T @ at[1]))
    parts = [replace(one, body=first) if one is part else one for one in machine.parts]
    moved = _remarked(machine, on)
    return replace(moved, parts=(*parts, other), links=(*moved.links, weld))


def later(draw, machine):
    """All of it at another time."""
    shift = draw(st.sampled_from([0.25, -3.0, 16.0]))

    def change(function):
        return of_time.later(function, shift)

    links = [
        link if link.motion is None else replace(link, motion=of_time.later(link.motion, shift))
        for link in machine.links
    ]
    loads = [load.mapped(change) for load in machine.loads]
    return replace(machine, links=tuple(links), loads=tuple(loads), start=machine.start + shift)


def frame_elsewhere(draw, machine):
    """Reduced bodies with their frame on another interface, or on the mean axis.

    The modes span the same fields, so that nothing differs as long as nothing is bent.  But with modes a meshed part
    has some of its stretch as well, which are those of loads on its own frame.
    """
    reduced = [part for part in machine.parts if part.reduced]
    reduced = [part for part in reduced if not (isinstance(part.body, Meshed) and part.body.modes)]
    if not reduced:
        return None
    changed = {}
    for part in reduced:
        frame = draw(st.sampled_from([f for f in ("a", "b", None) if f != part.body.frame]))
        body = replace(part.body, frame=frame)
        (p, R), (p_new, R_new) = part.body.interface("a"), body.interface("a")
        turn = R @ R_new.T
        changed[part.name] = Part(part.name, body, part.pose.after(p - turn @ p_new, turn))

    def on(mark):
        if mark.part not in changed:
            return mark
        p, R = changed[mark.part].body.interface(mark.interface)
        return replace(mark, p=p, R=R)

    parts = tuple(changed.get(part.name, part) for part in machine.parts)
    return _remarked(replace(machine, parts=parts), on)


