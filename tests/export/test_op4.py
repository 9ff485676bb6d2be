"""OP4: pyNastran reads every number back exactly, and so do we; files that are none."""

import numpy as np
import pytest
from exported_bodies import damped_rod, floating_bar, small_body, soft_bar
from mutations import survive

import flexmbd as fm
from flexmbd.errors import ExportError
from flexmbd.export import InterfaceNode

WHY = "no pyNastran: pip install --no-deps pyNastran cpylog docopt-ng"


@pytest.mark.parametrize("make", [soft_bar, damped_rod, floating_bar])
def test_pynastran_reads_the_same_numbers(tmp_path, make):
    op4 = pytest.importorskip("pyNastran.op4.op4", reason=WHY)
    element = fm.export.superelement(make())
    fm.export.op4(make(), tmp_path / "part.op4")
    matrices = op4.OP4(debug=False).read_op4(str(tmp_path / "part.op4"))
    wanted = {"KAAX": element.K, "MAAX": element.M, "PAAX": element.p}
    if np.any(element.D):
        wanted["BAAX"] = element.D
    assert set(matrices) == {*wanted, "QAAX", "NAAX"}
    for name, matrix in wanted.items():
        np.testing.assert_array_equal(matrices[name].data, np.where(abs(matrix) > 1e-99, matrix, 0.0))
        assert matrices[name].form == (2 if name == "PAAX" else 6)


def test_pynastrans_own_file_is_read(tmp_path):
    op4 = pytest.importorskip("pyNastran.op4.op4", reason=WHY)
    bar = soft_bar()
    element = fm.export.superelement(bar)
    written = {"KAA": (6, element.K), "MAA": (6, element.M)}
    op4.OP4(debug=False).write_op4(str(tmp_path / "other.op4"), written, name_order=["KAA", "MAA"], is_binary=False)
    ends = {name: InterfaceNode(p) for name, p in zip(element.names, element.p, strict=True)}
    body = fm.export.read_op4(tmp_path / "other.op4", interfaces=ends)
    np.testing.assert_allclose(body.frequencies(), bar.frequencies(), rtol=1e-10)
    with pytest.raises(ExportError, match="does not say which interfaces"):
        fm.export.read_op4(tmp_path / "other.op4")


def written(tmp_path, *changes):
    fm.export.op4(small_body(), tmp_path / "part.op4")
    text = (tmp_path / "part.op4").read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    (tmp_path / "changed.op4").write_text(text)
    return tmp_path / "changed.op4"


@pytest.mark.parametrize(
    ("old", "new", "match"),
    [
        ("       8       8       6       2KAAX", "99999999       8       6       2KAAX", "read are dense real ones"),
        ("       8       8       6       2KAAX", "    4000    4000       6       2KAAX", "too short to hold"),
        ("       8       8       6       2KAAX", "       8      -8       6       2KAAX", "-8 rows"),
        ("       8       8       6       2KAAX", "       8       8       6       4KAAX", "type 4"),
        ("       1       1       8", "       1       1       9", "rows 1 to 9|header|could not convert"),
        ("       1       1       8", "       1       0       8", "sparse"),
        ("KAAX    ", "XAAX    ", "begins with K; it holds XAAX, MAAX"),
        ("MAAX    ", "KAAX    ", "KAAX is there twice"),
    ],
)
def test_files_that_do_not_fit(tmp_path, old, new, match):
    with pytest.raises(ExportError, match=match):
        fm.export.read_op4(written(tmp_path, (old, new)))


def test_numbers_that_are_none(tmp_path):
    fm.export.op4(small_body(), tmp_path / "part.op4")
    lines = (tmp_path / "part.op4").read_text().splitlines()
    lines[2] = f"{'NaN':>23s}" + lines[2][23:]
    (tmp_path / "x.op4").write_text("\n".join(lines))
    with pytest.raises(ExportError, match="not finite"):
        fm.export.read_op4(tmp_path / "x.op4")


def test_damaged_files(tmp_path):
    fm.export.op4(small_body(), tmp_path / "part.op4")
    data = (tmp_path / "part.op4").read_bytes()
    bodies = survive(fm.export.read_op4, tmp_path / "x.op4", data, count=2000)
    assert bodies < 1000
