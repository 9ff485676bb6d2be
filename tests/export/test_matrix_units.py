"""Matrices in mm, t, s and other units: the numbers in the file by hand, and the body that comes back."""

import numpy as np
import pytest
from exported_bodies import damped_rod

import flexmbd as fm
from flexmbd.errors import ExportError
from flexmbd.export import InterfaceNode, NodeSet

WRITERS = [(fm.export.dmig, fm.export.read_dmig, "x.pch"), (fm.export.calculix, fm.export.read_calculix, "x.inp")]
SYSTEMS = ["mm-t-s", "mm-kg-ms", "in-slinch-s", "ft-slug-s", "cm-g-ms"]


def same(found, wanted, *, rtol):
    np.testing.assert_allclose(found.mass, wanted.mass, rtol=rtol)
    np.testing.assert_allclose(found.frequencies(), wanted.frequencies(), rtol=rtol)
    np.testing.assert_allclose(found.damping, wanted.damping, rtol=0.0, atol=rtol * np.abs(wanted.damping).max())
    np.testing.assert_allclose(found.inertia, wanted.inertia, rtol=0.0, atol=rtol * np.abs(wanted.inertia).max())
    for there, here in zip(found.interfaces, wanted.interfaces, strict=True):
        np.testing.assert_allclose(there.p_BI_B, here.p_BI_B, rtol=0.0, atol=rtol)


@pytest.mark.parametrize(("write", "read", "name"), WRITERS)
@pytest.mark.parametrize("units", SYSTEMS)
def test_comes_back(tmp_path, write, read, name, units):
    """A file of ours says its units; with others it is refused."""
    path = tmp_path / name
    write(damped_rod(), path)
    wanted = read(path)
    write(damped_rod(), path, units=units)
    same(read(path), wanted, rtol=1e-8)
    same(read(path, units=units), wanted, rtol=1e-8)
    with pytest.raises(ExportError, match=f"says that its units are {units}, and is read with units='m-kg-s'"):
        read(path, units="m-kg-s")


def test_the_numbers_in_mm_t_s(tmp_path):
    """N/mm, N mm, t, t mm^2 and mm beside N/m, N m, kg, kg m^2 and m; modes of unit mass and their 1/s^2 as before."""
    entries = []
    for name, units in (("si", "m-kg-s"), ("mm", "mm-t-s")):
        fm.export.calculix(damped_rod(), tmp_path / f"{name}.inp", units=units)
        entries.append(
            [np.loadtxt(tmp_path / f"{name}{kind}", delimiter=",") for kind in (".sti", ".mas", ".dam")]
        )
        deck = (tmp_path / f"{name}.inp").read_text().split("\n")
        nodes = [line.split(",")[1:] for line in deck if line.startswith(("1, ", "2, "))]
        entries[-1].append(np.array(nodes, dtype=float))

    def of(file, *key):
        (row,) = (row for row in file if tuple(row[:4]) == key)
        return row[4]

    si, mm = entries
    np.testing.assert_allclose(mm[3], 1e3 * si[3], rtol=1e-11, atol=1e-12)
    for part, factors in ((0, (1e-3, 1e3)), (1, (1e-3, 1e3)), (2, (1e-3, 1e3))):
        for component, factor in zip((1, 4), factors, strict=True):
            key = (1, component, 1, component)
            np.testing.assert_allclose(of(mm[part], *key), factor * of(si[part], *key), rtol=1e-13)
    for part in (0, 1, 2):
        np.testing.assert_allclose(of(mm[part], 3, 1, 3, 1), of(si[part], 3, 1, 3, 1), rtol=1e-13)


