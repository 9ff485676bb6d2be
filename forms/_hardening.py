"""Isotropic hardening: how the yield stress of a plastic form grows with the accumulated plastic strain.

Not a formulation, as its name begins with an underscore.  Forms alone import it.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Protocol

import ufl

from flexmbd.forms._shared import Expr, take_numbers


class Hardening(Protocol):
    """How the yield stress grows over its first value with the accumulated plastic strain."""

    def growth(self, alpha: Expr) -> Expr:
        """Growth, Pa, at the accumulated plastic strain alpha (dimensionless); zero at alpha = 0."""

    def work(self, alpha: Expr) -> Expr:
        """Integral of `growth` from 0 to alpha, J/m^3."""


@dataclass(frozen=True)
class LinearHardening:
    """Linear hardening: growth = modulus * alpha.

    Attributes:
        modulus: plastic modulus H of a uniaxial test (stress over plastic strain), Pa, at least 0.

    Raises:
        ValueError: the modulus is not finite, or below zero.
    """

    modulus: float = 0.0

    def __post_init__(self) -> None:
        take_numbers(self)
        if not 0.0 <= self.modulus < float("inf"):
            raise ValueError(f"the plastic modulus must be finite and at least 0 (Pa), got {self.modulus}")

    def growth(self, alpha: Expr) -> Expr:
        """See `Hardening`."""
        return self.modulus * alpha

    def work(self, alpha: Expr) -> Expr:
        """See `Hardening`."""
        return self.modulus / 2 * alpha**2


@dataclass(frozen=True)
class VoceHardening:
    """Saturating hardening: growth = saturation (1 - exp(-rate alpha)) + modulus alpha (Voce 1948).

    Attributes:
        saturation: what the exponential part ends at, Pa, at least 0.
        rate: of the exponential, dimensionless, > 0.
        modulus: of the linear part, Pa, at least 0.

    Raises:
        ValueError: a value is not a finite number inside its range.
    """

    saturation: float
    rate: float
    modulus: float = 0.0

    def __post_init__(self) -> None:
        take_numbers(self)
        for name, value in (("saturation", self.saturation), ("modulus", self.modulus)):
            if not 0.0 <= value < float("inf"):
                raise ValueError(f"{name} must be finite and at least 0 (Pa), got {value}")
        if not 0.0 < self.rate < float("inf"):
            raise ValueError(f"rate must be positive and finite, got {self.rate}")

    def growth(self, alpha: Expr) -> Expr:
        """See `Hardening`."""
        return self.saturation * (1 - ufl.exp(-self.rate * alpha)) + self.modulus * alpha

    def work(self, alpha: Expr) -> Expr:
        """See `Hardening`."""
        decay = (1 - ufl.exp(-self.rate * alpha)) / self.rate
        return self.saturation * (alpha - decay) + self.modulus / 2 * alpha**2


@dataclass(frozen=True)
class TabulatedHardening:
    """Hardening read from the curve of a uniaxial test: linear between its points, constant behind.

    Attributes:
        plastic_strain: (n,) of the points, ascending from 0.
        stress: (n,) Pa, true stress at them, not falling; the first is the yield stress.

    Raises:
        ValueError: fewer than two points, or a curve that is not a function, does not begin at zero
            plastic strain, or falls.
    """

    plastic_strain: tuple[float, ...]
    stress: tuple[float, ...]

    def __post_init__(self) -> None:
        for item in fields(self):
            values = tuple(float(value) for value in getattr(self, item.name))
            if not all(abs(value) < float("inf") for value in values):
                raise ValueError(f"{item.name} of the hardening table must be finite, got {values}")
            object.__setattr__(self, item.name, values)
        strain, stress = self.plastic_strain, self.stress
        if len(strain) != len(stress) or len(strain) < 2:
            raise ValueError(
                "the hardening table needs two points or more, with a stress for every plastic strain; "
                f"got {len(strain)} strains and {len(stress)} stresses"
            )
        if strain[0] != 0.0:
            raise ValueError(f"the hardening table must begin at plastic strain 0, not at {strain[0]}")
        for k in range(1, len(strain)):
            if not strain[k] > strain[k - 1]:
                raise ValueError(
                    f"the hardening table is not a function: plastic strain {strain[k]} follows {strain[k - 1]}"
                )
            if not stress[k] >= stress[k - 1]:
                raise ValueError(
                    f"the hardening table falls from {stress[k - 1]} to {stress[k]} Pa at plastic strain "
                    f"{strain[k]}: softening has no unique solution"
                )

    def growth(self, alpha: Expr) -> Expr:
        """See `Hardening`."""
        return sum(bend * ufl.max_value(alpha - start, 0.0) for start, bend in self._bends())

    def work(self, alpha: Expr) -> Expr:
        """See `Hardening`."""
        return sum(bend / 2 * ufl.max_value(alpha - start, 0.0) ** 2 for start, bend in self._bends())

    def _bends(self) -> list[tuple[Expr, Expr]]:
        """Where the curve bends, and by how much its slope changes there."""
        strain, stress, n = self.plastic_strain, self.stress, len(self.stress)
        slopes = [(stress[k + 1] - stress[k]) / (strain[k + 1] - strain[k]) for k in range(n - 1)]
        changes = [slopes[0], *(slopes[k] - slopes[k - 1] for k in range(1, n - 1)), -slopes[-1]]
        return [(strain[k], changes[k]) for k in range(n)]


def check_yield(yield_stress: float, hardening: Hardening) -> None:
    """Refuse a yield stress, or a hardening that does not go with it.

    Raises:
        ValueError: not positive and finite, no hardening, or a table that begins elsewhere.
    """
    if not 0.0 < yield_stress < float("inf"):
        raise ValueError(f"yield_stress must be positive and finite (Pa), got {yield_stress}")
    if not (hasattr(hardening, "growth") and hasattr(hardening, "work")):
        raise ValueError(
            "hardening must be LinearHardening(...), VoceHardening(...), TabulatedHardening(...) (all of "
            f"flexmbd.forms.j2_plasticity) or the like, with growth(alpha) and work(alpha), got {hardening!r}"
        )
    first = hardening.stress[0] if isinstance(hardening, TabulatedHardening) else yield_stress
    if abs(first - yield_stress) > 1e-9 * yield_stress:
        raise ValueError(f"the hardening table begins at {first} Pa and not at the yield stress, {yield_stress} Pa")
