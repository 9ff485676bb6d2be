"""Many free pseudo-rigid bodies as arrays: their deformation gradients, stepped together."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.errors import SceneError
from flexmbd.given import checked, is_number, numbers
from flexmbd.multibody.bodies.homogeneous import StVenantKirchhoff, polar
from flexmbd.multibody.bodies.solid import Solid
from flexmbd.multibody.kernels.physics import swarm as kernel

FloatArray = NDArray[np.float64]


class SwarmEnergy(NamedTuple):
    """Energies (J) of each body, each (n,)."""

    kinetic: FloatArray
    elastic: FloatArray
    gravitational: FloatArray

    @property
    def total(self) -> FloatArray:
        """Sum of the three."""
        return self.kinetic + self.elastic + self.gravitational


class PseudoRigidSwarm:
    """Free pseudo-rigid bodies, x = r + F (X - C) (Zienkiewicz, Taylor & Fox, eq. 8.1); St Venant-Kirchhoff material.

    The unknowns are F itself, nine numbers a body, with F'' J = -V dW/dF about the centre, which falls freely.
    Velocity Verlet keeps linear and angular momentum to round-off, energy to the square of the step, and never drifts.

    Attributes:
        t: s.
        r, v: (n, 3) m, m/s, centres of mass and their velocities, in inertial axes.
        F, F_rate: (n, 3, 3) deformation gradients, and 1/s.  All five may be set between steps.
    """

    @checked("solids")
    def __init__(
        self,
        solids: Sequence[Solid],
        materials: StVenantKirchhoff | Sequence[StVenantKirchhoff],
        *,
        r: ArrayLike,
        gravity: Sequence[float] = (0.0, 0.0, 0.0),
    ) -> None:
        """Bodies at rest, undeformed.

        Args:
            solids: n of them; the same one may stand for many, and its own centre does not matter.
            materials: one for all, or n.
            r: (n, 3) m, centres.
            gravity: (3,) m/s^2.

        Raises:
            SceneError: no solids, or numbers of solids, materials and centres that differ.
        """
        n = len(solids)
        alike = isinstance(materials, StVenantKirchhoff)
        each: Sequence[StVenantKirchhoff] = [materials] * n if isinstance(materials, StVenantKirchhoff) else materials
        if n == 0 or (not alike and len(each) != n):
            raise SceneError(f"a swarm of {n} solids and {len(each)} materials: give one material, or one a solid")
        self.t = 0.0
        self.gravity: FloatArray = _array(gravity, (3,), "gravity")
        self.r: FloatArray = _array(r, (n, 3), "r").copy()
        self.v: FloatArray = np.zeros((n, 3))
        self.F: FloatArray = np.tile(np.eye(3), (n, 1, 1))
        self.F_rate: FloatArray = np.zeros((n, 3, 3))
        self.mass: FloatArray = np.array([solid.mass for solid in solids])
        self._volume: FloatArray = np.array([solid.volume for solid in solids])
        self._second: FloatArray = np.array([solid.second for solid in solids])
        self._lame: FloatArray = np.array([material.lame for material in each])
        inverse = self._volume[:, None, None] * np.linalg.inv(self._second)
        self._inverse = np.ascontiguousarray(inverse[:, [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]])
        self._scratch: FloatArray = np.zeros(kernel.N_ROWS * kernel.LANES)

    @checked("count")
    def step(self, h: float, count: int = 1) -> None:
        """Take ``count`` steps of h (s).

        Raises:
            SceneError: a step or an array that is not finite or does not fit; det F <= 0, at the start or on the way,
                with the body and the time.  The swarm is then as before the call.
        """
        n = len(self.mass)
        if not (is_number(h) and h > 0.0) or not 0 <= count <= np.iinfo(np.int64).max:
            raise SceneError(
                f"a swarm's step h = {h} s must be positive and finite, their number, count = {count}, not negative "
                "and one that 64 bits hold"
            )
        shapes = {"r": (n, 3), "v": (n, 3), "F": (n, 3, 3), "F_rate": (n, 3, 3)}
        r, v, F, G = (_array(getattr(self, name), shape, name) for name, shape in shapes.items())
        nine = (n, 9)
        new_F, new_G = np.empty(nine), np.empty(nine)
        constants = self._inverse, self._lame, float(h), int(count), self._scratch
        bad = kernel.advance_swarm(F.reshape(nine), G.reshape(nine), *constants, new_F, new_G)
        if bad >= 0:
            step, det = self._scratch[:2]
            raise SceneError(
                f"body {bad} of the swarm has det F = {det:.3g} or worse from t = {self.t + step * h:.6g} s on: it is "
                "pressed flat or turned inside out; take a smaller step, or slower or stiffer bodies"
            )
        span = count * h
        self.r = r + span * v + 0.5 * span * span * self.gravity
        self.v = v + span * self.gravity
        self.F, self.F_rate = new_F.reshape(n, 3, 3), new_G.reshape(n, 3, 3)
        self.t += span

    def stable_step(self) -> float:
        """A step (s) that is stable for all bodies nearly undeformed: 2 over a bound of the fastest vibration.

        Bodies that are much stretched are stiffer; a tenth of it resolves the vibrations to a per cent.
        """
        lam, mu = self._lame.T
        stiffest = np.maximum(3.0 * lam + 2.0 * mu, 2.0 * mu)
        lightest = np.linalg.eigvalsh(self._second)[:, 0]
        return float(2.0 / np.sqrt((self._volume * stiffest / lightest).max()))

    def polar(self) -> tuple[FloatArray, FloatArray]:
        """Rotations R and stretches U, (n, 3, 3) each, with F = R U."""
        return polar(self.F)

    def linear_momentum(self) -> FloatArray:
        """(n, 3) kg m/s."""
        return self.mass[:, None] * self.v

    def angular_momentum(self) -> FloatArray:
        """(n, 3) kg m^2/s, of each body about the inertial origin."""
        product = self.F @ self._second @ self.F_rate.transpose(0, 2, 1)
        own = np.stack([product[:, i, j] - product[:, j, i] for i, j in ((1, 2), (2, 0), (0, 1))], axis=1)
        return np.asarray(own + np.cross(self.r, self.linear_momentum()))

    def energy(self) -> SwarmEnergy:
        """Energies of each body; that of its weight from the inertial origin."""
        spin = np.einsum("nij,njk,nik->n", self.F_rate, self._second, self.F_rate)
        E = 0.5 * (self.F.transpose(0, 2, 1) @ self.F - np.eye(3))
        lam, mu = self._lame.T
        W = 0.5 * lam * np.trace(E, axis1=1, axis2=2) ** 2 + mu * np.einsum("nij,nij->n", E, E)
        kinetic = 0.5 * (self.mass * np.einsum("ni,ni->n", self.v, self.v) + spin)
        return SwarmEnergy(kinetic, self._volume * W, -self.mass * (self.r @ self.gravity))


def _array(values: ArrayLike, shape: tuple[int, ...], what: str) -> FloatArray:
    array = np.ascontiguousarray(numbers(values))
    if array.shape != shape or not np.isfinite(array).all():
        raise SceneError(f"a swarm's {what} must be finite numbers of shape {shape}, got shape {array.shape}")
    return array
