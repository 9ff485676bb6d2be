"""Curved cells that follow fillets and bores: valid at any size, told where they are straighter, and measured."""

import warnings

from mpi4py import MPI

import gmsh
import lattice
import numpy as np
import pytest
import step_shapes
from measures import moments, n_cells, n_owned, volume

from flexmbd import meshes
from flexmbd.continuum.compat import cell_nodes
from flexmbd.errors import MeshError, MeshWarning
from flexmbd.meshes import session
from flexmbd.meshes.untangle import LEAST, scaled_jacobians, untangle

pytestmark = pytest.mark.mpi

COMM = MPI.COMM_WORLD
FILLET, HUB, BORE = step_shapes.FILLET, step_shapes.HUB, step_shapes.BORE

# Of the fillet the area of its section, and its moment about the hub's wall, by Pappus.
SECTION, MOMENT = FILLET**2 * (1 - np.pi / 4), FILLET**3 * (5 / 6 - np.pi / 4)
VOLUME = 1e-9 * (
    90 * 60 * 12
    + np.pi * HUB**2 * 28
    - np.pi * BORE**2 * 40
    - 2 * np.pi * 4**2 * 12
    + 2 * np.pi * (HUB * SECTION + MOMENT)
)
TAGS = {
    "bore": lambda face: face.radius is not None and abs(face.radius - BORE * 1e-3) < 1e-5,
    "foot": lambda face: face.radius is None and abs(face.centre[2]) < 1e-7,
}


@pytest.fixture(scope="module")
def hub(tmp_path_factory):
    path = COMM.bcast(tmp_path_factory.mktemp("hub") / "hub.step" if COMM.rank == 0 else None)
    if COMM.rank == 0:
        step_shapes.write(path, step_shapes.add_hub)
    COMM.barrier()
    return path


@pytest.mark.parametrize("h", [0.02, 0.015, 0.012, 0.01, 0.008, 0.0065, 0.0055, 0.005])
def test_a_fillet_at_any_size(hub, h):
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always", MeshWarning)
        part = meshes.from_step(hub, tags=TAGS, h=h)
    texts = [str(one.message) for one in told if issubclass(one.category, MeshWarning)]
    found = meshes.quality(part)
    assert found.scaled_jacobian >= LEAST
    assert found.cells == n_cells(part)
    straighter = int(texts[0].split("hub.step: ")[1].split(" of ")[0]) if texts else 0
    assert straighter <= 0.01 * found.cells
    # the error of curved cells that follow an arc of angle 2 a / n is some a^4
    assert volume(part) == pytest.approx(VOLUME, rel=2e-3)


def test_the_same_cells_on_any_number_of_ranks(hub):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MeshWarning)
        whole = meshes.from_step(hub, tags=TAGS, h=0.012)
        alone = meshes.from_step(hub, tags=TAGS, h=0.012, comm=MPI.COMM_SELF)
    assert whole.fingerprint() == alone.fingerprint()


def test_sizes_that_follow_the_curvature(hub):
    """Nothing is to be made straighter, and the volume is nearer."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", MeshWarning)
        part = meshes.from_step(hub, tags=TAGS, h=0.02, curvature=12)
    assert meshes.quality(part).scaled_jacobian >= LEAST
    assert volume(part) == pytest.approx(VOLUME, rel=1e-4)
    with pytest.raises(MeshError, match="curvature must be a positive whole number, got 0"):
        meshes.from_step(hub, tags=TAGS, h=0.02, curvature=0)


def test_scaled_jacobians_are_gmshs(hub):
    """gmsh bounds them by Bernstein's polynomials; in 84 points of a cell they are the same but for a little."""
    if COMM.rank > 0:
        return
    with session.model():
        gmsh.model.occ.importShapes(str(hub))
        gmsh.model.occ.synchronize()
        gmsh.model.addPhysicalGroup(2, [tag for _, tag in gmsh.model.getEntities(2)], name="all")
        session.generate(h=0.012, degree=2)
        share = session.model_input(3)
        theirs = gmsh.model.mesh.getElementQualities(share.cell_numbers, "minSJ")
    ours = scaled_jacobians(share.points, share.cells)
    assert ours.min() < 0  # what gmsh leaves
    assert ours == pytest.approx(theirs, abs=0.05)
    done, how = untangle(share)
    assert scaled_jacobians(done.points, done.cells).min() >= LEAST
    assert how.left == how.inverted == 0
    moved = np.flatnonzero((done.points != share.points).any(axis=1))
    assert not np.isin(moved, share.cells[:, :4]).any()  # corners stay


def test_quality_of_known_cells():
    cubes = meshes.block(2.0, 1.0, 1.0, divisions=(2, 1, 1))
    assert meshes.quality(cubes).shape == pytest.approx(1.0, rel=1e-14)
    assert meshes.quality(cubes).scaled_jacobian == pytest.approx(1.0, rel=1e-14)
    corners = np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
    middles = [(corners[a] + corners[b]) / 2 for a, b in ((0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3))]

    def tetrahedron(points):
        cells = np.array([range(10)])
        groups = {"all": lambda x: x[0] > -9}
        return meshes.from_arrays(
            MPI.COMM_SELF, points=points, cells=cells, cell="tetrahedron", degree=2, facet_groups=groups,
            order=meshes.NodeOrder.LEXICOGRAPHIC,
        )  # fmt: skip

    regular = meshes.quality(tetrahedron(np.vstack((corners, middles))))
    assert regular.shape == pytest.approx(1.0, rel=1e-12)
    assert regular.scaled_jacobian == pytest.approx(1.0, rel=1e-12)
    # the middle of the edge 01 moved along it by a part t of its length: the determinant at 1 is 1 - 4 t
    bent = np.vstack((corners, middles))
    bent[4] += 0.15 * (corners[1] - corners[0])
    found = meshes.quality(tetrahedron(bent))
    assert found.scaled_jacobian == pytest.approx(0.4, rel=1e-12)
    assert str(found).startswith("1 tetrahedra of degree 2: least scaled Jacobian 0.4, least shape 1 near (")
    with pytest.raises(MeshError, match="not of cells of the kind quadrilateral"):
        meshes.quality(meshes.sheet(1.0, 1.0, divisions=(1, 1)))


