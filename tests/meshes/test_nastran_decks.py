"""Nastran's decks as they are met: every way of writing is the same mesh, and sets of all cards are groups."""

import warnings

from mpi4py import MPI

import dolfinx
import lattice
import numpy as np
import pytest
from measures import area, moments, n_cells, n_owned, nodes_of, volume

from flexmbd import meshes
from flexmbd.errors import MeshError, MeshWarning
from flexmbd.files.bulk_cards import read_bulk

pytestmark = pytest.mark.mpi

COMM = MPI.COMM_WORLD

PLACES = {
    1: (0, 0, 0), 2: (1, 0, 0), 3: (1, 1, 0), 4: (0, 1, 0), 5: (0, 0, 1), 6: (1, 0, 1), 7: (1, 1, 1), 8: (0, 1, 1),
    9: (2, 0, 0), 10: (2, 1, 0), 11: (2, 0, 1), 12: (2, 1, 1),
}  # fmt: skip
CELLS = {1: (1, 2, 3, 4, 5, 6, 7, 8), 2: (2, 9, 10, 3, 6, 11, 12, 7)}
SHELL = "CQUAD4        90       9       1       4       8       5\n"
GRIDS = "".join(f"GRID    {n:8d}        {x:8.4f}{y:8.4f}{z:8.4f}\n" for n, (x, y, z) in PLACES.items())
SOLIDS = "".join(
    f"CHEXA   {e:8d}{1:8d}" + "".join(f"{n:8d}" for n in nodes[:6]) + "+       \n+       "
    + "".join(f"{n:8d}" for n in nodes[6:]) + "\n"
    for e, nodes in CELLS.items()
)  # fmt: skip


def deck(bulk):
    return f"SOL 103\nCEND\n  SUBCASE 1\n    SPC = 1\nBEGIN BULK\n{bulk}ENDDATA\n"


@pytest.fixture
def write(shared_path):
    """Writes a text to a file on rank 0 and says where it is."""

    def write_text(text, name="part.bdf", encoding="utf-8"):
        path = shared_path / name
        if COMM.rank == 0:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(text.encode(encoding))
        COMM.barrier()
        return path

    return write_text


def apart():
    """Each continuation far from its card, before or behind it, as in decks that were sorted."""
    each = [(e, [f"{n:8d}" for n in nodes]) for e, nodes in CELLS.items()]
    heads = [f"CHEXA   {e:8d}{1:8d}{''.join(nodes[:6])}+C{e:<6d}\n" for e, nodes in each]
    tails = [f"+C{e:<6d}{''.join(nodes[6:])}\n" for e, nodes in each]
    return tails[0] + "".join(heads) + SHELL + GRIDS + tails[1]


def wide(mark="*"):
    return "".join(
        f"CHEXA*  {e:16d}{1:16d}{a[0]:16d}{a[1]:16d}{mark}\n{mark:<8s}{a[2]:16d}{a[3]:16d}{a[4]:16d}{a[5]:16d}{mark}\n"
        f"{mark:<8s}{a[6]:16d}{a[7]:16d}\n"
        for e, a in CELLS.items()
    )


