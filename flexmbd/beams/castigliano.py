"""The beam spring of a discrete element: its flexibility by Castigliano's theorem, its stiffness from that.

Anthonis & Ramon 2003 (Comparison between the discrete and finite element methods for modelling an
agricultural spray boom, part 1), eq. 16-21, with the shear factors as divisors, k = 1 / kappa.
"""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import SceneError
from flexmbd.round_off import SAME_PLACE

FloatArray = NDArray[np.float64]



class Section(Protocol):
    """Material and section of a beam; `flexmbd.forms.beam_timoshenko.Parameters` is one."""

    @property
    def E(self) -> float:
        """Young's modulus, Pa."""

    @property
    def nu(self) -> float:
        """Poisson's ratio."""

    @property
    def rho(self) -> float:
        """Density, kg/m^3."""

    @property
    def A(self) -> float:
        """Area, m^2."""

    @property
    def Iy(self) -> float:
        """Integral of z^2, m^4."""

    @property
    def Iz(self) -> float:
        """Integral of y^2, m^4."""

    @property
    def Iyz(self) -> float:
        """Integral of y z, m^4."""

    @property
    def J(self) -> float:
        """Torsion constant, m^4."""

    @property
    def ky(self) -> float:
        """Shear factor along y; infinite for a beam without shear."""

    @property
    def kz(self) -> float:
        """Shear factor along z."""

    @property
    def orientation(self) -> tuple[float, float, float]:
        """A vector whose part normal to the axis is y; z = tangent x y."""


def check_section(section: Section, group: str) -> None:
    """Refuse values that no section has.

    Raises:
        SceneError: names the group and the value.
    """
    names = "E", "rho", "A", "Iy", "Iz", "J", "ky", "kz"
    try:
        values = {name: float(getattr(section, name)) for name in names}
        nu, mixed = float(section.nu), float(section.Iyz)
    except (AttributeError, TypeError, ValueError) as error:
        raise SceneError(f"section of {group!r}: {error}; give forms.beam_timoshenko.Parameters or its like") from error
    for name, value in values.items():
        # written so that NaN fails; without shear its factors are infinite
        if not (0.0 < value and (math.isfinite(value) or name in ("ky", "kz"))):
            raise SceneError(f"section of {group!r}: {name} must be positive and finite, got {value}")
    if not -1.0 < nu < 0.5:
        raise SceneError(f"section of {group!r}: nu must lie between -1 and 0.5, got {section.nu}")
    if not mixed**2 < section.Iy * section.Iz:
        raise SceneError(
            f"section of {group!r}: Iyz^2 must be less than Iy Iz, or bending has no positive energy; got Iyz = "
            f"{section.Iyz}, Iy = {section.Iy}, Iz = {section.Iz} m^4"
        )


def section_axes(along: FloatArray, section: Section, group: str) -> FloatArray:
    """(3, 3) rotation whose rows are the tangent, y and z of a beam in the frame's axes.

    Args:
        along: (3,) from the beam's start to its end.
        section: of the beam.
        group: of the beam, for the message.

    Raises:
        SceneError: the orientation lies along the beam.
    """
    t = along / np.linalg.norm(along)
    towards = np.asarray(section.orientation, dtype=np.float64)
    y = towards - (towards @ t) * t
    size = np.linalg.norm(y)
    if not size > SAME_PLACE * np.linalg.norm(towards):
        raise SceneError(
            f"section of {group!r} has its orientation {section.orientation} along a beam of the group; take a vector "
            "that is across all its beams, or put that beam in a group of its own"
        )
    y = y / size
    return np.stack([t, y, np.cross(t, y)])


def compliance(section: Section) -> FloatArray:
    """(6, 6) strains of a section by its resultants, along and about t, y, z: 1/N, 1/(N m^2).

    Raises:
        SceneError: a stiffness is beyond what numbers hold.
    """
    shear = section.E / (2.0 * (1.0 + section.nu))
    answer = np.zeros((6, 6))
    stretch = section.E * section.A, section.ky * shear * section.A, section.kz * shear * section.A
    direct = np.array([*stretch, shear * section.J])
    bending = section.E * np.array([[section.Iy, -section.Iyz], [-section.Iyz, section.Iz]])
    try:
        if not (direct > 0.0).all():  # without shear two are infinite
            raise np.linalg.LinAlgError
        answer[:4, :4] = np.diag(1.0 / direct)
        answer[4:, 4:] = np.linalg.inv(bending)
    except np.linalg.LinAlgError:
        raise SceneError(f"{section!r:.200}: numbers do not hold its stiffnesses, which are too small") from None
    return answer


def flexibility_along(section: Section, levers: FloatArray, axes: FloatArray, weights: FloatArray) -> FloatArray:
    """Motion of the end of a beam of any axis per load on it, its start held, (6, 6) in the axes of the arguments.

    Castigliano's theorem, eq. 19: the integral along the beam of B^T C B, where B gives the normal and shear forces and
    the moments at a place for a unit load (N; N m) at the end, and C is the compliance of the section.

    Args:
        section: of the beam.
        levers: (k, 3) m, from places of a quadrature to the end.
        axes: (k, 3, 3) there, rows t, y, z.
        weights: (k,) m.

    Returns:
        Rows: displacement (m) and small rotation (rad); columns: force, moment.
    """
    strains = compliance(section)
    total = np.zeros((6, 6))
    for (x, y, z), turn, weight in zip(levers, axes, weights, strict=True):
        inner = np.zeros((6, 6))
        inner[:3, :3] = inner[3:, 3:] = turn
        inner[3:, :3] = turn @ np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        total += weight * inner.T @ strains @ inner
    return total


def stiffness(flexibility: FloatArray, along: FloatArray) -> FloatArray:
    """(12, 12) N/m, N, N m of a beam: six coordinates of its start, then of its end.

    The inverse of the flexibility, and what equilibrium makes of it at the start (eq. 21).

    Args:
        flexibility: (6, 6) as of `flexibility_along`.
        along: (3,) m, from its start to its end, in the same axes.
    """
    x, y, z = along
    # a load on the end and those that hold the start
    both = np.vstack([-np.eye(6), np.eye(6)])
    both[3:6, :3] = -np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    scale = np.array([1.0] * 3 + [1.0 / float(np.linalg.norm(along))] * 3)
    even = np.linalg.inv(flexibility / np.outer(scale, scale)) / np.outer(scale, scale)
    return both @ even @ both.T
