"""CalculiX computes with the written matrices; Abaqus's and CalculiX's own forms are read; files that are none."""

import re
import shutil
import subprocess

import numpy as np
import pytest
from exported_bodies import damped_rod, floating_bar, small_body, soft_bar
from mutations import survive

import flexmbd as fm
from flexmbd.errors import ExportError
from flexmbd.export import InterfaceNode

JOB = """\
*INCLUDE,INPUT=part.inp
*BOUNDARY
1,1,6
*STEP
*FREQUENCY
6
*NODE FILE
U
*END STEP
"""


@pytest.mark.parametrize("make", [soft_bar, damped_rod, floating_bar])
def test_calculix_finds_the_frequencies(tmp_path, make):
    ccx = shutil.which("ccx")
    said = subprocess.run([ccx, "-v"], capture_output=True, text=True).stdout if ccx else ""
    version = re.search(r"Version 2\.(\d+)", said)
    if version is None or int(version[1]) < 21:
        pytest.skip("no CalculiX (ccx) of version 2.21 or later on the PATH: earlier ones assemble no matrices")
    body = make()
    fm.export.calculix(body, tmp_path / "part.inp")
    (tmp_path / "job.inp").write_text(JOB)
    subprocess.run([ccx, "job"], cwd=tmp_path, capture_output=True, check=True, timeout=60)
    table = (tmp_path / "job.dat").read_text().partition("E I G E N V A L U E")[2].splitlines()
    found = [float(line.split()[3]) for line in table if re.match(r"\s+\d+(\s+0\.\d+E[+-]\d+){4}$", line)]
    np.testing.assert_allclose(found, body.frequencies([body.interfaces[0].name])[:6], rtol=1e-6)


def test_the_fragment(tmp_path):
    left = fm.export.calculix(damped_rod(), tmp_path / "a b.inp", name="ROD", first=11)
    assert left[0].startswith("the inertia of large motions")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a b.inp", "a_b.dam", "a_b.mas", "a_b.sti"]
    text = (tmp_path / "a b.inp").read_text()
    assert "*MATRIX ASSEMBLE,NAME=ROD,STIFFNESS FILE=a_b.sti,MASS FILE=a_b.mas" in text
    assert "*BOUNDARY" not in text  # its six modes fill their node
    fm.export.calculix(floating_bar(), tmp_path / "floating.inp")
    assert "*BOUNDARY\n5, 3, 6\n" in (tmp_path / "floating.inp").read_text()  # 14 modes, six to a node
    fm.export.calculix(soft_bar(), tmp_path / "bar.inp")
    assert not (tmp_path / "bar.dam").exists()
    stiffness = (tmp_path / "bar.sti").read_text().split()
    mass = (tmp_path / "bar.mas").read_text().split()
    assert [line.rpartition(",")[0] for line in stiffness] == [line.rpartition(",")[0] for line in mass]


@pytest.mark.parametrize(
    ("options", "match"),
    [({"name": "LONGER"}, "one to four letters"), ({"name": "A B"}, "letters or digits"), ({"first": 0}, "do not fit")],
)
def test_arguments(tmp_path, options, match):
    with pytest.raises(ExportError, match=match):
        fm.export.calculix(soft_bar(), tmp_path / "x.inp", **options)
    with pytest.raises(ExportError, match="files cannot be called"):
        fm.export.calculix(soft_bar(), tmp_path / "a=b.inp")
    assert not any(tmp_path.iterdir())


def abaqus_deck(tmp_path):
    fm.export.calculix(damped_rod(), tmp_path / "rod.inp")
    inline = (tmp_path / "rod.mas").read_text()
    element = fm.export.superelement(damped_rod())
    nodes = "".join(f"{i + 1}, {x:.15g}, {y:.15g}, {z:.15g}\n" for i, (x, y, z) in enumerate(element.p))
    deck = f"""\
*Node
{nodes}*Matrix Input, name=stiff, input=rod.sti
*Matrix Input, name=Mass
{inline}*Matrix Input, name=damp, input="rod.dam"
*MATRIX ASSEMBLE, stiffness=stiff, mass=MASS, viscous damping=damp
"""
    (tmp_path / "abaqus.inp").write_text(deck)
    return tmp_path / "abaqus.inp"


