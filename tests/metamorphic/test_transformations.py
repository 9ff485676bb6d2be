"""Random machines, and what may be done to them without any matter: the same accelerations, reactions and motion.

`./run pytest tests/metamorphic` takes some fifty machines for each transformation, `-m thousand` a thousand.  What is
drawn follows from METAMORPHIC_SEED, which the report's head tells; a failure is shrunk and printed as a description.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import pytest
import transformations as change
from drawing import machines
from hypothesis import assume, note
from many import few_and_a_thousand, many
from observation import described, differences, sizes
from random_machine import Units
from running import rtol_of, see
from vibration import in_motion

#: Of the start: the first share of the machine's own sizes; the second times the square of the constraints' condition,
#: since reactions come from normal equations; the third times the condition of the mass matrix; the last times what
#: another rounding of the reduced bodies is seen to change.
ROUND_OFF, BY_CONDITION, BY_INERTIA, BY_RECORDS = 1e-12, 2e-14, 1e-14, 4.0

#: Units of mass (kg) in which all numbers of a reduced body's mesh are rounded anew.
ODD_MASSES = (3.0, 5.0, 7.0)

#: Of the motion, in rtol: of rigid bodies all, of bodies that deform positions alone, since the rates of modes too fast
#: to be seen are not what rtol bounds.
MOTION, MOTION_OF_MODES = 10.0, 10.0


@dataclass(frozen=True)
class Case:
    """A transformation, whether their motions agree to rtol, and what is drawn.

    A body whose frame is elsewhere is another one as soon as it is bent, in the second order.
    """

    name: str
    motion: bool = True
    options: dict[str, Any] = field(default_factory=dict)


CASES = (
    Case("order"),
    Case("turned_round"),
    Case("cut", options={"closed": True, "bodies": ("rigid",)}),
    Case("ways"),
    Case("markers"),
    Case("body_frames", options={"bodies": ("rigid", "rigid", "rigid", "beam")}),
    Case("welded", options={"bodies": ("rigid", "rigid", "rigid", "beam")}),
    Case("later"),
    Case("frame_elsewhere", motion=False, options={"bodies": ("rigid", "beam", "mesh")}),
)


def tolerance_of(*seen):
    """What rounding may leave of starts."""
    worst, inertia = max(one.condition for one in seen), max(one.inertia for one in seen)
    note(f"start, condition {worst:.3g} and {inertia:.3g}")
    return ROUND_OFF + BY_CONDITION * worst**2 + BY_INERTIA * inertia


def rounding_of_records(machine, by):
    """What other roundings of its reduced bodies change at the start: thin meshes are badly conditioned."""
    short = replace(machine, duration=1e-6 * machine.duration)
    start = see(short).start
    changes = []
    for mass in ODD_MASSES:
        anew = see(change.in_units(short, Units(mass=mass))).start
        changes.append(differences(anew.in_units(Units(mass=1.0 / mass)), start, by))
    return {kind: max(found[kind] for found in changes) for kind in changes[0]}


def check_start(machine, seen, by):
    """The machine starts where its description has it, and as fast."""
    found = differences(seen.start, described(machine, seen.start), by)
    note(f"start and description: {found}")
    assert max(found.values()) <= tolerance_of(seen), found


def compare_start(machines, one, other, by):
    """Positions, velocities, accelerations and reactions agree to round-off.

    ``machines``: those whose reduced bodies differ by their rounding.
    """
    tolerance = tolerance_of(one, other)
    found = differences(one.start, other.start, by, reactions=not (one.redundant or other.redundant))
    note(f"start: {found}")
    if max(found.values()) > tolerance:
        rounding = [rounding_of_records(m, by) for m in machines if any(part.reduced for part in m.parts)]
        note(f"rounding of records: {rounding}")
        found = {kind: value - BY_RECORDS * sum(each[kind] for each in rounding) for kind, value in found.items()}
    assert max(found.values()) <= tolerance, found


def compare_motion(machine, one, other, by):
    """The ends of the motions agree to what rtol allows."""
    by = by if machine.deforms else in_motion(by, machine)
    found = differences(one.end, other.end, by, reactions=not (one.redundant or other.redundant))
    if machine.deforms:
        found = {name: found[name] for name in ("position", "rotation")}
    elif "generalized-alpha" in one.run.stats.integrator:  # which finds accelerations by differences of a step
        found = {name: found[name] for name in ("position", "rotation", "velocity", "turning", "energy")}
    note(f"end: {found}")
    assert max(found.values()) <= (MOTION_OF_MODES if machine.deforms else MOTION) * rtol_of(machine), found


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
@few_and_a_thousand
def test_transformation(case, part):
    def agree(data):
        machine = data.draw(machines(**case.options))
        changed = getattr(change, case.name)(data.draw, machine)
        assume(changed is not None)
        note(f"changed to {changed}")
        one, other = see(machine), see(changed)
        by = sizes(machine, one.start)
        check_start(machine, one, by)
        check_start(changed, other, by)
        compare_start((machine, changed), one, other, by)
        if case.motion:
            compare_motion(machine, one, other, by)

    many(agree, CASES.index(case), part)


@few_and_a_thousand
def test_units(part):
    """All numbers scale, without any rounding but where metres meet radians."""

    def agree(data):
        machine, u = data.draw(machines()), change.units(data.draw)
        one, other = see(machine), see(change.in_units(machine, u))
        back = Units(1.0 / u.length, 1.0 / u.mass, 1.0 / u.time)
        by = sizes(machine, one.start)
        compare_start((machine,), one, _in_units(other, back), by)
        compare_motion(machine, one, _in_units(other, back), by)

    many(agree, 20, part)


def _in_units(seen, u):
    return type(seen)(
        seen.start.in_units(u), seen.end.in_units(u), seen.condition, seen.inertia, seen.redundant, seen.run, seen.built
    )


