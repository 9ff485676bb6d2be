"""A solid as a homogeneous motion knows it: mass, volume, centre and the second moments of mass."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.errors import SceneError
from flexmbd.multibody.closed_surface import enclosed_moments

FloatArray = NDArray[np.float64]

_ROUND_OFF = 1e-12  # of a second moment that should not be negative


@dataclass(frozen=True, eq=False)
class Solid:
    """The mass integrals of a solid body (Zienkiewicz, Taylor & Fox, eq. 8.16, 8.20).

    Attributes:
        mass: kg, positive.
        volume: m^3, positive.
        com: (3,) m, centre of mass, in the axes that the solid was given in.
        second: (3, 3) kg m^2, integral of density times (x - com)(x - com)^T (Euler's tensor), in those axes.

    Raises:
        SceneError: numbers that no solid has, each named.
    """

    mass: float
    volume: float
    com: FloatArray
    second: FloatArray

    def __post_init__(self) -> None:
        com, second = np.array(self.com, np.float64), np.array(self.second, np.float64)
        faults = [
            f"{name} must be positive, got {value}"
            for name, value in (("mass", self.mass), ("volume", self.volume))
            if not (np.isfinite(value) and value > 0.0)
        ]
        if com.shape != (3,) or not np.isfinite(com).all():
            faults.append(f"com must be three finite numbers (m), got {self.com!r}")
        if second.shape != (3, 3) or not np.isfinite(second).all():
            faults.append(f"second must be finite numbers of shape (3, 3), got {self.second!r}")
        elif abs(second - second.T).max() > _ROUND_OFF * abs(second).max():
            faults.append("second must be symmetric")
        elif np.linalg.eigvalsh(second)[0] <= _ROUND_OFF * abs(second).max():
            faults.append(f"second must be positive definite, its eigenvalues are {np.linalg.eigvalsh(second)}")
        if faults:
            raise SceneError("solid: " + "; ".join(faults))
        for name, value in (("com", com), ("second", second)):
            value.flags.writeable = False
            object.__setattr__(self, name, value)

    @classmethod
    def box(cls, sides: ArrayLike, *, density: float) -> Solid:
        """A box about the origin: sides (3,) m along the axes, density kg/m^3."""
        a = _lengths(sides, "sides of a box")
        return cls._even(float(a.prod()), a**2 / 12.0, density)

    @classmethod
    def ellipsoid(cls, semi_axes: ArrayLike, *, density: float) -> Solid:
        """An ellipsoid about the origin: semi-axes (3,) m along the axes, density kg/m^3."""
        a = _lengths(semi_axes, "semi-axes of an ellipsoid")
        return cls._even(4.0 / 3.0 * np.pi * float(a.prod()), a**2 / 5.0, density)

    @classmethod
    def from_surface(cls, points: ArrayLike, triangles: ArrayLike, *, density: float) -> Solid:
        """What a closed surface of flat triangles encloses; see ``closed_surface.enclosed_moments``.

        Args:
            points: (n, 3) m.
            triangles: (t, 3) rows of points.
            density: kg/m^3.

        Raises:
            SceneError: the surface is open, its triangles disagree which side is out, or it encloses no volume.
        """
        density = _positive(density)
        volume, centre, second = enclosed_moments(points, triangles)
        return cls(density * volume, volume, centre, density * second)

    @classmethod
    def _even(cls, volume: float, squares: ArrayLike, density: float) -> Solid:
        mass = _positive(density) * volume
        return cls(mass, volume, np.zeros(3), mass * np.diag(squares))

    @cached_property
    def inertia(self) -> FloatArray:
        """(3, 3) kg m^2 about the centre of mass (eq. 8.19)."""
        return np.trace(self.second) * np.eye(3) - self.second


def principal_axes(inertia: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Principal moments (3,) of an inertia (3, 3), ascending, and the rotation from their axes to its own.

    The third axis is the first times the second; of the others the largest component is positive.
    """
    moments, axes = np.linalg.eigh(inertia)
    for k in range(2):
        axes[:, k] *= np.sign(axes[np.argmax(abs(axes[:, k])), k])
    axes[:, 2] = np.cross(axes[:, 0], axes[:, 1])
    return moments, axes


def _lengths(values: ArrayLike, what: str) -> FloatArray:
    a = np.asarray(values, dtype=np.float64)
    if a.shape != (3,) or not np.isfinite(a).all() or (a <= 0.0).any():
        raise SceneError(f"{what} must be three positive numbers (m), got {values!r}")
    return a


def _positive(density: float) -> float:
    if not (np.isfinite(density) and density > 0.0):
        raise SceneError(f"density must be positive (kg/m^3), got {density}")
    return float(density)
