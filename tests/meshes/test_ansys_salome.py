"""Ansys' archives and Salome's MED files: the same cells, bent as they should be, with their groups."""

import sys

from mpi4py import MPI

import foreign_decks
import h5py
import lattice
import numpy as np
import pytest
from measures import area, moments, n_cells, n_owned

from flexmbd import meshes
from flexmbd.errors import MeshError
from flexmbd.meshes import trial_read

pytestmark = pytest.mark.mpi

COMM = MPI.COMM_WORLD
DEGREES = [("tetrahedron", 1), ("tetrahedron", 2), ("hexahedron", 1), ("hexahedron", 2)]
ELEMENTS = {("tetrahedron", 1): 285, ("tetrahedron", 2): 187, ("hexahedron", 1): 185, ("hexahedron", 2): 186}


def bent(cell, degree):
    map = lattice.shear
    if degree == 2:
        map = lattice.bend_cubically if cell == "hexahedron" else lattice.bend
    return lattice.lattice(cell, degree, map=map)


@pytest.fixture
def write(shared_path):
    """Writes a text to a file on rank 0 and says where it is."""

    def write_text(text, name="part.cdb"):
        path = shared_path / name
        if COMM.rank == 0:
            path.write_text(text)
        COMM.barrier()
        return path

    return write_text


@pytest.mark.parametrize(("cell", "degree"), DEGREES)
def test_an_archive(write, cell, degree):
    source = bent(cell, degree)
    half = len(source.cells) // 2
    types = [(ELEMENTS[cell, degree], 3 if i < half else 4, 0) for i in range(len(source.cells))]
    components = foreign_decks.component("FOOT", "NODE", source.at(0, 0.0))
    components += foreign_decks.component("TIP", "NODE", source.at(0, 2.0)[:1])
    path = write(foreign_decks.cdb(source.points, source.cells.tolist(), types=types, components=components))
    part = meshes.read(path)
    assert part.mesh.topology.cell_name() == cell
    assert moments(part) == pytest.approx(lattice.moments(source.map), rel=1e-11, abs=1e-11)
    assert part.cell_groups.keys() == {"material 3", "material 4"}
    assert part.facet_groups.keys() == {"FOOT"}
    assert n_owned(part, 0, part.vertices("TIP")) == 1
    assert n_owned(part, 3, part.cells("material 3")) == half
    named = components + foreign_decks.component("LEFT", "ELEM", range(half))
    path = write(foreign_decks.cdb(source.points, source.cells.tolist(), types=types, components=named))
    assert meshes.read(path).cell_groups.keys() == {"LEFT", "material 4"}


FOLDED = {  # corners and middles of a brick of 20 nodes, by those of the cell
    "prism": ("01223455", "01 12 22 20 34 45 55 53 03 14 25 25"),
    "pyramid": ("01234444", "01 12 23 30 44 44 44 44 04 14 24 34"),
    "tetrahedron": ("01223333", "01 12 22 20 33 33 33 33 03 13 23 23"),
}


def cubes_of(kind):
    """Corners of the cells that two unit cubes along x are made of."""
    found = []
    for i in range(2):
        corners = [tuple(np.add(c, (i, 0, 0)).tolist()) for c in lattice.AROUND]
        middle = (i + 0.5, 0.5, 0.5)
        if kind == "prism":
            found += [[corners[k] for k in rows] for rows in ((0, 1, 2, 4, 5, 6), (0, 2, 3, 4, 6, 7))]
            continue
        for side in ("0321", "4567", "0154", "1265", "2376", "3047"):
            square = [corners[int(k)] for k in side]
            if kind == "pyramid":
                found.append([*square, middle])
            else:  # by the diagonal at the corner that is highest in all coordinates, alike on both sides
                start = square.index(max(square))
                turned = square[start:] + square[:start]
                found += [[*turned[:3], middle], [turned[0], turned[2], turned[3], middle]]
    return found


