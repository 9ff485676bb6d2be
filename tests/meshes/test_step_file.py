"""Parts from STEP files: units, tags of faces, several solids, and files that are no such part."""

from mpi4py import MPI

import dolfinx
import gmsh
import numpy as np
import pytest
import step_shapes
from measures import area, extents, n_cells, n_owned, nodes_of, volume

from flexmbd import meshes
from flexmbd.continuum.compat import cell_nodes, geometry_degree
from flexmbd.errors import MeshError

pytestmark = pytest.mark.mpi

COMM = MPI.COMM_WORLD

# Of the bracket, m.
FOOT = 0.08 * 0.04 * 0.008 - 2 * np.pi * 0.0045**2 * 0.008
LUG = 0.02 * (0.04 * 0.032 + np.pi * 0.02**2 / 2 - np.pi * 0.008**2)
H = 6e-3


def is_pin(face):
    return face.radius is not None and abs(face.radius - 0.008) < 1e-9


# Each bolt bore by a point on it.
TAGS = {"pin": is_pin, "bolts": [(-0.0325, 0, 0.004), (0.028, 0.0045, 0.002)], "foot": (0, 0, 0)}


@pytest.fixture(scope="module")
def bracket():
    return meshes.from_step(meshes.BRACKET, tags=TAGS, h=H)


@pytest.fixture
def write(shared_path):
    """Writes a STEP file on rank 0 and says where it is."""

    def write_shape(shape, *, name="part.step", **how):
        path = shared_path / name
        if COMM.rank == 0:
            step_shapes.write(path, shape, **how)
        COMM.barrier()
        return path

    return write_shape


def add_box(*corner, size=(20.0, 10.0, 10.0)):
    return gmsh.model.occ.addBox(*corner, *size)


def test_bracket_is_in_metres(bracket):
    assert bracket.mesh.topology.cell_name() == "tetrahedron"
    assert geometry_degree(bracket.mesh) == 2
    assert volume(bracket) == pytest.approx(FOOT + LUG, rel=1e-4)
    corners = np.array([[-0.04, -0.02, 0], [0.04, 0.02, 0.06]])
    assert extents(bracket) == pytest.approx(corners, abs=1e-4)


def test_groups_of_the_bracket(bracket):
    assert bracket.facet_groups.keys() == {"pin", "bolts", "foot", "surface"}
    assert area(bracket, "pin") == pytest.approx(2 * np.pi * 0.008 * 0.02, rel=1e-3)
    assert area(bracket, "bolts") == pytest.approx(4 * np.pi * 0.0045 * 0.008, rel=1e-3)
    assert area(bracket, "foot") == pytest.approx(0.08 * 0.04 - 2 * np.pi * 0.0045**2, rel=1e-4)
    pin, bolts, foot = (nodes_of(bracket, name) for name in ("pin", "bolts", "foot"))
    assert np.hypot(pin[:, 1], pin[:, 2] - 0.04) == pytest.approx(0.008, abs=1e-9)
    assert np.hypot(abs(bolts[:, 0]) - 0.028, bolts[:, 1]) == pytest.approx(0.0045, abs=1e-9)
    assert foot[:, 2] == pytest.approx(0.0, abs=1e-12)
    assert n_owned(bracket, 3, bracket.cells("part")) == n_cells(bracket)
    bracket.mesh.topology.create_connectivity(2, 3)
    boundary = dolfinx.mesh.exterior_facet_indices(bracket.mesh.topology)
    assert np.array_equal(np.sort(bracket.facet_tags.indices), np.sort(boundary))


def test_straight_cells():
    straight = meshes.from_step(meshes.BRACKET, tags=TAGS, h=H, degree=1)
    assert geometry_degree(straight.mesh) == 1
    assert volume(straight) == pytest.approx(FOOT + LUG, rel=0.01)


def test_faces_are_listed():
    faces = meshes.step_faces(meshes.BRACKET)
    radii = sorted(round(face.radius, 9) for face in faces if face.radius is not None)
    assert radii == [0.0045, 0.0045, 0.008, 0.02]
    assert len(faces) == 13
    (foot,) = (f for f in faces if f.normal is not None and abs(f.centre[2]) < 1e-9)
    assert np.abs(foot.normal) == pytest.approx([0, 0, 1], abs=1e-12)
    assert foot.area == pytest.approx(0.08 * 0.04 - 2 * np.pi * 0.0045**2, rel=1e-6)
    assert "cylinder of radius 0.008 m, centre (0, 0, 0.04) m" in [str(f)[:49] for f in faces]


