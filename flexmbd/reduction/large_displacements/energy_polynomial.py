"""Cubic and quartic strain energy of a body on a basis of displacements.

Of an energy density that is quadratic in the Green-Lagrange strain E = sym H + H^T H / 2, H = grad u, the same in all
points of its cells, the energy of u = sum phi_i q_i is exactly

    1/2 integral of E : C : E,   E = sum_i e_i q_i + 1/2 sum_ij h_ij q_i q_j,   h_ij = sym(H_i^T H_j),

so that the coefficients are integrals of e_i : C : h_jk / 2 and of h_ij : C : h_kl / 8, dense products of strains in
the points of the rule. Whether a body's energy is of this kind is seen by its forces: the derivatives of the form
itself, on a displacement of all shapes, are compared.

Where they differ, as of a neo-Hookean solid, C is that of the form at rest, which is its expansion by E to the second
degree. The expansion by H to the fourth degree would be no better: a rotation changes it by terms of the fifth degree,
and it is not bounded below. What is left out, of the third degree in the strains, is part of the estimated error, which
is by the form's own forces.

A density that is not a function of H alone, or not the same everywhere, has its coefficients from the form's third and
fourth derivatives, assembled as one vector for each pair and each triple of shapes: the Taylor polynomial at rest.
So have springs on facets, which are no strain.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations_with_replacement

import numpy as np
from dolfinx import fem

from flexmbd.continuum.finite_elements.linear_model import LinearModel
from flexmbd.continuum.matrices.blocks import FloatArray, inner, total
from flexmbd.record.strain_polynomial import StrainPolynomial, monomials, places
from flexmbd.reduction.large_displacements.face_membranes import FaceMembranes
from flexmbd.reduction.large_displacements.force_derivatives import ForceDerivatives
from flexmbd.reduction.stiffening.point_gradients import RulePoints, by_node, field_gradients, point_gradients
from flexmbd.reduction.stiffening.stress_stiffness import gradient_tensor
from flexmbd.round_off import TEN_DIGITS

# Strains xx yy zz and twice yz xz xy, by their entries of the gradient.
_VOIGT = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))
# Numbers in the strains of a chunk of cells: 8 MB.
_CHUNK = 2**20


@dataclass(frozen=True, eq=False)
class EnergyPolynomial:
    """Coefficients of a strain energy, the same to the bit on every rank.

    Attributes:
        cubic: as in `NonlinearStiffness`.
        quartic: likewise.
        note: of what energy, for the provenance.
    """

    cubic: FloatArray
    quartic: FloatArray
    note: str


def energy_polynomial(derivatives: ForceDerivatives, modes: FloatArray, faces: FaceMembranes) -> EnergyPolynomial:
    """The polynomial on a basis. Collective.

    Args:
        derivatives: of the body's internal forces.
        modes: (local dofs including ghosts, n).
        faces: of these modes, with what keeps rigid ones rigid.
    """
    body = _of_body(derivatives, modes)
    cubic, quartic = _coefficients(*faces.higher_products())
    return EnergyPolynomial(body.cubic + cubic, body.quartic + quartic, body.note)


def _of_body(derivatives: ForceDerivatives, modes: FloatArray) -> EnergyPolynomial:
    """Without membranes on faces. Collective."""
    model = derivatives.model
    cells = of_green_strain(model, modes)
    if cells is None:
        return EnergyPolynomial(*by_derivatives(derivatives, modes), f"Taylor polynomial of {model.form_name} at rest")
    cubic, quartic = cells
    note = ""
    if derivatives.springs is not None:
        springs = by_derivatives(derivatives.springs, modes)
        cubic, quartic = cubic + springs[0], quartic + springs[1]
        note = ", and the Taylor polynomial at rest of the springs on facets"
    if _agree(derivatives, modes, cubic, quartic):
        return EnergyPolynomial(cubic, quartic, f"exactly that of {model.form_name}{note}")
    own = f"St Venant-Kirchhoff's with the stiffness of {model.form_name} at rest"
    return EnergyPolynomial(cubic, quartic, own + note)


def _agree(derivatives: ForceDerivatives, modes: FloatArray, cubic: FloatArray, quartic: FloatArray) -> bool:
    """Whether the polynomial's forces are those of the form, on a displacement of all shapes. Collective."""
    n, model = modes.shape[1], derivatives.model
    own = modes[: model.n_owned]
    # of equal sizes and irregular signs, the same on all ranks
    q = np.cos(np.arange(1, n + 1) ** 2) / np.sqrt(total(model.comm, np.einsum("ij,ij->j", own, own)))
    u = modes @ q
    for part, force in (
        (StrainPolynomial(np.zeros(n), cubic, np.zeros_like(quartic)), derivatives.second(u, u) / 2.0),
        (StrainPolynomial(np.zeros(n), np.zeros_like(cubic), quartic), derivatives.third(u, u, u) / 6.0),
    ):
        work, size = inner(model.comm, own, np.asarray(force, dtype=float)[:, None])[:, 0] * q, part.force(q) * q
        if abs(work - size).max(initial=0.0) > TEN_DIGITS * abs(work).max(initial=0.0):
            return False
    return True


