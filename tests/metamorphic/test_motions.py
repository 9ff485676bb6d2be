"""Random machines in motion: integrators agree, a restart goes on to the bit, energy is accounted for."""

from __future__ import annotations

import numpy as np
import pytest
from drawing import machines
from drawing_parts import BENDING, SHARES, STEPPED
from hypothesis import note
from hypothesis import strategies as st
from many import few_and_a_thousand, many
from observation import differences, sizes
from power import INTERVALS, work
from random_machine import build
from running import see

import flexmbd as fm

RIGID, EITHER = ("rigid", "rigid", "pseudo"), ("rigid", "pseudo", "beam")
DEFORMED = ("position", "rotation")

#: Kinds of loads, each of which the account of energy is to meet: none of the other tests sees what they take.
DAMPERS = ("spring", "bush", "coordinate spring", "friction", "pin", "motor", "push")

#: The integrators with error control: at which rtol, for which bodies, and how many rtol their error may be.
METHODS = {
    "Dormand-Prince 5": (fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_5), 1e-6, RIGID, 10.0),
    "Dormand-Prince 8": (fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8), 1e-8, RIGID, 10.0),
    "Radau": (fm.RadauIIA(), 1e-6, EITHER, 10.0),
    "generalized-alpha": (fm.GeneralizedAlpha(), 1e-4, EITHER, 10.0),
    "energy-momentum": (fm.EnergyMomentum(), 1e-4, RIGID, 10.0),
}


@pytest.mark.parametrize("name", METHODS)
@few_and_a_thousand
def test_error_is_at_most_so_many_rtol(name, part):
    """Against Radau, or the explicit pair of order 8, at a tolerance ten thousand times tighter."""
    method, rtol, bodies, most = METHODS[name]

    def agree(data):
        machine = data.draw(machines(bodies=bodies))
        exact = fm.RadauIIA() if machine.deforms else fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8)
        reference = see(machine, rtol=max(1e-4 * rtol, 1e-11), integrator=exact)
        one = see(machine, rtol=rtol, integrator=method)
        found = differences(one.end, reference.end, sizes(machine, reference.start))
        found = {kind: found[kind] for kind in DEFORMED}
        note(f"{found}, {one.run.stats}")
        assert max(found.values()) <= most * rtol, found

    many(agree, 60 + list(METHODS).index(name), part, few=15)


@pytest.mark.parametrize("name", METHODS)
@few_and_a_thousand
def test_restart(name, part):
    """From a checkpoint, in another System of the same description, to the bit as without a stop."""
    method, rtol, bodies, _ = METHODS[name]

    def agree(data):
        machine = data.draw(machines(bodies=bodies))
        middle, end = machine.start + 0.375 * machine.duration, machine.start + machine.duration
        whole = see(machine, rtol=rtol, integrator=method, checkpoints=[middle]).run
        kept = whole.checkpoints[0]
        rest = build(machine).scene.simulate(end, rtol=rtol, integrator=method, restart=kept)
        rows = len(whole.t) - len(rest.t)
        for part in ("t", "x", "v", "a", "multipliers"):
            np.testing.assert_array_equal(getattr(rest, part), getattr(whole, part)[rows:])

    many(agree, 70 + list(METHODS).index(name), part, few=15)


@few_and_a_thousand
def test_energy_is_what_there_was_and_the_work_since(part):
    """With the work of loads, motors, motions, dampers and friction summed up over equal steps.

    Motions whose rate jumps do work in no time, and short pulses between two rows, which is not summed up.
    """

    def agree(data):
        damped_by = data.draw(st.sampled_from(DAMPERS))
        machine = data.draw(machines(bodies=RIGID, loads_of=STEPPED, motions_of=BENDING, damped_by=damped_by))
        seen = see(
            machine,
            h=machine.duration / (SHARES * INTERVALS),
            integrator=fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8),
        )
        run = seen.run
        total = run.energy().total
        done = work(machine, seen.built, run)
        size = max(np.abs(total - total[0]).max(), np.abs(run.energy().kinetic).max(), np.abs(done).max())
        note(f"energy {total[-1] - total[0]}, work {done[-1]}, size {size}")
        assert abs(total[-1] - total[0] - done[-1]) <= 1e-8 * size

    many(agree, 80, part)