WAYS = {
    "zeros left blank": SHELL + SOLIDS + "".join(
        f"GRID    {n:8d}{'':8s}" + "".join(f"{v:8.3f}" if v else " " * 8 for v in p) + "\n" for n, p in PLACES.items()
    ),
    "free fields": SHELL
    + "".join(f"GRID,{n},," + ",".join(f"{v}." if v else "" for v in p) + "\n" for n, p in PLACES.items())
    + "".join(f"CHEXA,{e},1,{','.join(map(str, a[:6]))}\n,{','.join(map(str, a[6:]))}\n" for e, a in CELLS.items()),
    "wide free fields": SOLIDS + SHELL
    + "".join(f"GRID*,{n},,{x}.,{y}.,*\n*,{z}.\n" for n, (x, y, z) in PLACES.items()),
    "comments": "$ a comment: CHEXA\n" + (SHELL + GRIDS).replace("\n", " $ node, with a comma\n\n") + SOLIDS,
    "tabs": SHELL + SOLIDS
    + "".join(f"GRID\t{n}\t\t{x:.3f}\t{y:.3f}\t{z:.3f}\n" for n, (x, y, z) in PLACES.items()),
    "apart": apart(),
    "lines of more than ten fields": SHELL + GRIDS + "".join(f"CHEXA,{e},1,{str(a)[1:-1]}\n" for e, a in CELLS.items()),
    "replicated": SHELL + SOLIDS + "".join(
        f"GRID,{a},,{x}.,0.,{z}.\n=,*({b - a}),=,=,*1.,==\n"
        for a, b, x, z in ((1, 4, 0, 0), (5, 8, 0, 1), (2, 3, 1, 0), (6, 7, 1, 1))
    ) + "GRID    9               2.      0.      0.\n=       *(2)    =       =       =       *1.\n"
    + "GRID,10,,2.,1.,0.\n=,*2,=,=,=,*(1.)\n",
    "named but for the first letter": apart().replace("+C1     ", "+1").replace("+C2     ", "+2").replace("+C", "C"),
    "wide": SHELL + GRIDS + wide(),
    "wide, with names": SHELL + GRIDS + wide("*A"),
    "small letters": (SHELL + GRIDS + SOLIDS).lower(),
    "nothing at the end of a line": SHELL + GRIDS + SOLIDS.replace("+       \n+       ", "\n        "),
    "exponents": SHELL + SOLIDS + "".join(
        f"GRID,{n},,{10 * x}.-1,{y}.D+0,{z / 10}e1\n" for n, (x, y, z) in PLACES.items()
    ),
}  # fmt: skip


@pytest.mark.parametrize("way", WAYS)
def test_every_way_of_writing_is_the_same_mesh(write, way):
    part = meshes.read(write(deck(WAYS[way])))
    plain = meshes.read(write(deck(SHELL + GRIDS + SOLIDS), "plain.bdf"))
    assert part.fingerprint() == plain.fingerprint()
    assert part.facet_groups.keys() == {"property 9"}
    assert area(part, "property 9") == pytest.approx(1.0, rel=1e-13)
    assert volume(part) == pytest.approx(2.0, rel=1e-13)


@pytest.mark.parametrize(
    ("encoding", "end"), [("utf-8-sig", "\n"), ("utf-8", "\r\n"), ("utf-8", "\r"), ("latin-1", "\n")]
)
def test_text_of_any_system(write, encoding, end):
    """A byte 0x85 in a comment is an ellipsis of Windows, and ends a line for Python only."""
    text = deck("$ D\u00fcse \x85CHEXA,7,1,1\n" + SHELL + GRIDS + SOLIDS).replace("\n", end)
    assert volume(meshes.read(write(text, encoding=encoding))) == pytest.approx(2.0, rel=1e-13)


def in_system(points, kind, origin, axes):
    """Points of the basic system in another one, angles in degrees."""
    local = (np.asarray(points) - origin) @ axes
    x, y, z = local.T
    if kind == "R":
        return local
    around = np.degrees(np.arctan2(y, x))
    if kind == "C":
        return np.column_stack((np.hypot(x, y), around, z))
    r = np.linalg.norm(local, axis=1)
    return np.column_stack((r, np.degrees(np.arccos(z / r)), around))


