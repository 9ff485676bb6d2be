"""Curved tetrahedra made valid: those that a curved face turns inside out are bent to follow it, or straightened.

The measure is the scaled Jacobian of meshes of higher order: the least Jacobian determinant in a cell over that of
the straight cell with the same corners. Nodes inside the part are moved so that the sum over points of cells of
(J - 1)² + log²((J - e)/(1 - e)) is least, in which the barrier e rises with what was reached (T. Toulorge, C. Geuzaine,
J.-F. Remacle, J. Lambrechts, Robust untangling of curvilinear meshes, Journal of Computational Physics 254, 2013,
equations 9 to 11); here only in the surroundings of bad cells, with corners and the surface held. gmsh's own
optimisers take up to seventy times as long as meshing, and end the process on some parts (4.13.1).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import basix
import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize

from flexmbd.continuum.grid.mesh_input import MeshInput
from flexmbd.meshes.cell_faces import FaceTable, faces_of

Points = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

#: The scaled Jacobian that every cell shall have.
LEAST = 0.1

# Below this a cell is of no use.
_FLAT = 1e-6

# What is aimed at: above the least, so that it is not missed by a hair.
_AIM = 0.2

# Rounds of raised barriers; steps in each; what a round must gain, else it was the last one.
_ROUNDS = 8
_STEPS = 40
_GAIN = 1e-2

# What is left of the curvature of an edge that is made straighter; of the cells, how many may be at most.
_STRAIGHTER = (0.8, 0.6, 0.4, 0.2, 0.0)
_MOST = 0.01

# Lattices of the points in which determinants are looked at, to bend and to judge; cells judged in one go.
_COARSE, _FINE = 3, 6
_BATCH = 10_000

# basix's edges of a tetrahedron, whose middles are the nodes 4 to 9.
_EDGES = ((2, 3), (1, 3), (1, 2), (0, 3), (0, 2), (0, 1))


@dataclass(frozen=True)
class Untangled:
    """What was done.

    Attributes:
        bent: cells that were below the least scaled Jacobian.
        straightened: those of them of which an edge on the surface was made straighter, and with it the surface.
        left: those that are below still.
        inverted: those of them whose Jacobian determinant vanishes or changes its sign.
    """

    bent: int
    straightened: int
    left: int
    inverted: int


def scaled_jacobians(points: Points, cells: IntArray) -> Points:
    """The least scaled Jacobian of each tetrahedron of 10 nodes, in basix's order, among 84 points of it, (n,)."""
    least = np.ones(len(cells))
    x = points[cells]
    middles = np.stack([x[:, 4 + i] - 0.5 * (x[:, a] + x[:, b]) for i, (a, b) in enumerate(_EDGES)], axis=1)
    size = np.linalg.norm(x[:, 1:4] - x[:, :1], axis=2).max(axis=1)
    curved = np.flatnonzero(np.linalg.norm(middles, axis=2).max(axis=1) > 1e-9 * size)
    gradients = _gradients(_FINE)
    for some in np.array_split(curved, max(1, len(curved) // _BATCH)):
        least[some] = _ratios(points, cells[some], gradients, _straight(points, cells[some])).min(axis=1)
    return least


def untangle(share: MeshInput) -> tuple[MeshInput, Untangled]:
    """An input of tetrahedra of degree 2 whose cells are valid, as far as that can be; rank 0.

    Corners stay where they are. Middles of edges on the surface, and between cells of two groups, are moved only where
    nothing else helps.
    """
    points, cells = share.points.copy(), share.cells
    before = scaled_jacobians(points, cells)
    bad = np.flatnonzero(before < LEAST)
    if len(bad) == 0:
        return share, Untangled(0, 0, 0, 0)
    held = np.zeros(len(points), dtype=bool)
    held[cells[:, :4]] = True
    held[_surface_middles(share)] = True
    _bend(points, cells, bad, held)
    after = scaled_jacobians(points, cells)
    still = np.flatnonzero(after < LEAST)
    worst = still[np.argsort(after[still], kind="stable")][: max(1, int(_MOST * len(cells)))]
    straightened = _straighten(points, cells, worst)
    least = scaled_jacobians(points, cells)
    left, inverted = (int(np.count_nonzero(least < bound)) for bound in (LEAST, _FLAT))
    return replace(share, points=points), Untangled(len(bad), straightened, left, inverted)


def _gradients(lattice: int) -> Points:
    """Derivatives of the shape functions in the points of a lattice of a tetrahedron, (3, points, 10)."""
    cell = basix.CellType.tetrahedron
    element = basix.create_element(basix.ElementFamily.P, cell, 2, basix.LagrangeVariant.equispaced)
    table: Points = element.tabulate(1, basix.create_lattice(cell, lattice, basix.LatticeType.equispaced, True))
    return table[1:, :, :, 0]


def _straight(points: Points, cells: IntArray) -> Points:
    """Jacobian determinants of the straight cells, (n,)."""
    x = points[cells[:, :4]]
    found: Points = np.linalg.det(x[:, 1:] - x[:, :1])
    return found


def _ratios(points: Points, cells: IntArray, gradients: Points, straight: Points) -> Points:
    """Jacobian determinants over those of the straight cells, (n, points of a cell)."""
    jacobian = np.einsum("cni,kqn->cqik", points[cells], gradients, optimize=True)
    ratio: Points = np.linalg.det(jacobian) / straight[:, None]
    return ratio


def _surface_middles(share: MeshInput) -> IntArray:
    """The middles of the edges of the surface and of the faces between two groups of cells."""
    corners = share.cells[:, :4]
    table = FaceTable([faces_of("tetrahedron", corners)], len(share.points))
    tags = np.tile(share.cell_tags, 4)
    lowest, highest = np.full(len(table.rows), 1 << 30), np.full(len(table.rows), -1)
    np.minimum.at(lowest, table.of_cells, tags)
    np.maximum.at(highest, table.of_cells, tags)
    faces = table.rows[table.is_outer | (lowest < highest)][:, :3]
    n = len(share.points)
    edges = np.unique(np.concatenate([_key(faces[:, [a, b]], n) for a, b in ((0, 1), (1, 2), (0, 2))]))
    found = [
        share.cells[np.isin(_key(corners[:, [a, b]], n), edges), 4 + i] for i, (a, b) in enumerate(_EDGES)
    ]
    return np.unique(np.concatenate(found))


def _key(edges: IntArray, n: int) -> IntArray:
    return edges.min(axis=1) * n + edges.max(axis=1)


def _bend(points: Points, cells: IntArray, bad: IntArray, held: npt.NDArray[np.bool_]) -> None:
    """Move the middles inside, around bad cells, until these are good; in place."""
    near = np.isin(cells[:, 4:], cells[bad, 4:]).any(axis=1)
    free = np.unique(cells[near, 4:])
    free = free[~held[free]]
    if len(free) == 0:
        return
    patch = cells[np.isin(cells, free).any(axis=1)]
    gradients, straight = _gradients(_COARSE), _straight(points, patch)
    where = np.full(len(points), -1, dtype=np.int64)
    where[free] = np.arange(len(free))
    slots = where[patch]
    inside = slots >= 0
    # lengths in units of the cells' size
    size = np.cbrt(abs(straight).mean())

    beyond = np.inf

    def energy(x: Points, barrier: float) -> tuple[float, Points]:
        moved = points.copy()
        moved[free] += size * x.reshape(-1, 3)
        jacobian = np.einsum("cni,kqn->cqik", moved[patch], gradients, optimize=True)
        ratio = np.linalg.det(jacobian) / straight[:, None]
        if ratio.min() <= barrier:
            return beyond, np.zeros_like(x)
        log = np.log((ratio - barrier) / (1.0 - barrier))
        slope = (2.0 * (ratio - 1.0) + 2.0 * log / (ratio - barrier)) / straight[:, None]
        cofactors = np.stack(
            [np.cross(jacobian[..., (k + 1) % 3], jacobian[..., (k + 2) % 3]) for k in range(3)], axis=-1
        )
        of_nodes = np.einsum("cq,cqik,kqn->cni", slope, cofactors, gradients, optimize=True)
        gradient = np.zeros((len(free), 3))
        np.add.at(gradient, slots[inside], of_nodes[inside])
        return float(((ratio - 1.0) ** 2 + log**2).sum()), size * gradient.reshape(-1)

    before = -np.inf
    for _ in range(_ROUNDS):
        least = float(_ratios(points, patch, gradients, straight).min())
        if least >= _AIM or least < before + _GAIN:
            return
        before = least
        barrier = least - 0.1 * max(abs(least), 0.1)
        beyond = 1e3 * energy(np.zeros(3 * len(free)), barrier)[0]  # the search of a step goes back from there
        done = minimize(
            energy, np.zeros(3 * len(free)), args=(barrier,), jac=True, method="L-BFGS-B",
            options={"maxiter": _STEPS, "maxfun": 2 * _STEPS},
        )  # fmt: skip
        if done.fun >= beyond:
            return
        points[free] += size * done.x.reshape(-1, 3)


def _straighten(points: Points, cells: IntArray, bad: IntArray) -> int:
    """Make the edges of bad cells as much straighter as it takes; how many cells that were. In place."""
    curved = points.copy()
    taken: IntArray = np.empty(0, dtype=np.int64)
    for rest in _STRAIGHTER:
        if len(bad) == 0:
            break
        taken = np.union1d(taken, bad).astype(np.int64)
        for i, (a, b) in enumerate(_EDGES, start=4):
            middle = cells[bad, i]
            halfway = (points[cells[bad, a]] + points[cells[bad, b]]) / 2.0
            points[middle] = halfway + rest * (curved[middle] - halfway)
        near = np.flatnonzero(np.isin(cells, cells[taken, 4:]).any(axis=1))
        bad = near[scaled_jacobians(points, cells[near]) < LEAST]
    return len(taken)
