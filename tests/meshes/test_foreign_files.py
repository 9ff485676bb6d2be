"""Abaqus's and Nastran's files: the same cells, bent as they should be, with their groups; and what is refused."""

import re
import warnings

from mpi4py import MPI

import gmsh
import lattice
import numpy as np
import pytest
from measures import area, moments, n_cells, n_owned, nodes_of, nodes_of_entities, volume

from flexmbd import meshes
from flexmbd.continuum.compat import cell_nodes, geometry_degree
from flexmbd.errors import MeshError

pytestmark = pytest.mark.mpi

COMM = MPI.COMM_WORLD
KINDS = [("tetrahedron", 1), ("tetrahedron", 2), ("hexahedron", 1), ("hexahedron", 2)]


@pytest.fixture
def write(shared_path):
    """Writes a text to a file on rank 0 and says where it is."""

    def write_text(text, name):
        path = shared_path / name
        if COMM.rank == 0:
            path.write_text(text)
        COMM.barrier()
        return path

    return write_text


def bent(cell, degree, program):
    """A lattice with all the terms that its cells have."""
    map = lattice.shear
    if degree == 2:
        map = lattice.bend_cubically if cell == "hexahedron" else lattice.bend
    return lattice.lattice(cell, degree, program=program, map=map)


@pytest.mark.parametrize(("cell", "degree"), KINDS)
@pytest.mark.parametrize("ending", ["inp", "bdf", "nas"])
def test_volume_and_inertia(write, cell, degree, ending):
    """Of cells bent by a known polynomial, which their nodes reproduce; a wrong order would not."""
    program = "abaqus" if ending == "inp" else "nastran"
    source = bent(cell, degree, program)
    fields = {"bdf": "fixed", "nas": "free"}.get(ending)
    text = lattice.inp(source, degree) if ending == "inp" else lattice.bdf(source, degree, fields=fields)
    groups = {"facet_groups": ["foot"]} if ending == "inp" else {}
    if ending != "inp" and degree == 2:
        # this writer gives shells to straight cells only, and interfaces are asked for
        text = text.replace("ENDDATA", shells_on_foot(source) + "ENDDATA")
    part = meshes.read(write(text, f"part.{ending}"), **groups)
    assert part.mesh.topology.cell_name() == cell
    assert geometry_degree(part.mesh) == degree
    assert n_cells(part) == len(source.cells)
    # fixed fields of 16 columns hold 10 digits
    near = 1e-9 if ending == "bdf" else 1e-12
    assert moments(part) == pytest.approx(lattice.moments(source.map), rel=near, abs=near)
    # row i of the input is the file's i-th lowest number
    ascending = source.points[np.argsort(lattice.node_numbers(len(source.points)))]
    rows = part.mesh.geometry.input_global_indices
    theirs = rows < len(ascending)  # hexahedra of 27 have nodes that the file has not
    assert part.mesh.geometry.x[theirs] == pytest.approx(ascending[rows[theirs]], abs=1e-9)
    grid = np.stack(np.meshgrid(*[np.arange(0, end + 0.1, 0.5) for end in (2, 1, 1)]), axis=-1).reshape(-1, 3)
    places = source.map(grid)
    for x in part.mesh.geometry.x[~theirs]:
        assert np.linalg.norm(places - x, axis=1).min() < 1e-8


def shells_on_foot(source):
    nodes = lattice.node_numbers(len(source.points))
    card = {"tetrahedron": "CTRIA3", "hexahedron": "CQUAD4"}[source.cell]
    lines = []
    for k, (i, number) in enumerate(source.faces(0, 0.0)):
        vertices = [source.cells[i][int(v) - 1] for v in lattice.FACES[source.cell][number - 1]]
        lines.append(f"{card},{9000 + k},8,{','.join(map(str, nodes[vertices]))}\n")
    return "".join(lines)


CHOSEN = {"cell_groups": ["left", "Right"], "facet_groups": ["foot", "end", "skin"]}


