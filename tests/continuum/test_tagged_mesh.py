"""Meshes from arrays: orders of nodes, groups of facets, the fingerprint, and bad arrays."""

import itertools

from mpi4py import MPI

import dolfinx
import numpy as np
import pytest
import ufl
from dolfinx import fem

from flexmbd.continuum.compat import cell_nodes
from flexmbd.continuum.grid.node_order import NodeOrder
from flexmbd.continuum.grid.tagged_mesh import from_arrays
from flexmbd.errors import MeshError

pytestmark = pytest.mark.mpi

COMM = MPI.COMM_WORLD

# Written down from the formats' own documents: which vertices each further node lies between.
TETRAHEDRON_EDGES = {
    NodeOrder.LEXICOGRAPHIC: ["01", "02", "03", "12", "13", "23"],
    NodeOrder.VTK: ["01", "12", "02", "03", "13", "23"],
    NodeOrder.GMSH: ["01", "12", "02", "03", "23", "13"],
}
HEXAHEDRON_NODES = {
    NodeOrder.VTK: "01 12 23 03 45 56 67 47 04 15 26 37 0347 1256 0145 2367 0123 4567 01234567",
    NodeOrder.GMSH: "01 03 04 12 15 23 26 37 45 47 56 67 0123 0145 0347 1256 2367 4567 01234567",
}
# Around the bottom face, then the top one.
HEXAHEDRON_CORNERS = [
    (0, 0, 0),
    (1, 0, 0),
    (1, 1, 0),
    (0, 1, 0),
    (0, 0, 1),
    (1, 0, 1),
    (1, 1, 1),
    (0, 1, 1),
]

ORIGIN = np.array([0.1, -0.2, 0.3])
SIDES = np.array([[1.0, 0.1, 0.0], [0.0, 2.0, 0.2], [0.3, 0.0, 1.5]])


def placed(reference):
    """An affine image of reference points."""
    return ORIGIN + np.asarray(reference, dtype=float) @ SIDES


def middles(corners, nodes):
    return np.array([np.mean([corners[int(i)] for i in node], axis=0) for node in nodes])


def one_cell(points, **how):
    return from_arrays(MPI.COMM_SELF, points, [list(range(len(points)))], facet_groups={}, **how)


def assert_affine(tagged):
    """The nodes of the cell are an affine image of basix's reference nodes, in its order."""
    element = tagged.mesh.ufl_domain().ufl_coordinate_element().basix_element
    nodes = tagged.mesh.geometry.x[cell_nodes(tagged.mesh)[0]]
    assert len(np.unique(nodes.round(9), axis=0)) == len(element.points)
    reference = np.column_stack((np.ones(len(nodes)), element.points))
    fit = np.linalg.lstsq(reference, nodes, rcond=None)[0]
    assert reference @ fit == pytest.approx(nodes, abs=1e-12)


@pytest.mark.parametrize("order", NodeOrder)
def test_ten_node_tetrahedron(order):
    corners = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
    points = placed(np.vstack((corners, middles(corners, TETRAHEDRON_EDGES[order]))))
    tagged = one_cell(points, cell="tetrahedron", degree=2, order=order)
    assert_affine(tagged)
    assert volume(tagged) == pytest.approx(abs(np.linalg.det(SIDES)) / 6, rel=1e-13)


def test_orders_of_the_tetrahedron_differ_where_it_matters():
    """The first test would pass with one order for all if the orders were not told apart."""
    corners = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
    points = placed(np.vstack((corners, middles(corners, TETRAHEDRON_EDGES[NodeOrder.GMSH]))))
    with pytest.raises(MeshError, match="inverted"):
        one_cell(points, order=NodeOrder.LEXICOGRAPHIC)


def test_eight_node_hexahedron_in_lexicographic_order():
    corners = [(i, j, k) for k, j, i in itertools.product((0, 1), repeat=3)]
    tagged = one_cell(placed(corners), cell="hexahedron", degree=1)
    assert_affine(tagged)
    assert volume(tagged) == pytest.approx(abs(np.linalg.det(SIDES)), rel=1e-13)


