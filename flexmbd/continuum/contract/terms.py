"""The terms of a form, pairs of an integrand and its quadrature rule, checked without a mesh."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import ufl

from flexmbd.continuum.contract.quadrature import is_rule

_ONE_RULE = (
    "two quadrature rules in one form give a silently wrong residual, so each term is "
    "(integrand, Quadrature) and is assembled by itself"
)
_NOWHERE = {
    ufl.classes.CellAvg: (
        "averages over a cell (cell_avg), which DOLFINx does not compile: F-bar is not a plain UFL form; give the "
        "volumetric part a term with a lower rule of its own, or make the pressure an unknown"
    ),
    ufl.classes.FacetAvg: "averages over a facet: the terms are integrals over cells",
    ufl.classes.Restricted: "has sides of a facet, as jump and avg do: the terms are integrals over cells",
}
_NOT_IN_CELLS = {
    **_NOWHERE,
    ufl.classes.FacetNormal: (
        "has the normal of a facet (FacetNormal): the terms are integrals over cells; what acts on facets stands in "
        "surface_energy or surface_kinetic_energy"
    ),
}


def term_faults(
    terms: Any, cell: str, look: Callable[[ufl.core.expr.Expr], Iterator[str]], *, on_facets: bool = False
) -> Iterator[str]:
    """Faults of a list of terms; `look` checks an integrand that is in order.

    Args:
        terms: what a function of a form file returned.
        cell: of the integrals; of those over facets the facets' name.
        look: finds what else is wrong.
        on_facets: whether they are integrals over facets.
    """
    if isinstance(terms, ufl.BaseForm):
        yield _facet_fault(terms) or f"returns a form with {_rules(terms)}; return a list of terms: {_ONE_RULE}"
        return
    terms = list(terms)
    if not terms:
        yield "has no terms"
    for number, term in enumerate(terms):
        label = f"term {number}"
        if isinstance(term, ufl.BaseForm):
            yield f"{label} {_facet_fault(term) or f'is a form with {_rules(term)}: {_ONE_RULE}'}"
            continue
        if not isinstance(term, tuple) or len(term) != 2:
            yield f"{label} must be a pair (integrand, Quadrature), got {type(term).__name__}"
            continue
        integrand, rule = term
        if not is_rule(rule, cell):
            expected = "a quadrature degree (int >= 0) and a scheme that basix has for these cells"
            yield f"{label} must state {expected}, got {rule!r}"
        if isinstance(integrand, ufl.BaseForm):
            why = _facet_fault(integrand) or f"already holds a measure with {_rules(integrand)}: {_ONE_RULE}"
            yield f"{label}: the integrand {why}"
        elif not isinstance(integrand, ufl.core.expr.Expr):
            yield f"{label}: the integrand must be a UFL expression, got {type(integrand).__name__}"
        elif integrand.ufl_shape != () or integrand.ufl_free_indices != ():
            yield f"{label}: the integrand must be scalar, has shape {integrand.ufl_shape}"
        elif misplaced := _misplaced(integrand, _NOWHERE if on_facets else _NOT_IN_CELLS):
            yield f"{label}: the integrand {misplaced}"
        else:
            yield from (f"{label}: {fault}" for fault in look(integrand))


def _misplaced(integrand: ufl.core.expr.Expr, not_here: Mapping[type, str]) -> str | None:
    """What the integrand has that such an integral cannot have."""
    for part in ufl.corealg.traversal.unique_pre_traversal(integrand):
        for kind, why in not_here.items():
            if isinstance(part, kind):
                return why
    return None


def _facet_fault(form: ufl.BaseForm) -> str | None:
    """What is wrong with integrals over facets, if there are some."""
    kinds = {integral.integral_type() for integral in form.integrals()} if isinstance(form, ufl.Form) else set()
    if not any("facet" in kind for kind in kinds):
        return None
    if any("interior" in kind for kind in kinds):
        return "holds an integral over inner facets (dS), which no term has: write the energy in the cells"
    return (
        "holds an integral over facets (ds): terms on facets are surface_energy(u, p) and "
        "surface_kinetic_energy(v, p), as integrands with their rules and without a measure"
    )


def _rules(form: ufl.BaseForm) -> str:
    integrals = form.integrals() if isinstance(form, ufl.Form) else ()
    count = len({repr(integral.metadata()) for integral in integrals})
    return f"{count} rule{'' if count == 1 else 's'}"