@pytest.mark.parametrize("cell", ["tetrahedron", "hexahedron"])
def test_groups_of_an_inp_file(write, cell):
    source = lattice.lattice(cell, 1, map=lattice.shear)
    part = meshes.read(write(lattice.inp(source, 1), "part.inp"), **CHOSEN)
    assert part.cell_groups.keys() == {"left", "Right"}
    assert part.facet_groups.keys() == {"foot", "end", "skin"}
    sides = lattice.shear(np.eye(3))
    face = np.linalg.norm(np.cross(sides[1], sides[2]))
    assert area(part, "foot") == pytest.approx(face, rel=1e-13)
    assert area(part, "end") == pytest.approx(face, rel=1e-13)
    assert area(part, "skin") == pytest.approx(2 * np.linalg.norm(np.cross(sides[0], sides[2])), rel=1e-13)
    back = np.linalg.inv(sides)
    for name, axis, place in (("foot", 0, 0.0), ("end", 0, 2.0), ("skin", 1, 0.0)):
        assert (nodes_of(part, name) @ back)[:, axis] == pytest.approx(place, abs=1e-12)
    x = part.mesh.geometry.x[cell_nodes(part.mesh)] @ back
    assert x[part.cells("left"), :, 0].max(initial=0) < 1 + 1e-9
    assert x[part.cells("Right"), :, 0].min(initial=2) > 1 - 1e-9
    assert n_owned(part, 3, part.cells("left")) == n_owned(part, 3, part.cells("Right")) == n_cells(part) / 2
    # sets of nodes without a whole facet, or not taken
    assert part.vertex_groups.keys() >= {"corner", "all_nodes"}
    assert n_owned(part, 0, part.vertices("corner")) == 1
    tip = nodes_of_entities(part, 0, part.vertices("corner"))
    assert tip @ back == pytest.approx(np.array([[2.0, 1, 1]] * len(tip)).reshape(-1, 3), abs=1e-12)
    assert n_owned(part, 0, part.vertices("all_nodes")) == 6


@pytest.mark.parametrize(("cell", "degree"), KINDS)
def test_each_face_of_a_cell(write, cell, degree):
    """S1, S2, ... by the vertices that the manual lists."""
    source = bent(cell, degree, "abaqus")
    number = lattice.element_numbers(len(source.cells))[0]
    text = lattice.inp(source, degree)
    labels = [f"S{i}" for i in range(1, len(lattice.FACES[cell]) + 1)]
    text += "".join(f"*SURFACE, NAME=face {s}\n{number}, {s}\n" for s in labels)
    part = meshes.read(write(text, "part.inp"), cell_groups=[], facet_groups=[f"face {s}" for s in labels])
    for label, face in zip(labels, lattice.FACES[cell], strict=True):
        expected = source.points[[source.cells[0][int(v) - 1] for v in face]]
        nodes = nodes_of(part, f"face {label}")
        every = np.concatenate(COMM.allgather(nodes))
        missing = [x for x in expected if not (np.linalg.norm(every - x, axis=1) < 1e-12).any()]
        assert missing == []
        assert n_owned(part, 2, part.facets(f"face {label}")) == 1


@pytest.mark.parametrize("cell", ["tetrahedron", "hexahedron"])
def test_groups_of_a_bdf_file(write, cell):
    source = lattice.lattice(cell, 1, program="nastran", map=lattice.shear)
    part = meshes.read(write(lattice.bdf(source, 1), "part.bdf"), scale=1e-3)
    assert part.cell_groups.keys() == {"property 3", "property 4"}
    assert part.facet_groups.keys() == {"property 8"}
    sides = lattice.shear(np.eye(3)) * 1e-3
    assert area(part, "property 8") == pytest.approx(np.linalg.norm(np.cross(sides[1], sides[2])), rel=1e-9)
    assert volume(part) == pytest.approx(2 * np.linalg.det(sides), rel=1e-9)
    x = part.mesh.geometry.x[cell_nodes(part.mesh)] @ np.linalg.inv(sides)
    assert x[part.cells("property 3"), :, 0].max(initial=0) < 1 + 1e-6
    assert x[part.cells("property 4"), :, 0].min(initial=2) > 1 - 1e-6


