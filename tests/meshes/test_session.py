"""The gmsh session: closed afterwards, a guest in the user's, quiet, and in step on all ranks."""

from mpi4py import MPI

import gmsh
import pytest

from flexmbd import meshes
from flexmbd.errors import MeshError
from flexmbd.meshes import session

pytestmark = pytest.mark.mpi

COMM = MPI.COMM_WORLD


def some_beam(comm=COMM):
    return meshes.beam(1.0, 0.2, 0.2, h=0.2, degree=1, comm=comm)


@pytest.fixture
def users():
    """A session and a model of the user's, on every rank, with options of theirs."""
    gmsh.initialize([], readConfigFiles=False, interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.model.add("mine")
    gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)
    gmsh.model.occ.synchronize()
    gmsh.model.add("other")
    gmsh.model.setCurrent("mine")
    gmsh.option.setNumber("Mesh.MeshSizeFactor", 0.3)
    gmsh.option.setNumber("Mesh.RecombineAll", 1)
    yield
    gmsh.finalize()


def test_gmsh_is_closed_again():
    some_beam()
    assert not gmsh.isInitialized()
    with pytest.raises(MeshError):
        meshes.read("nowhere.msh")
    assert not gmsh.isInitialized()


def test_the_users_session_is_left_as_it_was_and_changes_nothing(users):
    mark = some_beam(MPI.COMM_SELF).fingerprint()
    assert gmsh.isInitialized()
    assert gmsh.model.getCurrent() == "mine"
    assert sorted(gmsh.model.list())[-2:] == ["mine", "other"]
    assert len(gmsh.model.getEntities(3)) == 1
    assert gmsh.option.getNumber("Mesh.MeshSizeFactor") == 0.3
    assert gmsh.option.getNumber("Mesh.RecombineAll") == 1
    with pytest.raises(MeshError):
        meshes.read("nowhere.msh", comm=MPI.COMM_SELF)
    assert gmsh.model.getCurrent() == "mine"
    gmsh.finalize()
    assert some_beam(MPI.COMM_SELF).fingerprint() == mark
    gmsh.initialize([], readConfigFiles=False, interruptible=False)


def test_gmsh_is_quiet(capfd):
    some_beam()
    with pytest.raises(MeshError):
        meshes.read("nowhere.msh")
    assert capfd.readouterr() == ("", "")


def test_an_error_inside_is_raised_on_all_ranks():
    def fill():
        raise ZeroDivisionError("in the geometry")

    with pytest.raises(ZeroDivisionError, match="in the geometry"):
        session.tagged_mesh(COMM, fill)
    assert COMM.allreduce(1) == COMM.size
    assert not gmsh.isInitialized()


@pytest.mark.parametrize("sound", [0, 1])
def test_what_gmsh_cannot_mesh_is_a_mesh_error(sound):
    """A volume with a hole, alone or beside a sound one; some versions of gmsh leave it empty and only log that."""

    def add_tetrahedron(x, sides):
        corners = [(x, 0, 0), (x + 1, 0, 0), (x, 1, 0), (x, 0, 1)]
        points = [gmsh.model.geo.addPoint(*corner) for corner in corners]
        lines = {
            (i, j): gmsh.model.geo.addLine(points[i], points[j])
            for i in range(4)
            for j in range(i + 1, 4)
        }
        loops = [
            gmsh.model.geo.addCurveLoop([lines[a, b], lines[b, c], -lines[a, c]])
            for a, b, c in sides
        ]
        surfaces = [gmsh.model.geo.addPlaneSurface([loop]) for loop in loops]
        gmsh.model.geo.addVolume([gmsh.model.geo.addSurfaceLoop(surfaces)])

    def fill():
        sides = [(0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3)]
        for i in range(sound):
            add_tetrahedron(2.0 * i, sides)
        add_tetrahedron(2.0 * sound, sides[:3])
        gmsh.model.geo.synchronize()
        session.generate(h=0.5, degree=1)

    with pytest.raises(MeshError, match=rf"gmsh cannot mesh this part: .*in volume {sound + 1}"):
        session.tagged_mesh(COMM, fill)
