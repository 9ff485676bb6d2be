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
        ("       8       8       6       2KAAX", "99999999       8       6       2KAAX", "rows 8 to 13"),
        ("       8       8       6       2KAAX", "       8    4000       6       2KAAX", "of size .4000, 8."),
        ("       8       8       6       2KAAX", "       8 9999999       6       2KAAX", "9999999 rows"),
        ("       8       8       6       2KAAX", "       8       8       6       9KAAX", "type 9"),
        ("       8       8       6       2KAAX", "       8       8       6       4KAAX", "type 4"),
        ("       1       1       8", "       1       1       9", "rows 1 to 9|header|could not convert"),
        ("       1       1       8", "       1       0       8", "invalid literal"),
        ("KAAX    ", "XAAX    ", "begins with K; it holds XAAX, MAAX"),
        ("MAAX    ", "KAAX    ", "it holds KAAX:1, KAAX:2"),
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


def binary(tmp_path, *, order="<", kind="f8", word=4, changes=()):
    """A file of binary records, written from the layout: length, content, length; words of four or eight bytes."""
    element = fm.export.superelement(small_body())

    def record(*parts):
        content = b"".join(parts)
        length = np.array(len(content), f"{order}i4").tobytes()
        return length + content + length

    def whole(*numbers):
        return np.array(numbers, f"{order}i{word}").tobytes()

    data = b""
    for name, matrix in (("KAAX", element.K), ("MAAX", element.M), ("BAAX", element.D)):
        n = len(matrix)
        data += record(whole(n, n, 6, 1 if kind == "f4" else 2), name.ljust(2 * word).encode())
        for column in range(n):
            words = matrix[:, column].astype(order + kind).tobytes()
            data += record(whole(column + 1, 1, len(words) // word), words)
        data += record(whole(n + 1, 1, 1), np.ones(1, order + kind).tobytes())
    for old, new in changes:
        assert old in data
        data = data.replace(old, new, 1)
    (tmp_path / "x.op4").write_bytes(data)
    return tmp_path / "x.op4"


NODE = {"a": InterfaceNode((0.0, 0.0, 0.0))}


@pytest.mark.parametrize(
    ("order", "kind", "word", "rtol"),
    [("<", "f8", 4, 1e-12), (">", "f8", 4, 1e-12), ("<", "f4", 4, 1e-4), ("<", "f8", 8, 1e-12), (">", "f8", 8, 1e-12)],
)
def test_binary_files(tmp_path, order, kind, word, rtol):
    """Little and big ends, double and single precision, words of 32 and 64 bits, damping included."""
    path, wanted = binary(tmp_path, order=order, kind=kind, word=word), small_body()
    found = fm.export.read_op4(path, interfaces=NODE)
    np.testing.assert_allclose(found.stiffness, wanted.stiffness, rtol=max(rtol, 1e-9))
    np.testing.assert_allclose(np.diag(found.damping), np.diag(wanted.damping), rtol=max(rtol, 1e-6))


@pytest.mark.parametrize("order", "<>")
def test_pynastran_reads_these_binary_files(tmp_path, order):
    """So the layout from which the file was written is Nastran's."""
    op4 = pytest.importorskip("pyNastran.op4.op4", reason=WHY)
    matrices = op4.OP4(debug=False).read_op4(str(binary(tmp_path, order=order)))
    element = fm.export.superelement(small_body())
    for name, matrix in (("KAAX", element.K), ("MAAX", element.M), ("BAAX", element.D)):
        np.testing.assert_array_equal(matrices[name].data, matrix)


@pytest.mark.parametrize("order", "<>")
def test_pyyeti_reads_words_of_64_bits(tmp_path, order):
    """Which pyNastran does not: the layout is that of Nastran's 64-bit builds."""
    op4 = pytest.importorskip("pyyeti.nastran.op4", reason="no pyyeti: pip install pyyeti")
    matrices = op4.OP4().dctload(str(binary(tmp_path, order=order, word=8)))
    element = fm.export.superelement(small_body())
    for name, matrix in (("kaax", element.K), ("maax", element.M), ("baax", element.D)):
        np.testing.assert_array_equal(matrices[name][0], matrix)


@pytest.mark.parametrize(
    ("old", "new", "match"),
    [
        (b"KAAX", b"XAAX", "begins with K; it holds XAAX"),
        (b"MAAX", b"KAAX", "it holds KAAX:1, KAAX:2"),
        (np.array([1, 1, 16], "<i4").tobytes(), np.array([1, 0, 16], "<i4").tobytes(), "a string of -1 words"),
        (np.array([1, 1, 16], "<i4").tobytes(), np.array([9, 1, 16], "<i4").tobytes(), "KAAX is cut|header should be"),
        (np.array([1, 1, 16], "<i4").tobytes(), np.array([1, 2, 16], "<i4").tobytes(), "column 1 has rows 2 to 9"),
        (np.array([8, 8, 6, 2], "<i4").tobytes(), np.array([8, -9999, 6, 2], "<i4").tobytes(), "9999 rows"),
        (np.array([8, 8, 6, 2], "<i4").tobytes(), np.array([8, 8, 6, 9], "<i4").tobytes(), "type 9"),
        (np.array([8, 8, 6, 2], "<i4").tobytes(), np.array([8, 8, 6, 4], "<i4").tobytes(), "type 4"),
    ],
)
def test_binary_files_that_do_not_fit(tmp_path, old, new, match):
    with pytest.raises(ExportError, match=match):
        fm.export.read_op4(binary(tmp_path, changes=[(old, new)]), interfaces=NODE)


@pytest.mark.parametrize("word", [4, 8])
def test_damaged_binary_files(tmp_path, word):
    data = binary(tmp_path, word=word).read_bytes()
    for cut in (5, 30, len(data) // 2, len(data) - 3):
        (tmp_path / "cut.op4").write_bytes(data[:cut])
        with pytest.raises(ExportError, match=r"cut\.op4"):
            fm.export.read_op4(tmp_path / "cut.op4", interfaces=NODE)

    def read(path):
        return fm.export.read_op4(path, interfaces=NODE)

    assert survive(read, tmp_path / "y.op4", data, count=1000) < 900