def test_a_part_of_an_assembly(write):
    """As Abaqus/CAE writes it: sets of the instance, and a reference point that is node 1 of its own."""
    source = lattice.lattice("hexahedron", 1, map=lattice.shear)
    text = lattice.inp(source, 1)
    head, sets = text.split("*NSET, NSET=half_end", 1)
    text = (
        head.replace("*NODE", "*Part, name=rod\n*NODE", 1)
        + "*End Part\n*Assembly, name=Assembly\n*Instance, name=rod-1, part=rod\n*End Instance\n"
        + "*Node\n986, 9., 9., 9.\n*Nset, nset=point\n986\n*NSET, INSTANCE=rod-1, NSET=half_end"
        + sets.replace("*NSET, NSET", "*NSET, INSTANCE=rod-1, NSET").replace("*MATERIAL", "*End Assembly\n*MATERIAL")
    )
    part = meshes.read(write(text, "part.inp"), **CHOSEN)
    plain = meshes.read(write(lattice.inp(source, 1), "plain.inp"), **CHOSEN)
    assert part.fingerprint() == plain.fingerprint()
    assert area(part, "end") == pytest.approx(area(plain, "end"), rel=1e-14)
    assert "point" not in part.vertex_groups


def test_the_nodes_of_a_set_of_elements(write):
    text = HEXAHEDRA.replace("*MATERIAL", "*NSET, NSET=of_left, ELSET=LEFT\n*MATERIAL")
    part = meshes.read(write(text, "part.inp"), **CHOSEN)
    assert n_owned(part, 0, part.vertices("of_left")) == 8
    whole = meshes.read(write(text, "part.inp"), cell_groups=[], facet_groups=["of_left"])
    assert n_owned(whole, 2, whole.facets("of_left")) == 5


def test_an_include_goes_to_its_folder(write, shared_path):
    text = lattice.inp(lattice.lattice("hexahedron", 1), 1)
    head, rest = text.split("*Element", 1)
    write(head, "nodes.inp")
    whole = meshes.read(write(text, "whole.inp"), **CHOSEN)
    split = meshes.read(write("*INCLUDE, INPUT=nodes.inp\n*Element" + rest, "part.inp"), **CHOSEN)
    assert split.fingerprint() == whole.fingerprint()


@pytest.mark.parametrize("ending", ["inp", "bdf"])
def test_what_gmsh_writes(shared_path, ending):
    """A bent part written by gmsh for the other program and for itself is the same mesh."""
    path, own = shared_path / f"part.{ending}", shared_path / "part.msh"
    if COMM.rank == 0:
        gmsh.initialize([], readConfigFiles=False, interruptible=False)
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.model.occ.addCylinder(0, 0, 0, 0, 0, 1, 0.5)
        gmsh.model.occ.synchronize()
        gmsh.model.addPhysicalGroup(2, [1], name="wall")
        gmsh.model.addPhysicalGroup(3, [1], name="part")
        gmsh.option.setNumber("Mesh.MeshSizeMax", 0.4)
        gmsh.option.setNumber("Mesh.SaveGroupsOfElements", 1)
        gmsh.option.setNumber("Mesh.BdfFieldFormat", 2)
        gmsh.model.mesh.generate(3)
        gmsh.model.mesh.setOrder(2)
        gmsh.write(str(path))
        gmsh.write(str(own))
        gmsh.finalize()
    COMM.barrier()
    name = {"inp": "wall", "bdf": "property 1"}[ending]
    part, same = meshes.read(path), meshes.read(own)
    assert (ending == "bdf") or set(part.cell_groups) == {"part"}
    assert n_cells(part) == n_cells(same)
    assert moments(part) == pytest.approx(moments(same), rel=1e-9, abs=1e-9)
    assert area(part, name) == pytest.approx(area(same, "wall"), rel=1e-9)


HEXAHEDRA = lattice.inp(lattice.lattice("hexahedron", 1, map=lattice.shear), 1)


