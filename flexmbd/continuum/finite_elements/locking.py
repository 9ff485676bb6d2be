"""Whether linear cells of displacements alone may be too stiff: in bending, or where volume hardly changes.

A linear brick cannot bend without shear, and where volume is kept its points hold more constraints than it has freedoms
(Hughes 2000, section 4.4).
"""

from __future__ import annotations

import basix
import numpy as np
from dolfinx import la
from dolfinx.mesh import exterior_facet_indices
from numpy.typing import NDArray

from flexmbd.continuum import parallel
from flexmbd.continuum.finite_elements.elastic_sums import cell_edges, cell_volumes, elastic_sums
from flexmbd.continuum.finite_elements.linear_model import LinearModel
from flexmbd.errors import LockingWarning, warn

FloatArray = NDArray[np.float64]

_ENOUGH = 4  # cells through a thickness, from which bending is right within some per cent
_NEARLY_INCOMPRESSIBLE = 0.45
_SHARE = 0.1  # of the volume that is thin, from which it is told
_LONG = 1.5  # by this power of the length of cells over their thickness they are stiffer

# First bending frequency of a slender beam of cubic cells (six tetrahedra each) over the exact one, for 1 to 4 cells
# through the thickness, by Poisson's ratio; computed with `solid_linear`.
_POISSON = np.array([0.3, 0.45, 0.48, 0.499, 0.4999])
_TOO_HIGH = {
    "hexahedron": [
        [1.242, 1.068, 1.031, 1.018],
        [1.376, 1.136, 1.070, 1.044],
        [1.451, 1.195, 1.114, 1.076],
        [1.830, 1.419, 1.304, 1.249],
        [2.854, 1.937, 1.644, 1.504],
    ],
    "tetrahedron": [
        [1.861, 1.283, 1.138, 1.082],
        [2.392, 1.524, 1.278, 1.174],
        [2.681, 1.715, 1.418, 1.281],
        [2.946, 1.981, 1.702, 1.572],
        [2.978, 2.043, 1.794, 1.684],
    ],
}


def tell_locking(model: LinearModel) -> None:
    """Say on rank 0 where frequencies of bending may be much too high. Collective.

    Warns:
        LockingWarning: of linear solid cells of displacements alone, fewer than four of which lie through a tenth of
            the volume or more, or whose material has a Poisson's ratio above 0.45.
    """
    element = model.layout.node_space.element.basix_element
    alone = model.layout.displacement_dofs.size == model.layout.n_local and model.condensed is None
    cell = model.mesh.mesh.topology.cell_name()
    if not (alone and cell in _TOO_HIGH and element.family == basix.ElementFamily.P and element.degree == 1):
        return
    if model.has_surface_energy or model.state is not None:
        return
    layers, share = _thin(model)
    poisson = elastic_sums(model.mesh, model.layout, model.K, model.M).poisson
    if share < _SHARE and not poisson > _NEARLY_INCOMPRESSIBLE:
        return
    thin = share >= _SHARE
    through = layers if thin else _ENOUGH
    reasons = [f"{'one cell lies' if layers == 1 else f'{layers} cells lie'} through {100.0 * share:.0f} % of its "
               "volume"] if thin else []  # fmt: skip
    if poisson > _NEARLY_INCOMPRESSIBLE:
        reasons.append(f"its Poisson's ratio is {poisson:.4g}")
    text = (
        f"the body is of {cell} cells of degree 1, which lock, and {' and '.join(reasons)}: its bending "
        f"frequencies may be some {_excess(model, cell, poisson, through):.0f} % too high, its stiffness by twice that "
        "and more. Take degree=2, or four cells and more through each thickness"
    )
    parallel.on_root(model.comm, lambda: warn(text, LockingWarning))


def _excess(model: LinearModel, cell: str, poisson: float, through: int) -> float:
    """%, by how much a bending frequency is too high with so many cells through the thickness, by this rank's cells."""
    table = np.array(_TOO_HIGH[cell])[:, through - 1]
    ratio = np.interp(-np.log(1.0 - 2.0 * min(poisson, 0.4999)), -np.log(1.0 - 2.0 * _POISSON), table)
    edges = np.sort(np.linalg.norm(cell_edges(model.mesh), axis=2), axis=1)
    usual = 1.0 if cell == "hexahedron" else np.sqrt(3.0)
    length = max(1.0, float(np.median(edges[:, 2] / edges[:, 0])) / usual) if len(edges) else 1.0
    return float(100.0 * (np.sqrt(1.0 + (ratio**2 - 1.0) * length**_LONG) - 1.0))


def _thin(model: LinearModel) -> tuple[int, float]:
    """The fewest cells that lie through a tenth of the volume, 1 to 3, and the share (<= 1) with fewer than four.

    By how far, in cells, nodes lie below the surface where that is deepest nearby.
    """
    mesh, space = model.mesh.mesh, model.layout.node_space
    mesh.topology.create_connectivity(2, 3)
    nodes = space.dofmap.list[: mesh.topology.index_map(3).size_local]
    surface = np.zeros(len(model.layout.node_x), bool)
    surface[model.layout.nodes_on(2, exterior_facet_indices(mesh.topology))] = True

    def touching(marked: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Nodes that share a cell with a marked one."""
        total = la.vector(space.dofmap.index_map)
        total.array[:] = 0.0
        total.array[nodes[marked[nodes].any(axis=1)].reshape(-1)] = 1.0
        total.scatter_reverse(la.InsertMode.add)
        total.scatter_forward()
        return np.asarray(total.array > 0.0)

    below = ~surface
    second = below & ~touching(surface)
    over_second = touching(second) & below
    # nodes from which ever deeper ones lead to the second below the surface, and those beside them: of tetrahedra some
    # at an edge touch none below
    deep = touching(second | over_second | (touching(over_second) & surface))
    volumes = cell_volumes(model.mesh)
    thin = ~deep[nodes].any(axis=1)
    single = thin & ~touching(below)[nodes].any(axis=1)
    inner = thin & below[nodes].all(axis=1)  # between the outer ones there are some where three lie through
    sums = [volumes[one].sum() for one in (thin, single, inner)]
    thin_volume, one, middle, whole = model.comm.allreduce(np.array([*sums, volumes.sum()]))
    through = 1 if one >= _SHARE * whole else 3 if middle >= _SHARE * thin_volume else 2
    return through, float(thin_volume / whole)
