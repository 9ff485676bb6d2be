"""A law of a solid's form in the strain of a thin wall: the functions of a solid-shell with any law.

The law sees a displacement's gradient H alone, and so it is given another one.  With the assumed strain E of
`_thin_wall` that is

    H = U - 1,    U^T U = 1 + 2 E,    U upper triangular (Cholesky's factor, written so that small strains keep digits),

the deformation up to a rotation, which is that of the axes: a law that does not care how it is turned, as every one of
finite strain, answers as it would to F; and one of small strain, which does care, is right for any rotation of
the wall.  Virtual work is with the variation of the same H, so that an energy stays one.  Tensors of the history lie
in the axes of U, which are the body's as long as the wall is not turned, and turn with it; Cauchy's stress is turned
to the body's axes.

Through the thickness the change of volume is linear, not E_33: flow keeps the volume, so that in a fold the thickness
goes with one over the stretch, which differs from face to face by more than a line can follow, and the wall locks.

A law whose reference is the updated configuration is given U U'^-1 - 1 with the U' of the step's begin, which is kept
behind its history, per volume det U' of the updated configuration; so the wall's own reference is the initial
configuration, and its strain does not depend on the steps.  Forms alone import it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import basix.ufl
import ufl

from flexmbd.forms import _thin_wall
from flexmbd.forms._shared import Expr, Quadrature, Terms

KEPT = 6  # numbers of U' - 1

# Of Gauss's points in the plane: 2 x 2.
_IN_PLANE = 3

# Rows and columns of U' - 1.
_PLACES = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))

# Of Pade's sum for a root, sqrt(1 + x) = 1 + sum a x / (1 + b x): a = 2/9 sin^2(k pi/9), b = cos^2(k pi/9).
_ROOT = (
    (0.025995061875669103, 0.8830222215594891),
    (0.09181686914811883, 0.5868240888334652),
    (0.16666666666666666, 0.25),
    (0.21552140230954533, 0.03015368960704583),
)


@dataclass(frozen=True)
class WallLaw:
    """A solid-shell with the law of a form.

    Attributes:
        law: the form, whose unknown is the displacement.
        layers: points through the thickness, 2 to 99; which, says the documentation of rules ("layers n").
        modulus: of the parameters, Pa: of the size of the material's stiffness; changes no result.
    """

    law: Any
    layers: int
    modulus: Callable[[Any], Expr]

    @property
    def rule(self) -> Quadrature:
        """Of all that the law says."""
        return Quadrature(_IN_PLANE, f"layers {self.layers}")

    def strain_energy(self, u: Expr, p: Any) -> Terms:
        """The law's energy per initial volume, J/m^3, and what ties the assumed strain."""
        wall = self._assumed(u, p)
        gradient = _gradient(wall.strain)
        terms = at_gradient(lambda c: [density for density, _ in self.law.strain_energy(c, p)], u, gradient)
        return [*((density, self.rule) for density in terms), *wall.ties]

    def residual(self, u: Expr, v: Expr, state: Expr, p: Any, **given: Expr) -> Terms:
        """Virtual work per initial volume, J/m^3, and that of what ties the assumed strain, linear in v."""
        wall = self._assumed(u, p)
        own, begin = self._begin(state)
        whole = _gradient(wall.strain)
        gradient, volume = _since(whole, begin)
        virtual = ufl.Coefficient(_symbol(u).ufl_function_space())
        terms = at_gradient(lambda c: [w for w, _ in self.law.residual(c, virtual, own, p, **given)], u, gradient)
        density = sum(terms)
        stress = volume * _on_strain(_on_gradient(density, virtual, begin), whole)
        rest = ufl.replace(density, {ufl.grad(virtual): ufl.zero(3, 3)})
        work = wall.virtual_work(stress, v)
        if virtual in ufl.algorithms.extract_coefficients(rest):
            work += volume * ufl.replace(rest, {virtual: _thin_wall.displacement(v)})
        return [(work, self.rule), *wall.virtual_ties(v)]

    def state(self, p: Any) -> Expr:
        """The law's history at rest, and what is kept behind it."""
        begin = self.law.state(p)
        if self.law.REFERENCE == "INITIAL":
            return begin
        return ufl.as_vector([*(begin[i] for i in range(begin.ufl_shape[0])), *[0.0] * KEPT])

    def state_names(self, p: Any) -> dict[str, int]:
        """Those of the law, and of what is kept behind."""
        names = dict(self.law.state_names(p))
        return names if self.law.REFERENCE == "INITIAL" else {**names, "wall_stretch": KEPT}

    def update(self, u: Expr, state: Expr, p: Any, **given: Expr) -> Expr:
        """The history at the step's end."""
        own, begin = self._begin(state)
        whole = _gradient(self._assumed(u, p).strain)
        gradient, _ = _since(whole, begin)
        (new,) = at_gradient(lambda c: [self.law.update(c, own, p, **given)], u, gradient)
        if begin is None:
            return new
        kept = [whole[i, j] for i, j in _PLACES]
        return ufl.as_vector([*(new[i] for i in range(own.ufl_shape[0])), *kept])

    def local_residual(self, z: Expr, u: Expr, state: Expr, p: Any, **given: Expr) -> Expr:
        """The equations of the law's local unknowns."""
        return self._of_step(lambda c, own: self.law.local_residual(z, c, own, p, **given), u, state, p)

    def increment_size(self, u: Expr, state: Expr, p: Any) -> Expr:
        """The law's, of the step."""
        return self._of_step(lambda c, own: self.law.increment_size(c, own, p), u, state, p)

    def energies(self, u: Expr, state: Expr, p: Any) -> dict[str, tuple[Expr, Quadrature]]:
        """The law's per initial volume, J/m^3, with the history of the same instant."""
        own, begin = self._begin(state)
        # the law of an updated configuration is asked where that is
        gradient = _gradient(self._assumed(u, p).strain) if begin is None else ufl.zero(3, 3)
        _, volume = _since(gradient, begin)
        names = list(self.law.energies(_symbol(u), own, p))
        found = at_gradient(lambda c: [density for density, _ in self.law.energies(c, own, p).values()], u, gradient)
        return {name: (volume * density, self.rule) for name, density in zip(names, found, strict=True)}

    def stress(self, u: Expr, state: Expr | None, p: Any, **given: Expr) -> Expr:
        """Cauchy stress, Pa, 3 x 3, in the axes of the body."""
        wall = self._assumed(u, p)
        own, begin = (None, None) if state is None else self._begin(state)
        whole = _gradient(wall.strain)
        gradient, _ = _since(whole, begin)
        (found,) = at_gradient(lambda c: [self.law.stress(c, own, p, **given)], u, gradient)
        turn = _rotation(_thin_wall.displacement(u), wall.strain, whole)
        return turn * found * turn.T

    def kinetic_energy(self, v: Expr, p: Any) -> Terms:
        """The law's, of the velocity v of displacements."""
        rules = [rule for _, rule in self.law.kinetic_energy(_symbol(v), p)]
        terms = at_gradient(lambda c: [density for density, _ in self.law.kinetic_energy(c, p)], v, None)
        return list(zip(terms, rules, strict=True))

    def _assumed(self, u: Expr, p: Any) -> _thin_wall.AssumedStrain:
        return _thin_wall.assumed_strain(u, self.modulus(p), by_volume=True)

    def _of_step(self, function: Callable[[Expr, Expr], Expr], u: Expr, state: Expr, p: Any) -> Expr:
        own, begin = self._begin(state)
        gradient, _ = _since(_gradient(self._assumed(u, p).strain), begin)
        return at_gradient(lambda c: [function(c, own)], u, gradient)[0]

    def _begin(self, state: Expr) -> tuple[Expr, Expr | None]:
        """The law's own history, and U' - 1 where its reference is updated."""
        if self.law.REFERENCE == "INITIAL":
            return state, None
        n = state.ufl_shape[0] - KEPT
        own = ufl.as_vector([state[i] for i in range(n)])
        rows = [[0.0] * 3 for _ in range(3)]
        for k, (i, j) in enumerate(_PLACES):
            rows[i][j] = state[n + k]
        return own, ufl.as_matrix(rows)