@pytest.mark.parametrize(
    ("old", "new", "pattern"),
    [
        (HEXAHEDRA, "nothing", r"part\.inp: not an Abaqus input file: it has no \*NODE"),
        ("type=c3d8r", "type=c3d27", "elements of type C3D27 are not known; write C3D4, "),
        ("type=c3d8r", "type=s4", "element of type S4 needs 4 nodes"),
        ("type=c3d8r, ELSET=Right", "type=c3d6", "type C3D6 needs 6 nodes"),
        ("*Element, type=c3d8r", "*ELEMENT, TYPE=MASS", "the mesh has no three-dimensional cells"),
        ("1000, ", "4, ", "node 1000 is used and not given; the file is not complete"),
        ("993, ", "1000, ", r"node 1000 is given more than once \(1 such numbers\)"),
        ("\n8, ", "\n5, ", "element 5 is given more than once"),
        ("\n1000, 0.0", "\n1000, nan", r"1 nodes have coordinates that are not finite, the first in row 11"),
        ("\n1000, 0.0", "\n1000, zero", "could not convert string to float: 'ZERO'"),
        ("\n1000, 0.0", "\n1000", "a node needs a number and three coordinates"),
        ("\n1000, 0.0", "\n1000, 9.0", r"1 cells are inverted or flat .* the worst, number 5, near \["),
        ("*NODE,", "*NODE, SYSTEM=C,", "SYSTEM is not read"),
        ("*Heading", "*NGEN\n1, 5, 1", r"\*NGEN is not read; write out all nodes"),
        ("*Heading", "*INCLUDE, INPUT=other.inp", r"other\.inp: cannot be opened: No such file"),
        ("*Heading", "*INCLUDE, INPUT=part.inp", r"\*INCLUDE goes more than 10 files deep"),
        ("*Heading", "*PART, NAME=a\n*PART, NAME=b", "there are 2 parts and 0 instances"),
        ("*Heading", "*INSTANCE, NAME=a\n1., 0., 0.", "the instance is moved"),
        ("HALF_END,", "other,", r"\*NSET 'end' names 'other', which is not a set before it"),
        ("*ELSET, ELSET=left, ", "*ELSET, ", r"\*ELSET without a name"),
        ("_foot_S6, S6\n", "_foot_S6, S7\n", "surface 'foot' has the face 'S7'; a hexahedron has the faces S1 to S6"),
    ],
)  # fmt: skip
def test_inp_files_that_are_refused(write, old, new, pattern):
    assert old in HEXAHEDRA
    every = old.startswith("*Element")
    path = write(HEXAHEDRA.replace(old, new, -1 if every else 1) if old != HEXAHEDRA else new, "part.inp")
    with pytest.raises(MeshError, match=pattern):
        meshes.read(path, facet_groups=["foot", "end"])
    assert COMM.allreduce(1) == COMM.size


@pytest.mark.parametrize(
    ("chosen", "pattern"),
    [
        (
            {"facet_groups": ["skin", "all_nodes"]},
            r"the sets 'skin' and 'all_nodes' share 1 facets, .* facet_groups=\('skin', \.\.\.\)",
        ),
        ({"facet_groups": ["pin"]}, "no facet group 'pin'; its facet groups are: 'all_nodes', 'end', 'foot', 'skin'"),
        ({"cell_groups": ["iron"]}, "no cell group 'iron'; its cell groups are: 'Right', 'left'"),
        ({"facet_groups": "foot"}, r"facet_groups must be a list of names, .* got 'foot'"),
        ({"cell_groups": [3]}, "cell_groups must be a list of names"),
        ({"scale": 0}, "scale must be a positive"),
    ],
)
def test_choices_that_do_not_fit(write, chosen, pattern):
    path = write(HEXAHEDRA, "part.inp")
    with pytest.raises(MeshError, match=pattern):
        meshes.read(path, **({"cell_groups": ["left", "Right"]} | chosen))
    assert COMM.allreduce(1) == COMM.size


def test_sets_of_cells_that_overlap(write):
    """Asked for, they are refused; else the small ones are taken, and what they hold together is no group."""
    path = write(HEXAHEDRA + "*ELSET, ELSET=every, GENERATE\n5, 8\n", "part.inp")
    with pytest.raises(MeshError, match=r"sets 'Right' and 'every' share 1 cells, .* cell_groups=\('Right', "):
        meshes.read(path, cell_groups=["Right", "every"])
    part = meshes.read(path)
    assert part.cell_groups.keys() == {"left", "Right"}
    assert part.facet_groups.keys() == {"foot", "end", "skin"}
    assert "all_nodes" in part.vertex_groups


