"""A measured curve of force over deformation, elastic and then hardening, as numbers of an elasto-plastic law."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.errors import SceneError
from flexmbd.given import is_number, numbers
from flexmbd.multibody.kernels.elements.elastoplastic import N_MEMORY_BEFORE
from flexmbd.round_off import TEN_DIGITS

FloatArray = NDArray[np.float64]


#: What a user asks for by name; the law's own numbers follow.
PLASTIC_NAMES = ("plastic_deformation", "plastic_way", "dissipated")


@dataclass(frozen=True, eq=False)
class YieldCurve:
    """A curve of straight pieces through the origin, for both directions alike; the last goes on.

    Attributes:
        stiffness: of the elastic piece (N/m or N m/rad).
        yields: (n,) deformations (m or rad) at which it bends.
        forces: (n,) forces (N or N m) there.
        slopes: (n,) of the pieces after these.
    """

    stiffness: float
    yields: FloatArray
    forces: FloatArray
    slopes: FloatArray

    def law_numbers(self, kinematic: float) -> FloatArray:
        """The numbers of ``kernels.elements.elastoplastic``, for a share of kinematic hardening."""
        before = np.array([self.stiffness, *self.slopes[:-1]])
        plastic = self.yields - self.forces / self.stiffness
        last = self.stiffness * self.slopes[-1] / (self.stiffness - self.slopes[-1])
        side_by_side = np.column_stack([before - self.slopes, self.yields]).ravel()
        growing = np.column_stack([plastic, self.forces]).ravel()
        n = float(len(self.yields))
        return np.array([kinematic, n, self.stiffness, *side_by_side, self.slopes[-1], *growing, last])

    def memory(self) -> dict[str, float]:
        """Names of what the law remembers, with the zeros that it begins with."""
        own = N_MEMORY_BEFORE - len(PLASTIC_NAMES) + len(self.yields)
        return dict.fromkeys([*PLASTIC_NAMES, *(f"_{k}" for k in range(own))], 0.0)


def yield_curve(deformation: ArrayLike, force: ArrayLike, kinematic: float, what: str) -> YieldCurve:
    """The curve through points, of which the first may be the origin.

    Raises:
        SceneError: they are no such curve; the message says where.
    """
    d, f = numbers(deformation), numbers(force)
    if d.ndim != 1 or d.shape != f.shape or not np.isfinite(d).all() or not np.isfinite(f).all():
        raise SceneError(
            f"{what}: deformation and force must be two lists of as many finite numbers, got {deformation!r:.80} and "
            f"{force!r:.80}"
        )
    if not is_number(kinematic) or not 0.0 <= kinematic <= 1.0:
        raise SceneError(f"{what}: kinematic = {kinematic!r} must be a share from 0 (isotropic hardening) to 1")
    if d.size and d[0] == 0.0 and f[0] != 0.0:
        raise SceneError(f"{what}: the force at deformation 0 is {f[0]:g}, not 0: set `rest` or `length` for a preload")
    if d.size == 0 or d[0] != 0.0:
        d, f = np.concatenate([[0.0], d]), np.concatenate([[0.0], f])
    steps, rises = np.diff(d), np.diff(f)
    for k in np.flatnonzero(steps <= 0.0):
        raise SceneError(f"{what}: deformations must grow from 0; after {d[k]:g} comes {d[k + 1]:g}")
    slopes = rises / steps
    if slopes.size == 0 or slopes[0] <= 0.0:
        raise SceneError(f"{what}: the curve has no elastic slope; its force must rise from 0 to its first point")
    stiffness = float(slopes[0])
    for k in np.flatnonzero(rises < 0.0):
        raise SceneError(
            f"{what}: the force falls from {f[k]:g} to {f[k + 1]:g} after the deformation {d[k]:g}; a curve that "
            "softens has no stable law of its own: end it at its peak"
        )
    bends = np.flatnonzero(np.abs(np.diff(slopes)) > TEN_DIGITS * stiffness) + 1
    if bends.size == 0:
        raise SceneError(f"{what}: the curve never yields, all its points lie on one line; use a spring")
    before = slopes[bends - 1]
    for k in bends[(slopes[bends] >= stiffness) | ((slopes[bends] > before) & (kinematic > 0.0))]:
        steeper = "the elastic slope" if slopes[k] >= stiffness else "before; kinematic hardening needs falling slopes"
        raise SceneError(f"{what}: after the deformation {d[k]:g} the slope {slopes[k]:g} is not below {steeper}")
    return YieldCurve(stiffness, d[bends], f[bends], slopes[bends])