def at_gradient(function: Callable[[Expr], list[Expr]], u: Expr, gradient: Expr | None) -> list[Expr]:
    """What a function of a displacement says where its gradient is another one.

    Args:
        function: of the symbol of a displacement.
        u: of the wall's element.
        gradient: (3, 3); None: the displacement's own.
    """
    symbol, moved = _symbol(u), _thin_wall.displacement(u)
    given = {ufl.grad(symbol): ufl.grad(moved) if gradient is None else gradient, symbol: moved}
    return [ufl.replace(ufl.algorithms.expand_derivatives(value), given) for value in function(symbol)]


def _symbol(u: Expr) -> ufl.Coefficient:
    """A displacement on the wall's cells."""
    domain = ufl.domain.extract_unique_domain(u)
    element = basix.ufl.element("Lagrange", str(domain.ufl_cell()), 1, shape=(3,))
    return ufl.Coefficient(ufl.FunctionSpace(domain, element))


def _gradient(strain: Expr) -> Expr:
    """U - 1 of an assumed strain: each number a multiple of strains, so that small ones keep their digits."""
    first = ufl.sqrt(1 + 2 * strain[0, 0])
    a, b = 2 * strain[0, 1] / first, 2 * strain[0, 2] / first
    middle = 2 * strain[1, 1] - a**2
    second = ufl.sqrt(1 + middle)
    c = (2 * strain[1, 2] - a * b) / second
    last = 2 * strain[2, 2] - b**2 - c**2
    return ufl.as_matrix([
        [2 * strain[0, 0] / (first + 1), a, b],
        [0.0, middle / (second + 1), c],
        [0.0, 0.0, last / (ufl.sqrt(1 + last) + 1)],
    ])  # fmt: skip