@pytest.mark.parametrize("kind", FOLDED)
@pytest.mark.parametrize("degree", [1, 2])
def test_folded_bricks(write, kind, degree):
    """SOLID185 and 186 with corners of the same number are wedges, pyramids, tetrahedra."""
    places, cells = {}, []
    fold = [int(k) for k in FOLDED[kind][0]]
    edges = [(int(a), int(b)) for a, b in FOLDED[kind][1].split()]
    for corners in cubes_of(kind):
        points = [tuple(map(float, corners[k])) for k in fold]
        if degree == 2:
            points += [tuple(np.mean([corners[a], corners[b]], axis=0).tolist()) for a, b in edges]
        cells.append([places.setdefault(x, len(places)) for x in points])
    bend = lattice.bend if degree == 2 else lattice.shear
    points = bend(np.array(list(places)))
    types = [(186 if degree == 2 else 185, 1, 0)] * len(cells)
    foot = [row for place, row in places.items() if place[0] == 0.0]
    text = foreign_decks.cdb(points, cells, types=types, components=foreign_decks.component("FOOT", "NODE", foot))
    part = meshes.read(write(text), tetrahedra=kind != "tetrahedron")
    assert moments(part) == pytest.approx(lattice.moments(bend), rel=1e-11, abs=1e-11)
    assert n_cells(part) == len(cells) * {"prism": 3, "pyramid": 2, "tetrahedron": 1}[kind]
    assert n_owned(part, 2, part.facets("FOOT")) == 2


@pytest.mark.parametrize(("cell", "degree"), DEGREES)
def test_a_med_file(shared_path, cell, degree):
    source = bent(cell, degree)
    path = shared_path / "part.med"
    kind = foreign_decks.KINDS[cell, degree]
    half = len(source.cells) // 2
    corner = {"tetrahedron": "triangle", "hexahedron": "quad"}[cell]
    skin = [[source.cells[i][int(v) - 1] for v in lattice.FACES[cell][f - 1]] for i, f in source.faces(1, 0.0)]
    if COMM.rank == 0:
        blocks = [(kind, source.cells, [-6] * half + [-7] * half), (corner, np.array(skin), [-8] * len(skin))]
        names = {-6: ["left"], -7: ["right", "behind"], -8: ["skin"]}
        tip = {"rows": {2: source.at(0, 2.0)[:1]}, "names": {2: ["tip"]}}
        foreign_decks.write_med(path, source.points, blocks, names, tip)
    COMM.barrier()
    part = meshes.read(path)
    assert moments(part) == pytest.approx(lattice.moments(source.map), rel=1e-12, abs=1e-12)
    assert "left" in part.cell_groups
    assert len({"right", "behind"} & part.cell_groups.keys()) == 1  # two names of one group
    assert part.facet_groups.keys() == {"skin"}
    if degree == 1:
        sides = lattice.shear(np.eye(3))
        assert area(part, "skin") == pytest.approx(2 * np.linalg.norm(np.cross(sides[0], sides[2])), rel=1e-13)
    assert n_owned(part, 0, part.vertices("tip")) == 1


def test_a_med_file_that_names_another(shared_path):
    """Nothing is read of what a file only refers to."""
    path = shared_path / "part.med"
    if COMM.rank == 0:
        with h5py.File(path, "w") as file:
            file["ENS_MAA"] = h5py.ExternalLink("/etc/passwd", "/")
    COMM.barrier()
    with pytest.raises(MeshError, match=r"meshio cannot read it: ValueError .*ENS_MAA is a link to elsewhere"):
        meshes.read(path)


@pytest.mark.parametrize(("name", "library"), [("part.med", "meshio"), ("part.cdb", "mapdl_archive")])
def test_without_the_library(write, monkeypatch, name, library):
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(MeshError, match=rf"{library} reads such files, .* pip install 'flexmbd\[meshes\]'"):
        meshes.read(write("", name))
    assert COMM.allreduce(1) == COMM.size


def test_archives_that_are_none(write, monkeypatch):
    monkeypatch.setattr(trial_read, "LIMITS", trial_read.TrialLimits(seconds=(5.0, 0.0), bytes=(2.0**31, 0.0)))
    claims = "/PREP7\nET,1,185\nNBLOCK,6,SOLID,2000000000,2000000000\n(3i9,6e21.13e3)\n"
    for text in (claims, "nothing\n", claims.replace("NBLOCK", "EBLOCK,19")):
        with pytest.raises(MeshError, match=r"part\.cdb: "):
            meshes.read(write(text))
    assert COMM.allreduce(1) == COMM.size