PREPOMAX = """*Element, Type=C3D8, Elset=Solid_part-1
5, 1, 2, 3, 4, 5, 6, 7, 8
8, 2, 9, 10, 3, 6, 11, 12, 7
*Elset, Elset=Element_Set-1
8
*Elset, Elset=Internal-1_Surface-1_S3
5, 8
*Elset, Elset=Internal-2_Surface-1_S5
5, 8
*Surface, Name=Surface-1, Type=Element
Internal-1_Surface-1_S3, S3
Internal-2_Surface-1_S5, S5
*Nset, Nset=Node_Set-1
1, 4, 5, 8
*Nset, Nset=Internal_Selection-1_Fixed-1
1, 4, 5, 8
*Nset, Nset=Gr\u00f6\u00dfe
1, 2, 5, 6, 9, 11
"""


@pytest.mark.parametrize("encoding", ["utf-8-sig", "latin-1"])
def test_sets_of_prepomax(shared_path, encoding):
    """Its helpers overlap one another, its parts and its sets; surfaces and sets of the user's are groups, untold."""
    places = {1: (0, 0, 0), 2: (1, 0, 0), 3: (1, 1, 0), 4: (0, 1, 0), 5: (0, 0, 1), 6: (1, 0, 1), 7: (1, 1, 1),
              8: (0, 1, 1), 9: (2, 0, 0), 10: (2, 1, 0), 11: (2, 0, 1), 12: (2, 1, 1)}  # fmt: skip
    text = "*Node\n" + "".join(f"{n}, {x}., {y}., {z}.\n" for n, (x, y, z) in places.items()) + PREPOMAX
    path = shared_path / "part.inp"
    if COMM.rank == 0:
        path.write_bytes(text.replace("\n", "\r\n").encode(encoding))
    COMM.barrier()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        part = meshes.read(path)
    assert part.cell_groups.keys() == {"Element_Set-1"}
    assert part.facet_groups.keys() >= {"Surface-1"}
    assert len({"Node_Set-1", "Internal_Selection-1_Fixed-1"} & part.facet_groups.keys()) == 1
    assert "Gr\u00f6\u00dfe" in part.vertex_groups  # its facets are the surface's
    assert area(part, "Surface-1") == pytest.approx(4.0, rel=1e-13)
    whole = meshes.read(path, cell_groups=["Solid_part-1"], facet_groups=["Gr\u00f6\u00dfe"])
    assert n_owned(whole, 3, whole.cells("Solid_part-1")) == 2
    assert area(whole, "Gr\u00f6\u00dfe") == pytest.approx(2.0, rel=1e-13)


def test_two_pieces(write):
    """Two cubes that do not touch: the right one has nodes of its own."""
    source = lattice.lattice("hexahedron", 1, map=lattice.shear)
    cells = np.vstack((source.cells[0], source.cells[1]))
    own = np.unique(cells[1])
    apart = np.where(np.isin(cells[1], cells[0]), len(source.points) + np.searchsorted(own, cells[1]), cells[1])
    reference = np.vstack((source.reference, source.reference[own]))
    apart = lattice.Lattice("hexahedron", reference, np.vstack((cells[0], apart)), lattice.shear)
    with pytest.raises(MeshError, match="falls into 2 pieces that share no facet: 1 cells around"):
        meshes.read(write(lattice.inp(apart, 1), "part.inp"), **CHOSEN)
    assert COMM.allreduce(1) == COMM.size


BULK = lattice.bdf(lattice.lattice("hexahedron", 1, program="nastran", map=lattice.shear), 1, fields="free")

CHEXAS = BULK[BULK.index("CHEXA") : BULK.index("CQUAD4")]


