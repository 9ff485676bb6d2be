"""DMIG: pyNastran reads the matrices back, and so do we; decks of other programs; files that are none."""

import re

import numpy as np
import pytest
from exported_bodies import damped_rod, floating_bar, small_body, soft_bar
from mutations import survive

import flexmbd as fm
from flexmbd.errors import ExportError
from flexmbd.export import InterfaceNode
from flexmbd.export.superelements.dmig_file import wide

WHY = "no pyNastran: pip install --no-deps pyNastran cpylog docopt-ng"


@pytest.mark.parametrize("make", [soft_bar, damped_rod, floating_bar])
def test_pynastran_reads_grids_points_and_matrices(tmp_path, make):
    bdf = pytest.importorskip("pyNastran.bdf.bdf", reason=WHY)
    element = fm.export.superelement(make())
    fm.export.dmig(make(), tmp_path / "part.pch", first=101)
    deck = bdf.BDF(debug=None)
    deck.read_bdf(str(tmp_path / "part.pch"), xref=False, punch=True)
    b, m = len(element.names), element.n_modes
    places = np.array([deck.nodes[101 + i].xyz for i in range(b)])
    np.testing.assert_allclose(places, element.p, rtol=1e-10, atol=1e-12)
    assert sorted(deck.spoints) == list(range(101 + b, 101 + b + m))
    dofs = [(101 + i, c) for i in range(b) for c in range(1, 7)] + [(101 + b + i, 0) for i in range(m)]
    matrices = {"KAAX": element.K, "MAAX": element.M, "BAAX": element.D}
    assert set(deck.dmigs) == {name for name, matrix in matrices.items() if np.any(matrix)}
    for name, card in deck.dmigs.items():
        found, rows, columns = card.get_matrix(is_sparse=False, apply_symmetry=True)
        wanted = matrices[name][np.ix_([dofs.index(rows[i]) for i in rows], [dofs.index(columns[i]) for i in columns])]
        np.testing.assert_allclose(found, wanted, rtol=1e-10, atol=0.0)


def test_numbers_fill_their_fields():
    random = np.random.default_rng(0)
    values = random.normal(size=4000) * 10.0 ** random.integers(-90, 90, size=4000)
    for value in [*values.tolist(), 1.0, -1.0, 1e15, 123456.7890123456, -1e-300, 1e300, 0.0]:
        text = wide(value)
        mantissa, exponent = re.fullmatch(r"([+-]?\d+\.\d*)([+-]\d+)?", text).groups()
        assert len(text) <= 16
        assert abs(float(f"{mantissa}e{exponent or 0}") - value) <= 1e-10 * abs(value)


HEAD = f"""\
SOL 103
BEGIN BULK
$ a free bar between two points, its modes are the points from 50 on
GRID,7,,0.0,0.0,0.0
{"GRID":8}{9:8}{"":8}{"+2.":>8}{"0.-1":8}{"0.D+2":>8}
{"SPOINT":8}{50:8}"""


def by_hand(tmp_path, **changes):
    """A deck of another program's style around the matrices of a body."""
    element = fm.export.superelement(soft_bar())
    lines = HEAD.splitlines()
    dofs = [(node, c) for node in (7, 9) for c in range(1, 7)] + [(50 + i, 0) for i in range(element.n_modes)]
    for name, matrix in {"KX": element.K, "MX": element.M}.items():
        lines.append(f"DMIG    {name:8s}{0:8d}{1:8d}{2:8d}{0:8d}")
        for j, column in enumerate(dofs):
            values = [(row, float(matrix[i, j])) for i, row in enumerate(dofs) if matrix[i, j] != 0.0]
            for (node, c), value in values:
                lines.append(f"DMIG*,{name},{column[0]},{column[1]},,")
                lines.append(f"*,{node},{c},{value!r},")
    text = "\n".join([*lines, "ENDDATA"])
    for old, new in changes.get("replace", []):
        assert old in text
        text = text.replace(old, new)
    (tmp_path / "foreign.bdf").write_text(text)
    return tmp_path / "foreign.bdf"


def test_a_deck_of_another_style(tmp_path):
    bar, path = soft_bar(), by_hand(tmp_path)
    ends = {"left": InterfaceNode((0.0, 0.0, 0.0), 7), "right": InterfaceNode((1.0, 0.0, 0.0), 9)}
    body = fm.export.read_dmig(path, interfaces=ends, frame="right")
    assert [frame.name for frame in body.interfaces] == ["left", "right"]
    np.testing.assert_allclose(body.frequencies(), bar.frequencies(), rtol=1e-9)
    np.testing.assert_allclose(body.frequencies(["left"]), bar.frequencies(["x_min"]), rtol=1e-9)
    np.testing.assert_allclose(body.com, [-0.5, 0.0, 0.0], atol=1e-9)


def test_positions_and_names_from_the_grids(tmp_path):
    path = by_hand(tmp_path, replace=[("+2.", "+1.")])
    body = fm.export.read_dmig(path, frame="")
    assert [frame.name for frame in body.interfaces] == ["grid 7", "grid 9"]
    assert body.frame is None
    np.testing.assert_allclose(body.p_MB_M, [0.5, 0.0, 0.0], atol=1e-9)


