"""Reading .msh files: what was written comes back, and what is no such mesh is refused."""

from mpi4py import MPI

import gmsh
import numpy as np
import pytest
from measures import area, n_cells, nodes_of, volume

from flexmbd import meshes
from flexmbd.errors import MeshError

pytestmark = pytest.mark.mpi

COMM = MPI.COMM_WORLD

# Two tetrahedra on the unit square's diagonal, with gaps in the numbers of the nodes; node 70
# belongs to no cell. Written by hand.
TWO_TETRAHEDRA = """$MeshFormat
2.2 0 8
$EndMeshFormat
$PhysicalNames
2
2 1 "foot"
3 2 "all"
$EndPhysicalNames
$Nodes
6
10 0 0 0
20 1 0 0
35 0 1 0
40 1 1 0
70 9 9 9
90 0.5 0.5 1
$EndNodes
$Elements
4
1 2 2 1 1 10 20 35
2 2 2 1 1 20 40 35
3 4 2 2 1 10 20 35 90
4 4 2 2 1 20 40 35 90
$EndElements
"""


@pytest.fixture
def write(shared_path):
    """Writes a text to a file on rank 0 and says where it is."""

    def write_text(text, name="part.msh"):
        path = shared_path / name
        if COMM.rank == 0:
            path.write_text(text)
        COMM.barrier()
        return path

    return write_text


@pytest.fixture
def save(shared_path):
    """Runs a function in gmsh on rank 0, which makes a model, and writes the model to a file."""

    def save_model(make, *, version=4.1, binary=False):
        path = shared_path / "part.msh"
        if COMM.rank == 0:
            gmsh.initialize([], readConfigFiles=False, interruptible=False)
            gmsh.option.setNumber("General.Terminal", 0)
            gmsh.option.setNumber("Mesh.MshFileVersion", version)
            gmsh.option.setNumber("Mesh.Binary", binary)
            try:
                make()
                gmsh.write(str(path))
            finally:
                gmsh.finalize()
        COMM.barrier()
        return path

    return save_model


def meshed_box(*, groups=("inside", "outside"), volumes=("part",), degree=2, algorithm=1):
    """A unit cube with the face x = 0 apart from the others."""
    box = gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)
    gmsh.model.occ.synchronize()
    faces = [tag for _, tag in gmsh.model.getEntities(2)]
    inside = [tag for tag in faces if gmsh.model.occ.getCenterOfMass(2, tag)[0] < 1e-6]
    for name, tags in zip(groups, (inside, set(faces) - set(inside)), strict=False):
        gmsh.model.addPhysicalGroup(2, sorted(tags), name=name)
    for name in volumes:
        gmsh.model.addPhysicalGroup(3, [box], name=name)
    gmsh.option.setNumber("Mesh.MeshSizeMax", 0.4)
    gmsh.option.setNumber("Mesh.Algorithm3D", algorithm)
    gmsh.model.mesh.generate(3)
    gmsh.model.mesh.setOrder(degree)


@pytest.mark.parametrize(
    ("version", "binary"), [(4.1, False), (4.1, True), (2.2, False), (2.2, True)]
)
def test_formats(save, version, binary):
    part = meshes.read(save(meshed_box, version=version, binary=binary))
    assert part.facet_groups.keys() == {"inside", "outside"}
    assert part.cell_groups.keys() == {"part"}
    assert volume(part) == pytest.approx(1, rel=1e-13)
    assert area(part, "inside") == pytest.approx(1, rel=1e-13)
    assert area(part, "outside") == pytest.approx(5, rel=1e-13)
    assert nodes_of(part, "inside")[:, 0] == pytest.approx(0, abs=1e-15)


def test_a_path_may_be_a_text(save):
    assert n_cells(meshes.read(str(save(meshed_box)))) > 0


def test_the_nodes_keep_the_files_numbers(save):
    """Row i of the input is the file's node i + 1."""
    written = {}

    def make():
        meshed_box()
        tags, x, _ = gmsh.model.mesh.getNodes()
        written.update(zip(tags.tolist(), x.reshape(-1, 3), strict=True))

    part = meshes.read(save(make))
    written = COMM.bcast(written, root=0)
    for number, x in zip(
        part.mesh.geometry.input_global_indices, part.mesh.geometry.x, strict=True
    ):
        assert x == pytest.approx(written[number + 1], abs=1e-15)


