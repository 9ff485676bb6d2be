"""Lines and surfaces in space, for beams and shells."""

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from measures import extents, n_cells, n_nodes, n_owned, nodes_of, nodes_of_entities, total, volume

from flexmbd import meshes
from flexmbd.continuum.grid.node_order import NodeOrder
from flexmbd.continuum.grid.tagged_mesh import from_arrays
from flexmbd.errors import MeshError

pytestmark = pytest.mark.mpi

COMM = MPI.COMM_WORLD


@pytest.mark.parametrize("degree", [1, 2])
def test_line(degree):
    line = meshes.line(3.0, divisions=7, degree=degree)
    assert (line.dim, line.mesh.geometry.dim) == (1, 3)
    assert (n_cells(line), n_nodes(line)) == (7, 7 * degree + 1)
    assert volume(line) == pytest.approx(3.0, rel=1e-14)
    moment = total(line, ufl.SpatialCoordinate(line.mesh)[0] * ufl.dx(domain=line.mesh, degree=4))
    assert moment == pytest.approx(4.5, rel=1e-14)
    assert line.facet_groups.keys() == {"start", "end"}
    for name, x in (("start", 0.0), ("end", 3.0)):
        assert np.array_equal(line.facets(name), line.vertices(name))
        assert n_owned(line, 0, line.facets(name)) == 1
        found = nodes_of(line, name)
        assert found == pytest.approx(np.array([[x, 0, 0]] * len(found)).reshape(-1, 3), abs=1e-15)
    assert n_owned(line, 1, line.cells("line")) == 7
    assert line.fingerprint() == meshes.line(3.0, divisions=7, degree=degree).fingerprint()
    if COMM.rank == 0:
        alone = meshes.line(3.0, divisions=7, degree=degree, comm=MPI.COMM_SELF)
        assert len(alone.facets("end")) == 1


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize(("cell", "in_each"), [("quadrilateral", 1), ("triangle", 2)])
def test_sheet(cell, in_each, degree):
    sheet = meshes.sheet(0.6, 0.2, divisions=(5, 3), cell=cell, degree=degree)
    assert (sheet.dim, sheet.mesh.geometry.dim) == (2, 3)
    assert sheet.mesh.topology.cell_name() == cell
    assert n_cells(sheet) == 15 * in_each
    assert n_nodes(sheet) == (5 * degree + 1) * (3 * degree + 1)
    assert volume(sheet) == pytest.approx(0.12, rel=1e-14)
    assert extents(sheet) == pytest.approx(np.array([[0, -0.1, 0], [0.6, 0.1, 0]]), abs=1e-15)
    sides = {"x_min": (0, 0.0), "x_max": (0, 0.6), "y_min": (1, -0.1), "y_max": (1, 0.1)}
    assert sheet.facet_groups.keys() == sides.keys()
    for name, (axis, place) in sides.items():
        assert n_owned(sheet, 1, sheet.edges(name)) == (3, 5)[axis]
        assert nodes_of(sheet, name)[:, axis] == pytest.approx(place, abs=1e-15)
    assert len(sheet.vertex_groups) == 4
    for name in sheet.vertex_groups:
        assert n_owned(sheet, 0, sheet.vertices(name)) == 1
        for x in nodes_of_entities(sheet, 0, sheet.vertices(name)):
            for side in name.split():
                assert x[sides[side][0]] == pytest.approx(sides[side][1], abs=1e-15)


@pytest.mark.parametrize(
    ("call", "pattern"),
    [
        (lambda: meshes.line(-1.0, divisions=2), "length must be a positive"),
        (lambda: meshes.line(1.0, divisions=0), "divisions must be a positive whole number, got 0"),
        (lambda: meshes.line(1.0, divisions=2, degree=3), "degree of the geometry"),
        (lambda: meshes.sheet(1.0, 0.0, divisions=(1, 1)), "width must be a positive"),
        (lambda: meshes.sheet(1.0, 1.0, divisions=(1, 1, 1)), "divisions must be two positive"),
        (
            lambda: meshes.sheet(1.0, 1.0, divisions=(1, 1), cell="tetrahedron"),
            'cell must be "triangle" or "quadrilateral", got \'tetrahedron\'',
        ),
    ],
)
def test_bad_arguments(call, pattern):
    with pytest.raises(MeshError, match=pattern):
        call()


