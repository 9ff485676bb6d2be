"""Groups of facets by their place, of any file."""

from mpi4py import MPI

import lattice
import numpy as np
import pytest
from measures import area, nodes_of

from flexmbd import meshes
from flexmbd.errors import MeshError
from flexmbd.meshes import InBox, OnCylinder, OnPlane

pytestmark = pytest.mark.mpi

COMM = MPI.COMM_WORLD


@pytest.fixture(scope="module")
def ring():
    """A tube askew in space, and how it is turned."""
    plain = meshes.tube(0.2, 0.05, 0.03, h=0.02)
    z = np.array([2.0, -1.0, 2.0]) / 3.0
    x = np.cross(z, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x)
    turn = np.column_stack((x, np.cross(z, x), z))
    start = plain.mesh.geometry.x.copy()
    plain.mesh.geometry.x[:] = start @ turn.T + [0.4, 0.1, -0.3]
    along = plain.mesh.comm.allreduce(np.ptp(start, axis=0).max(initial=0.0), op=MPI.MAX)
    assert along > 0
    return plain, turn


def test_planes_cylinders_and_functions(ring):
    """Beside the groups that the part has from its maker: the same facets, found by their place."""
    tube, _ = ring
    own = {name: tube.facet_groups[name] for name in ("start", "end", "inner", "outer")}
    bare = meshes.TaggedMesh(tube.mesh, tube.facet_tags, {}, tube.cell_tags, tube.cell_groups)
    middle = np.concatenate(COMM.allgather(nodes_of(tube, "start"))).mean(axis=0)
    far = np.concatenate(COMM.allgather(nodes_of(tube, "end"))).mean(axis=0)
    axis = far - middle
    places = {
        "here": OnPlane(tuple(middle), tuple(-5.0 * axis)),
        "there": OnPlane(tuple(far), tuple(axis)),
        "bore": OnCylinder(tuple(far + 3.0 * axis), tuple(axis), 0.03),
        "skin": lambda x: np.linalg.norm(np.cross(x.T - middle, axis / np.linalg.norm(axis)), axis=1) > 0.0499,
    }
    found = meshes.with_facet_groups(bare, places)
    for name, same in (("here", "start"), ("there", "end"), ("bore", "inner"), ("skin", "outer")):
        assert np.array_equal(found.facets(name), np.sort(tube.facet_tags.find(own[same])))
    assert found.cell_groups == tube.cell_groups


def test_a_place_within_a_group_is_cut_out_of_it():
    """Of a part from STEP "surface" is what has no other name."""
    bracket = meshes.from_step(meshes.BRACKET, tags={"foot": (0, 0, 0)}, h=8e-3)
    whole = area(bracket, "surface")
    found = meshes.with_facet_groups(bracket, {"pin": OnCylinder((0, 0, 0.04), (1, 0, 0), 0.008)})
    assert area(found, "pin") == pytest.approx(2 * np.pi * 0.008 * 0.02, rel=1e-3)
    assert area(found, "surface") == pytest.approx(whole - area(found, "pin"), rel=1e-12)
    assert area(found, "foot") == pytest.approx(area(bracket, "foot"), rel=1e-15)


def test_an_end_is_not_on_its_cylinder():
    """A coarse bar whose end has facets with all vertices on the rim."""
    bar = meshes.round_bar(0.1, 0.3, divisions=(2, 2, 2))
    bar = meshes.TaggedMesh(bar.mesh, bar.facet_tags, {}, bar.cell_tags, bar.cell_groups)
    found = meshes.with_facet_groups(bar, {"side": OnCylinder((0, 0, 0), (0, 0, 1), 0.1)})
    assert area(found, "side") > 0.9 * np.pi / 2 * 0.1 * 0.3
    x = nodes_of(found, "side")
    assert np.hypot(x[:, 0], x[:, 1]) == pytest.approx(0.1, rel=1e-6)
    points = np.array([[1.0, 0, 0], [-0.5, np.sqrt(0.75), 0], [-0.5, -np.sqrt(0.75), 0], [1, 0, 1.0]])
    faces = {"side": OnCylinder((0, 0, 0), (0, 0, 1), 1.0)}
    wedge = meshes.from_arrays(
        MPI.COMM_SELF, points=points, cells=np.array([[0, 1, 2, 3]]), cell="tetrahedron", degree=1,
        facet_groups={}, order=meshes.NodeOrder.LEXICOGRAPHIC,
    )  # fmt: skip
    # all four corners lie on the cylinder, and three of its faces go along it
    assert len(meshes.with_facet_groups(wedge, faces).facets("side")) == 3


