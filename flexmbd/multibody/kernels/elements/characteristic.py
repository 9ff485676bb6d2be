"""A spring whose force is a piecewise polynomial of the deflection, and a damper.

Its numbers: rest, c, force and potential over the deflection (see ``time_functions.piecewise``).
"""

from __future__ import annotations

from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.elements.element import Behaviour, CoordinateLaw, Stiffness
from flexmbd.multibody.kernels.physics.time_functions import piecewise


@kernel
def _law(plan, row, x, rate):
    data = plan.data
    o = row[at.EL_DATA]
    force, slope, _ = piecewise(data, o + 2, row[at.EL_COUNT], x - data[o])
    return -force - data[o + 1] * rate, -slope, -data[o + 1]


@kernel
def _energy(plan, row, x):
    data = plan.data
    o = row[at.EL_DATA]
    pieces = row[at.EL_COUNT]
    potential = o + 4 + pieces + int(data[o + 2]) * pieces
    return piecewise(data, potential, pieces, x - data[o])[0]


CHARACTERISTIC = CoordinateLaw(Behaviour("springs", Stiffness.SEEN, changing=True, damper=(1, 1)), _law, _energy)
