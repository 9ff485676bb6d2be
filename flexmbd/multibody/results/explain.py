"""A plain text of what a compiled scene computes and what it skips."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flexmbd.multibody.bodies.body import Body
from flexmbd.multibody.bodies.continuum_body import ContinuumBody, ExplicitInterior, ImplicitInterior
from flexmbd.multibody.bodies.point_mass import is_point
from flexmbd.multibody.bodies.pseudo_rigid_body import PseudoRigidBody
from flexmbd.multibody.joint.connection import Connection
from flexmbd.multibody.joint.enforcement import Penalty
from flexmbd.multibody.joint.fixed import Fixed
from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.forward_dynamics.shortcuts import shortcuts
from flexmbd.multibody.kernels.reading.constraint_tables import constraint_rows
from flexmbd.multibody.kernels.reading.force_tables import force_elements, hard_contact_places
from flexmbd.multibody.kernels.reading.tree import has_modal_damping, rotates, shaft_inertias
from flexmbd.multibody.start.consistent_start import Start

_KINDS = {
    kinds.TIME_PIECEWISE: "read as data",
    kinds.TIME_SINE: "read as data",
    kinds.TIME_COMPILED: "called compiled",
    kinds.TIME_PYTHON: "Python, called at each new time",
}

_YIELDS = "yields to a penalty, no multipliers"
_SHOWN = 4
_LISTED = 20  # lines of a list that are told one by one


@dataclass(frozen=True)
class _Line:
    """A line of the text, of which many that say the same are told as one.

    Attributes:
        says: with {} for each name.
        names: what the line is of.
        kind: lines of different kinds do not say the same.
    """

    says: str
    names: tuple[str, ...]
    kind: str = ""


def explain(start: Start) -> str:
    """A text: which joints are carried by coordinates, which by multipliers, and which terms are left out."""
    scene = start.scene
    plan = scene.plan
    bodies = len(scene.topology.branches)
    states = int(scene.state_mask.sum())
    links = len(plan.tree) - bodies - states
    massless = f" and {_counted(links, 'massless link')}" if links else ""
    equations = f", {_counted(states, 'state')} of equations" if states else ""
    lines = [
        f"{_counted(bodies, 'body')}{massless}, {_counted(scene.nv - states, 'velocity')} "
        f"({len(plan.free) - states} free, "
        f"{len(plan.driven)} prescribed){equations}, {_counted(len(plan.rows), 'multiplier')}"
    ]
    lines.extend(["tree:", *_told(_branches(start))])
    lines.extend(_histories(start))
    lines.extend(_closures(start))
    lines.extend(_inputs(start))
    lines.extend(_elements(start))
    lines.extend(f"{switch.name}: its switch is located, as an event is" for switch in start.scene.switches)
    lines.extend(_skipped(start))
    if start.moved:
        lines.append("the start was made consistent:")
        lines.extend(f"  {name}: {old:.6g} -> {new:.6g}" for name, old, new in start.moved[:_LISTED])
        if len(start.moved) > _LISTED:
            lines.append(f"  and {len(start.moved) - _LISTED} more: stats.start_moved of a run has them all")
    if start.strain.warning is not None:
        lines.append(start.strain.warning)
    return "\n".join(lines)


def _branches(start: Start) -> list[_Line]:
    """A line a body of the tree: what carries it."""
    lines = []
    parts = [part for one in _with_history(start) for part in one.parts]
    for branch in start.scene.topology.branches:
        body = branch.outer.body
        kind = _kind(body)
        if branch.connection is None and body in parts:
            says = f"  {{}} ({kind}): 6 coordinates of its own, starts where its body has it"
            lines.append(_Line(says, (body.name,)))
            continue
        if branch.connection is None:
            says = (
                f"  {{}} ({kind}): flies with {3 if is_point(body) else 6} coordinates, for no joint that goes by "
                "coordinates reaches it at a frame that is rigid in it"
            )
            lines.append(_Line(says, (body.name,)))
            continue
        joint = type(branch.connection.joint).__name__
        how = "prescribed" if branch.connection.motion is not None else "joint coordinates"
        back = ", run from child to parent" if branch.reversed else ""
        says = f"  {{}}: {joint} -> {{}} ({kind}), {how}{back}"
        lines.append(_Line(says, (branch.connection.name, body.name)))
    return lines


def _told(lines: Sequence[_Line]) -> list[str]:
    """The lines as text; where there are many, those that say the same as one, with their number, first and last."""
    if len(lines) <= _LISTED:
        return [line.says.format(*line.names) for line in lines]
    alike: dict[tuple[str, str], list[_Line]] = {}
    for line in lines:
        alike.setdefault((line.says, line.kind), []).append(line)
    text = []
    for (says, _), group in alike.items():
        if len(group) == 1:
            text.append(says.format(*group[0].names))
            continue
        ends = zip(group[0].names, group[-1].names, strict=True)
        indent = says[: len(says) - len(says.lstrip())]
        text.append(f"{indent}{len(group)} x " + says.lstrip().format(*(f"{a} ... {b}" for a, b in ends)))
    return text


def _kind(body: Body) -> str:
    if isinstance(body, PseudoRigidBody):
        return "pseudo-rigid, its stretches held" if body.rigid else "pseudo-rigid, six stretches"
    if is_point(body):
        return "point mass"
    record = body.reduced()
    if record is None:
        return "rigid"
    stretch = "" if record.stretch is None else f", {len(record.stretch.strain)} membrane strains"
    if record.nonlinear is not None:
        stretch = ", nonlinear stiffness"
    return f"flexible, {record.n_modes} modes{stretch}"


def _with_history(start: Start) -> tuple[ContinuumBody, ...]:
    return () if start.scene.interiors is None else start.scene.interiors.bodies


def _histories(start: Start) -> list[str]:
    """A line a body with history: its frames, and how its interior can be stepped."""
    lines = []
    for body in _with_history(start):
        interior, ways = body.interior, []
        if isinstance(interior, ImplicitInterior):
            ways.append("is solved for at a step's end, with its condensed tangent")
        if isinstance(interior, ExplicitInterior):
            ways.append(f"can step explicitly, by {interior.stable_step():.3g} s at most as it starts")
        names = ", ".join(frame.name for frame in interior.frames)
        lines.append(
            f"  {body.name}: {len(body.parts)} interface frames as rigid bodies ({names}), no multipliers; its "
            f"interior of {interior.mass:.4g} kg {' or '.join(ways)}"
        )
        lines.extend(_remainders(start, body))
    return ["bodies with history:", *lines] if lines else []


def _remainders(start: Start, body: ContinuumBody) -> list[str]:
    """A line for each reduced body that goes on, past a fixed joint, where a body with history ends."""
    topology = start.scene.topology
    held = [b.connection for b in topology.branches if b.connection is not None] + list(topology.closures)
    lines = []
    for connection in held:
        for here, there in ((connection.parent, connection.child), (connection.child, connection.parent)):
            record = there.body.reduced()
            names = [f.name for f, part in zip(body.interior.frames, body.parts, strict=True) if part is here.body]
            if not names or record is None or not isinstance(connection.joint, Fixed):
                continue
            watch = "a YieldMonitor tells whether it yields"
            if record.stress is None:
                watch = "without stress modes in its record nothing tells whether it yields"
            lines.append(
                f"    beyond {names[0]}: {there.body.name}, reduced, no history; its frame turns with it; {watch}"
            )
    return lines


def _closures(start: Start) -> list[str]:
    scene = start.scene
    penalised = [c for c in scene.topology.closures if isinstance(c.enforce, Penalty)]
    yielding = _told([_Line(f"  {{}}: {type(c.joint).__name__}, {_YIELDS}", (c.name,)) for c in penalised])
    if not len(start.unreduced.plan.rows):
        return ["loops: none, so no multipliers and no drift", *yielding]
    lines = ["loops, closed by multipliers:"]
    lines.extend(yielding)
    held = [c for c in scene.topology.closures if c not in penalised]
    kept, wholly = (Counter(map(id, owners)) for owners in (scene.row_owners, start.unreduced.row_owners))
    closing = []
    for owner in dict.fromkeys((*held, *start.unreduced.row_owners)):
        count, whole = kept[id(owner)], wholly[id(owner)]
        kind, why = type(owner).__name__, ""
        if isinstance(owner, Connection):
            kind = type(owner.joint).__name__
            if not owner.may_be_coordinates:
                why = ", by constraints as asked" if owner.joint.steps else ", constraints alone"
        closing.append(_Line(f"  {{}}: {kind}, {count} of {whole} rows{why}", (owner.name,)))
    lines.extend(_told(closing))
    if scene.redundant:
        left_out, more = scene.redundant[:_LISTED], len(scene.redundant) - _LISTED
        lines.append("  redundant, left out: " + "; ".join(left_out) + (f"; and {more} more" if more > 0 else ""))
    rolling = int(np.sum(~constraint_rows(scene.plan).holds_position))
    if rolling:
        lines.append(f"  {rolling} of the rows hold velocities alone (nonholonomic)")
    return lines


def _inputs(start: Start) -> list[str]:
    scene = start.scene
    rows = zip(scene.time_names, scene.time_rows, strict=True)
    texts = [(name, row.text.replace("{", "{{").replace("}", "}}"), _KINDS[row.kind]) for name, row in rows]
    return _told([_Line(f"{{}}: {text}, {how}", (name,)) for name, text, how in texts])


def _elements(start: Start) -> list[str]:
    """One line a force element; of those that call a user's function, at what cost."""
    scene = start.scene
    lines: dict[_Line, None] = {}
    elements = force_elements(scene.plan)
    for number, behaviour, address in zip(elements.number, elements.behaviour, elements.address, strict=True):
        name, cost = scene.element_names[number], ""
        if behaviour.calls_user:
            python = address in scene.callbacks.addresses
            cost = ": Python, called at each evaluation of the equations" if python else ": called compiled"
        lines[_Line("{}" + cost, (name,), behaviour.name)] = None
    for v, inertia in shaft_inertias(scene.plan):
        text = f"one-dimensional inertia of {inertia:.6g} on {{}}: in the mass matrix"
        lines[_Line(text, (scene.velocity_names[v],), "one-dimensional inertias")] = None
    watched = len(hard_contact_places(scene.plan))
    told = [f"{_counted(watched, 'hard contact')} watched, by impulses"] if watched else []
    return [*_told(list(lines)), *told]