@pytest.mark.parametrize(
    ("old", "new", "match"),
    [
        ("GRID,7,,0.0", "GRID,7,4,0.0", "coordinate system 4 is used and not given"),
        ("GRID,7,,0.0", "GRID,7,,nan", "line 4: GRID 7: 'nan' is not a number"),
        ("GRID,7,,0.0,0.0,0.0\n", "", "not the square|of no interface|no matrix entries"),
        (f"{'DMIG':8}{'MX':8}{0:8}{1:8}", f"{'DMIG':8}{'MX':8}{0:8}{9:8}", "form 9"),
        ("MX", "XX", "begins with M"),
        ("DMIG*,KX,7,1,,\n*,7,1,", "DMIG*,KX,7,1,,\n*,7,8,", "component 8 of GRID 7"),
        ("DMIG*,KX,7,1,,\n*,7,1,", "DMIG*,KX,-7,1,,\n*,7,1,", "component 1 of node -7: there are no negative"),
    ],
)
def test_decks_that_do_not_fit(tmp_path, old, new, match):
    path = by_hand(tmp_path, replace=[("+2.", "+1."), (old, new)])
    with pytest.raises(ExportError, match=match):
        fm.export.read_dmig(path)


def test_a_foreign_position_that_is_wrong_is_found(tmp_path):
    with pytest.raises(ExportError, match="resists rigid motions"):
        fm.export.read_dmig(by_hand(tmp_path))  # its second grid lies at x = 2 m, the bar ends at 1 m


def test_arguments(tmp_path):
    with pytest.raises(ExportError, match="numbers from 99999999 on do not fit"):
        fm.export.dmig(soft_bar(), tmp_path / "x.pch", first=99_999_999)
    assert not (tmp_path / "x.pch").exists()
    fm.export.dmig(soft_bar(), tmp_path / "x.pch")
    with pytest.raises(ExportError, match="no interface 'nose' for the body frame"):
        fm.export.read_dmig(tmp_path / "x.pch", frame="nose")
    with pytest.raises(ExportError, match="no matrix entries of interface 'a', GRID 77"):
        fm.export.read_dmig(tmp_path / "x.pch", interfaces={"a": InterfaceNode((0, 0, 0), 77)})


def test_damaged_files(tmp_path):
    fm.export.dmig(small_body(), tmp_path / "part.pch")
    data = (tmp_path / "part.pch").read_bytes()
    bodies = survive(fm.export.read_dmig, tmp_path / "x.pch", data, count=2000)
    assert bodies < 1000


def small(text):
    return text.lower()


def tabs(text):
    return text.replace("GRID,7,,0.0,0.0,0.0", "GRID\t7\t\t0.0\t0.0\t0.0")


def named(text):
    """Each continuation called by its card, and all of them behind the last card."""
    heads, tails = [], []
    for line in text.splitlines():
        if line.startswith("*,"):
            tails.append(line.replace("*,", f"*C{len(tails)},", 1))
            heads[-1] = heads[-1][:-1] + f",*C{len(tails) - 1}"
        elif line != "ENDDATA":
            heads.append(line)
    return "\n".join([*heads, *tails])


def called_what_no_card_says(text):
    """A column a card, all continuations of one name, which none of their cards ends with."""
    lines, column = [], ""
    for line in text.splitlines():
        if line != column:
            lines.append(line.replace("*,", "*K,") if line.startswith("*,") else line)
        column = line if line.startswith("DMIG*") else column
    return "\n".join(lines)


def sections(text):
    """The points' section of a superelement, and the matrices' behind it."""
    at = text.index("DMIG")
    return f"{text[:at]}ENDDATA\nBEGIN SUPER=4\n{text[at:]}"


def below_results(text):
    """Results that were punched to the same file, and no other section."""
    rows = [f"{node:10d}       G      {0.5:13.6E}     {0.25:13.6E}     {0.0:13.6E}{node:8d}\n" for node in (7, 9)]
    return "$TITLE   =\n$DISPLACEMENTS\n" + "-CONT-\n".join(rows) + text[text.index("GRID,7") :]


WAYS = (small, tabs, named, called_what_no_card_says, sections, below_results)


@pytest.mark.parametrize("way", WAYS)
def test_every_way_of_writing_is_the_same_body(tmp_path, way):
    plain = by_hand(tmp_path, replace=[("+2.", "+1.")])
    path = tmp_path / "other.pch"
    path.write_text(way(plain.read_text()))
    found, wanted = fm.export.read_dmig(path), fm.export.read_dmig(plain)
    assert np.array_equal(found.gram, wanted.gram)
    assert np.array_equal(found.stiffness, wanted.stiffness)


def test_matrices_in_a_file_that_the_deck_includes(tmp_path):
    """And what is wrong there is said with that file and its line."""
    plain = by_hand(tmp_path, replace=[("+2.", "+1.")])
    text = plain.read_text()
    at = text.index("DMIG")
    (tmp_path / "matrices.pch").write_text(text[at:].replace("ENDDATA", ""))
    (tmp_path / "deck.bdf").write_text(f"{text[:at]}INCLUDE 'matrices.pch'\n$\nGRID,3,,none\nENDDATA\n")
    with pytest.raises(ExportError, match=r"deck\.bdf: line 9: GRID 3: 'none' is not a number"):
        fm.export.read_dmig(tmp_path / "deck.bdf")
    (tmp_path / "deck.bdf").write_text(f"{text[:at]}INCLUDE 'matrices.pch'\nENDDATA\n")
    found, wanted = fm.export.read_dmig(tmp_path / "deck.bdf"), fm.export.read_dmig(plain)
    assert np.array_equal(found.stiffness, wanted.stiffness)
    (tmp_path / "matrices.pch").write_text("$\nDMIG,KX,0,6,2,0\nDMIG,KX,7,1,,7,1,1.,,5\n")
    with pytest.raises(ExportError, match=r"deck\.bdf: .*matrices\.pch, line 3: DMIG KX: its line ends with 5"):
        fm.export.read_dmig(tmp_path / "deck.bdf")
