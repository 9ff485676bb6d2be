"""What no part can be made of: one error that names it, on all ranks; wrong types, shapes, units and communicators."""

from mpi4py import MPI

import numpy as np
import pytest

from flexmbd import MeshError, meshes

pytestmark = pytest.mark.mpi
ONE = {"divisions": (1, 1)}
BAR = {"root": (0.0, 0.0, 0.0), "tip": (1.0, 0.0, 0.0)}, {"bar": [("root", "tip")]}


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: meshes.beam(True, 0.1, 0.1, h=0.1), "length must be a positive, finite length in m, got True"),
        (lambda: meshes.beam(1.0, 0.1, 0.1, h=0.1, comm=None), "comm must be a Comm, got None"),
        (lambda: meshes.beam(1.0, 0.1, 0.1, h=0.1, comm=MPI.COMM_NULL), "comm must be a communicator"),
        (lambda: meshes.sheet(1.0, 1.0, **ONE, cell=np.eye(2)), "cell must be"),
        (lambda: meshes.sheet(1.0, 1.0, **ONE, degree=np.eye(2)), "degree of the geometry must be 1 or 2"),
        (lambda: meshes.sheet(1.0, 1.0, divisions=(True, 1)), "divisions must be two positive whole numbers"),
        (lambda: meshes.line(1.0, divisions=True), "divisions must be a positive whole number, got True"),
        (lambda: meshes.plate(1.0, 1.0, 1e30, h=0.5), "gmsh cannot build this part"),
        (lambda: meshes.block(1.0, 1.0, 1.0, divisions=(1, 1, 1), layers=3), "layers must be a list of names"),
        (lambda: meshes.write(meshes.line(1.0, divisions=2), 3), "path must be a path, got 3"),
        (lambda: meshes.write(3, "a.h5"), "part must be a TaggedMesh, got 3"),
        (lambda: meshes.read(3), "path must be a path, got 3"),
        (lambda: meshes.read("a.msh", cell_groups=3), "cell_groups must be a list of names"),
        (lambda: meshes.step_faces(meshes.BRACKET, comm=3), "comm must be a Comm, got 3"),
        (lambda: meshes.connecting_rod(length=300.0, h=12.0), "sizes do not fit together; give all of them in metres"),
    ],
)
def test_what_no_part_is_made_of(make, said):
    with pytest.raises(MeshError, match=said):
        make()


def test_a_wrong_argument_on_one_rank_is_told_on_all():
    comm = MPI.COMM_WORLD
    path = 3 if comm.rank == comm.size - 1 else "a.h5"
    part = meshes.line(1.0, divisions=4)
    with pytest.raises(MeshError, match="path must be a path, got 3"):
        meshes.write(part, path)


@pytest.mark.parametrize(
    ("part", "named"),
    [
        (lambda: meshes.line(1.0, divisions=10**30), "divisions makes 1e.30 cells"),
        (lambda: meshes.block(1.0, 1.0, 1.0, divisions=(2**20, 2**20, 1)), "divisions makes 1.1e.12 cells"),
        (lambda: meshes.plate(1.0, 1.0, 0.1, h=0.5, through=2**40), "through makes 1.1e.12 cells"),
        (lambda: meshes.beam(1.0, 0.1, 0.1, h=1e-6), "h = 1e-06 m makes 1e.16 cells"),
        (lambda: meshes.beam(1.0, 0.1, 0.1, h=1e-6, cell="hexahedron"), "h = 1e-06 m makes 1e.16 cells"),
        (lambda: meshes.tube(1.0, 0.1, 0.05, h=1e-6), "h = 1e-06 m makes 5e.15 cells"),
        (lambda: meshes.frame(*BAR, divisions=10**30), "divisions makes 1e.30 elements"),
    ],
)
def test_more_cells_than_memory_holds_are_refused_before_they_are_made(part, named):
    """gmsh counts in 32 bits, and would make another number of them without a word."""
    with pytest.raises(MeshError, match=named):
        part()