@pytest.mark.parametrize("order", [NodeOrder.VTK, NodeOrder.GMSH])
@pytest.mark.parametrize("degree", [1, 2])
def test_hexahedron_of_other_programs(order, degree):
    further = middles(HEXAHEDRON_CORNERS, HEXAHEDRON_NODES[order].split())
    reference = np.vstack((HEXAHEDRON_CORNERS, further)) if degree == 2 else HEXAHEDRON_CORNERS
    tagged = one_cell(placed(reference), cell="hexahedron", degree=degree, order=order)
    assert_affine(tagged)
    assert volume(tagged) == pytest.approx(abs(np.linalg.det(SIDES)), rel=1e-13)


def volume(tagged):
    one = fem.form(1.0 * ufl.dx(domain=tagged.mesh, degree=5))
    return tagged.comm.allreduce(fem.assemble_scalar(one))


def boxes(n):
    """Points and cells of n x 1 x 1 hexahedra on [0, n] x [0, 1] x [0, 1], x fastest."""
    points = np.array(
        [(i, j, k) for k in (0, 1) for j in (0, 1) for i in range(n + 1)], dtype=float
    )
    corner = np.array(
        [i + (n + 1) * (j + 2 * k) for k, j, i in itertools.product((0, 1), repeat=3)]
    )
    return points, corner + np.arange(n)[:, None]


GROUPS = {"left": lambda x: np.isclose(x[0], 0), "right": lambda x: np.isclose(x[0], 6)}


def six_boxes(comm=COMM, **changes):
    points, cells = boxes(6) if comm.rank == 0 else (None, None)
    how = {"cell": "hexahedron", "degree": 1, "facet_groups": GROUPS} | changes
    return from_arrays(comm, how.pop("points", points), how.pop("cells", cells), **how)


def test_groups_of_facets_by_predicate():
    tagged = six_boxes()
    assert tagged.facet_groups == {"left": 1, "right": 2}
    for name, x in (("left", 0.0), ("right", 6.0)):
        facets = tagged.facets(name)
        assert COMM.allreduce(len(facets)) == 1
        middle = dolfinx.mesh.compute_midpoints(tagged.mesh, 2, facets)
        assert middle.reshape(-1, 3) == pytest.approx(
            np.array([[x, 0.5, 0.5]] * len(facets)).reshape(-1, 3)
        )
    assert tagged.cell_groups == {}
    assert volume(tagged) == pytest.approx(6, rel=1e-13)


def test_an_unknown_group_lists_those_there_are():
    with pytest.raises(
        MeshError, match="no facet group 'top'; its facet groups are: 'left', 'right'"
    ):
        six_boxes().facets("top")
    with pytest.raises(MeshError, match="its facet groups are: none"):
        six_boxes(facet_groups={}).facets("top")


def test_fingerprint_does_not_depend_on_the_partition():
    assert six_boxes().fingerprint() == six_boxes(MPI.COMM_SELF).fingerprint()


def test_fingerprint_sees_a_moved_node_and_another_cell():
    points, cells = boxes(6)
    marks = {six_boxes(points=points, cells=cells).fingerprint()}
    moved = points.copy()
    moved[3, 1] = np.nextafter(moved[3, 1], 1)
    marks.add(six_boxes(points=moved, cells=cells).fingerprint())
    marks.add(six_boxes(points=points, cells=cells[:-1], facet_groups={}).fingerprint())
    assert len(marks) == 3
    # the order of the cells in the input is of no account
    assert six_boxes(points=points, cells=cells[::-1]).fingerprint() in marks