def test_a_deck_of_abaqus(tmp_path):
    rod = damped_rod()
    ends = {"a": InterfaceNode(node=1), "b": InterfaceNode(node=2)}
    body = fm.export.read_calculix(abaqus_deck(tmp_path), interfaces=ends)
    np.testing.assert_allclose(body.frequencies(["a"]), rod.frequencies(["big_end"]), rtol=1e-10)
    np.testing.assert_allclose(abs(np.diag(body.damping)), abs(np.diag(rod.damping)), rtol=1e-9)


def test_bare_triplets(tmp_path):
    fm.export.calculix(soft_bar(), tmp_path / "bar.inp")
    ends = {"a": InterfaceNode((0, 0, 0), 1), "b": InterfaceNode((1, 0, 0), 2)}
    body = fm.export.read_calculix(tmp_path / "bar.sti", mass=tmp_path / "bar.mas", interfaces=ends, frame="b")
    np.testing.assert_allclose(body.frequencies(["a"]), soft_bar().frequencies(["x_min"]), rtol=1e-10)
    assert body.frame == "b"
    with pytest.raises(ExportError, match="no mass matrix"):
        fm.export.read_calculix(tmp_path / "bar.sti", interfaces=ends)
    with pytest.raises(ExportError, match="does not say which interfaces"):
        fm.export.read_calculix(tmp_path / "bar.sti", mass=tmp_path / "bar.mas")
    ends["c"] = InterfaceNode((0, 0, 0), 9)
    with pytest.raises(ExportError, match="no matrix entries of interface 'c', node 9"):
        fm.export.read_calculix(tmp_path / "bar.sti", mass=tmp_path / "bar.mas", interfaces=ends)


def lower(matrix):
    """The lower triangle row by row, four values a line, as both programs write it."""
    lines = []
    for i in range(len(matrix)):
        row = [f"{value:20.13E}" for value in matrix[i, : i + 1]]
        lines += [",".join(row[at : at + 4]) + "," for at in range(0, len(row), 4)]
    return "\n".join(lines)


