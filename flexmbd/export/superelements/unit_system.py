"""Superelements in other systems of units.

Imported by the readers and writers of matrices in this room.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from flexmbd.export.superelements.superelement import Superelement
from flexmbd.files.units import SI as SI
from flexmbd.files.units import UnitSystem
from flexmbd.files.units import unit_system as unit_system


def to_si(element: Superelement, units: UnitSystem) -> Superelement:
    """The same superelement in SI units; modes of unit mass stay such."""
    return _changed(element, units)


def from_si(element: Superelement, units: UnitSystem) -> Superelement:
    """A superelement in SI units, in others; modes of unit mass stay such."""
    return _changed(element, UnitSystem(1.0 / units.length, 1.0 / units.mass, 1.0 / units.time))


def _changed(element: Superelement, unit: UnitSystem) -> Superelement:
    """The numbers of a superelement in other units, of which one before is `unit` now.

    A coordinate x becomes s x; energies are quadratic in the coordinates or their rates.
    """
    b, n = len(element.names), element.n_boundary
    s = np.full(len(element.K), unit.length * np.sqrt(unit.mass))
    s[:n] = unit.length
    s[: 6 * b] = np.tile(np.repeat([unit.length, 1.0], 3), b)
    inertia = unit.mass * unit.length**2 / np.outer(s, s)
    return replace(
        element,
        p=unit.length * element.p,
        x=unit.length * element.x,
        K=inertia / unit.time**2 * element.K,
        M=inertia * element.M,
        D=inertia / unit.time * element.D,
    )
