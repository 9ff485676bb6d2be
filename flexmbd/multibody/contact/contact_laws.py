"""Laws of contact: the normal force of Hertz or of a stated stiffness, what an impact loses, and friction."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import scipy  # its parts load when they are asked for

from flexmbd.errors import SceneError
from flexmbd.multibody.contact.shapes import TouchedShape
from flexmbd.multibody.force.protocol import check_numbers

_NEXT_TO_ONE = 1e-4  # of 1 - restitution: there the equation for D is round-off, and its series has eight digits
_NO_ROUND = "Hertz's law is of round surfaces: a point has none, and an edge or a profile not one alone; take PowerLaw"


@runtime_checkable
class NormalLaw(Protocol):
    """N = k delta^p (1 + D delta') by the depth delta (m) and its rate."""

    def check(self, what: str) -> None:
        """Raise SceneError for numbers that no law has; ``what`` is the contact's name in messages."""

    def stiffness(self, shape: TouchedShape, radius: float, what: str) -> float:
        """k (N/m^p) where a sphere of this radius (m), or a point, 0, touches a shape.

        Raises:
            SceneError: the law does not know these.
        """

    @property
    def exponent(self) -> float:
        """Its p."""

    def dissipation(self) -> float:
        """Its D (s/m); negative: -D of 1 m/s, divided by the speed at which the surfaces meet."""


def dissipation_of(restitution: float, speed: float) -> float:
    """D (s/m) at which an impact at ``speed`` (m/s) ends at ``restitution`` times it, whatever k, p and the masses.

    Of m w' = -k delta^p (1 + D w) the depth's work cancels between the way in and the way out, which leaves
    D v (1 + e) = ln((1 + D v) / (1 - e D v)) (after Hunt & Crossley 1975, whose D is this one's first term in 1 - e).
    """
    e = restitution
    if 1.0 - e < _NEXT_TO_ONE:  # the equation's first two terms, the next is of the order of its square
        return 1.5 * (1.0 - e**2) / (1.0 + e**3) / speed

    def equation(t: float) -> float:  # t = ln(1 - e D v), for D v is next to 1 / e where e is small
        x = -math.expm1(t) / e
        return math.log1p(x) - t - x * (1.0 + e)

    first = min(1.0 - e, 0.5)  # of D v; next to zero it is (e^2 - 1) (D v)^2 / 2 < 0
    while equation(math.log1p(-e * first)) >= 0.0:
        first *= 0.5
    t = scipy.optimize.brentq(equation, -(1.0 + e) / e - 2.0, math.log1p(-e * first), xtol=1e-14, rtol=1e-14)
    return -math.expm1(t) / e / speed


@dataclass(frozen=True, kw_only=True)
class _Impact:
    """What an impact leaves of the speed."""

    restitution: float = 1.0
    speed: float | None = 1.0

    def _check_impact(self, what: str) -> None:
        check_numbers(what, positive={"restitution": self.restitution})
        if self.speed is not None:
            check_numbers(what, positive={"speed": self.speed})
        if self.restitution > 1.0:
            raise SceneError(f"{what}: restitution = {self.restitution} makes energy; it is between 0 and 1")

    def dissipation(self) -> float:
        """D (s/m); without a speed -D of 1 m/s, which the kernels divide by the speed at which the surfaces meet."""
        return dissipation_of(self.restitution, self.speed) if self.speed else -dissipation_of(self.restitution, 1.0)


@dataclass(frozen=True, kw_only=True)
class Hertz(_Impact):
    """N = (4/3) E* sqrt(R) delta^(3/2): two smooth elastic bodies, much larger than where they touch (Hertz 1881).

    Of surfaces whose curvatures differ along two directions k has Hertz's elliptic integrals (Johnson 1985, eq. 4.26).

    Attributes:
        E: Pa, Young's modulus of both, or of the sphere where the other's is given.
        nu: Poisson's ratio alike.
        E_other, nu_other: of the touched shape; None: the same.
        restitution: share of its speed that an impact at ``speed`` leaves, between 0 and 1; at other speeds it is
            nearer to 1 the slower they are (Hunt & Crossley 1975).
        speed: m/s; None: ``restitution`` at every speed, by that at which the surfaces meet.
    """

    E: float = 0.0
    nu: float = 0.3
    E_other: float | None = None
    nu_other: float | None = None

    @property
    def exponent(self) -> float:
        """3/2."""
        return 1.5

    def check(self, what: str) -> None:
        """Raise SceneError for numbers that no material has."""
        self._check_impact(what)
        for name, E, nu in (("", self.E, self.nu), ("_other", *self._other())):
            check_numbers(what, positive={f"E{name}": E}, least={f"nu{name}": nu})
            if not nu <= 0.5:
                raise SceneError(f"{what}: nu{name} = {nu} must be at most 0.5")

    def stiffness(self, shape: TouchedShape, radius: float, what: str) -> float:
        """k (N/m^1.5)."""
        if radius == 0.0:
            raise SceneError(f"{what}: {_NO_ROUND}")
        E, nu = self._other()
        star = 1.0 / ((1.0 - self.nu**2) / self.E + (1.0 - nu**2) / E)
        low, high = sorted(1.0 / radius + one for one in shape.curvatures())
        if not low > 0.0:
            raise SceneError(f"{what}: a sphere of radius {radius:g} m does not fit into the hollow it is to touch")
        return 4.0 / 3.0 * star * _ellipse(high / low) / math.sqrt(math.sqrt(low * high))

    @property
    def touched_modulus(self) -> float:
        """E / (1 - nu^2) of the touched shape (Pa)."""
        E, nu = self._other()
        return E / (1.0 - nu**2)

    def _other(self) -> tuple[float, float]:
        return (
            self.E if self.E_other is None else self.E_other,
            self.nu if self.nu_other is None else self.nu_other,
        )


def _ellipse(ratio: float) -> float:
    """F2^(-3/2) of Johnson 1985, eq. 4.26: 1 of a circle, by the ratio of the relative curvatures, 1 or more."""
    if ratio < 1.0 + 1e-9:
        return 1.0

    def curvatures(b: float) -> tuple[float, float, float]:
        """(a/b)^2 E - K, K - E and K, of an ellipse of axes 1 and b."""
        K, E = scipy.special.ellipkm1(b * b), scipy.special.ellipe(1.0 - b * b)
        return E / (b * b) - K, K - E, K

    def equation(log_b: float) -> float:
        over, under, _ = curvatures(math.exp(log_b))
        return math.log(over / under) - math.log(ratio)

    b = math.exp(scipy.optimize.brentq(equation, -0.5 * math.log(ratio) * 2.0 - 1.0, -1e-9))
    over, under, K = curvatures(b)
    eccentricity = 1.0 - b * b
    first = (4.0 / (math.pi * eccentricity) * b**1.5 * math.sqrt(over * under)) ** (1.0 / 3.0)
    second = 2.0 / math.pi * math.sqrt(b) / first * K
    return float(second**-1.5)


@dataclass(frozen=True, kw_only=True)
class PowerLaw(_Impact):
    """N = k delta^p: a stated stiffness, whatever the shapes; ``PowerLaw.bearing`` has it of a stated depth.

    Attributes:
        k: N/m^p.
        p: the exponent, 1 or more.
        restitution: share of its speed that an impact at ``speed`` leaves, between 0 and 1; at other speeds it is
            nearer to 1 the slower they are (Hunt & Crossley 1975).
        speed: m/s; None: ``restitution`` at every speed, by that at which the surfaces meet.
    """

    k: float = 0.0
    p: float = 1.0

    @classmethod
    def bearing(cls, load: float, *, depth: float, restitution: float = 1.0, speed: float | None = 1.0) -> PowerLaw:
        """The linear one that bears a load (N) at a depth (m).

        Raises:
            SceneError: one of them is not positive.
        """
        check_numbers("PowerLaw.bearing", positive={"load": load, "depth": depth})
        return cls(restitution=restitution, speed=speed, k=load / depth)

    @classmethod
    def of_cylinder(
        cls,
        load: float,
        *,
        length: float,
        radius: float,
        E: float,
        nu: float = 0.3,
        radius_other: float | None = None,
        E_other: float | None = None,
        nu_other: float | None = None,
        restitution: float = 1.0,
        speed: float | None = 1.0,
    ) -> PowerLaw:
        """That of a cylinder which lies along a line, as a rope on a floor, near a load (Hertz).

        Its middle comes nearer by P (1 - nu^2) / (pi E) (2 ln(4 R / a) - 1) under P (N/m), half the contact's width
        being a = sqrt(4 P R* / (pi E*)) (Johnson 1985, eq. 4.45 and 5.58); of two cylinders both give way. It has this
        depth and its slope at the load; at a tenth of it, and at ten times as much, the depth is some 2 % off.

        Args:
            load: N, that it mostly bears.
            length: m, on which it does; of a sphere along a beam what that stands for (``spheres_along``).
            radius: m, of the cylinder.
            E: Pa.
            nu: Poisson's ratio.
            radius_other: m, of a parallel cylinder that it lies on; None: a plane that does not give way.
            E_other: Pa, of that cylinder; None: the same.
            nu_other: alike.
            restitution: as of the law.
            speed: as of the law.

        Raises:
            SceneError: a number that no material or size has, a material of a cylinder without a radius, or a load
                that would press it flat.
        """
        what = "PowerLaw.of_cylinder"
        check_numbers(what, positive={"load": load, "length": length, "radius": radius})
        if radius_other is not None:
            check_numbers(what, positive={"radius_other": radius_other})
        elif E_other is not None or nu_other is not None:
            raise SceneError(
                f"{what}: E_other and nu_other are of a second cylinder: give its radius_other. A plane gives way "
                "under a line load by an amount that its depth decides: take PowerLaw.bearing(load, depth=)"
            )
        material = Hertz(E=E, nu=nu, E_other=E_other, nu_other=nu_other)
        material.check(what)
        parts = [(radius, (1.0 - nu**2) / E)]
        if radius_other is not None:
            parts.append((radius_other, 1.0 / material.touched_modulus))
        P = load / length
        curvature, give = sum(1.0 / R for R, _ in parts), sum(part for _, part in parts)
        half = math.sqrt(4.0 * P * give / (math.pi * curvature))
        if not half < min(R for R, _ in parts):
            raise SceneError(
                f"{what}: {P:g} N/m would press it to {2.0 * half:.3g} m of width, which is no small part of its "
                f"diameter: the law is of stiff and thick ones; take PowerLaw(k=)"
            )
        each = [(P * part / math.pi, 2.0 * math.log(4.0 * R / half) - 1.0) for R, part in parts]
        depth, change = sum(c * one for c, one in each), sum(c * (one - 1.0) for c, one in each)
        p = depth / change
        return cls(restitution=restitution, speed=speed, k=load / depth**p, p=p)

    @property
    def exponent(self) -> float:
        """p."""
        return self.p

    def check(self, what: str) -> None:
        """Raise SceneError for numbers that no law has."""
        self._check_impact(what)
        check_numbers(what, positive={"k": self.k, "p": self.p})
        if self.p < 1.0:
            raise SceneError(f"{what}: p = {self.p} is infinitely stiff at the first touch; it must be 1 or more")

    def stiffness(self, shape: TouchedShape, radius: float, what: str) -> float:
        """k."""
        return self.k


@dataclass(frozen=True)
class Friction:
    """Coulomb's friction with true stick: a bristle that slides where it would bear more than mu N.

    Below that the contact sticks on a spring, and a load that comes and goes does not make it creep.

    Attributes:
        mu: coefficient of friction.
        stiffness: N/m of the bristle; mu N / stiffness is how far a contact gives before it slides.
        damping: N s/m beside it, without which what sticks would swing for ever.
        load: N, a typical normal force; rtol is relative to the bristle's stretch under it.
        static: coefficient at rest, mu or more; None: mu.
        stribeck: m/s, the sliding speed over which the coefficient falls from ``static`` to ``mu``.
        rolling, spinning: m, arms at which N is resisted where a sphere rolls and where it spins about the normal: a
            moment that holds it up to arm times N, by bristles of the same stiffness and damping at its radius.
    """

    mu: float
    stiffness: float
    damping: float
    load: float
    static: float | None = None
    stribeck: float | None = None
    rolling: float = 0.0
    spinning: float = 0.0

    def check(self, what: str) -> None:
        """Raise SceneError for numbers that no friction has."""
        check_numbers(
            what,
            positive={"stiffness": self.stiffness, "damping": self.damping, "load": self.load},
            least={"mu": self.mu, "rolling": self.rolling, "spinning": self.spinning},
        )
        if self.static is None:
            if self.stribeck is not None:
                raise SceneError(f"{what}: stribeck = {self.stribeck} m/s needs the coefficient at rest, static=...")
            return
        check_numbers(what, least={"static": self.static})
        if self.static < self.mu:
            raise SceneError(f"{what}: static = {self.static} is less than mu = {self.mu}")
        if self.stribeck is None:
            raise SceneError(f"{what}: static = {self.static} needs the speed (m/s) over which it falls, stribeck=...")
        check_numbers(what, positive={"stribeck": self.stribeck})

    def numbers(self) -> list[float]:
        """Of the law (``kernels.contact.contact_law``), from FRICTION on."""
        static = self.mu if self.static is None else self.static
        return [self.mu, static, self.stribeck or 1.0, self.stiffness, self.damping]

    def stretch(self) -> float:
        """Of the bristle under the typical load (m)."""
        return max(self.mu, self.static or 0.0) * self.load / self.stiffness

    @property
    def resists(self) -> bool:
        """Whether it resists rolling or spinning."""
        return self.rolling > 0.0 or self.spinning > 0.0

    def turn(self, radius: float) -> float:
        """How far a sphere of this radius (m) turns, times the radius, before it rolls or spins under the load (m)."""
        return max(self.rolling, self.spinning) / radius * self.load / self.stiffness
