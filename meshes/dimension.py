"""Checks of the dimensions a part is asked for."""

from __future__ import annotations

import math
import numbers

from flexmbd.errors import MeshError


def require_positive(**lengths: float) -> None:
    """Refuse a length that is no positive, finite number; not collective.

    Args:
        **lengths: values in m, by the names the caller knows them by.

    Raises:
        MeshError: names the first length that is at fault.
    """
    for name, value in lengths.items():
        if not isinstance(value, numbers.Real) or not 0 < value < math.inf:
            raise MeshError(f"{name} must be a positive, finite length in m, got {value!r}")


def require_degree(degree: int) -> None:
    """Refuse a degree of the geometry other than 1 and 2; not collective.

    Raises:
        MeshError: names the degree.
    """
    if degree not in (1, 2):
        raise MeshError(f"degree of the geometry must be 1 or 2, got {degree!r}")


def require_cell(cell: str) -> None:
    """Refuse a cell other than tetrahedron and hexahedron; not collective.

    Raises:
        MeshError: names the cell.
    """
    if cell not in ("tetrahedron", "hexahedron"):
        raise MeshError(f'cell must be "tetrahedron" or "hexahedron", got {cell!r}')
