"""The same mesh with elements of the next lower degree, whose fields are among those of the higher one."""

from __future__ import annotations

import basix.ufl
import numpy as np
import scipy.sparse
from dolfinx import fem

from flexmbd.continuum import compat
from flexmbd.round_off import EQUAL


def next_lower(space: fem.FunctionSpace) -> fem.FunctionSpace | None:
    """The space of the next lower degree, or None where there is none. Collective.

    Of Lagrange elements whose dofs are values at points, all components alike.
    """
    element = space.ufl_element()
    if isinstance(element, basix.ufl._MixedElement) or getattr(element, "element_family", None) is None:
        return None
    basic = element.basix_element
    if basic.family is not basix.ElementFamily.P or basic.degree < 2 or not basic.interpolation_is_identity:
        return None
    lower = basix.ufl.element(
        basic.family, basic.cell_type, basic.degree - 1, basic.lagrange_variant, shape=element.reference_value_shape
    )
    return fem.functionspace(space.mesh, lower)


def nodal_interpolation(coarse: fem.FunctionSpace, space: fem.FunctionSpace) -> scipy.sparse.csr_array:
    """Values at the nodes of a space from those at the nodes of the one of `next_lower`; not collective.

    Returns:
        (owned nodes, nodes of the coarse space on all ranks).
    """
    points = compat.interpolation_points(space)
    dim = space.mesh.topology.dim
    weights = coarse.ufl_element().basix_element.tabulate(0, np.ascontiguousarray(points[:, :dim]))[0, :, :, 0]
    weights = np.where(abs(weights) > EQUAL, weights, 0.0)
    owned = space.dofmap.index_map.size_local
    nodes = space.dofmap.list
    # a node has the same value from whichever of its cells
    place = np.full(owned + space.dofmap.index_map.num_ghosts, -1)
    place[nodes.reshape(-1)] = np.arange(nodes.size)
    cell, corner = np.divmod(place[:owned], nodes.shape[1])
    values = weights[corner]
    kept = values != 0.0
    numbers = coarse.dofmap.index_map.local_to_global(coarse.dofmap.list[cell].reshape(-1).astype(np.int32))
    indptr = np.concatenate([[0], np.cumsum(kept.sum(axis=1))])
    return scipy.sparse.csr_array(
        (values[kept], numbers.reshape(kept.shape)[kept], indptr), shape=(owned, coarse.dofmap.index_map.size_global)
    )