TET = lattice.bdf(lattice.lattice("tetrahedron", 1, program="nastran", map=lambda x: np.asarray(x) * 100.0), 1)


@pytest.fixture
def deck(shared_path):
    path = shared_path / "part.bdf"
    if COMM.rank == 0:
        path.write_text(TET)
    COMM.barrier()
    return path


def test_places_of_a_file(deck, shared_path):
    """In metres, whatever the file is in; a set of the file on the same facets gives way unless it was asked for."""
    box = InBox((-np.inf, -0.01, -0.01), (1e-6, 0.11, 0.11))
    part = meshes.read(deck, scale=1e-3, places={"foot": box, "end": OnPlane((0.2, 0, 0), (1, 0, 0))})
    assert part.facet_groups.keys() == {"foot", "end"}
    assert area(part, "foot") == pytest.approx(0.01, rel=1e-9)
    assert area(part, "end") == pytest.approx(0.01, rel=1e-9)
    with pytest.raises(MeshError, match="of these facets are in the group 'property 8' already"):
        meshes.read(deck, scale=1e-3, facet_groups=["property 8"], places={"foot": box})
    with pytest.raises(MeshError, match="of these facets are in the group 'property 8' already"):
        meshes.with_facet_groups(meshes.read(deck, scale=1e-3), {"all": lambda x: x[0] < 9.0})
    path = shared_path / "part.h5"
    meshes.write(part, path)
    more = meshes.read(path, places={"top": OnPlane((0, 0, 0.1), (0, 0, 1))})
    assert more.facet_groups.keys() == {"foot", "end", "top"}
    assert area(more, "top") == pytest.approx(0.02, rel=1e-9)


@pytest.mark.parametrize(
    ("places", "pattern"),
    [
        ({"foot": OnPlane((5, 0, 0), (1, 0, 0))}, "facet group 'foot': no boundary facet lies in it"),
        ({"foot": 7}, r"places\['foot'\] must be OnPlane, OnCylinder, InBox or a function of points, got 7"),
        ({"": InBox((0, 0, 0), (1, 1, 1))}, "places has the name ''; names are texts"),
        ([InBox((0, 0, 0), (1, 1, 1))], "places must be a dictionary of places"),
        ({"foot": lambda x: 1 / 0}, "facet group 'foot': its function raised ZeroDivisionError"),
        ({"a": InBox((-1, -1, -1), (9, 9, 9)), "b": lambda x: x[0] < 1e-9}, "facet groups 'a' and 'b' share facets"),
    ],
)
def test_places_that_do_not_fit(deck, places, pattern):
    with pytest.raises(MeshError, match=pattern):
        meshes.read(deck, scale=1e-3, places=places)
    assert COMM.allreduce(1) == COMM.size


@pytest.mark.parametrize(
    ("make", "pattern"),
    [
        (lambda: OnPlane((5, 0), (1, 0, 0)), r"OnPlane: point must be three numbers, got \(5, 0\)"),
        (lambda: OnPlane((5, 0, 0), (0, 0, 0)), "OnPlane: normal: a direction must have a length"),
        (lambda: OnPlane((0, 0, 0), (1, 0, 0), within=-1.0), "OnPlane: within must be a positive length in m, got -1"),
        (lambda: OnCylinder((0, 0, 0), (1, 0, 0), "8"), "OnCylinder: radius must be a positive length in m, got '8'"),
        (lambda: InBox((1, 0, 0), (0, 1, 1)), r"InBox: its low corner \(1, 0, 0\) lies above its high one"),
    ],
)
def test_places_that_are_none(make, pattern):
    with pytest.raises(MeshError, match=pattern):
        make()