@pytest.mark.parametrize(
    ("says", "scale"),
    [
        ("SI_UNIT($,.METRE.)", 1e-3),
        ("SI_UNIT(.CENTI.,.METRE.)", 0.1),
    ],
)
def test_a_file_that_says_another_unit(write, bracket, says, scale):
    """The same bracket, drawn in millimetres: with the scale it is the same, faces and all."""
    path = write(step_shapes.add_bracket, says=says)
    part = meshes.from_step(path, tags=TAGS, h=H, scale=scale)
    assert volume(part) == pytest.approx(FOOT + LUG, rel=1e-4)
    assert area(part, "pin") == pytest.approx(area(bracket, "pin"), rel=1e-3)
    assert area(part, "bolts") == pytest.approx(area(bracket, "bolts"), rel=1e-3)
    with pytest.raises(MeshError, match=r"the part measures [0-9.]+ x [0-9.]+ x [0-9.]+ m\. If"):
        meshes.from_step(path, tags={}, h=2e-4)


def test_a_part_of_300_metres(write):
    path = write(lambda: add_box(0, 0, 0, size=(300, 48, 28)), says="SI_UNIT($,.METRE.)")
    with pytest.raises(
        MeshError,
        match=r"cells of h = 0\.006 m are too small, there would be about 2e\+13 of them: "
        r"the part measures 300 x 48 x 28 m\. .* scale=0\.001 for millimetres",
    ):
        meshes.from_step(path, tags={}, h=0.006)
    with pytest.raises(MeshError, match=r"h = 200 m are too big: the part measures 300 x 48 x 28 m"):
        meshes.from_step(path, tags={}, h=200)


def two_boxes():
    add_box(0, 0, 0)
    add_box(20, 0, 0, size=(10, 10, 10))


def test_several_solids(write):
    path = write(two_boxes)
    with pytest.raises(
        MeshError,
        match=r"there are 2 solids in it: 1: 0\.02 x 0\.01 x 0\.01 m around \(0\.01, 0\.005, 0\.005\) m; "
        r"2: 0\.01 x 0\.01 x 0\.01 m around \(0\.025, .* solid=1, \.\.\., .* glue=True, or fuse",
    ):
        meshes.from_step(path, tags={}, h=4e-3)
    end = {"end": (0.03, 0.004, 0.006)}
    second = meshes.from_step(path, tags=end, h=4e-3, solid=2)
    assert volume(second) == pytest.approx(1e-6, rel=1e-12)
    assert area(second, "end") == pytest.approx(1e-4, rel=1e-12)
    glued = meshes.from_step(path, tags=end, h=4e-3, glue=True)
    assert volume(glued) == pytest.approx(3e-6, rel=1e-12)
    assert glued.cell_groups.keys() == {"solid 1", "solid 2"}
    x = glued.mesh.geometry.x[cell_nodes(glued.mesh)]
    assert x[glued.cells("solid 1"), :, 0].max(initial=0) < 0.02 + 1e-9
    assert x[glued.cells("solid 2"), :, 0].min(initial=1) > 0.02 - 1e-9
    # what lies between the two is no surface
    assert area(glued, "surface") == pytest.approx(2 * 3e-4 + 2 * 3e-4 + 1e-4, rel=1e-12)
    with pytest.raises(MeshError, match="solid is 3, and there are 2 solids in it"):
        meshes.from_step(path, tags={}, h=4e-3, solid=3)


def test_solids_apart_cannot_be_glued(write):
    path = write(lambda: (add_box(0, 0, 0), add_box(30, 0, 0)))
    with pytest.raises(MeshError, match="falls into 2 pieces"):
        meshes.from_step(path, tags={}, h=5e-3, glue=True)


def test_no_solid(write):
    path = write(lambda: gmsh.model.occ.addRectangle(0, 0, 0, 10, 10))
    with pytest.raises(MeshError, match=r"part\.step: there is no solid in it, but 1 faces; in the CAD"):
        meshes.from_step(path, tags={}, h=1e-3)
    with pytest.raises(MeshError, match="there is no solid in it"):
        meshes.step_faces(path)


