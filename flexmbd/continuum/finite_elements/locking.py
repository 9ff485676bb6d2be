"""Whether linear cells of displacements alone may be too stiff: in bending, or where volume hardly changes.

A linear brick cannot bend without shear, and where volume is kept its points hold more constraints than it has freedoms
(Hughes 2000, section 4.4). The mean of the volume over a cell takes the second of these away, not the first.
"""

from __future__ import annotations

from collections.abc import Callable

import basix
import numpy as np
from dolfinx import la
from dolfinx.mesh import entities_to_geometry, exterior_facet_indices
from numpy.typing import NDArray

from flexmbd.continuum import parallel
from flexmbd.continuum.compat import cell_nodes
from flexmbd.continuum.finite_elements.discrete_forms import DiscretisedBody
from flexmbd.continuum.finite_elements.elastic_sums import cell_edges, cell_volumes, elastic_sums
from flexmbd.continuum.finite_elements.held_surface import held_dofs
from flexmbd.continuum.finite_elements.linear_model import LinearModel
from flexmbd.errors import LockingWarning, warn

FloatArray = NDArray[np.float64]

_ENOUGH = 4  # cells through a thickness, from which bending is right within some per cent
_NEARLY_INCOMPRESSIBLE = 0.45
_SHARE = 0.1  # of the volume that is thin, from which it is told
_STIFF = 0.1  # of the stiffness against bending, from which it is told where the volume is a cell's mean
_MIDDLE = 0.05  # of 3 x 3 cells a ninth lies inside, less what the ends take; of 2 x 2 none
_FLAT = 1e-6  # a normal's parts below this are round-off
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
        LockingWarning: as `tell_locking_cells`.
    """
    if model.state is not None:
        return
    held = held_dofs(model.supports, layout=model.layout)[model.layout.displacement_dofs[: model.layout.n_owned_nodes]]
    tell_locking_cells(
        model, held=held, poisson=lambda: elastic_sums(model.mesh, model.layout, model.K, model.M).poisson, means=False
    )


def tell_locking_cells(
    body: DiscretisedBody, *, held: NDArray[np.bool_], poisson: Callable[[], float], means: bool
) -> None:
    """Say on rank 0 where cells may be much too stiff. Collective.

    Args:
        body: at rest.
        held: (owned nodes, 3) components that something holds: facets that are held along their normal, as in planes
            of symmetry, are no surface.
        poisson: Poisson's ratio of the body; collective.
        means: whether the volume of a cell changes by its mean alone.

    Warns:
        LockingWarning: of linear solid cells of displacements alone, fewer than four of which lie through a tenth of
            the volume or more, and which are too stiff where they bend; or whose material has a Poisson's ratio above
            0.45, and no mean volume.
    """
    element = body.layout.node_space.element.basix_element
    alone = body.layout.displacement_dofs.size == body.layout.n_local and body.fields is None
    cell = body.mesh.mesh.topology.cell_name()
    if not (alone and cell in _TOO_HIGH and element.family == basix.ElementFamily.P and element.degree == 1):
        return
    if body.has_surface_energy:
        return
    layers, share = _thin(body, held)
    ratio = poisson()
    means = means and cell == "hexahedron"  # of a tetrahedron of degree 1 every strain is a mean
    thin, dense = share >= _SHARE, ratio > _NEARLY_INCOMPRESSIBLE and not means
    by_means = _excess_by_means(body, ratio, layers) if means and thin else 0.0
    if not (dense or (thin and (not means or by_means > _STIFF))):
        return
    reasons = [f"{'one cell lies' if layers == 1 else f'{layers} cells lie'} through {100.0 * share:.0f} % of its "
               "volume"] if thin else []  # fmt: skip
    if dense:
        reasons.append(f"its Poisson's ratio is {ratio:.4g}")
    excess = by_means if means else _excess(body, cell, ratio, layers if thin else _ENOUGH)
    text = (
        f"the body is of {cell} cells of degree 1, which lock, and {' and '.join(reasons)}: its bending "
        f"frequencies may be some {100.0 * (np.sqrt(1.0 + excess) - 1.0):.0f} % too high, its stiffness by twice that "
        "and more. Take degree=2, four cells and more through each thickness, or a form whose cells bend by fields of "
        "their own (solid_enhanced; of walls solid_shell, wall_form)"
    )
    parallel.on_root(body.comm, lambda: warn(text, LockingWarning))


def _excess_by_means(body: DiscretisedBody, poisson: float, through: int) -> float:
    """By what share bricks of mean volume are too stiff in bending, with so many through the thickness. Collective.

    Curvatures a, b along edges l, w of a brick of thickness h cost 2 G times the square of the deviatoric strain, and
    of the shears a x and b y that it cannot do without; b is free. What n cells do by their own bending is a share of
    1 / n^2.
    """
    h, w, length = np.sort(np.linalg.norm(cell_edges(body.mesh), axis=2), axis=1).T
    shear = 1.0 / (2.0 * (1.0 + poisson))  # over Young's modulus
    along, across = (shear * (4.0 / 3.0 + (edge / h) ** 2) for edge in (length, w))
    own = along - (2.0 / 3.0 * shear) ** 2 / across
    total, count = body.comm.allreduce(np.array([own.sum(), len(own)]))
    return float((total / count - 1.0) / through**2)


def _excess(body: DiscretisedBody, cell: str, poisson: float, through: int) -> float:
    """By what share cells are too stiff in bending, with so many through the thickness, by this rank's cells."""
    table = np.array(_TOO_HIGH[cell])[:, through - 1]
    ratio = np.interp(-np.log(1.0 - 2.0 * min(poisson, 0.4999)), -np.log(1.0 - 2.0 * _POISSON), table)
    edges = np.sort(np.linalg.norm(cell_edges(body.mesh), axis=2), axis=1)
    usual = 1.0 if cell == "hexahedron" else np.sqrt(3.0)
    length = max(1.0, float(np.median(edges[:, 2] / edges[:, 0])) / usual) if len(edges) else 1.0
    return float((ratio**2 - 1.0) * length**_LONG)


