"""Random machines of rigid bodies whose shapes touch, on short motions: what is of no matter, restarts, integrators.

Smooth contacts by error control, hard ones by equal steps: of these what leaves a step's equations as they are.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import transformations as change
from drawing import machines
from hypothesis import assume, note, reject
from hypothesis import strategies as st
from many import few_and_a_thousand, many
from observation import differences, sizes
from random_machine import Units, build
from running import see
from touching import touches

import flexmbd as fm
from flexmbd.run.stopped import SimulationError

#: Changes to descriptions, whose motions agree to so many rtol.
CASES = ("order", "turned_round", "ways", "body_frames", "welded")
MOST = 30.0
RTOL = 1e-7
METHODS = {
    "Dormand-Prince 8": (fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8), 1e-7),
    "Radau": (fm.RadauIIA(), 1e-6),
    "generalized-alpha": (fm.GeneralizedAlpha(), 1e-4),
    "Dormand-Prince 5": (fm.ExplicitRungeKutta(), 1e-6),
    "energy-momentum": (fm.EnergyMomentum(), 1e-4),
}


def touching(data, *, rough=None):
    """A machine of rigid bodies, loads left out, with one or two contacts; ``rough``: with friction, None: some."""
    machine = data.draw(machines(bodies=("rigid",), loads=False))
    for _ in range(data.draw(st.integers(1, 2))):
        rubs = data.draw(st.booleans()) if rough is None else rough
        machine = replace(machine, touches=(*machine.touches, touches(data.draw, machine, rough=rubs)))
    return machine


def moved(machine, one, other):
    """Differences of places and axes at the end, over the machine's own sizes."""
    found = differences(one.end, other.end, sizes(machine, one.start))
    note(f"{found}, {one.run.stats}, {other.run.stats}")
    return max(found["position"], found["rotation"])


@pytest.mark.parametrize("name", CASES)
@few_and_a_thousand
def test_what_is_of_no_matter(name, part):
    def agree(data):
        machine = touching(data)
        changed = getattr(change, name)(data.draw, machine)
        assume(changed is not None)
        note(f"changed to {changed}")
        assert moved(machine, see(machine, rtol=RTOL), see(changed, rtol=RTOL)) <= MOST * RTOL

    many(agree, 90 + CASES.index(name), part, few=15)


@few_and_a_thousand
def test_the_mirror_image(part):
    """Places and turns of the mirrored machine are the mirror image of the machine's."""

    def agree(data):
        machine = touching(data)
        image = change.mirrored(data.draw, machine)
        one, other = see(machine, rtol=RTOL), see(image, rtol=RTOL)
        assert moved(machine, one, replace(other, end=other.end.mirrored())) <= MOST * RTOL

    many(agree, 104, part, few=15)


@few_and_a_thousand
def test_another_root(part):
    """The free joint of a machine that flies on another body."""

    def agree(data):
        machine = change.flying(touching(data))
        changed = change.rooted_elsewhere(data.draw, machine)
        assert moved(machine, see(machine, rtol=RTOL), see(changed, rtol=RTOL)) <= MOST * RTOL

    many(agree, 105, part, few=15)


@few_and_a_thousand
def test_units(part):
    def agree(data):
        machine, u = touching(data), change.units(data.draw)
        one, other = see(machine, rtol=RTOL), see(change.in_units(machine, u), rtol=RTOL)
        back = Units(1.0 / u.length, 1.0 / u.mass, 1.0 / u.time)
        assert moved(machine, one, replace(other, end=other.end.in_units(back))) <= MOST * RTOL

    many(agree, 96, part, few=15)


@pytest.mark.parametrize("name", METHODS)
@few_and_a_thousand
def test_another_integrator(name, part):
    """Against Dormand & Prince's pair of order 8 at a tighter tolerance; without friction."""
    method, rtol = METHODS[name]

    def agree(data):
        machine = touching(data, rough=False)
        exact = see(machine, rtol=1e-10, integrator=fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8))
        assert moved(machine, exact, see(machine, rtol=rtol, integrator=method)) <= MOST * rtol

    many(agree, 97 + list(METHODS).index(name), part, few=15)


@pytest.mark.parametrize("name", METHODS)
@few_and_a_thousand
def test_a_restart_in_contact(name, part):
    """To the bit as without a stop, what a bristle remembers with it."""
    method, rtol = METHODS[name]

    def agree(data):
        machine = touching(data)
        middle, end = machine.start + 0.375 * machine.duration, machine.start + machine.duration
        try:
            whole = see(machine, rtol=rtol, integrator=method, checkpoints=[middle]).run
        except SimulationError:
            assume(name != "energy-momentum")  # which stops in some rough contacts, docs/contact.md
            raise
        rest = build(machine).scene.simulate(end, rtol=rtol, integrator=method, restart=whole.checkpoints[0])
        for values in ("t", "x", "v", "a"):
            np.testing.assert_array_equal(getattr(rest, values), getattr(whole, values)[len(whole.t) - len(rest.t) :])

    many(agree, 101 + list(METHODS).index(name), part, few=10)


# ------------------------------------------------------------------------------------------------------ hard contacts

STEPS = 40


def hard(data):
    """A machine without loops, gears and motions whose shapes touch by impulses."""
    machine = data.draw(machines(bodies=("rigid",), loads=False, loops=False))
    links = tuple(replace(link, motion=None) for link in machine.links)
    machine = replace(machine, links=links, gears=())
    for _ in range(data.draw(st.integers(1, 2))):
        touch = touches(data.draw, machine, rough=data.draw(st.booleans()))
        machine = replace(machine, touches=(*machine.touches, replace(touch, hard=True)))
    return machine


def stepped(machine, **options):
    """By equal steps; another machine is drawn where the run tells that it finds no impulses.

    Painlevé's case, or a contact of parts that cannot move against each other, as some that a joint holds.
    """
    try:
        return see(machine, rtol=1e-9, h=machine.duration / STEPS, integrator=fm.MoreauJean(), **options)
    except SimulationError:
        reject()


def hard_order(draw, machine):
    return change.order(draw, machine), lambda moment: moment


def hard_units(draw, machine):
    u = change.units(draw)
    back = Units(1.0 / u.length, 1.0 / u.mass, 1.0 / u.time)
    return change.in_units(machine, u), lambda moment: moment.in_units(back)


def hard_mirror(draw, machine):
    return change.mirrored(draw, machine), lambda moment: moment.mirrored()


@pytest.mark.parametrize("altered", [hard_order, hard_units, hard_mirror])
@few_and_a_thousand
def test_what_is_of_no_matter_to_hard_contacts(altered, part):
    def agree(data):
        machine = hard(data)
        changed, back = altered(data.draw, machine)
        one, other = stepped(machine), stepped(changed)
        assert moved(machine, one, replace(other, end=back(other.end))) <= 1e-6

    many(agree, 106 + [hard_order, hard_units, hard_mirror].index(altered), part, few=15)


@few_and_a_thousand
def test_a_restart_in_hard_contact(part):
    def agree(data):
        machine = hard(data)
        h = machine.duration / STEPS
        middle, end = machine.start + 15 * h, machine.start + machine.duration
        whole = stepped(machine, checkpoints=[middle]).run
        rest = build(machine).scene.simulate(
            end, rtol=1e-9, h=h, integrator=fm.MoreauJean(), restart=whole.checkpoints[0]
        )
        for values in ("t", "x", "v", "a"):
            np.testing.assert_array_equal(getattr(rest, values), getattr(whole, values)[len(whole.t) - len(rest.t) :])

    many(agree, 109, part, few=10)