@pytest.mark.parametrize(
    ("text", "pattern"),
    [
        (None, r"part\.step: cannot be opened: No such file"),
        ("solid ascii\nfacet normal", r"part\.step: not a STEP file: it does not begin with ISO"),
        ("", "not a STEP file"),
        ("ISO-10303-21;\nHEADER;\nENDSEC;\nDATA;\n#1 = BROKEN(", "part.step: "),
    ],
)
def test_files_that_are_no_part(shared_path, text, pattern):
    path = shared_path / "part.step"
    if COMM.rank == 0 and text is not None:
        path.write_text(text)
    COMM.barrier()
    with pytest.raises(MeshError, match=pattern):
        meshes.from_step(path, tags={}, h=1e-3)
    assert COMM.allreduce(1) == COMM.size
    assert not gmsh.isInitialized()


@pytest.mark.parametrize(
    ("tags", "pattern"),
    [
        (
            {"pin": (0, 0, 0.04)},
            r"'pin': the point \(0, 0, 0\.04\) m lies on no face; the nearest, 0\.008 m away, is "
            r"this: cylinder of radius 0\.008 m.* measures 0\.08 x 0\.04 x 0\.06 m",
        ),
        # inside the bore of the foot's plane, where there is no face
        ({"foot": (0.028, 0.0, 0.0)}, r"lies on no face; the nearest, 0\.0045 m away"),
        ({"edge": (0.04, 0.0, 0.0)}, r"'edge': the point .* lies on 2 faces; give one that is not"),
        (
            {"big": lambda face: face.radius is not None and face.radius > 1},
            r"'big' chooses none of the 13 faces, which are: plane, normal to .*; \.\.\.",
        ),
        (
            {"pin": is_pin, "all": lambda face: True},
            r"'pin' and 'all' both choose this face: cylinder of radius 0\.008",
        ),
        ({"surface": is_pin}, "the name 'surface' is for all faces without a tag"),
        ({"pin": "bore"}, r"'pin' must be a point .* got 'bore'"),
        ({"pin": (0, 1)}, "'pin' must be a point"),
        ({"pin": [(0, 1, np.nan)]}, "'pin' must be a point"),
        (["pin"], "tags must be a dictionary"),
    ],
)
def test_tags_that_do_not_fit(tags, pattern):
    with pytest.raises(MeshError, match=pattern):
        meshes.from_step(meshes.BRACKET, tags=tags, h=H)
    assert COMM.allreduce(1) == COMM.size


@pytest.mark.parametrize(
    ("bad", "pattern"),
    [
        ({"h": 0}, "h must be a positive"),
        ({"scale": -1}, "scale must be a positive"),
        ({"degree": 3}, "degree of the geometry"),
        ({"solid": 0}, "solid must be a positive whole number"),
        ({"solid": 1, "glue": True}, "not both"),
    ],
)
def test_bad_arguments(bad, pattern):
    with pytest.raises(MeshError, match=pattern):
        meshes.from_step(meshes.BRACKET, tags={}, **({"h": H} | bad))


@pytest.mark.parametrize(
    ("other", "pattern"),
    [
        ({"path": "nowhere.step"}, r"path is .*bracket\.step' on rank 0 and 'nowhere\.step' on rank 1"),
        ({"h": -1.0}, r"h is 0\.006 on rank 0 and -1\.0 on rank 1"),
        ({"tags": {"pin": (0, 0, 1)}}, "tags is .* on rank 0 and .* on rank 1"),
    ],
)
def test_arguments_of_one_rank_only(other, pattern):
    if COMM.size == 1:
        return
    how = {"path": meshes.BRACKET, "tags": {}, "h": H} | (other if COMM.rank == 1 else {})
    with pytest.raises(MeshError, match=pattern):
        meshes.from_step(how.pop("path"), **how)
    assert COMM.allreduce(1) == COMM.size


def test_the_bracket_is_what_the_script_writes(write):
    path = write(step_shapes.add_bracket)
    written, sample = (sorted(map(str, meshes.step_faces(file))) for file in (path, meshes.BRACKET))
    assert written == sample