def test_gaps_in_the_numbers_and_nodes_of_no_cell(write):
    part = meshes.read(write(TWO_TETRAHEDRA), comm=MPI.COMM_SELF)
    assert volume(part) == pytest.approx(1 / 3, rel=1e-14)
    assert area(part, "foot") == pytest.approx(1, rel=1e-14)
    expected = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0), (0.5, 0.5, 1)]
    rows = part.mesh.geometry.input_global_indices
    assert sorted(rows) == [0, 1, 2, 3, 4]
    assert part.mesh.geometry.x == pytest.approx(np.array(expected)[rows], abs=1e-15)


def test_volumes_need_no_group(write):
    text = TWO_TETRAHEDRA.replace("2\n2 1", "1\n2 1").replace('3 2 "all"\n', "")
    text = text.replace(" 4 2 2 1 ", " 4 2 0 1 ")
    part = meshes.read(write(text), comm=MPI.COMM_SELF)
    assert volume(part) == pytest.approx(1 / 3, rel=1e-14)
    assert part.cell_groups == {}


def test_missing_file(shared_path):
    with pytest.raises(MeshError, match=r"nowhere\.msh: cannot be opened: No such file"):
        meshes.read(shared_path / "nowhere.msh")
    with pytest.raises(MeshError, match="Is a directory"):
        meshes.read(shared_path)


@pytest.mark.parametrize(
    ("old", "new", "pattern"),
    [
        (TWO_TETRAHEDRA, "", r"part\.msh: not a gmsh mesh file"),
        (TWO_TETRAHEDRA, 'Merge "other.msh";', r"part\.msh: not a gmsh mesh file"),
        ("2.2 0 8", "9.9 0 8", r"part\.msh: gmsh cannot read it"),
        ('2 1 "foot"', '1 1 "foot"', "no named group of surfaces"),
        (
            "4 2 2 1 10 20 35 90\n4 4 2 2 1 20 40 35 90",
            "2 2 9 1 10 20 90\n4 2 2 9 1 20 40 90",
            "no three-dimensional",
        ),
        ("4 4 2 2 1 20 40 35 90", "4 4 2 0 3 20 40 35 90", "volume 3 is in 0 physical groups"),
        (
            "4 4 2 2 1 20 40 35 90",
            "4 7 2 2 1 20 40 35 10 90",
            "of the kinds pyramid of 5 nodes, tetrahedron of 4 nodes",
        ),
        ("90 0.5 0.5 1", "90 0.5 0.5 0", "2 cells are inverted or flat .* the worst, number 3, near"),
        ("90 0.5 0.5 1", "90 0.5 nan 1", "1 nodes have coordinates that are not finite, the first in row 4"),
    ],
)
def test_files_that_are_no_such_mesh(write, old, new, pattern):
    assert old in TWO_TETRAHEDRA
    path = write(TWO_TETRAHEDRA.replace(old, new))
    with pytest.raises(MeshError, match=pattern):
        meshes.read(path)
    assert COMM.allreduce(1) == COMM.size


def test_a_file_broken_off(save, shared_path):
    path = save(meshed_box)
    if COMM.rank == 0:
        path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    COMM.barrier()
    with pytest.raises(MeshError):
        meshes.read(path)


def test_a_surface_in_two_groups(save):
    def make():
        meshed_box()
        gmsh.model.addPhysicalGroup(2, [1], name="again")

    with pytest.raises(MeshError, match=r"surface 1 is in several physical groups \(.*again"):
        meshes.read(save(make))


def test_a_volume_in_two_groups(save):
    with pytest.raises(MeshError, match="volume 1 is in 2 physical groups"):
        meshes.read(save(lambda: meshed_box(volumes=("part", "again"))))


def test_groups_that_overlap_can_be_chosen(save):
    def make():
        meshed_box(volumes=("part", "again"))
        gmsh.model.addPhysicalGroup(2, [1, 2, 3], name="some")

    path = save(make)
    part = meshes.read(path, cell_groups=["again"], facet_groups=["some"], scale=2.0)
    assert (part.cell_groups.keys(), part.facet_groups.keys()) == ({"again"}, {"some"})
    assert area(part, "some") == pytest.approx(12, rel=1e-13)
    assert COMM.allreduce(len(part.cells("again"))) >= n_cells(part)
    with pytest.raises(MeshError, match="no cell group 'all'; its cell groups are: 'again', 'part'"):
        meshes.read(path, cell_groups=["all"])


def test_a_name_given_twice(save):
    path = save(meshed_box)
    if COMM.rank == 0:
        path.write_text(path.read_text().replace('"outside"', '"inside"'))
    COMM.barrier()
    with pytest.raises(
        MeshError, match="two physical groups of dimension 2 have the name 'inside'"
    ):
        meshes.read(path)
