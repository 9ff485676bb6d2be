"""One Newton step for the local unknowns of a form as a UFL expression, where nothing is stored and solved."""

from __future__ import annotations

from typing import Any

import ufl

from flexmbd.continuum.contract.entries import optional_entries
from flexmbd.continuum.contract.results import solved, step_keyword


def point_keywords(form: Any, u: ufl.core.expr.Expr, state: Any, p: Any) -> dict[str, Any]:
    """The arguments `z` and `dt` of a form's functions at u, before any time passes; those that it has.

    z is one Newton step from where the local unknowns begin, and so exact where their equations are linear, as below
    yield, and in its first derivative at rest.  Of a compiled law it is what the tangent at rest makes of the strain.
    """
    step = step_keyword(form, 0.0)
    law = optional_entries(form).point_law
    if law is not None:
        return {"z": law(p).linearised(u, p), **step}
    begin = solved(form, p).get("z")
    if begin is None:
        return step
    at = ufl.variable(begin)
    lack = ufl.as_ufl(form.local_residual(at, u, state, p, **step))
    slope = ufl.diff(lack, at)
    if not begin.ufl_shape:
        return {"z": begin - lack / slope, **step}
    n = begin.ufl_shape[0]
    change = _solve([[slope[i, j] for j in range(n)] for i in range(n)], [lack[i] for i in range(n)])
    return {"z": ufl.as_vector([begin[i] - change[i] for i in range(n)]), **step}


def _solve(rows: list[list[Any]], right: list[Any]) -> list[Any]:
    """A x = b by elimination without exchange of rows, which symbols do not allow to choose."""
    n = len(right)
    rows, right = [list(row) for row in rows], list(right)
    for k in range(n):
        for i in range(k + 1, n):
            factor = rows[i][k] / rows[k][k]
            for j in range(k + 1, n):
                rows[i][j] = rows[i][j] - factor * rows[k][j]
            right[i] = right[i] - factor * right[k]
    found: list[Any] = [None] * n
    for i in reversed(range(n)):
        rest = right[i]
        for j in range(i + 1, n):
            rest = rest - rows[i][j] * found[j]
        found[i] = rest / rows[i][i]
    return found
