"""Meshes that fall into pieces are refused, however they are spread over the ranks."""

from mpi4py import MPI

import gmsh
import numpy as np
import pytest

from flexmbd.continuum.grid.tagged_mesh import from_arrays
from flexmbd.errors import MeshError
from flexmbd.meshes import session

pytestmark = pytest.mark.mpi

COMM = MPI.COMM_WORLD


def row_of_boxes(n, *, cut=()):
    """n hexahedra along x; behind each box of `cut` the nodes are doubled, so that the row is cut."""
    points, cells = [], []
    for i in range(n):
        if i == 0 or i - 1 in cut:
            first = len(points)
            points += [(i, j, k) for k in (0, 1) for j in (0, 1)]
        else:
            first = cells[-1][1]
        points += [(i + 1, j, k) for k in (0, 1) for j in (0, 1)]
        last = len(points) - 4
        cells.append([first, last, first + 1, last + 1, first + 2, last + 2, first + 3, last + 3])
    return np.array(points, dtype=float), np.array(cells)


def mesh(points, cells, **how):
    return from_arrays(COMM, points, cells, cell="hexahedron", degree=1, facet_groups={}, **how)


def test_a_row_hangs_together():
    assert mesh(*row_of_boxes(9)).mesh.topology.index_map(3).size_global == 9


def test_doubled_nodes():
    with pytest.raises(
        MeshError,
        match=r"falls into 2 pieces that share no facet: 6 cells around \[3\.0, 0\.5, 0\.5\] m, "
        r"3 cells around \[7\.5, 0\.5, 0\.5\] m; join them",
    ):
        mesh(*row_of_boxes(9, cut=(5,)))
    assert COMM.allreduce(1) == COMM.size


def test_many_pieces():
    with pytest.raises(MeshError, match=r"falls into 9 pieces .*m, \.\.\.; join them"):
        mesh(*row_of_boxes(9, cut=range(9)))


def test_cells_that_share_an_edge_only():
    """Two boxes that touch by an edge are a hinge."""
    points, cells = row_of_boxes(2)
    beside = points[cells[1]] + (0, 1, 0)
    shared = {tuple(x): i for i, x in enumerate(points[cells[0]])}
    new = [cells[0][shared[tuple(x)]] if tuple(x) in shared else -1 for x in beside]
    assert new.count(-1) == 6
    extra = len(points) + np.cumsum(np.array(new) == -1) - 1
    points = np.vstack((points, beside[np.array(new) == -1]))
    hinge = np.where(np.array(new) == -1, extra, new)
    with pytest.raises(MeshError, match="2 pieces"):
        mesh(points, [cells[0], hinge])


def test_lines_and_forks():
    """A line through points shared by ranks, a line in two pieces, and a fork of three."""
    x = np.column_stack((np.arange(10.0), np.zeros((10, 2))))
    chain = np.column_stack((np.arange(9), np.arange(1, 10)))
    how = {"cell": "interval", "degree": 1, "facet_groups": {}}
    assert from_arrays(COMM, x, chain, **how).dim == 1
    with pytest.raises(MeshError, match="2 pieces"):
        from_arrays(COMM, x, np.delete(chain, 4, axis=0), **how)
    fork = np.vstack((chain, [4, 10]))
    if COMM.size == 1:
        assert from_arrays(COMM, np.vstack((x, [4, 1, 0])), fork, **how).dim == 1
        return
    # DOLFINx would hang the third line on a point of its own
    with pytest.raises(MeshError, match=r"1 facets have more than two cells, .* \[4\] .*run on one"):
        from_arrays(COMM, np.vstack((x, [4, 1, 0])), fork, **how)


@pytest.mark.parametrize("times", [2, 3])
def test_a_cell_given_twice(times):
    points, cells = row_of_boxes(3)
    turned = cells[1][[1, 3, 0, 2, 5, 7, 4, 6]]
    with pytest.raises(
        MeshError, match=r"1 cells are given more than once, .* \[4, 5, 6, 7, 8, 9, 10, 11\]"
    ):
        mesh(points, np.vstack((cells, [turned] * (times - 1))))


def test_three_cells_on_one_facet():
    points = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (0, 0, -1), (0.1, 0.1, 0.5)])
    cells = [[0, 1, 2, i] for i in (3, 4, 5)]
    with pytest.raises(MeshError, match=r"1 facets .* \[0, 1, 2\] of the input: cells overlap"):
        from_arrays(COMM, points, cells, degree=1, facet_groups={})


def test_two_volumes_of_gmsh():
    def fill():
        boxes = [gmsh.model.occ.addBox(x, 0, 0, 1, 1, 1) for x in (0, 1)]  # touch, but not fused
        gmsh.model.occ.synchronize()
        gmsh.model.addPhysicalGroup(2, [1], name="foot")
        gmsh.model.addPhysicalGroup(3, boxes, name="both")
        session.generate(h=0.5, degree=2)

    with pytest.raises(MeshError, match="falls into 2 pieces"):
        session.tagged_mesh(COMM, fill)


def test_ranks_without_cells():
    """One cell on any number of ranks."""
    points, cells = row_of_boxes(1)
    part = mesh(points, cells, vertex_groups={"corner": lambda x: x.sum(axis=0) < 0.5})
    assert COMM.allreduce(len(part.vertices("corner"))) == 1
