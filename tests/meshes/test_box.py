"""Block and beam: the same box, in a regular grid and by a cell size."""

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from measures import area, extents, n_cells, n_nodes, n_owned, nodes_of, total, volume

from flexmbd import meshes
from flexmbd.errors import MeshError

pytestmark = pytest.mark.mpi

COMM = MPI.COMM_WORLD
SIZES = (0.6, 0.2, 0.1)
FACES = {"x_min": 0.02, "x_max": 0.02, "y_min": 0.06, "y_max": 0.06, "z_min": 0.12, "z_max": 0.12}
CORNERS = np.array([[0, -0.1, -0.05], [0.6, 0.1, 0.05]])


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize(("cell", "in_each"), [("hexahedron", 1), ("tetrahedron", 6)])
def test_block(cell, in_each, degree):
    block = meshes.block(*SIZES, divisions=(4, 3, 2), cell=cell, degree=degree)
    assert block.mesh.topology.cell_name() == cell
    assert n_cells(block) == 24 * in_each
    assert n_nodes(block) == np.prod([degree * n + 1 for n in (4, 3, 2)])
    assert volume(block) == pytest.approx(0.012, rel=1e-13)
    assert extents(block) == pytest.approx(CORNERS, abs=1e-15)
    assert block.facet_groups.keys() == FACES.keys()
    for axis, name in zip([0, 0, 1, 1, 2, 2], FACES, strict=True):
        assert area(block, name) == pytest.approx(FACES[name], rel=1e-13)
        place = CORNERS[0 if name.endswith("min") else 1][axis]
        assert nodes_of(block, name)[:, axis] == pytest.approx(place, abs=1e-15)
    assert block.cell_groups.keys() == {"block"}
    assert set(block.cell_tags.values) <= {block.cell_groups["block"]}


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize(("cell", "in_each"), [("hexahedron", 1), ("tetrahedron", 6)])
def test_block_in_layers(cell, in_each, degree):
    """Three layers share nodes, and each is a cell group of the volume and at the place it should."""
    names = ("foot", "rubber", "head")
    block = meshes.block(*SIZES, divisions=(4, 3, 6), layers=names, cell=cell, degree=degree)
    assert n_nodes(block) == np.prod([degree * n + 1 for n in (4, 3, 6)])
    assert block.cell_groups.keys() == set(names)
    for axis, name in zip([0, 0, 1, 1, 2, 2], FACES, strict=True):
        assert area(block, name) == pytest.approx(FACES[name], rel=1e-13)
        place = CORNERS[0 if name.endswith("min") else 1][axis]
        assert nodes_of(block, name)[:, axis] == pytest.approx(place, abs=1e-15)
    dx = ufl.Measure("dx", domain=block.mesh, subdomain_data=block.cell_tags)
    z = ufl.SpatialCoordinate(block.mesh)[2]
    for i, name in enumerate(names):
        part = dx(block.cell_groups[name], metadata={"quadrature_degree": 6})
        assert total(block, 1.0 * part) == pytest.approx(0.004, rel=1e-13)
        assert total(block, z * part) == pytest.approx(0.004 * (i - 1) / 30, abs=1e-16)
        assert n_owned(block, 3, block.cells(name)) == 24 * in_each


def test_numbers_may_be_numpys():
    plain = meshes.block(0.5, 0.25, 0.25, divisions=(2, 1, 1))
    sizes, divisions = np.array([0.5, 0.25, 0.25], dtype=np.float32), tuple(np.array([2, 1, 1]))
    assert meshes.block(*sizes, divisions=divisions).fingerprint() == plain.fingerprint()


def test_block_of_the_calculix_reference():
    """Its nodes are the regular grid of 11 x 3 x 3."""
    block = meshes.block(1.0, 0.1, 0.1, divisions=(10, 2, 2), comm=MPI.COMM_SELF)
    grid = np.stack(
        np.meshgrid(np.linspace(0, 1, 11), [-0.05, 0, 0.05], [-0.05, 0, 0.05], indexing="ij"),
        axis=-1,
    ).reshape(-1, 3)
    nodes = block.mesh.geometry.x
    distance = np.linalg.norm(nodes[:, None] - grid[None], axis=2)
    assert nodes.shape == grid.shape
    assert distance.min(axis=0).max() < 1e-15
    assert n_cells(block) == 40