@pytest.mark.parametrize("kind", "RCS")
@pytest.mark.parametrize("by", ["points", "points in another system", "nodes"])
def test_coordinate_systems(write, kind, by):
    """Nodes in a system askew, by CP or by GRDSET, are where they are in the basic one."""
    origin = np.array([-0.7, 0.4, -0.9])
    z = np.array([1.0, 2.0, 2.0]) / 3.0
    y = np.cross(z, [1.0, 0.0, 0.0])
    y /= np.linalg.norm(y)
    axes = np.column_stack((np.cross(y, z), y, z))
    three = np.array([origin, origin + 2.0 * z, origin + 0.5 * z + 3.0 * axes[:, 0]])
    if by == "nodes":
        lines = [f"CORD1{kind},7,101,102,103"]
        # node 103 in a cylindrical system of its own
        lines += [f"GRID,{101 + i},0,{','.join(f'{v:.12f}' for v in three[i])}" for i in range(2)]
        flat = in_system(three[2:], "C", np.zeros(3), np.eye(3))[0]
        lines += ["CORD2C,8,0,0.,0.,0.,0.,0.,1.\n,1.,0.,0.", f"GRID,103,8,{','.join(f'{v:.12f}' for v in flat)}"]
    else:
        of, points = 0, three
        lines = []
        if by == "points in another system":
            lines = ["CORD2R,5,,1.,2.,3.,2.,2.,3.\n,1.,3.,3."]
            turned = np.column_stack(([0.0, 1, 0], [0, 0, 1], [1, 0, 0]))  # its axes: y, z, x
            of, points = 5, (three - (1.0, 2.0, 3.0)) @ turned
        flat = [f"{v:.12f}" for v in points.reshape(-1)]
        lines.append(f"CORD2{kind},7,{of},{','.join(flat[:6])}\n,{','.join(flat[6:])}")
    local = in_system(list(PLACES.values()), kind, origin, axes)
    blank = kind != "S"  # GRDSET's, or each node's own
    cp = "" if blank else "7"
    lines += [f"GRID,{n},{cp},{','.join(f'{v:.12f}' for v in x)}" for n, x in zip(PLACES, local, strict=True)]
    lines += ["GRDSET,,7"] if blank else []
    part = meshes.read(write(deck(SHELL + SOLIDS + "\n".join(lines) + "\n")))
    expected = np.array(list(PLACES.values()), dtype=float)
    rows = part.mesh.geometry.input_global_indices
    assert part.mesh.geometry.x == pytest.approx(expected[rows], abs=1e-10)


def test_systems_that_hang_on_themselves(write):
    text = "CORD2R,1,2,0.,0.,0.,0.,0.,1.\n,1.,0.,0.\nCORD2R,2,1,0.,0.,0.,0.,0.,1.\n,1.,0.,0.\nGRDSET,,1\n"
    with pytest.raises(MeshError, match=r"coordinate system 1 hangs on itself, by \[1, 2\]"):
        meshes.read(write(deck(text + SHELL + GRIDS + SOLIDS)))
    line = "CORD2R,1,,0.,0.,0.,0.,0.,1.\n,0.,0.,3.\nGRDSET,,1\n"
    with pytest.raises(MeshError, match="the three points of CORD2R 1 lie on a line"):
        meshes.read(write(deck(line + SHELL + GRIDS + SOLIDS)))


@pytest.mark.parametrize(("old", "new"), [("nan", "not a number"), ("1e999", "too large a number")])
def test_places_that_are_no_numbers(write, old, new):
    """Numpy takes these."""
    with pytest.raises(MeshError, match=rf"part\.bdf: line 23: GRID 99: '{old}' is {new}"):
        meshes.read(write(deck(SHELL + GRIDS + SOLIDS + f"GRID,99,,0.,{old},1.\n")))


def test_files_within_files(write):
    """Beside the file that names them, beside the first one, over several lines, from before BEGIN BULK too."""
    write(SHELL, "model/parts/shells.bdf")
    write("INCLUDE 'shells.bdf'\ninclude \"model/solids.bdf\"  $ of the first one's folder\n", "model/parts/all.bdf")
    write(SOLIDS, "model/solids.bdf")
    write(f"BEGIN BULK\n{GRIDS}INCLUDE 'model/\n  parts/\nall.bdf'\n", "rest.bdf")
    path = write("SOL 101\nCEND\nINCLUDE rest.bdf\nENDDATA\nCHEXA,1,1\n")
    assert volume(meshes.read(path)) == pytest.approx(2.0, rel=1e-13)
    write("INCLUDE '../part.bdf'\n", "model/solids.bdf")
    circle = r"INCLUDE goes in a circle: .*part\.bdf includes .*solids\.bdf includes .*part\.bdf"
    with pytest.raises(MeshError, match=circle):
        meshes.read(path)