def _since(gradient: Expr, begin: Expr | None) -> tuple[Expr, Expr]:
    """U U'^-1 - 1 and det U'; where nothing is kept U - 1 and one."""
    if begin is None:
        return gradient, ufl.as_ufl(1.0)
    return (gradient - begin) * _inverse(begin), (1 + begin[0, 0]) * (1 + begin[1, 1]) * (1 + begin[2, 2])


def _on_gradient(density: Expr, virtual: Expr, begin: Expr | None) -> Expr:
    """(3, 3) Pa, whose work on the variation of U is a density linear in that of U U'^-1, the gradient of ``virtual``.

    Of its upper triangle, which is all that works.
    """
    rows = ufl.Identity(3) if begin is None else _inverse(begin)
    domain = ufl.domain.extract_unique_domain(virtual)
    element = basix.ufl.element("DG", str(domain.ufl_cell()), 0, shape=(3, 3))
    symbol = ufl.Coefficient(ufl.FunctionSpace(domain, element))
    # all that is not linear in it is one object from here on
    density = ufl.replace(density, {ufl.grad(virtual): symbol, virtual: ufl.zero(3)})

    def of(i: int, j: int) -> Expr:
        varied = [[0.0] * 3 for _ in range(3)]
        varied[i] = [rows[j, k] for k in range(3)]
        return ufl.replace(density, {symbol: ufl.as_matrix(varied)})

    return ufl.as_matrix([[of(i, j) if j >= i else 0.0 for j in range(3)] for i in range(3)])


def _on_strain(stress: Expr, gradient: Expr) -> Expr:
    """S with S : dE = P : dU of a stress P on the variation of U, Cholesky's factor of 1 + 2 E.

    dU U^-1 is the upper triangle of U^-T 2 dE U^-1 with half of its diagonal, and so S = U^-1 Q U^-T, the upper
    triangle of the symmetric Q that of P U^T (Smith 1995, doi:10.1080/10618600.1995.10474671).
    """
    whole = stress * (ufl.Identity(3) + gradient).T
    q = ufl.as_matrix([[whole[min(i, j), max(i, j)] for j in range(3)] for i in range(3)])
    back = _inverse(gradient)
    return back * q * back.T


def _inverse(excess: Expr) -> Expr:
    """The inverse of an upper triangular tensor, given less the unit tensor."""
    a, b, c = (1 / (1 + excess[i, i]) for i in range(3))
    d, e = -a * b * excess[0, 1], -b * c * excess[1, 2]
    return ufl.as_matrix([[a, d, -a * (c * excess[0, 2] + excess[0, 1] * e)], [0.0, b, e], [0.0, 0.0, c]])


def _rotation(moved: Expr, strain: Expr, gradient: Expr) -> Expr:
    """From the axes of U to the body's: root(1 + 2 e) F U^-1, with e = F^-T (E - E(u)) F^-1 what is assumed on top."""
    h = ufl.grad(moved)
    f = ufl.Identity(3) + h
    back = ufl.inv(f)
    twice = back.T * (2 * strain - h - h.T - h.T * h) * back
    unit = ufl.Identity(3)
    root = unit + sum(a * twice * ufl.inv(unit + b * twice) for a, b in _ROOT)
    return root * f * _inverse(gradient)