def test_beam_of_tetrahedra():
    beam = meshes.beam(*SIZES, h=0.05)
    assert volume(beam) == pytest.approx(0.012, rel=1e-13)
    assert extents(beam) == pytest.approx(CORNERS, abs=1e-15)
    assert beam.facet_groups.keys() == {"start", "end", "side"}
    assert area(beam, "start") == pytest.approx(0.02, rel=1e-13)
    assert area(beam, "end") == pytest.approx(0.02, rel=1e-13)
    assert area(beam, "side") == pytest.approx(0.36, rel=1e-13)
    assert nodes_of(beam, "start")[:, 0] == pytest.approx(0.0, abs=1e-15)
    assert nodes_of(beam, "end")[:, 0] == pytest.approx(0.6, abs=1e-15)
    assert beam.cell_groups.keys() == {"beam"}


def test_size_of_cells_is_followed():
    """The mean volume of a cell is near that of a regular tetrahedron of edge h."""
    for h in (0.06, 0.03):
        beam = meshes.beam(*SIZES, h=h, degree=1)
        assert 0.4 < 0.012 / n_cells(beam) / (h**3 / (6 * np.sqrt(2))) < 1.6


def test_beam_of_hexahedra_has_edges_up_to_h():
    beam = meshes.beam(*SIZES, h=0.1, cell="hexahedron", degree=1)
    assert n_cells(beam) == 6 * 2 * 1
    assert n_cells(meshes.beam(*SIZES, h=0.099, cell="hexahedron", degree=1)) == 7 * 3 * 2
    assert volume(beam) == pytest.approx(0.012, rel=1e-13)
    assert area(beam, "side") == pytest.approx(0.36, rel=1e-13)


def test_a_mesh_is_the_same_each_time_and_on_any_number_of_ranks():
    mark = meshes.beam(*SIZES, h=0.05).fingerprint()
    assert meshes.beam(*SIZES, h=0.05, comm=MPI.COMM_SELF).fingerprint() == mark
    assert meshes.beam(*SIZES, h=0.04).fingerprint() != mark


@pytest.mark.parametrize("bad", [0.0, -1.0, float("nan"), float("inf"), "1", None])
@pytest.mark.parametrize("place", range(4))
def test_bad_sizes_are_named(bad, place):
    name = ("length", "width", "height", "h")[place]
    sizes = [*SIZES, 0.05]
    sizes[place] = bad
    with pytest.raises(MeshError, match=f"^{name} must be a positive"):
        meshes.beam(*sizes[:3], h=sizes[3])
    if name != "h":
        with pytest.raises(MeshError, match=f"^{name} must be a positive"):
            meshes.block(*sizes[:3], divisions=(1, 1, 1))


@pytest.mark.parametrize(
    ("bad", "pattern"),
    [
        ({"divisions": (1, 2)}, r"divisions must be three .* got \(1, 2\)"),
        ({"divisions": (1, 2, 0)}, "divisions must be three positive"),
        ({"divisions": (1, 2, 2.5)}, "divisions must be three positive whole numbers"),
        ({"cell": "prism"}, "cell must be .* got 'prism'"),
        ({"layers": "steel"}, r"layers must be a list of names, .* got 'steel'"),
        ({"layers": ()}, r"layers must be at least one name"),
        ({"layers": ("a", "a")}, "no two alike"),
        ({"layers": ("a", "b")}, "along z must be a multiple of the 2 layers, got 1"),
        ({"degree": 3}, "degree of the geometry must be 1 or 2, got 3"),
    ],
)
def test_other_bad_arguments_are_named(bad, pattern):
    with pytest.raises(MeshError, match=pattern):
        meshes.block(*SIZES, **{"divisions": (1, 1, 1)} | bad)
    if not {"divisions", "layers"} & bad.keys():
        with pytest.raises(MeshError, match=pattern):
            meshes.beam(*SIZES, h=0.1, **bad)
