"""Systems of units by name: files hold plain numbers, and much of industry computes in mm, t and s."""

from __future__ import annotations

from dataclasses import dataclass

from flexmbd.errors import ExportError

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