def by_derivatives(derivatives: ForceDerivatives, modes: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Cubic and quartic by the form's third and fourth derivatives. Collective."""
    n, model = modes.shape[1], derivatives.model
    own = modes[: model.n_owned]
    found = []
    for degree, derivative in ((2, derivatives.second), (3, derivatives.third)):
        index = monomials(n, degree + 1)
        coefficients = np.zeros(len(index))
        # each coefficient by the derivative along all of its indices but the last and smallest
        for chosen in combinations_with_replacement(range(n), degree):
            forces = derivative(*(modes[:, i] for i in chosen))
            work = inner(model.comm, own[:, : chosen[0] + 1], forces[:, None])[:, 0]
            rows = np.column_stack([np.tile(chosen[::-1], (len(work), 1)), np.arange(len(work))])
            coefficients[places(rows)] = work
        found.append(coefficients / _repetitions(index))
    return found[0], found[1]


def _repetitions(index: np.ndarray) -> FloatArray:
    """(count,) products of the factorials of how often each index is repeated."""
    total: FloatArray = np.ones(len(index))
    run: FloatArray = np.ones(len(index))
    for i in range(1, index.shape[1]):
        run = np.where(index[:, i] == index[:, i - 1], run + 1.0, 1.0)
        total *= run
    return total


def of_green_strain(model: LinearModel, modes: FloatArray) -> tuple[FloatArray, FloatArray] | None:
    """Cubic and quartic by dense products; None where a density is not of strain, the same everywhere. Collective."""
    u, n = fem.Function(model.space), modes.shape[1]
    pairs = monomials(n, 2)
    linear = np.zeros((n, len(pairs)))
    square = np.zeros((len(pairs), len(pairs)))
    for group in model.groups:
        for term in group.formulation.strain_energy(u, group.symbols):
            tensor = gradient_tensor(term, u)
            if tensor is None or not _is_of_strain(tensor):
                return None
            _add_products(RulePoints(model, group.cells, term[1]), tensor, modes, linear=linear, square=square)
    three, four = _coefficients(linear, square)
    return total(model.comm, three), total(model.comm, four)


def _coefficients(linear: FloatArray, square: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Cubic and quartic of e_i : C : h_jk (n, pairs) and h_ij : C : h_kl (pairs, pairs)."""
    n = len(linear)
    pairs = monomials(n, 2)
    # h_ij of a pair i != j stands for two
    weights = np.where(pairs[:, 0] == pairs[:, 1], 0.5, 1.0)
    cubic, quartic = (len(monomials(n, degree)) for degree in (3, 4))
    rows, columns = np.indices(linear.shape).reshape(2, -1)
    of_three = places(np.column_stack([rows, pairs[columns]]))
    three = np.bincount(of_three, (linear * weights).ravel(), minlength=cubic)
    rows, columns = np.indices(square.shape).reshape(2, -1)
    of_four = places(np.hstack([pairs[rows], pairs[columns]]))
    four = np.bincount(of_four, (0.5 * square * np.outer(weights, weights)).ravel(), minlength=quartic)
    return np.asarray(three, dtype=float), np.asarray(four, dtype=float)


def _is_of_strain(tensor: FloatArray) -> bool:
    """Whether a rotation costs nothing, of second derivatives (9, 9) by the gradient."""
    turned = tensor.reshape(3, 3, 9).transpose(1, 0, 2).reshape(9, 9)
    return bool(abs(turned - tensor).max() <= TEN_DIGITS * abs(tensor).max())


def _add_products(
    points: RulePoints, tensor: FloatArray, modes: FloatArray, *, linear: FloatArray, square: FloatArray
) -> None:
    """Add the integrals of e_i : C : h_jk and h_ij : C : h_kl over this rank's cells."""
    elastic = np.array([[tensor[3 * a + b, 3 * c + d] for c, d in _VOIGT] for a, b in _VOIGT])
    n = modes.shape[1]
    by_nodes, nodes = by_node(modes), points.model.space.dofmap.list
    first, second = monomials(n, 2).T
    for cells, operator, weights in point_gradients(points, chunk=max(1, _CHUNK // (6 * len(first) + 9 * n))):
        # [point, direction, component, mode]
        slopes = field_gradients(operator, by_nodes, nodes[cells]).reshape(weights.size, 3, 3, n)
        strain = np.stack(
            [slopes[:, a, b] if a == b else slopes[:, a, b] + slopes[:, b, a] for a, b in _VOIGT], axis=1
        )
        second_order = np.empty((weights.size, 6, len(first)))
        for i, (a, b) in enumerate(_VOIGT):
            products = slopes[:, a].transpose(0, 2, 1) @ slopes[:, b]
            whole = products if a == b else products + products.transpose(0, 2, 1)
            second_order[:, i] = whole[:, first, second]
        stress = (elastic @ second_order) * weights.reshape(-1, 1, 1)
        stress = stress.reshape(-1, len(first))
        linear += strain.reshape(-1, n).T @ stress
        square += second_order.reshape(-1, len(first)).T @ stress
