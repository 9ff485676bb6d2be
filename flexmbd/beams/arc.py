"""A piece of a beam's axis, straight or an arc of a circle, and the section's axes along it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.beams.castigliano import Section, flexibility_along, section_axes
from flexmbd.round_off import SAME_PLACE

FloatArray = NDArray[np.float64]

# Points of Gauss' rule along a piece: to round-off up to a quarter of a circle.
_POINTS = 8



@dataclass(frozen=True, eq=False)
class Arc:
    """A piece of axis through three places.

    Attributes:
        start, middle, end: (3,) m.
    """

    start: FloatArray
    middle: FloatArray
    end: FloatArray

    @property
    def _bend(self) -> tuple[FloatArray, FloatArray, float, float] | None:
        """Centre (3,) m, unit normal (3,), radius (m), and angle (rad) of the arc; None: it is straight."""
        chord = self.end - self.start
        sagitta = self.middle - 0.5 * (self.start + self.end)
        rise, half = float(np.linalg.norm(sagitta)), 0.5 * float(np.linalg.norm(chord))
        if rise <= SAME_PLACE * half:
            return None
        radius = 0.5 * (half**2 / rise + rise)
        centre = self.middle - radius * sagitta / rise
        normal = np.cross(sagitta, chord)
        return centre, normal / np.linalg.norm(normal), radius, 4.0 * float(np.arctan2(rise, half))

    @property
    def length(self) -> float:
        """Length of the axis, m."""
        bend = self._bend
        return float(np.linalg.norm(self.end - self.start)) if bend is None else bend[2] * bend[3]

    def places(self, s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Places (k, 3) m and unit tangents (k, 3) at parts s (k,) of the length."""
        bend = self._bend
        chord = self.end - self.start
        if bend is None:
            return self.start + s[:, None] * chord, np.tile(chord / np.linalg.norm(chord), (len(s), 1))
        centre, normal, radius, angle = bend
        first = (self.start - centre) / radius
        second = np.cross(normal, first)
        turned = angle * s[:, None]
        outwards = np.cos(turned) * first + np.sin(turned) * second
        return centre + radius * outwards, np.cross(normal, outwards)

    def axes(self, s: FloatArray, section: Section, group: str) -> FloatArray:
        """(k, 3, 3) rows tangent, y and z of the section at parts s of the length.

        Raises:
            SceneError: the section's orientation lies along the beam there.
        """
        return np.array([section_axes(tangent, section, group) for tangent in self.places(s)[1]])

    def quadrature(self, first: float = 0.0, last: float = 1.0) -> tuple[FloatArray, FloatArray]:
        """Parts of the length (k,), and weights (k,) in m, of a quadrature from one part of the length to another."""
        points, weights = np.polynomial.legendre.leggauss(_POINTS)
        half = 0.5 * (last - first)
        return first + half * (1.0 + points), half * self.length * weights

    def flexibility(self, section: Section, group: str) -> FloatArray:
        """(6, 6) motion of its end per load there, its start held, in the section's axes at its start.

        As of `flexibility_along`; coordinates that have nothing to do with each other keep apart to the last bit.
        """
        s, weights = self.quadrature()
        turn = self.axes(np.zeros(1), section, group)[0].T
        levers = (self.end - self.places(s)[0]) @ turn
        return flexibility_along(section, levers, self.axes(s, section, group) @ turn, weights)
