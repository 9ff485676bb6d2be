"""Every difference between DOLFINx 0.9, 0.10 and 0.11 that flexmbd meets, and nothing else.

Tested with 0.9 and 0.11; the branches for 0.10 alone follow its published sources.
"""

from __future__ import annotations

from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
from dolfinx import fem, mesh


def gmsh_model_to_mesh(
    model: Any, comm: MPI.Comm
) -> tuple[mesh.Mesh, mesh.MeshTags, mesh.MeshTags]:
    """Three-dimensional mesh, cell tags and facet tags of rank 0's gmsh model. Collective.

    Up to 0.9 the module is `gmshio` and returns a triple; from 0.10 on it is `gmsh`, returns a
    MeshData, and gives None instead of empty tags.

    Args:
        model: `gmsh.model` on rank 0; ignored on the others.
        comm: the communicator of the mesh.
    """
    try:
        from dolfinx.io import gmsh as module
    except ImportError:
        from dolfinx.io import gmshio as module
    data = module.model_to_mesh(model, comm, 0, gdim=3)
    domain, cell_tags, facet_tags = data[0], data[1], data[2]
    return domain, _tags(cell_tags, domain, 3), _tags(facet_tags, domain, 2)


def cell_nodes(domain: mesh.Mesh) -> npt.NDArray[np.int32]:
    """Local nodes of each cell, owned cells first, (n_cells, nodes of a cell); not collective.

    Up to 0.10 there is one `dofmap`; later ones deprecate it for `dofmaps`, one by cell type.
    """
    geometry = domain.geometry
    if not hasattr(geometry, "dofmaps"):
        return geometry.dofmap
    return geometry.dofmaps(0) if callable(geometry.dofmaps) else geometry.dofmaps[0]


def geometry_degree(domain: mesh.Mesh) -> int:
    """Degree of the map from the reference cell; not collective.

    Up to 0.10 there is one `cmap`; later ones deprecate it for `cmaps`, one by cell type.
    """
    geometry = domain.geometry
    maps = getattr(geometry, "cmaps", None)
    if maps is None:
        return geometry.cmap.degree
    return (maps(0) if callable(maps) else maps[0]).degree


def interpolation_points(space: fem.FunctionSpace) -> npt.NDArray[np.float64]:
    """Where a space's element evaluates what it interpolates, (n, 3); not collective.

    Up to 0.9 a method, from 0.10 on a property.
    """
    points = space.element.interpolation_points
    return points() if callable(points) else points


def _tags(tags: mesh.MeshTags | None, domain: mesh.Mesh, dim: int) -> mesh.MeshTags:
    if tags is not None:
        return tags
    none = np.empty(0, dtype=np.int32)
    return mesh.meshtags(domain, dim, none, none)