@pytest.mark.parametrize(
    ("call", "pattern"),
    [
        (
            lambda rank: meshes.line(1.0 + rank, divisions=2),
            r"length is 1\.0 on rank 0 and 2\.0 on rank 1; give the same on all ranks",
        ),
        (lambda rank: meshes.line(1.0, divisions=2 - 4 * rank), "divisions is 2 on rank 0 and -2"),
        (
            lambda rank: meshes.sheet(1.0, 1.0, divisions=(1, 1 + rank)),
            r"divisions is \(1, 1\) on rank 0 and \(1, 2\) on rank 1",
        ),
    ],
)
def test_arguments_of_one_rank_only(call, pattern):
    if COMM.size == 1:
        call(0)
        return
    with pytest.raises(MeshError, match=pattern):
        call(COMM.rank)
    assert COMM.allreduce(1) == COMM.size


def arc(n, *, turn=np.pi / 2):
    """Points of n quadratic lines on a circle of radius 2, and the lines: ends, then middle."""
    angle = np.linspace(0, turn, 2 * n + 1)
    points = np.column_stack((2 * np.cos(angle), 2 * np.sin(angle), 0 * angle))
    cells = 2 * np.arange(n)[:, None] + [0, 2, 1]
    return points, cells


def test_curved_line_from_arrays():
    points, cells = arc(6)
    line = from_arrays(COMM, points, cells, cell="interval", degree=2, facet_groups={})
    assert volume(line) == pytest.approx(np.pi, rel=1e-5)


@pytest.mark.parametrize("order", NodeOrder)
def test_six_node_triangles_from_arrays(order):
    """With the middles of the edges in another order the cell would fold over."""
    corners = np.array([(1.0, 0, 0), (3, 1, 2), (0, 2, 1)])
    edges = {NodeOrder.LEXICOGRAPHIC: ["01", "02", "12"]}.get(order, ["01", "12", "02"])
    middles = [(corners[int(a)] + corners[int(b)]) / 2 for a, b in edges]
    how = {"cell": "triangle", "degree": 2, "order": order, "facet_groups": {}}
    face = from_arrays(COMM, np.vstack((corners, middles)), [range(6)], **how)
    doubled = np.linalg.norm(np.cross(corners[1] - corners[0], corners[2] - corners[0]))
    assert volume(face) == pytest.approx(doubled / 2, rel=1e-14)
    with pytest.raises(MeshError, match="1 cells are inverted"):
        from_arrays(COMM, np.vstack((corners, middles[1::-1], middles[2:])), [range(6)], **how)


@pytest.mark.parametrize(
    ("cell", "points"),
    [
        ("interval", [(0, 0, 0), (1, 0, 0), (1.2, 0, 0)]),  # the middle beyond the end
        ("triangle", [(0, 0, 0), (1, 0, 0), (0, 1, 0), (-0.3, -0.3, 0), (0, 0.5, 0), (0.5, 0, 0)]),
    ],
)
def test_cells_that_fold_over(cell, points):
    with pytest.raises(MeshError, match="1 cells are inverted"):
        from_arrays(
            MPI.COMM_SELF, points, [range(len(points))], cell=cell, degree=2, facet_groups={}
        )


def test_flat_surfaces_and_points_on_each_other():
    flat = [(0, 0, 0), (1, 0, 0), (2, 0, 0)]
    with pytest.raises(MeshError, match="1 cells are inverted or flat"):
        from_arrays(MPI.COMM_SELF, flat, [range(3)], cell="triangle", degree=1, facet_groups={})
    with pytest.raises(MeshError, match="1 cells are inverted or flat"):
        from_arrays(
            MPI.COMM_SELF, [flat[0]] * 2, [range(2)], cell="interval", degree=1, facet_groups={}
        )
