"""Cutting a mesh: what the pieces hold, that their sides fit, and that no partition matters."""

from mpi4py import MPI

import numpy as np
import pytest

import flexmbd as fm
from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface, cut_mesh
from flexmbd.continuum.compat import cell_nodes
from flexmbd.continuum.grid import cell_graph
from flexmbd.continuum.grid.mesh_input import entity_vertices
from flexmbd.continuum.grid.tagged_mesh import from_arrays
from flexmbd.errors import MeshError, SceneError
from flexmbd.forms import solid_linear

COMM = MPI.COMM_WORLD
pytestmark = pytest.mark.mpi

STEEL = solid_linear.Parameters(E=2.1e11, nu=0.3, rho=7850.0)
LENGTH, SIDE = 0.3, 0.02
MIDDLE = fm.Slab((1.0, 0.0, 0.0), 0.1, 0.2)


def n_cells(part):
    return part.mesh.topology.index_map(part.dim).size_global


def volume(part):
    """Exact for straight tetrahedra."""
    mesh = part.mesh
    own = cell_nodes(mesh)[: mesh.topology.index_map(3).size_local, :4]
    x = mesh.geometry.x[own]
    return part.comm.allreduce(abs(np.linalg.det(x[:, 1:] - x[:, :1])).sum() / 6.0)


def face(part, name):
    """Coordinates of the vertices of a facet group's facets, sorted, of all ranks: (f, v, 3) as bytes."""
    mesh, dim = part.mesh, part.dim - 1
    mesh.topology.create_connectivity(dim, 0)
    mine = part.facets(name)
    mine = mine[mine < mesh.topology.index_map(dim).size_local]
    rows = entity_vertices(mesh, dim)[mine]
    place = {int(row): x for row, x in zip(mesh.geometry.input_global_indices, mesh.geometry.x, strict=True)}
    facets = [b"".join(sorted(place[int(row)].tobytes() for row in facet)) for facet in rows]
    return sorted(facet for share in part.comm.allgather(facets) for facet in share)


def layered(comm=COMM):
    """Bricks in three layers along z, five of them in each."""
    return meshes.block(0.02, 0.02, 0.3, divisions=(1, 1, 15), layers=("low", "middle", "high"), degree=2, comm=comm)


def test_layers():
    """By a group of cells: counts, groups kept and left out, names, faces that fit."""
    whole = layered()
    cut = cut_mesh(whole, {"hinge": "middle"})
    assert list(cut.pieces) == ["rest 1", "hinge", "rest 2"]
    assert (cut.yielding, cut.elastic, cut.fragments) == (("hinge",), ("rest 1", "rest 2"), 0)
    assert [n_cells(piece) for piece in cut.pieces.values()] == [5, 5, 5]
    assert [list(piece.cell_groups) for piece in cut.pieces.values()] == [["low"], ["middle"], ["high"]]
    sides = {"x_min", "x_max", "y_min", "y_max"}
    assert set(cut.pieces["rest 1"].facet_groups) == sides | {"z_min", "rest 1/hinge"}
    assert set(cut.pieces["hinge"].facet_groups) == sides | {"rest 1/hinge", "hinge/rest 2"}
    assert set(cut.pieces["rest 2"].facet_groups) == sides | {"z_max", "hinge/rest 2"}
    for one, z in zip(cut.cuts, (-0.05, 0.05), strict=True):
        assert (one.facets, one.area) == (1, pytest.approx(4e-4))
        assert one.p == pytest.approx((0.01, 0.0, z), abs=1e-15)
        low, high = (face(cut.pieces[name], one.name) for name in one.pieces)
        assert low == high
        assert len(low) == one.facets
        assert len(low) == 1
    for name, piece in cut.pieces.items():
        outer = sorted(facet for group in sides & set(piece.facet_groups) for facet in face(piece, group))
        assert len(outer) == 20, name
    together = [facet for piece in cut.pieces.values() for facet in face(piece, "x_min")]
    assert sorted(together) == face(whole, "x_min")
    nodes = {name: piece.mesh.geometry.index_map().size_global for name, piece in cut.pieces.items()}
    assert nodes == dict.fromkeys(cut.pieces, 9 * 11)


