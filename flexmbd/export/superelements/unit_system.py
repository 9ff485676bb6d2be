"""Systems of units of matrices: files hold plain numbers, and much of industry computes in mm, t and s.

Imported by the readers and writers of matrices in this room.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from flexmbd.errors import ExportError
from flexmbd.export.superelements.superelement import Superelement

#: Name of the units of all records.
SI = "m-kg-s"

_POUND_FORCE = 4.4482216152605  # N
_LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 0.0254, "ft": 0.3048}
_MASSES = {"kg": 1.0, "t": 1e3, "g": 1e-3, "slinch": _POUND_FORCE / 0.0254, "slug": _POUND_FORCE / 0.3048}
_TIMES = {"s": 1.0, "ms": 1e-3}


@dataclass(frozen=True)
class UnitSystem:
    """A consistent system of units; those of force, moment and stress follow.

    Attributes:
        length: m.
        mass: kg.
        time: s.
    """

    length: float
    mass: float
    time: float


def unit_system(name: str) -> UnitSystem:
    """The system called length-mass-time, as "mm-t-s".

    Raises:
        ExportError: it is none.
    """
    parts = name.split("-") if isinstance(name, str) else []
    if len(parts) != 3 or parts[0] not in _LENGTHS or parts[1] not in _MASSES or parts[2] not in _TIMES:
        raise ExportError(
            f"units={name!r} is not length-mass-time, as 'mm-t-s'; lengths are {', '.join(_LENGTHS)}, masses "
            f"{', '.join(_MASSES)}, times {', '.join(_TIMES)}"
        )
    return UnitSystem(_LENGTHS[parts[0]], _MASSES[parts[1]], _TIMES[parts[2]])


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
