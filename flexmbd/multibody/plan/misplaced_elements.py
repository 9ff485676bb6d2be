"""Force elements that a start does not suit, as one beyond a stop."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import SceneError
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.arrays import Plan
from flexmbd.multibody.kernels.elements.element import CoordinateLaw, FrameElement
from flexmbd.multibody.kernels.elements.table import ELEMENTS


def refuse_misplaced_elements(names: Sequence[str], plan: Plan, x: NDArray[np.float64]) -> None:
    """Raise SceneError where a start (nx,) does not suit an element, as one beyond a stop."""
    for row, complaint in misplaced_elements(plan, placed_elements(plan), x):
        raise SceneError(f"{names[row[at.EL_NUMBER]]}: {complaint}")


def placed_elements(plan: Plan) -> list[NDArray[np.int64]]:
    """Rows of the elements that not every start suits."""
    kinds = [isinstance(one, CoordinateLaw | FrameElement) and one.misplaced is not None for one in ELEMENTS]
    return list(plan.elements[np.array(kinds, bool)[plan.elements[:, at.EL_KIND]]])


def misplaced_elements(
    plan: Plan, placed: Iterable[NDArray[np.int64]], x: NDArray[np.float64]
) -> Iterator[tuple[NDArray[np.int64], str]]:
    """Those of the ``placed_elements`` that a start (nx,) does not suit, each with what is wrong."""
    for row in placed:
        element, numbers, complaint = ELEMENTS[row[at.EL_KIND]], plan.data[row[at.EL_DATA] :], ""
        if isinstance(element, CoordinateLaw) and element.misplaced is not None:
            complaint = element.misplaced(numbers, float(x[row[at.EL_X]]))
        elif isinstance(element, FrameElement) and element.misplaced is not None:
            complaint = element.misplaced(numbers, x[row[at.EL_MEMORY] :])
        if complaint:
            yield row, complaint