def test_explain():
    text = cut_mesh(layered(), {"hinge": "middle"}).explain().splitlines()
    assert text[0] == "3 pieces, 2 cuts"
    assert text[2] == "  hinge         may yield  5 cells, x 0 to 0.02, y -0.01 to 0.01, z -0.05 to 0.05 m"
    assert text[3] == "  rest 2        elastic    5 cells, x 0 to 0.02, y -0.01 to 0.01, z 0.05 to 0.15 m"
    assert text[4] == "  rest 1/hinge  cut        1 facets, 0.0004 m^2 around (0.01, 0, -0.05) m"
    assert len(text) == 6


def test_free_tetrahedra():
    """A plane through a free mesh: nothing is lost, both sides have the same face, loose cells went to neighbours."""
    whole = meshes.beam(LENGTH, SIDE, SIDE, h=SIDE / 3.0, degree=1)
    cut = cut_mesh(whole, {"hinge": MIDDLE})
    assert sum(n_cells(piece) for piece in cut.pieces.values()) == n_cells(whole)
    volumes = [volume(piece) for piece in cut.pieces.values()]
    assert sum(volumes) == pytest.approx(LENGTH * SIDE**2, rel=1e-12)
    np.testing.assert_allclose(volumes, LENGTH * SIDE**2 / 3.0, rtol=0.05)
    for one in cut.cuts:
        low, high = (face(cut.pieces[name], one.name) for name in one.pieces)
        assert low == high
        assert len(low) == one.facets
        assert one.area > SIDE**2
    # and each is a body with a frame at its cuts
    model = ContinuumModel(cut.pieces["hinge"], solid_linear, STEEL, degree=1, interfaces=cut.interfaces("hinge"))
    assert [one.name for one in model.interfaces] == ["rest 1/hinge", "hinge/rest 2"]
    np.testing.assert_array_equal([one.p for one in model.interfaces], [one.p for one in cut.cuts])


@pytest.mark.parametrize("kind", ["layers", "free"])
def test_partition_does_not_matter(kind):
    found = []
    for comm in (MPI.COMM_SELF, COMM):
        mesh = layered(comm) if kind == "layers" else meshes.beam(LENGTH, SIDE, SIDE, h=SIDE, comm=comm)
        cut = cut_mesh(mesh, {"hinge": "middle" if kind == "layers" else MIDDLE})
        marks = [piece.fingerprint() for piece in cut.pieces.values()]
        groups = [
            {name: face(piece, name) for name in piece.facet_groups} for piece in cut.pieces.values()
        ]
        found.append((marks, groups, cut.cuts, cut.summaries))
    assert found[0] == found[1]


def test_two_cuts_between_two_pieces():
    """Half a tube: it meets the other half at two faces, each with a name of its own."""
    tube = meshes.tube(0.1, 0.03, 0.02, h=0.01, cell="hexahedron", degree=1)
    cut = cut_mesh(tube, {"upper": lambda x: x[2] > 0.0})
    names = [one.name for one in cut.cuts]
    assert sorted(names) == sorted({"/".join(cut.pieces), "/".join(cut.pieces) + " (2)"})
    y = sorted(one.p[1] for one in cut.cuts)
    np.testing.assert_allclose(y, [-0.025, 0.025], rtol=1e-3)
    for one in cut.cuts:
        assert one.area == pytest.approx(0.1 * 0.01, rel=1e-6)
        low, high = (face(cut.pieces[name], one.name) for name in one.pieces)
        assert low == high
        assert len(low) == one.facets


