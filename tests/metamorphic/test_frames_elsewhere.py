"""A reduced body with its frame elsewhere is another one, but only to the second order in how far it is bent.

A reduced body's displacements are linear in its frame's axes, so that another frame leaves out other products of
displacements, and of forces and displacements.  Of a machine at rest whose loads are all made s times as large its
deflections, speeds and drifts are so too, to first order: frames may differ by s^2 alone.  Where forces stay as they
are, as of a fast rotation, they differ in proportion to the deflection, and that is no fault.
"""

from __future__ import annotations

from dataclasses import replace

import functions_of_time as of_time
import numpy as np
import transformations as change
from drawing import machines
from hypothesis import assume, note, reject
from many import few_and_a_thousand, many
from random_machine import Units, build

import flexmbd as fm
from flexmbd.run.stopped import SimulationError

#: How much softer the parts are, and how many times as long they move, so that bending is more than rounding.
SOFTER, LONGER = 2.0**8, 4.0
STEPS = 64

#: A quarter of the loads must leave less than 4^-1.5 of the difference: half way, in orders, from the first to the
#: second; and this share of the machine's extent is rounding.
LEFT, ROUND_OFF = 4.0**-1.5, 1e-11

#: Orders are told where frames differ by less than this share of the extent: there parts bend by some hundredths.
LITTLE = 1e-4


def _loaded(machine, s):
    """With soft parts and s of the loads, speeds and motions, which bend it by s as much."""
    parts = []
    for part in machine.parts:
        body = part.body
        if part.reduced:
            # the modes that a damping ratio is given for are those of the frame
            body = replace(body, E=body.E / SOFTER, damping=0.0)
        pose = replace(part.pose, v=s * part.pose.v, w=s * part.pose.w)
        parts.append(replace(part, body=body, pose=pose))
    links = [link if link.motion is None else _driven(link, machine.start, s) for link in machine.links]
    forces = Units(mass=s)
    loads = [load.in_units(forces, machine.turns(load)) for load in machine.loads]
    return replace(
        machine,
        parts=tuple(parts),
        links=tuple(links),
        loads=tuple(loads),
        gravity=s * machine.gravity,
        duration=LONGER * machine.duration,
    )


def _driven(link, t, s):
    """By s of the way from where the link is at t."""
    motion = of_time.in_units(link.motion, s, 1.0)
    return replace(link, motion=of_time.raised(motion, of_time.value(link.motion, t) - of_time.value(motion, t)))


def _positions(machine):
    """(rows, probes, 3) at fixed steps, whose own error is the same in every frame to first order."""
    built = build(machine)
    end, h = machine.start + machine.duration, machine.duration / STEPS
    try:
        run = built.scene.simulate(end, t_start=machine.start, h=h, rtol=1e-10, integrator=fm.RadauIIA())
    except SimulationError:  # the step is too long for some
        reject()
    return np.stack([run.position(built.frame(machine.probes[name])) for name in sorted(machine.probes)], axis=1)


def _apart(machine, changed, s):
    """Of the machine's extent."""
    one, other = (_positions(_loaded(each, s)) for each in (machine, changed))
    return np.abs(one - other).max() / machine.extent


@few_and_a_thousand
def test_frames_differ_to_second_order_in_the_deflection(part):
    def agree(data):
        machine = data.draw(machines(bodies=("rigid", "beam", "beam")))
        changed = change.frame_elsewhere(data.draw, machine)
        assume(changed is not None)
        note(f"changed to {changed}")
        s = 2.0**-4
        apart, less = _apart(machine, changed, s), _apart(machine, changed, s / 4.0)
        while apart > LITTLE:
            s, apart, less = s / 4.0, less, _apart(machine, changed, s / 16.0)
        note(f"apart by {apart} and {less}")
        assume(apart > 10.0 * ROUND_OFF)
        # where higher orders still count, less of the loads tells: first order would leave a quarter down to rounding
        while less > LEFT * apart + ROUND_OFF and less > 10.0 * ROUND_OFF:
            s, apart, less = s / 4.0, less, _apart(machine, changed, s / 16.0)
            note(f"apart by {apart} and {less}")
        assert less <= LEFT * apart + ROUND_OFF

    many(agree, 30, part, few=6)