MESHES = [
    ("prism", 1, False, 4.1), ("prism", 2, False, 2.2), ("prism", 2, True, 4.1), ("hexahedron", 2, True, 2.2),
    ("pyramid", 1, False, 2.2), ("pyramid", 2, False, 4.1), ("pyramid", 2, True, 2.2),
]  # fmt: skip


@pytest.mark.parametrize(("cell", "degree", "incomplete", "version"), MESHES)
def test_cells_as_gmsh_makes_them(shared_path, cell, degree, incomplete, version):
    """A bent part of wedges, of hexahedra of 20 nodes, and of hexahedra, pyramids and tetrahedra: nothing is lost."""
    path = shared_path / "part.msh"
    if COMM.rank == 0:
        gmsh.initialize([], readConfigFiles=False, interruptible=False)
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("Mesh.MshFileVersion", version)
        gmsh.option.setNumber("Mesh.SecondOrderIncomplete", incomplete)
        add_boxes(cell)
        gmsh.model.mesh.setOrder(degree)
        numbers, x, _ = gmsh.model.mesh.getNodes()
        bend = lattice.bend if degree == 2 else lattice.shear
        for number, place in zip(numbers, bend(x.reshape(-1, 3)), strict=True):
            gmsh.model.mesh.setNode(number, place, [])
        gmsh.write(str(path))
        gmsh.finalize()
    COMM.barrier()
    part = meshes.read(path, tetrahedra=cell != "hexahedron")
    bend = lattice.bend if degree == 2 else lattice.shear
    assert moments(part) == pytest.approx(lattice.moments(bend), rel=1e-9, abs=1e-9)
    assert set(part.facet_groups) == {"end"}
    assert set(part.cell_groups) == {"left", "right"}
    assert n_owned(part, 0, part.vertices("tip")) == 1
    x = part.mesh.geometry.x[cell_nodes(part.mesh)[part.cells("left")]]
    undone = np.linalg.inv(lattice.shear(np.eye(3)))
    if degree == 1:
        assert (x @ undone)[..., 0].max(initial=0.0) < 1 + 1e-9
    if cell != "hexahedron":
        with pytest.raises(MeshError, match=r"all must be of one of these: .* tetrahedra=True cuts all into"):
            meshes.read(path)


def add_boxes(cell):
    """Two unit cubes along x with named groups, of which the left is of hexahedra or wedges."""
    geometry = gmsh.model.occ
    geometry.addPoint(0, 0, 0)
    square = geometry.addRectangle(0, 0, 0, 1, 1)
    if cell == "pyramid":
        left = geometry.addBox(0, 0, 0, 1, 1, 1)
        right = geometry.addBox(1, 0, 0, 1, 1, 1)
        geometry.remove([(2, square)], recursive=True)
        geometry.fragment([(3, left)], [(3, right)])
        geometry.synchronize()
        for _, curve in gmsh.model.getEntities(1):
            gmsh.model.mesh.setTransfiniteCurve(curve, 3)
        for _, surface in gmsh.model.getBoundary([(3, left)], oriented=False):
            gmsh.model.mesh.setTransfiniteSurface(surface)
            gmsh.model.mesh.setRecombine(2, surface)
        gmsh.model.mesh.setTransfiniteVolume(left)
        gmsh.model.mesh.setRecombine(3, left)
        volumes = [left, right]
    else:
        other = geometry.addRectangle(1, 0, 0, 1, 1)
        out, _ = geometry.fragment([(2, square)], [(2, other)])
        flat = cell == "hexahedron"
        made = geometry.extrude(out, 0, 0, 1, numElements=[2], recombine=True)
        geometry.synchronize()
        for _, curve in gmsh.model.getEntities(1):
            gmsh.model.mesh.setTransfiniteCurve(curve, 3)
        for _, surface in out:
            gmsh.model.mesh.setTransfiniteSurface(surface)
            if flat:
                gmsh.model.mesh.setRecombine(2, surface)
        volumes = [tag for dim, tag in made if dim == 3]
    for name, tag in zip(("left", "right"), volumes, strict=True):
        gmsh.model.addPhysicalGroup(3, [tag], name=name)
    ends = [tag for _, tag in gmsh.model.getEntities(2) if gmsh.model.occ.getCenterOfMass(2, tag)[0] > 2 - 1e-6]
    gmsh.model.addPhysicalGroup(2, ends, name="end")
    tips = gmsh.model.getEntitiesInBoundingBox(1.9, 0.9, 0.9, 2.1, 1.1, 1.1, 0)
    gmsh.model.addPhysicalGroup(0, [tag for _, tag in tips], name="tip")
    gmsh.model.mesh.generate(3)