def test_edges_and_vertices_go_with_their_pieces():
    bricks = meshes.block(0.3, 0.02, 0.02, divisions=(3, 1, 1), comm=MPI.COMM_SELF)
    points, cells = bricks.mesh.geometry.x, cell_nodes(bricks.mesh)
    part = from_arrays(
        COMM,
        points,
        cells,
        cell="hexahedron",
        degree=1,
        facet_groups={"end": lambda x: x[0] > 0.29},
        edge_groups={
            "line": lambda x: (x[1] > 0.009) & (x[2] > 0.009),
            "rim": lambda x: (x[0] < 0.01) & (x[1] > 0.009),
        },
        vertex_groups={"tips": lambda x: (abs(x[0] - 0.15) > 0.1) & (x[1] < 0.0) & (x[2] < 0.0)},
    )
    cut = cut_mesh(part, {"hinge": MIDDLE})
    assert [set(piece.edge_groups) for piece in cut.pieces.values()] == [{"line", "rim"}, {"line"}, {"line"}]
    assert [set(piece.vertex_groups) for piece in cut.pieces.values()] == [{"tips"}, set(), {"tips"}]
    assert ["end" in piece.facet_groups for piece in cut.pieces.values()] == [False, False, True]
    for piece in cut.pieces.values():
        mine = piece.edges("line")
        owned = mine[mine < piece.mesh.topology.index_map(1).size_local]
        assert COMM.allreduce(len(owned)) == 1


def test_several_regions_that_touch():
    cut = cut_mesh(layered(), {"a": "low", "b": ["middle"]})
    assert list(cut.pieces) == ["a", "b", "rest 1"]
    assert [one.name for one in cut.cuts] == ["a/b", "b/rest 1"]
    assert cut.yielding == ("a", "b")


def test_loose_cells_go_to_the_neighbour_they_share_most_with():
    """A row of 200 cells with one on the wrong side, and with seven, which tetrahedra of two bricks are more."""
    n = 200
    pairs = cell_graph.Neighbours(np.arange(n - 1), np.arange(1, n), np.zeros((n - 1, 4), dtype=np.int64))
    labels = np.where(np.arange(n) < 100, 1, 0)
    wrong = labels.copy()
    wrong[140] = 1
    np.testing.assert_array_equal(cell_graph.merge_fragments(wrong, pairs, "hexahedron"), labels)
    wrong[138:145] = 1
    np.testing.assert_array_equal(cell_graph.merge_fragments(wrong, pairs, "hexahedron"), wrong)
    np.testing.assert_array_equal(cell_graph.merge_fragments(wrong, pairs, "tetrahedron"), labels)


@pytest.mark.parametrize(
    ("regions", "message"),
    [
        ({}, "needs a region"),
        ({"hinge": lambda x: x[2] > 9.0}, "no cell has its centre in the region"),
        ({"hinge": lambda x: x[2] < 9.0}, "is all of the mesh"),
        ({"hinge": "centre"}, "no cell group 'centre'; it has: 'high', 'low', 'middle'"),
        ({"hinge": ["low", "high"]}, "falls into 2 pieces of 5, 5 cells"),
        ({"a": "low", "b": lambda x: x[2] < 0.0}, "regions 'a' and 'b' have 5 cells in common"),
        ({"hinge": lambda x: x[2]}, "must return n truth values, got float64"),
        ({"hinge": lambda x: x[7] > 0.0}, "its function raised IndexError"),
        ({"rest 1": "middle"}, "whose names cuts and remainders get"),
    ],
)
def test_bad_regions(regions, message):
    with pytest.raises(MeshError, match=message):
        cut_mesh(layered(), regions)


def test_bad_names():
    cut = cut_mesh(layered(), {"hinge": "middle"})
    with pytest.raises(MeshError, match="no piece 'arm'; there are: 'rest 1', 'hinge', 'rest 2'"):
        cut.interfaces("arm")
    with pytest.raises(SceneError, match="axis must be three finite numbers"):
        fm.Slab((0.0, 0.0, 0.0), 0.0, 1.0)
    with pytest.raises(SceneError, match="end must lie after its start"):
        fm.Slab((1.0, 0.0, 0.0), 1.0, 1.0)
    if COMM.size > 1:
        with pytest.raises(MeshError, match="regions is"):
            cut_mesh(layered(), {f"hinge {COMM.rank}": "middle"})


def test_interfaces_lie_on_outer_faces_too():
    """A frame at a group of the whole part goes on with the piece that has it."""
    cut = cut_mesh(layered(), {"hinge": "middle"})
    frames = [Interface("z_min"), *cut.interfaces("rest 1", coupling=fm.Coupling.AVERAGED)]
    model = ContinuumModel(cut.pieces["rest 1"], solid_linear, STEEL, degree=2, interfaces=frames)
    assert model.interface("z_min").p == pytest.approx((0.01, 0.0, -0.15), abs=1e-12)