SETS = {
    "SPC1,1,123456,1,4,5,8\nSPC1,1,3,9999": "SPC 1",
    "SPC,1,4,123,,5,3,.01\nSPC,1,1,123\nSPC,1,8,123": "SPC 1",
    "SET1,4,1,THRU,1,4,5,8": "SET1 4",
    "SET3,6,GRID,4,5,8,1": "SET3 6",
    "RBE2,50,99,123456,1,4,5,8,1.2-5\nGRID,99,,-.5,0.5,0.5": "RBE2 50",
    "RBE3,51,,99,123456,1.0,123,1,4,+\n+,2.0,123,5,8,UM,1,123\nGRID,99,,-.5,0.5,0.5": "RBE3 51",
    "PLOAD4,3,1,1.0,,,,1,8": "PLOAD4 3",
    "PLOAD4,3,1,1.0,,,,5,4": "PLOAD4 3",
    "CQUAD4,90,9,1,4,8,5\nPLOAD4,3,90,1.0": "PLOAD4 3",
    "CQUAD4,90,9,1,4,8,5\nPLOAD4,3,88,1.0,,,,THRU,999999999": "PLOAD4 3",
    "CQUAD4,90,9,1,4,8,5\nPLOAD2,3,1.0,90": "PLOAD2 3",
    "PLOAD,3,1.0,1,4,8,5": "PLOAD 3",
}


@pytest.mark.parametrize("cards", SETS)
def test_sets_are_groups(write, cards):
    part = meshes.read(write(deck(GRIDS + SOLIDS + cards + "\n")), facet_groups=[SETS[cards]])
    assert area(part, SETS[cards]) == pytest.approx(1.0, rel=1e-13)
    assert abs(nodes_of(part, SETS[cards])[:, 0]).max(initial=0.0) < 1e-15


def test_replicated_cards(write):
    """The manual's example: five nodes from two lines and a repeat."""
    text = "GRID,101,,1.0,10.5,,17,3456\n=,*(1),=,*(0.2),==\n=(3)\nSET1,4,101,THRU,105\nCTETRA,1,1,1,2,3,5\n"
    source = read_bulk(write(text), wanted=("GRID", "SET1")).cards
    assert [fields[0] for fields in source["GRID"]] == ["101", "102", "103", "104", "105"]
    assert [float(fields[2]) for fields in source["GRID"]] == pytest.approx([1.0, 1.2, 1.4, 1.6, 1.8], rel=1e-15)
    assert all(fields[3:7] == ["10.5", "", "17", "3456"] for fields in source["GRID"])


def test_sets_that_claim_any_number(write):
    """A range of 10^9 numbers costs what is in the deck."""
    cards = "SPC1,1,123,1,THRU,999999999\nSPC1,2,123,2,THRU,999999998,BY,2\n"
    part = meshes.read(write(deck(SHELL + GRIDS + SOLIDS + cards)))
    assert n_owned(part, 0, part.vertices("SPC 1")) == 12
    assert n_owned(part, 0, part.vertices("SPC 2")) == 6


@pytest.mark.parametrize("face", range(5))
def test_faces_of_wedges_and_pyramids_by_pressures(write, face):
    base = "GRID,1,,0.,0.,0.\nGRID,2,,3.,0.,0.\nGRID,3,,0.,4.,0.\n"
    grids = base + "GRID,4,,0.,0.,1.\nGRID,5,,3.,0.,1.\nGRID,6,,0.,4.,1.\n"
    named, expected = [("1,", 6.0), ("5,", 6.0), ("1,5", 3.0), ("3,5", 5.0), ("6,1", 4.0)][face]
    text = deck(f"{grids}CPENTA,1,1,1,2,3,4,5,6\nPLOAD4,2,1,1.0,,,,{named}\n")
    assert area(meshes.read(write(text), tetrahedra=True), "PLOAD4 2") == pytest.approx(expected, rel=1e-13)
    grids = "GRID,1,,0.,0.,0.\nGRID,2,,3.,0.,0.\nGRID,3,,3.,4.,0.\nGRID,4,,0.,4.,0.\nGRID,5,,0.,0.,12.\n"
    sides = [("1,3", 12.0), ("1,2", 18.0), ("3,2", 2 * np.hypot(3, 12)), ("3,4", 1.5 * np.hypot(4, 12)), ("4,1", 24.0)]
    named, expected = sides[face]
    text = deck(f"{grids}CPYRAM,1,1,1,2,3,4,5\nPLOAD4,2,1,1.0,,,,{named}\n")
    assert area(meshes.read(write(text), tetrahedra=True), "PLOAD4 2") == pytest.approx(expected, rel=1e-13)