@pytest.mark.parametrize(
    ("changes", "pattern"),
    [
        ({"cell": "prism"}, r"no cell 'prism' of degree 1; there are: tetrahedron of degree 1"),
        ({"degree": 3}, "no cell 'hexahedron' of degree 3"),
        ({"degree": 2}, r"cells must be whole numbers of shape \(m, 27\)"),
        ({"points": np.zeros((4, 2))}, r"points must have shape \(n, 3\), got \(4, 2\)"),
        ({"points": np.full((28, 3), np.nan)}, "not finite"),
        ({"points": np.zeros((28, 3))}, "6 cells are inverted or flat"),
        ({"cells": np.zeros((1, 8))}, "cells must be whole numbers"),
        ({"cells": np.full((1, 8), 28)}, "rows of points, 0 to 27"),
        ({"cells": np.full((1, 8), -1)}, "rows of points"),
        ({"cells": np.zeros((0, 8), dtype=int)}, "at least one cell"),
        ({"facet_groups": {"top": lambda x: x[2] > 2}}, "'top': no boundary facet"),
        (
            {"facet_groups": GROUPS | {"all": lambda x: x[0] > -1}},
            "'(left|right)' and 'all' share facets",
        ),
        (
            {"facet_groups": {"top": lambda x: x[5] > 2}},
            "facet group 'top': its function raised IndexError: index 5 is out of bounds",
        ),
        (
            {"facet_groups": {"top": lambda x: x > 2}},
            r"'top': its function of points \(3, n\) must return n truth values, got bool \(3, ",
        ),
    ],
)
def test_bad_input_is_refused_on_all_ranks(changes, pattern):
    with pytest.raises(MeshError, match=pattern):
        six_boxes(**changes)
    assert COMM.allreduce(1) == COMM.size


def test_27_node_hexahedra_need_an_order():
    points = np.random.default_rng(1).uniform(size=(27, 3))
    with pytest.raises(MeshError, match=r"needs order=NodeOrder\.VTK"):
        one_cell(points, cell="hexahedron", degree=2)


def test_a_twisted_cell_is_found_among_good_ones():
    """Two vertices of one hexahedron exchanged; the place is named."""
    points, cells = boxes(6)
    cells[4, [0, 1]] = cells[4, [1, 0]]
    with pytest.raises(MeshError, match=r"1 cells are inverted.* row 4 of the input, near \[4\.5, 0\.5, 0\.5\]"):
        six_boxes(points=points, cells=cells, facet_groups={})


def test_a_curved_cell_that_folds_over_is_found():
    """All vertices are good; one middle node is pushed through the cell."""
    corners = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
    points = np.vstack((corners, middles(corners, TETRAHEDRON_EDGES[NodeOrder.LEXICOGRAPHIC])))
    points[4] = (0.8, 0.0, 0.0)
    with pytest.raises(MeshError, match="1 cells are inverted"):
        one_cell(points)


def test_left_handed_cells_are_fine():
    points = placed([(0, 0, 0), (0, 1, 0), (1, 0, 0), (0, 0, 1)])
    assert volume(one_cell(points, degree=1)) == pytest.approx(abs(np.linalg.det(SIDES)) / 6)


def test_arguments_of_one_rank_only():
    """Another cell, another group, or a function that fails on one rank: an error on all."""
    if COMM.size == 1:
        return
    last = COMM.rank == COMM.size - 1

    def fails_on_the_last(x):
        if last:
            raise ValueError("not here")
        return x[0] < 0.5

    for other, pattern in [
        ({"cell": "prism"}, "rank 0 was given cell='hexahedron', .* cell='prism'"),
        ({"degree": 2}, "degree=1, .* degree=2, "),
        ({"facet_groups": {"left": GROUPS["left"]}}, r"groups \[\['left', 'right'\]"),
    ]:
        with pytest.raises(MeshError, match=pattern):
            six_boxes(**(other if last else {}))
    with pytest.raises(MeshError, match="'odd': its function raised ValueError: not here"):
        six_boxes(facet_groups={"odd": fails_on_the_last})
    assert COMM.allreduce(1) == COMM.size