def test_a_bar_of_another_program(tmp_path):
    """Two masses of 2 t and 1 t, 400 mm apart, on a spring of 3 kN/mm: frequency and mass in closed form."""
    m, k, small = (2.0, 1.0), 3.0e3, 1e3
    cards = ["GRID,1,,0.,0.,0.", "GRID,2,,400.,0.,0.", "DMIG,KAAX,0,6,2,0", "DMIG,MAAX,0,6,2,0"]
    # bending and torsion of a beam of EI = GJ = k L^2 (N mm^2), so that only rigid motions have no stiffness
    length, bend = 400.0, 3.0e3 * 400.0**2
    K = np.zeros((12, 12))
    for i, value in ((0, k), (3, bend / length)):
        K[np.ix_([i, i + 6], [i, i + 6])] = value * np.array([[1.0, -1.0], [-1.0, 1.0]])
    for a, b, sign in ((1, 5, 1.0), (2, 4, -1.0)):
        rows = [a, b, a + 6, b + 6]
        turn = np.diag([1.0, sign, 1.0, sign])
        beam = np.array([[12, 6, -12, 6], [6, 4, -6, 2], [-12, -6, 12, -6], [6, 2, -6, 4]], dtype=float)
        size = np.diag([1.0, length, 1.0, length])
        K[np.ix_(rows, rows)] += bend / length**3 * turn @ size @ beam @ size @ turn
    M = np.diag([m[0]] * 3 + [small] * 3 + [m[1]] * 3 + [small] * 3)
    dofs = [(node, c) for node in (1, 2) for c in range(1, 7)]
    for name, matrix in (("KAAX", K), ("MAAX", M)):
        for j, (node, c) in enumerate(dofs):
            for i in range(j, 12):
                if matrix[i, j]:
                    cards.append(f"DMIG*,{name},{node},{c},")
                    cards.append(f"*,{dofs[i][0]},{dofs[i][1]},{float(matrix[i, j])!r}")
    (tmp_path / "bar.pch").write_text("\n".join(cards) + "\n")
    body = fm.export.read_dmig(tmp_path / "bar.pch", units="mm-t-s")
    assert body.mass == pytest.approx(3000.0, rel=1e-12)
    np.testing.assert_allclose(body.interfaces[1].p_BI_B, (0.4, 0.0, 0.0), atol=1e-15)
    along = np.sqrt(3.0e6 * (1.0 / 2000.0 + 1.0 / 1000.0)) / (2.0 * np.pi)
    assert np.abs(body.frequencies() / along - 1.0).min() < 1e-9
    # turning masses of 1e3 t mm^2 = 1 kg m^2 beside 2000 kg and 1000 kg at 0.4 m
    assert body.inertia[0, 0] == pytest.approx(2.0, rel=1e-9)
    assert body.inertia[1, 1] == pytest.approx(2.0 + 2000.0 / 3.0 * 0.4**2, rel=1e-9)


def test_op4_and_full_matrices(tmp_path):
    """OP4 of another program in mm, t, s; full matrices of springs and masses; a file of ours is in SI."""
    fm.export.op4(damped_rod(), tmp_path / "ours.op4")
    with pytest.raises(ExportError, match="says that its units are m-kg-s"):
        fm.export.read_op4(tmp_path / "ours.op4", units="mm-t-s")
    text = (tmp_path / "ours.op4").read_text()
    # the same numbers as those of a file in t and s: a thousand times the mass, and the frequencies as they are
    (tmp_path / "other.op4").write_text(text[: text.index("PAAX") - 32])
    ends = {one.name: InterfaceNode(one.p_BI_B) for one in damped_rod().interfaces}
    kilograms = fm.export.read_op4(tmp_path / "other.op4", interfaces=ends)
    tons = fm.export.read_op4(tmp_path / "other.op4", interfaces=ends, units="m-t-s")
    assert tons.mass == pytest.approx(1e3 * kilograms.mass, rel=1e-12)
    np.testing.assert_allclose(tons.frequencies(), kilograms.frequencies(), rtol=1e-9)
    # and of one in ms: all is a thousand times quicker
    quick = fm.export.read_op4(tmp_path / "other.op4", interfaces=ends, units="m-kg-ms")
    assert quick.mass == pytest.approx(kilograms.mass, rel=1e-12)
    np.testing.assert_allclose(quick.frequencies(), 1e3 * kilograms.frequencies(), rtol=1e-9)
    np.testing.assert_allclose(np.diag(quick.damping), 1e3 * np.diag(kilograms.damping), rtol=1e-6)
    corners = np.array([(x, y, z) for x in (0.0, 500.0, 1000.0) for y in (0.0, 100.0) for z in (0.0, 100.0)])
    K = np.zeros((36, 36))
    for i in range(12):
        for j in range(i):
            line = (corners[j] - corners[i]) / np.linalg.norm(corners[j] - corners[i])
            pull = np.zeros(36)
            pull[3 * i : 3 * i + 3], pull[3 * j : 3 * j + 3] = -line, line
            K += 1e2 * np.outer(pull, pull)
    table = np.column_stack([np.arange(1, 13), corners])
    ends = {"left": NodeSet([1, 2, 3, 4]), "right": NodeSet([9, 10, 11, 12], origin=(1000.0, 50.0, 50.0))}
    options = dict(modes=4, frame="left")
    found = fm.export.reduce_matrices(K, 2.5e-4 * np.eye(36), table, interfaces=ends, units="mm-t-s", **options)
    ends["right"] = NodeSet([9, 10, 11, 12], origin=(1.0, 0.05, 0.05))
    si = np.column_stack([np.arange(1, 13), 1e-3 * corners])
    same(found, fm.export.reduce_matrices(1e3 * K, 0.25 * np.eye(36), si, interfaces=ends, **options), rtol=1e-9)


@pytest.mark.parametrize("units", ["SI", "mm", "mm-t", "mm-t-h", "", 3, "MM-T-S"])
def test_units_that_are_none(tmp_path, units):
    fm.export.dmig(damped_rod(), tmp_path / "x.pch")
    for call in (
        lambda: fm.export.dmig(damped_rod(), tmp_path / "y.pch", units=units),
        lambda: fm.export.read_dmig(tmp_path / "x.pch", units=units),
    ):
        with pytest.raises(ExportError, match=r"is not length-mass-time, as 'mm-t-s'; lengths are m, cm, mm"):
            call()
    assert not (tmp_path / "y.pch").exists()
