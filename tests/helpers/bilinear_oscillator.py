"""The exact motion of a mass on a spring that yields once, piece by piece: harmonic motions between events."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq


@dataclass(frozen=True)
class BilinearOscillator:
    """m x'' + F(x) = P sin(w t), F of stiffness k up to the force ``yields`` and ``hardening`` beyond.

    With kinematic hardening the elastic range keeps its width 2 ``yields``, else it grows with the force reached.
    """

    mass: float
    stiffness: float
    yields: float
    hardening: float
    load: float
    frequency: float
    kinematic: bool

    def end(self, x: float, v: float, t_end: float) -> tuple[float, float, float, int]:
        """Place, velocity, plastic deformation at ``t_end`` from x, v on a slack spring, and how often it yields."""
        t, force, top, centre, half, count = 0.0, 0.0, 0, 0.0, self.yields, 0
        # the elastic range is centre - half to centre + half of the force; ``top``: which end it flows at, 0 none
        while t < t_end:
            slope = self.hardening if top else self.stiffness
            motion = self._branch(t, x, v, force, slope)
            event = self._event(motion, t, t_end, force, slope, x, top, centre, half)
            x0 = x
            x, v = motion(event)
            force += slope * (x - x0)
            t = event
            if t >= t_end:
                break
            if top:  # it turned
                if self.kinematic:
                    centre = force - top * half
                else:
                    half = abs(force)
                top = 0
            else:
                top, count = (1 if v > 0 else -1), count + 1
        return x, v, x - force / self.stiffness, count

    def _branch(self, t0, x0, v0, force, slope):
        """x(t), v(t) of m x'' = P sin(w t) - force - slope (x - x0)."""
        rate = np.sqrt(slope / self.mass)
        rest = x0 - force / slope
        amplitude = self.load / (slope - self.mass * self.frequency**2)
        a = x0 - rest - amplitude * np.sin(self.frequency * t0)
        b = (v0 - amplitude * self.frequency * np.cos(self.frequency * t0)) / rate

        def motion(t):
            s = t - t0
            turn = self.frequency * t
            x = rest + a * np.cos(rate * s) + b * np.sin(rate * s) + amplitude * np.sin(turn)
            v = rate * (b * np.cos(rate * s) - a * np.sin(rate * s)) + amplitude * self.frequency * np.cos(turn)
            return x, v

        return motion

    def _event(self, motion, t, t_end, force, slope, x0, top, centre, half):
        """When the velocity turns, if it flows, or when the elastic range ends; at most ``t_end``."""

        def past(at):
            x, v = motion(at)
            if top:
                return -top * v
            return abs(force + slope * (x - x0) - centre) - half

        step = 0.002 / max(np.sqrt(self.stiffness / self.mass), self.frequency)
        before, at = t, t
        started = False
        while at < t_end:
            before, at = at, min(at + step, t_end)
            if not started and past(before) >= 0.0 and past(at) < 0.0:
                started = True
                continue
            if past(before) < 0.0 <= past(at):
                return brentq(past, before, at, xtol=1e-16, rtol=1e-15)
            started = started or past(at) < 0.0
        return t_end