@pytest.mark.parametrize(
    ("old", "new", "pattern"),
    [
        (CHEXAS, "", r"the mesh has no three-dimensional cells, but quad"),
        (BULK, "nothing\n", r"part\.bdf: not Nastran bulk data: it has no GRID, but NOTHING"),
        ("GRID,1000,,", "GRID,1000,5,", r"coordinate system 5 is used and not given; write its CORD card"),
        ("GRID,1000,,", "GRID,1000,,x", r"GRID 1000: 'x.*' is not a number"),
        ("CHEXA,5,3,1000", "CHEXA,5,3,", r"CHEXA 5 has 7 nodes; it needs 8 or 20"),
        ("CHEXA,5,3,1000", "CHEXA,5,3,one", r"CHEXA 5: 'one' is not a whole number"),
        ("CHEXA,5,3,1000", "CHEXA,5,3,1001", r"node 1001 is used and not given; the file is not complete"),
        ("CHEXA,5,3,", "CHEXA,5,,", "CHEXA 5 has no property"),
        ("CHEXA,8,4,", "CHEXA,5,4,", "element 5 is given more than once"),
        ("GRID,1000,", "GRID,4,", r"node 1000 is used and not given"),
        ("GRID,993,", "GRID,1000,", r"node 1000 is given more than once"),
        ("MAT1,1", "=(3)\nMAT1,1", r"replication \('=\(3\)'\) is read of cards of one line"),
        ("MAT1,1", "CBAR,1,1,1,2\n=,*1,==\n=(9999999)\nMAT1,1", r"replication \('=\(9999999\)'\) is read of cards of"),
        ("MAT1,1", "+,2\nMAT1,1", "the first card begins with a continuation"),
        ("MAT1,1", "BEGIN SUPER=2\nMAT1,1", "it has 2 sections of bulk data, the second 'BEGIN SUPER=2'"),
        ("MAT1,1", "INCLUDE 'other.bdf'\nMAT1,1", r"INCLUDE 'other\.bdf' is not there: .*other\.bdf is a file"),
        ("MAT1,1", "INCLUDE 'other.bdf\nMAT1,1", "INCLUDE 'other.bdf has no second quote|has no second quote"),
        ("MAT1,1", "INCLUDE 'part.bdf'\nMAT1,1", r"INCLUDE goes in a circle: .*part\.bdf includes .*part\.bdf"),
        ("MAT1,1", "SPC1,1,123,1,2,3,4,5,6,7\nMAT1,1", "ends with 7 in the tenth field"),
        ("MAT1,1", "SPC1,1,123,9,THRU,3\nMAT1,1", "SPC 1, card 1: 9 THRU 3 BY 1 is no range"),
        ("MAT1,1", "PLOAD4,1,5,1.,,,,1000,993\nMAT1,1", "names the nodes 1000 and 993, on no face of element 5"),
        ("MAT1,1", "PLOAD4,1,77,1.,,,,1000,993\nMAT1,1", "PLOAD4 1 names element 77, which is no solid or shell"),
        ("MAT1,1", "PLOAD,1,1.,1000,993\nMAT1,1", "PLOAD 1 names 2 nodes; a face has three or four"),
        ("CQUAD4,9000,8,", "CROD,9000,8,", r"no named set on the surface of the part; .* its place: places="),
    ],
)
def test_bdf_files_that_are_refused(write, old, new, pattern):
    assert old in BULK
    text = BULK.replace(old, new, 1) if old != BULK else new
    if "CROD" in new:
        text = re.sub(r"(CROD,9000,8,\d+,\d+).*", r"\1", text)
    with pytest.raises(MeshError, match=pattern):
        meshes.read(write(text, "part.bdf"))
    assert COMM.allreduce(1) == COMM.size


def test_bulk_data_without_a_beginning(write):
    """As gmsh and others write it."""
    text = BULK[BULK.index("GRID") :].replace("ENDDATA\n", "")
    assert n_cells(meshes.read(write(text, "part.bdf"))) == 2


def test_endings_that_are_not_known(write):
    with pytest.raises(MeshError, match=r"part\.stl: files that end in \.stl are not known, only those in \.msh, "):
        meshes.read(write("solid", "part.stl"))
    with pytest.raises(MeshError, match=r"for a STEP file use from_step"):
        meshes.read(meshes.BRACKET)
    with pytest.raises(MeshError, match=r"nowhere\.inp: cannot be opened: No such file"):
        meshes.read("nowhere.inp")


def test_a_path_of_one_rank_only(write):
    if COMM.size == 1:
        return
    path = write(HEXAHEDRA, "part.inp")
    with pytest.raises(MeshError, match=r"path is '.*part\.inp' on rank 0 and 'other\.inp' on rank 1"):
        meshes.read("other.inp" if COMM.rank == 1 else path, **CHOSEN)
    assert COMM.allreduce(1) == COMM.size
