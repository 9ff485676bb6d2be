"""Values of UFL expressions at a point, against UFL's own evaluation, which walks the whole tree."""

import basix.ufl
import numpy as np
import pytest
import ufl

from flexmbd.continuum.contract.ufl_values import NoValueError, evaluate

POINT = np.array([0.2, 0.3, 0.4])
DOMAIN = ufl.Mesh(basix.ufl.element("Lagrange", "tetrahedron", 1, shape=(3,)))
SPACE = ufl.FunctionSpace(DOMAIN, basix.ufl.element("Lagrange", "tetrahedron", 2, shape=(3,)))
U = ufl.Coefficient(SPACE)
X = ufl.SpatialCoordinate(DOMAIN)
I = ufl.Identity(3)  # noqa: E741
H = ufl.grad(U)
i, j, k = ufl.indices(3)


def affine(seed):
    """The same field as this evaluation wants it, and as UFL does."""
    rng = np.random.default_rng(seed)
    value, gradient = rng.normal(size=3), 0.3 * rng.normal(size=(3, 3))

    def ours(depth):
        return [value + gradient @ POINT, gradient, np.zeros((3, 3, 3))][depth]

    def theirs(x, derivatives=()):
        if len(derivatives) > 1:
            return np.zeros(3)
        return gradient[:, derivatives[0]] if derivatives else value + gradient @ np.asarray(x)

    return ours, theirs


EXPRESSIONS = {
    "invariants": ufl.tr(H) ** 2 + ufl.det(I + H) ** (-2 / 3) + ufl.inner(H.T * H, H),
    "inverse": ufl.inner(ufl.inv(2 * I + H), ufl.dev(H)) + ufl.tr(ufl.cofac(H)),
    "indices": H[i, j] * H[j, k] * H[k, i] + U[i] * H[i, j] * X[j] + H[i, i],
    "permutation": ufl.PermutationSymbol(3)[i, j, k] * H[i, j] * U[k],
    "vectors": ufl.dot(ufl.cross(U, X), H * X) + ufl.inner(ufl.outer(U, X), H),
    "lists": ufl.inner(ufl.as_matrix([[U[0], 1, 0], [0, U[1], X[2]], [2, 0, 3]]), H),
    "functions": ufl.exp(U[0]) + ufl.ln(5 + U[1]) + ufl.sqrt(4 + U[2]) + ufl.atan2(U[0], U[1]) + ufl.erf(U[0]),
    "trigonometry": ufl.sin(U[0]) * ufl.cos(U[1]) + ufl.tan(U[2] / 9) + ufl.tanh(U[0]) + ufl.acos(U[1] / 9),
    "choices": ufl.conditional(ufl.And(ufl.gt(U[0], -9), ufl.le(U[1], 9)), U[0] ** 2, U[1]) + abs(U[2]),
    "not chosen": ufl.conditional(ufl.Not(ufl.lt(U[0], -99)), ufl.max_value(U[0], U[1]), ufl.min_value(U[0], U[1])),
    "curvature": ufl.inner(ufl.grad(H), ufl.grad(H)) + ufl.tr(H),
}


@pytest.mark.parametrize("order", range(4))
@pytest.mark.parametrize("name", EXPRESSIONS)
def test_values_and_derivatives_are_ufls_own(name, order):
    expression = EXPRESSIONS[name]
    ours, theirs = affine(0)
    here, there = {U: ours, ufl.classes.SpatialCoordinate: lambda depth: POINT}, {U: theirs}
    for number in range(1, order + 1):
        direction = ufl.Argument(SPACE, number)
        here[direction], there[direction] = affine(number)
        expression = ufl.derivative(expression, U, direction)
    expected = float(ufl.algorithms.expand_derivatives(expression)(tuple(POINT), there))
    assert evaluate(expression, here) == pytest.approx(expected, rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("expression", [1 / ufl.tr(H), ufl.ln(ufl.tr(H)), ufl.sqrt(-1 + ufl.tr(H))])
def test_what_has_no_value_is_not_finite(expression):
    assert not np.isfinite(evaluate(expression, {U: lambda depth: np.zeros((3,) * (depth + 1))}))


def test_what_only_a_mesh_knows_is_said():
    with pytest.raises(NoValueError, match="CellVolume"):
        evaluate(ufl.CellVolume(DOMAIN) * ufl.tr(H), {U: lambda depth: np.zeros((3,) * (depth + 1))})


def test_shared_parts_are_evaluated_once():
    """Sixty doublings of one part: a tree of 10^18 leaves."""
    value = U[0]
    for _ in range(60):
        value = value + value * U[1]
    zero = {U: lambda depth: np.array([1.0, 0.0, 0.0])}
    assert evaluate(value, zero) == 1.0
