"""More modes: the eigenvalues of a random machine at rest fall, or stay, and none rises."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from beam_records import Beam
from drawing import machines
from hypothesis import assume, note
from many import few_and_a_thousand, many
from random_machine import build

#: rad^2/s^2, over the largest eigenvalue: what rounding leaves of those of rigid motions, and may add to others.
ROUND_OFF = 1e-9


def eigenvalues(machine):
    """(n,) squares of the angular frequencies, ascending; those of rigid motions are next to zero."""
    found = build(machine).scene.linearize(t=machine.start).eigenvalues()
    return np.sort(np.abs(found.imag) ** 2)


def _with_modes(part, modes):
    return replace(part, body=replace(part.body, modes=modes, damping=0.0)) if isinstance(part.body, Beam) else part


@few_and_a_thousand
def test_eigenvalues_fall_with_modes(part):
    """By the theorem of minimum and maximum, since fewer modes span a part of what more do."""

    def agree(data):
        machine = data.draw(machines(bodies=("rigid", "beam", "beam"), moving=False, loads=False))
        assume(any(isinstance(part.body, Beam) for part in machine.parts))
        few = None
        for modes in (0, 2, 5):
            more = eigenvalues(replace(machine, parts=tuple(_with_modes(part, modes) for part in machine.parts)))
            if few is not None:
                least = ROUND_OFF * few[-1]
                note(f"{few} to {more[: len(few)]}")
                assert (more[: len(few)] <= few * (1.0 + ROUND_OFF) + least).all()
            few = more

    many(agree, 90, part, few=15)
