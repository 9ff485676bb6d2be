"""Many pseudo-rigid bodies as arrays, free or touching: their deformation gradients, stepped together."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.errors import SceneError
from flexmbd.given import checked, is_number, numbers
from flexmbd.multibody.bodies.homogeneous import StVenantKirchhoff, polar
from flexmbd.multibody.bodies.solid import Solid
from flexmbd.multibody.contact.contact_laws import Friction, PowerLaw
from flexmbd.multibody.contact.polytopes import Polytope
from flexmbd.multibody.contact.touch import Touching
from flexmbd.multibody.kernels.swarm import free_flight as kernel
from flexmbd.multibody.swarm.stone_contacts import (
    NOTHING,
    StoneContacts,
    SwarmArrays,
    SwarmContacts,
    fastest_squared,
    pressed,
)

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
    """Pseudo-rigid bodies, x = r + F (X - C) (Zienkiewicz, Taylor & Fox, eq. 8.1); St Venant-Kirchhoff material.

    The unknowns are F itself, nine numbers a body, with F'' J = -V dW/dF about the centre, which falls freely.
    Velocity Verlet keeps linear and angular momentum to round-off, energy to the square of the step, and never drifts.

    With a ``law`` the bodies touch each other and walls, as convex polytopes that F carries: a force f at a point acts
    on F as f (x) (X - C).  Each step takes the forces in its middle; both momenta are kept to round-off as well.

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
        law: PowerLaw | None = None,
        friction: Friction | None = None,
        shapes: Sequence[Polytope | ArrayLike] | None = None,
        walls: Touching = (),
        damping: float = 0.0,
    ) -> None:
        """Bodies at rest, undeformed.

        Args:
            solids: n of them; the same one may stand for many, and its own centre does not matter.
            materials: one for all, or n.
            r: (n, 3) m, centres.
            gravity: (3,) m/s^2.
            law: of the normal force at each point where bodies touch; None: they do not.
            friction: None: smooth.
            shapes: n, each points (v, 3) m whose hull touches, or a polytope, in the axes of its solid; None: the hull
                of the solid's outline; of more than 32 points, of those foremost along 26 directions.
            walls: a shape on the ground that the bodies touch, or several.
            damping: s; strain rates times it are stressed as strains.  Of bodies that touch alone.

        Raises:
            SceneError: no solids, or numbers of solids, materials, centres and shapes that differ; a shape without
                a volume, a wall that is not on the ground; what is of contact, without a law.
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
        self._fastest_squared = fastest_squared(solids, self._lame)
        if not (is_number(damping) and 0.0 <= damping < np.inf):
            raise SceneError(f"damping of a swarm must be finite and not negative (s), got {damping!r}")
        fixed = list(walls) if isinstance(walls, Sequence) else [walls]
        if law is None and (friction is not None or shapes is not None or fixed or damping):
            raise SceneError("a swarm's friction, shapes, walls and damping are of bodies that touch: give their law=")
        self._touching: StoneContacts | None = None
        self._memory = NOTHING
        if law is not None:
            constants = solids, self._inverse, self._lame, float(damping)
            self._touching = StoneContacts(*constants, shapes=shapes, walls=fixed, law=law, friction=friction)

    @checked("count")
    def step(self, h: float, count: int = 1) -> None:
        """Take ``count`` steps of h (s).

        Raises:
            SceneError: a step or an array that is not finite or does not fit; det F <= 0, at the start or on the way,
                with the body and the time; a step that contacts cannot bear, with the longest, or in which bodies may
                pass each other.  The swarm is then as before the call.
        """
        n = len(self.mass)
        if not (is_number(h) and h > 0.0) or not 0 <= count <= np.iinfo(np.int64).max:
            raise SceneError(
                f"a swarm's step h = {h} s must be positive and finite, their number, count = {count}, not negative "
                "and one that 64 bits hold"
            )
        state = self._state()
        if self._touching is not None:
            r, v, F, G = state = state[0].copy(), state[1].copy(), state[2].copy(), state[3].copy()
            gravity = _array(self.gravity, (3,), "gravity")
            self._memory = self._touching.step(state, self._memory, gravity, t=self.t, h=float(h), count=int(count))
            self.r, self.v = r, v
            self.F, self.F_rate = F.reshape(n, 3, 3), G.reshape(n, 3, 3)
            self.t += count * h
            return
        r, v, F, G = state
        new_F, new_G = np.empty((n, 9)), np.empty((n, 9))
        constants = self._inverse, self._lame, float(h), int(count), self._scratch
        bad = kernel.advance_swarm(F, G, *constants, new_F, new_G)
        if bad >= 0:
            step, det = self._scratch[:2]
            raise pressed(bad, det, self.t + step * h)
        span = count * h
        self.r = r + span * v + 0.5 * span * span * self.gravity
        self.v = v + span * self.gravity
        self.F, self.F_rate = new_F.reshape(n, 3, 3), new_G.reshape(n, 3, 3)
        self.t += span

    def _state(self) -> SwarmArrays:
        """r, v (n, 3), F and its rate (n, 9), checked."""
        n = len(self.mass)
        shapes = {"r": (n, 3), "v": (n, 3), "F": (n, 3, 3), "F_rate": (n, 3, 3)}
        r, v, F, G = (_array(getattr(self, name), shape, name) for name, shape in shapes.items())
        return r, v, F.reshape(n, 9), G.reshape(n, 9)

    def contacts(self) -> SwarmContacts:
        """Where the bodies touch each other and walls, and the forces there; a bristle as the last step left it.

        Raises:
            SceneError: the bodies have no law by which they touch, or one has det F <= 0.
        """
        if self._touching is None:
            raise SceneError("the bodies of this swarm do not touch: give it a law=")
        return self._touching.contacts(self._state(), self._memory, t=self.t)

    def stable_step(self) -> float:
        """A step (s) that is stable for all bodies nearly undeformed: 2 over a bound of the fastest vibration.

        Bodies that are much stretched are stiffer; a tenth of it resolves the vibrations to a per cent.  Of bodies that
        touch it counts the contacts there are, of a linear law those of a pair that meets by its corners, friction and
        damping.  In a heap a body may have more: ``step`` refuses a step that one cannot bear.
        """
        if self._touching is not None:
            return self._touching.longest_step(self._state(), self._memory, t=self.t)
        return float(2.0 / np.sqrt(self._fastest_squared.max()))

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