def _thin(body: DiscretisedBody, held: NDArray[np.bool_]) -> tuple[int, float]:
    """The fewest cells that lie through a tenth of the volume, 1 to 3, and the share (<= 1) with fewer than four.

    By how far, in cells, nodes lie below the surface where that is deepest nearby.
    """
    mesh, space = body.mesh.mesh, body.layout.node_space
    mesh.topology.create_connectivity(2, 3)
    nodes = space.dofmap.list[: mesh.topology.index_map(3).size_local]
    surface = np.zeros(len(body.layout.node_x), bool)
    surface[body.layout.nodes_on(2, _free_facets(body, held))] = True

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
    volumes = cell_volumes(body.mesh)
    thin = ~deep[nodes].any(axis=1)
    single = thin & ~touching(below)[nodes].any(axis=1)
    inner = thin & below[nodes].all(axis=1)  # between the outer ones there are some where three lie through
    sums = [volumes[one].sum() for one in (thin, single, inner)]
    thin_volume, one, middle, whole = body.comm.allreduce(np.array([*sums, volumes.sum()]))
    through = 1 if one >= _SHARE * whole else 3 if middle >= _MIDDLE * thin_volume else 2
    return through, float(thin_volume / whole)


def _free_facets(body: DiscretisedBody, held: NDArray[np.bool_]) -> NDArray[np.int32]:
    """Facets of the surface that are not held along their normal, of this rank. Collective."""
    mesh, space = body.mesh.mesh, body.layout.node_space
    facets: NDArray[np.int32] = exterior_facet_indices(mesh.topology)
    everywhere = la.vector(space.dofmap.index_map, 3)
    everywhere.array[: held.size] = held.reshape(-1)
    everywhere.scatter_forward()
    if not len(facets):  # DOLFINx divides by their number
        return facets
    corners = entities_to_geometry(mesh, 2, facets)
    edges = mesh.geometry.x[corners[:, 1:3]] - mesh.geometry.x[corners[:, :1]]
    normals = np.cross(edges[:, 0], edges[:, 1])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    number = np.zeros(len(mesh.geometry.x), np.int32)  # of the node in a corner
    number[cell_nodes(mesh)] = space.dofmap.list
    loose = everywhere.array.reshape(-1, 3)[number[corners]] == 0.0
    return facets[(loose & (abs(normals)[:, None] > _FLAT)).any(axis=(1, 2))]