EDGES = {  # in Nastran's order of the middles
    "CTETRA": ("01", "12", "02", "03", "13", "23"),
    "CPENTA": ("01", "12", "20", "03", "14", "25", "34", "45", "53"),
    "CPYRAM": ("01", "12", "23", "30", "04", "14", "24", "34"),
    "CHEXA": lattice.HEXAHEDRON_EDGES["nastran"],
}


def cube_of(kind, i):
    """The cells (card, vertices) of the i-th unit cube along x."""
    corners = [tuple(np.add(c, (i, 0, 0)).tolist()) for c in lattice.AROUND]
    if kind == "CHEXA":
        return [(kind, corners)]
    if kind == "CPENTA":
        return [(kind, [corners[k] for k in rows]) for rows in ((0, 1, 2, 4, 5, 6), (0, 2, 3, 4, 6, 7))]
    middle = (i + 0.5, 0.5, 0.5)
    sides = ("0321", "4567", "0154", "1265", "2376", "3047")
    return [(kind, [*(corners[int(k)] for k in side), middle]) for side in sides]


def mixed_deck(cells, *, degree, bend, lacking=()):
    """A deck of cells bent by a map; `lacking` are the places of nodes in a cell that are left out."""
    numbers, lines = {}, []
    for number, (card, corners) in enumerate(cells, start=1):
        places = [tuple(map(float, x)) for x in corners]
        if degree == 2:
            places += [tuple(np.mean([places[int(a)], places[int(b)]], axis=0).tolist()) for a, b in EDGES[card]]
        nodes = [numbers.setdefault(x, len(numbers) + 1) for x in places]
        fields = [card, number, 1, *("" if k in lacking else node for k, node in enumerate(nodes))]
        rows = [fields[:9], *(["", *fields[at : at + 8]] for at in range(9, len(fields), 8))]
        lines += [",".join(map(str, row)) for row in rows]
    for place, number in numbers.items():
        x = bend(np.array([place]))[0]
        lines.append(f"GRID,{number},,{','.join(f'{v:.15g}' for v in x)}")
    end = [number for place, number in numbers.items() if place[0] == 2.0]
    lines += ["SPC1,1,123456," + ",\n,".join(",".join(map(str, end[i : i + 5])) for i in range(0, len(end), 5))]
    return "\n".join(lines) + "\n"


MIXED = [("CHEXA", "CHEXA"), ("CPENTA", "CPENTA"), ("CPYRAM", "CPYRAM"), ("CHEXA", "CPYRAM"), ("CPENTA", "CPYRAM")]


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("kinds", MIXED)
def test_cells_of_all_kinds_are_cut_into_tetrahedra(write, kinds, degree):
    """Bent by a map that tetrahedra of their degree follow exactly: nothing is lost, and neighbours fit."""
    cells = [cell for i, kind in enumerate(kinds) for cell in cube_of(kind, i)]
    bend = lattice.bend if degree == 2 else lattice.shear
    part = meshes.read(write(deck(mixed_deck(cells, degree=degree, bend=bend))), tetrahedra=True)
    assert part.mesh.topology.cell_name() == "tetrahedron"
    assert moments(part) == pytest.approx(lattice.moments(bend), rel=1e-12, abs=1e-12)
    per = {"CHEXA": 6, "CPENTA": 3, "CPYRAM": 2}
    assert n_cells(part) == sum(per[card] for card, _ in cells)
    part.mesh.topology.create_connectivity(2, 3)
    outer = dolfinx.mesh.exterior_facet_indices(part.mesh.topology)
    assert n_owned(part, 2, outer) == 20  # two triangles on each of the ten squares
    assert n_owned(part, 2, part.facets("SPC 1")) == 2


