"""Force elements that a start does not suit, as one beyond a stop."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import SceneError
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.arrays import Plan
from flexmbd.multibody.kernels.elements.element import CoordinateLaw
from flexmbd.multibody.kernels.elements.table import ELEMENTS


def refuse_misplaced_elements(names: Sequence[str], plan: Plan, x: NDArray[np.float64]) -> None:
    """Raise SceneError where a start (nx,) does not suit an element, as one beyond a stop."""
    for row, complaint in misplaced_elements(plan, placed_elements(plan), x):
        raise SceneError(f"{names[row[at.EL_NUMBER]]}: {complaint}")


def placed_elements(plan: Plan) -> list[NDArray[np.int64]]:
    """Rows of the elements that not every start suits."""
    return [row for row in plan.elements if _misplaced(row) is not None]


def misplaced_elements(
    plan: Plan, placed: Iterable[NDArray[np.int64]], x: NDArray[np.float64]
) -> Iterator[tuple[NDArray[np.int64], str]]:
    """Those of the ``placed_elements`` that a start (nx,) does not suit, each with what is wrong."""
    for row in placed:
        misplaced = _misplaced(row)
        complaint = misplaced(plan.data[row[at.EL_DATA] :], float(x[row[at.EL_X]])) if misplaced is not None else ""
        if complaint:
            yield row, complaint


def _misplaced(row: NDArray[np.int64]) -> Callable[[NDArray[np.float64], float], str] | None:
    element = ELEMENTS[row[at.EL_KIND]]
    return element.misplaced if isinstance(element, CoordinateLaw) else None
