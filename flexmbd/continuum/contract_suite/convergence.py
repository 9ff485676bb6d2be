"""Errors of a form's reference problem over ever finer meshes of several families, and the orders they fall at."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from flexmbd.continuum.contract.entries import is_layered
from flexmbd.continuum.contract.formulation import Formulation, orders
from flexmbd.continuum.contract.hessian import EXACT
from flexmbd.continuum.contract_suite.order import relative_error
from flexmbd.continuum.contract_suite.trial_mesh import DIMENSION, Family, family_mesh

#: Cells along an edge, by the degree of the element and the dimension of the cells.
DIVISIONS = {
    (1, 3): (4, 6, 8, 10), (2, 3): (2, 3, 4, 6), (1, 2): (4, 8, 12, 16), (2, 2): (3, 6, 9, 12),
    (1, 1): (8, 16, 32, 64), (2, 1): (4, 8, 16, 32),
}  # fmt: skip
_OTHERS = (1, 2, 3, 4)
_FITTED = 3  # of the finest meshes


@dataclass(frozen=True)
class MeshConvergence:
    """Of one cell and degree on the meshes of one family.

    Attributes:
        cell, degree: of the element.
        family: of the meshes.
        divisions: (k,) cells along an edge of 1 m.
        errors: (k,) relative L2 errors of the displacement.
        claimed: the order that the form claims.
        fault: why there are no errors; empty where there are.
    """

    cell: str
    degree: int
    family: Family
    divisions: tuple[int, ...]
    errors: tuple[float, ...]
    claimed: int
    fault: str = ""

    @property
    def order(self) -> float:
        """Slope of the errors' logarithms over the finest meshes; NaN where these are round-off, or none."""
        errors = np.array(self.errors[-_FITTED:])
        if len(errors) < 2 or not (errors > EXACT).all():
            return float("nan")
        return float(-np.polyfit(np.log(self.divisions[-_FITTED:]), np.log(errors), 1)[0])


def convergence(
    form: Formulation, cell: str, degree: int, *, family: Family, tell: Callable[[str], None] = lambda text: None
) -> MeshConvergence:
    """Solve the reference problem on each mesh of a family; on this rank alone. Compiles.

    Args:
        form: a checked form file.
        cell: one of its cells.
        degree: one of its degrees on that cell.
        family: of the meshes.
        tell: is told what begins.
    """
    divisions = DIVISIONS.get((degree, DIMENSION[cell]), _OTHERS)
    claimed = orders(form, cell)[degree]
    tell(f"convergence of {cell} {degree} on {family.value} meshes")
    try:
        meshes = (family_mesh(cell, family, n=n, layered=is_layered(form)) for n in divisions)
        errors = tuple(relative_error(form, cell, degree, mesh=mesh) for mesh in meshes)
    except Exception as error:  # noqa: BLE001  (a form file is foreign code)
        lines = str(error).strip().splitlines() or [""]
        return MeshConvergence(cell, degree, family, (), (), claimed, f"{type(error).__name__}: {lines[-1]}")
    return MeshConvergence(cell, degree, family, divisions, errors, claimed)