def _skipped(start: Start) -> list[str]:
    plan = start.scene.plan
    skipped = []
    if len(plan.rows) == 0:
        skipped.append("constraint rows, multipliers and position shifts (a tree)")
    if len(plan.flex) == 0:
        skipped.append("modal terms and the stiff filter of the error estimate (all rigid)")
    elif not has_modal_damping(plan):
        skipped.append("modal damping (zero)")
    reduced = [b.outer.body for b in start.scene.topology.branches if not isinstance(b.outer.body, PseudoRigidBody)]
    records = [record for body in reduced if (record := body.reduced()) is not None]
    stiffening = [r.nonlinear is not None or (r.stretch is not None and len(r.stretch.strain) > 0) for r in records]
    if records and not any(stiffening):
        skipped.append("geometric stiffening (in no record: a fast spinning body comes out too soft)")
    if len(plan.flex):
        skipped.append("factoring modal masses (the identity)")
    skipped.extend(_unneeded_coriolis(start))
    skipped.extend(_shorter_ways(start))
    idle = start.scene.idle_elements
    if idle:
        names = list(dict.fromkeys(idle))
        skipped.append(f"{len(idle)} force elements that exert nothing, their numbers being zero ({_shown(names)})")
    elif len(plan.elements) == 0:
        skipped.append("force elements (none)")
    return ["skipped: " + "; ".join(skipped)] if skipped else []