def test_several_kinds_are_refused_with_a_remedy(write):
    path = write(deck(mixed_deck(cube_of("CHEXA", 0) + cube_of("CPENTA", 1), degree=1, bend=lattice.shear)))
    with pytest.raises(
        MeshError, match=r"hexahedron of 8 nodes, prism of 6 nodes; .* tetrahedra=True cuts all .*; solids=\(\.\.\.\)"
    ):
        meshes.read(path)
    assert COMM.allreduce(1) == COMM.size


@pytest.mark.parametrize("cards", [("CHEXA",), ("CPYRAM", "CPENTA")])
def test_middles_that_are_left_out_lie_halfway(write, cards):
    cells = cube_of(cards[0], 0) + cube_of(cards[-1], 1)
    path = write(deck(mixed_deck(cells, degree=2, bend=lattice.shear, lacking=(9, 11))))
    part = meshes.read(path, tetrahedra=len(cards) > 1)
    assert moments(part) == pytest.approx(lattice.moments(lattice.shear), rel=1e-12, abs=1e-12)


def test_what_stands_beside_solids_is_told(write):
    off = "CQUAD4,91,8,20,21,22,23\nGRID,20,,5.,0.,0.\nGRID,21,,5.,1.,0.\nGRID,22,,5.,1.,1.\nGRID,23,,5.,0.,1.\n"
    path = write(deck(SHELL + off + "CBAR,300,5,1,2,0.,0.,1.\nCONM2,301,3,,5.\n" + GRIDS + SOLIDS))
    expected = r"beside the solids there are 1 CBAR, 1 CONM2, 1 shells that lie on no solid \(of 'property 8'\), which"
    if COMM.rank == 0:
        with pytest.warns(MeshWarning, match=expected):
            part = meshes.read(path)
    else:
        part = meshes.read(path)
    assert part.facet_groups.keys() == {"property 9"}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        meshes.read(path, solids=["property 1"])


def test_one_of_several_pieces(write):
    """The larger one is the first; a set of solids is another way to choose."""
    far = {20 + n: (x + 5, y, 2 * z) for n, (x, y, z) in PLACES.items() if n <= 8}
    more = "".join(f"GRID,{n},,{x}.,{y}.,{z}.\n" for n, (x, y, z) in far.items())
    more += "CHEXA,9,2,21,22,23,24,25,26\n,27,28\nSPC1,1,123,21,THRU,24\n"
    path = write(deck(SHELL + GRIDS + SOLIDS + more))
    with pytest.raises(MeshError, match=r"falls into 2 pieces .*: 2 cells around .*, 1 cells around .*; take one of"):
        meshes.read(path)
    assert volume(meshes.read(path, piece=1)) == pytest.approx(2.0, rel=1e-13)
    second, same = meshes.read(path, piece=2), meshes.read(path, solids=["property 2"])
    assert second.facet_groups.keys() == same.facet_groups.keys() == {"SPC 1"}
    assert volume(second) == pytest.approx(2.0, rel=1e-13)
    assert second.fingerprint() == same.fingerprint()
    assert n_cells(second) == 1
    with pytest.raises(MeshError, match="piece is 3, and the mesh falls into 2 pieces"):
        meshes.read(path, piece=3)
    with pytest.raises(MeshError, match="no cell group 'property 7'; its cell groups are: 'property 1', 'property 2'"):
        meshes.read(path, solids=["property 7"])


@pytest.mark.parametrize(
    ("old", "new", "pattern"),
    [
        (",17,18,19", ",18,17,19", r"edges have two nodes in their middle, one of them \d+ and \d+"),
        (",17,18,19", ",1,18,19", "two nodes in their middle|node 1 is in the middle of an edge and a corner"),
    ],
)
@pytest.mark.parametrize("tetrahedra", [False, True])
def test_middles_in_another_order(write, tetrahedra, old, new, pattern):
    """They would end the process in DOLFINx."""
    cells = cube_of("CHEXA", 0) + cube_of("CHEXA", 1)
    text = mixed_deck(cells, degree=2, bend=lattice.shear)
    assert old in text
    with pytest.raises(MeshError, match=pattern):
        meshes.read(write(deck(text.replace(old, new))), tetrahedra=tetrahedra)
    assert COMM.allreduce(1) == COMM.size
