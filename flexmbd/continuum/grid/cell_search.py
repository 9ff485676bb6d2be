"""Which cell of a mesh holds a point."""

from __future__ import annotations

import basix
import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.continuum import compat
from flexmbd.continuum.grid.tagged_mesh import TaggedMesh

FloatArray = NDArray[np.float64]

# By how much a point may lie outside, in reference coordinates: round-off of places given with seven digits.
_OUTSIDE = 1e-6


def find_cell(mesh: TaggedMesh, point: ArrayLike) -> tuple[int, FloatArray] | None:
    """An owned cell that holds a point, and the point's place in the reference cell; not collective.

    Args:
        mesh: of solid cells, or of cells of a surface.
        point: (3,) m.

    Returns:
        None where no cell of this rank holds it. Of several cells that share the point the first.
    """
    p = np.asarray(point, dtype=float).reshape(1, 3)
    domain = mesh.mesh
    cells = compat.cell_nodes(domain)[: domain.topology.index_map(domain.topology.dim).size_local]
    x = domain.geometry.x[cells]
    low, high = x.min(axis=1), x.max(axis=1)
    # a curved cell reaches beyond its nodes
    margin = (0.1 if compat.geometry_degree(domain) > 1 else _OUTSIDE) * (high - low).max(axis=1, keepdims=True)
    for cell in np.flatnonzero(((p >= low - margin) & (p <= high + margin)).all(axis=1)):
        try:
            reference = compat.coordinate_map(domain).pull_back(p, x[cell])[0]
        except RuntimeError:  # far outside a distorted cell Newton's method finds nothing
            continue
        if _is_inside(reference, domain.topology.cell_name()):
            # beside a surface a point has a place in its cells as well
            there = compat.coordinate_map(domain).push_forward(reference[None], x[cell])[0]
            if np.linalg.norm(there - p[0]) <= margin[cell].max():
                return int(cell), reference
    return None


def _is_inside(reference: FloatArray, cell: str) -> bool:
    """Whether reference coordinates (3,) or (2,) lie in the reference cell."""
    inside = bool((reference >= -_OUTSIDE).all())
    if basix.CellType[cell] in (basix.CellType.tetrahedron, basix.CellType.triangle):
        return inside and float(reference.sum()) <= 1.0 + _OUTSIDE
    return inside and bool((reference <= 1.0 + _OUTSIDE).all())