@pytest.mark.parametrize("style", ["calculix", "abaqus"])
def test_user_elements(tmp_path, style):
    """Of Abaqus, nodes with lists of components; of CalculiX, whose mass is another file, a node a component."""
    element = fm.export.superelement(soft_bar())
    n = len(element.K)
    nodes = [7] * 6 + [9] * 6 + [20 + i // 3 for i in range(n - 12)]
    components = [1 + i % 6 for i in range(12)] + [1 + i % 3 for i in range(n - 12)]
    if style == "abaqus":
        listing = sorted(set(nodes))
        lists = "1, 2, 3, 4, 5, 6\n3, 1, 2, 3\n"
        if rest := (n - 12) % 3:  # of the last node
            lists += f"{len(listing)}, " + ", ".join(map(str, range(1, rest + 1))) + "\n"
    else:
        listing = nodes
        lists = f"{components[0]:10d}\n" + "".join(f"{i:10d},{c:10d}\n" for i, c in enumerate(components[1:], start=2))
    head = f"**\n** GENERATION OF SUBSTRUCTURE\n*USER ELEMENT,NODES= {len(listing):9d},LINEAR\n** ELEMENT NODES\n"
    for at in range(0, len(listing), 10):
        head += "**" + ",".join(f"{node:10d}" for node in listing[at : at + 10]) + ",\n"
    stiffness = f"{head}{lists}*MATRIX,TYPE=STIFFNESS\n{lower(element.K)}\n"
    mass = f"*MATRIX,TYPE=MASS\n{lower(element.M)}\n"
    ends = {"a": InterfaceNode((0, 0, 0), 7), "b": InterfaceNode((1, 0, 0), 9)}
    if style == "abaqus":
        (tmp_path / "x.mtx").write_text(stiffness + mass)
        body = fm.export.read_calculix(tmp_path / "x.mtx", interfaces=ends)
    else:
        (tmp_path / "x.mtx").write_text(stiffness)
        (tmp_path / "m.mtx").write_text(head + lists + mass)
        body = fm.export.read_calculix(tmp_path / "x.mtx", mass=tmp_path / "m.mtx", interfaces=ends)
    np.testing.assert_allclose(body.frequencies(["a"]), soft_bar().frequencies(["x_min"]), rtol=1e-9)


@pytest.mark.parametrize("damage", [None, "short", "unlike"])
def test_an_unsymmetric_user_element(tmp_path, damage):
    """Whole matrices, row by row: what is symmetric is read, and what is not is no elastic body."""
    element = fm.export.superelement(soft_bar())
    K = element.K.copy()
    K[12, 13] += 0.1 * K[12, 12] if damage == "unlike" else 0.0
    n = len(K)
    text = f"*USER ELEMENT,NODES={n},LINEAR,UNSYMM\n** " + ",".join(str(1 + i // 6) for i in range(n)) + "\n1\n"
    text += "".join(f"{i + 1},{1 + i % 6}\n" for i in range(1, n))
    for kind, matrix in (("STIFFNESS", K), ("MASS", element.M)):
        rows = matrix[:-1] if damage == "short" else matrix
        lines = "\n".join(",".join(f"{value:.16E}" for value in row) for row in rows)
        text += f"*MATRIX,TYPE={kind}\n{lines}\n"
    (tmp_path / "x.mtx").write_text(text)
    ends = {"a": InterfaceNode((0, 0, 0), 1), "b": InterfaceNode((1, 0, 0), 2)}
    if damage is not None:
        says = {"short": "which is not a square of", "unlike": "matrix K is not symmetric"}[damage]
        with pytest.raises(ExportError, match=says):
            fm.export.read_calculix(tmp_path / "x.mtx", interfaces=ends)
        return
    body = fm.export.read_calculix(tmp_path / "x.mtx", interfaces=ends)
    np.testing.assert_allclose(body.frequencies(["a"]), soft_bar().frequencies(["x_min"]), rtol=1e-9)


@pytest.mark.parametrize(
    ("old", "new", "match"),
    [
        ("rod.sti", "../rod.sti", "not in the same folder"),
        ("rod.sti", "none.sti", "cannot read"),
        ("stiffness=stiff", "stiffness=other", "OTHER"),
        ("1,2,1,1,", "1,2,1,", "is not `node"),
        ("1,2,1,1,", "1,2,1,x,", "not a whole number"),
        ("*MATRIX ASSEMBLE", "*Matrix Assemble\n*MATRIX ASSEMBLE", "assembles 2 matrices"),
        ("mass=MASS", "mass_=MASS", "no mass matrix"),
    ],
)
def test_decks_that_do_not_fit(tmp_path, old, new, match):
    path = abaqus_deck(tmp_path)
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(ExportError, match=match):
        fm.export.read_calculix(path, interfaces={"a": InterfaceNode(node=1), "b": InterfaceNode(node=2)})


def test_nodes_of_three_components_are_no_interfaces(tmp_path):
    lines = [f"1,{i},1,{i},1.0" for i in (1, 2, 3)]
    (tmp_path / "k.mtx").write_text("\n".join(lines))
    solid = {"a": InterfaceNode((0, 0, 0), 1)}
    with pytest.raises(ExportError, match=r"node 1 has no component 4.* by reduce_matrices"):
        fm.export.read_calculix(tmp_path / "k.mtx", mass=tmp_path / "k.mtx", interfaces=solid)


def test_damaged_decks(tmp_path):
    fm.export.calculix(small_body(), tmp_path / "part.inp")
    (tmp_path / "o").mkdir()
    for name in ("part.sti", "part.mas", "part.dam"):
        (tmp_path / "o" / name).write_bytes((tmp_path / name).read_bytes())
    data = (tmp_path / "part.inp").read_bytes()
    assert survive(fm.export.read_calculix, tmp_path / "o" / "x.inp", data, count=700) < 600


def test_damaged_triplets(tmp_path):
    fm.export.calculix(small_body(), tmp_path / "part.inp")
    node = {"a": InterfaceNode((0.0, 0.0, 0.0), 1)}

    def read(path):
        return fm.export.read_calculix(path, mass=tmp_path / "part.mas", interfaces=node)

    assert survive(read, tmp_path / "x.sti", (tmp_path / "part.sti").read_bytes(), count=1500) < 800


def test_damaged_user_elements(tmp_path):
    element = fm.export.superelement(small_body())
    text = f"*USER ELEMENT,NODES=3,LINEAR\n** 1, 2, 3\n1,2,3,4,5,6\n2,1\n*MATRIX,TYPE=STIFFNESS\n{lower(element.K)}\n"
    data = f"{text}*MATRIX,TYPE=MASS\n{lower(element.M)}\n".encode()

    def read(path):
        return fm.export.read_calculix(path, interfaces={"a": InterfaceNode((0.0, 0.0, 0.0), 1)})

    (tmp_path / "x.mtx").write_bytes(data)
    assert read(tmp_path / "x.mtx").n_modes == 2
    assert survive(read, tmp_path / "x.mtx", data, count=1500) < 800
