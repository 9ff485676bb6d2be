"""Equal nodes of an expression as one object: how many are left, and what the expression is worth."""

import pytest
import ufl
from ufl.corealg.traversal import pre_traversal, unique_pre_traversal

from flexmbd.continuum.contract.formulation import load_form
from flexmbd.continuum.contract.shared_nodes import share_nodes
from flexmbd.continuum.contract.trial_symbols import TrialSymbols, affine

_LEVELS = 60


def _chain(x: ufl.core.expr.Expr) -> ufl.core.expr.Expr:
    """Of few objects and 2^60 leaves."""
    for _ in range(_LEVELS):
        x = ufl.max_value(x, ufl.sin(x))
    return x


@pytest.fixture(scope="module")
def unknown() -> TrialSymbols:
    form = load_form("solid_linear")
    return TrialSymbols(form, "hexahedron", 1, parameters=form.reference().parameters)


def test_two_equal_chains_are_one(unknown: TrialSymbols) -> None:
    both = share_nodes(ufl.as_vector((_chain(unknown.u[0]), _chain(unknown.u[0]))))
    one, other = both.ufl_operands
    assert one is other
    # as they are built, UFL compares two of 2^60 leaves with each other here, and never ends
    operators = [node for node in unique_pre_traversal(both) if not node._ufl_is_terminal_]
    assert len(operators) == 2 * _LEVELS + 2


@pytest.mark.parametrize("name", ["neo_hookean", "st_venant_kirchhoff", "solid_micropolar"])
def test_a_form_keeps_its_value(name: str) -> None:
    form = load_form(name)
    at = TrialSymbols(form, form.CELLS[0], 1, parameters=form.reference().parameters)
    along = ufl.Argument(at.space, 1)
    strained = affine(at.u.ufl_shape, seed=3)
    fields = {at.u: lambda depth: 0.01 * strained(depth), along: affine(at.u.ufl_shape, seed=4)}

    def slope(*, shared: bool) -> float | None:
        whole = sum(density for density, _ in form.strain_energy(at.u, at.parameters))
        if shared:
            known = {id(node) for node in pre_traversal(whole)}
            whole = share_nodes(whole)
            assert {id(node) for node in pre_traversal(whole)} <= known
        expanded = ufl.algorithms.expand_derivatives(ufl.derivative(whole, at.u, along))
        return at.evaluate_expanded(expanded, fields)

    alone = slope(shared=False)
    assert alone is not None
    assert abs(alone) > 0.0
    assert slope(shared=True) == pytest.approx(alone, rel=1e-14)