def _shorter_ways(start: Start) -> list[str]:
    """What forward dynamics leaves out for the directions of the joints."""
    ways = shortcuts(start.scene.plan)
    found = []
    if ways.planar:
        found.append("forces and moments out of the plane of the hinges, which are all parallel (forward dynamics)")
    elif ways.aligned:
        of = f"{ways.aligned} of {ways.joints} joints"
        found.append(f"rotations between the axes of {of} and their rigid parents' (the identity; forward dynamics)")
    return found


def _unneeded_coriolis(start: Start) -> list[str]:
    """Flexible bodies without Coriolis and centrifugal terms, by the joints between them and the ground."""
    scene = start.scene
    bodies = [branch.outer.body for branch in scene.topology.branches]
    still = [b.name for b in bodies if b.reduced() is not None and not rotates(scene.plan, scene.index.bodies[b])]
    if not still:
        return []
    return [f"Coriolis and centrifugal terms of {_listed(still, len(bodies))} (no joint turns the frame)"]


def _listed(names: list[str], whole: int) -> str:
    """Names of bodies, but no more than a few."""
    if len(names) == whole > 1:
        return f"all {whole} bodies"
    return _shown(names)


def _shown(names: list[str]) -> str:
    """The first few names."""
    shown = ", ".join(names[:_SHOWN])
    return shown if len(names) <= _SHOWN else f"{shown} and {len(names) - _SHOWN} more"


def _counted(number: int, word: str) -> str:
    """A number and its word, as "1 body" and "2 bodies"."""
    several = f"{word[:-1]}ies" if word.endswith("y") else f"{word}s"
    return f"{number} {word if number == 1 else several}"
