"""`flexmbd reduce part.step`: faces by their names, materials from files, the same record on any number of ranks."""

import json
import os
import re
import shutil
import subprocess
import sys

import numpy as np
import pytest

gmsh = pytest.importorskip("gmsh")

from flexmbd import meshes  # noqa: E402  (needs gmsh)
from flexmbd.cli import main  # noqa: E402
from flexmbd.record.reduced_body import ReducedBody  # noqa: E402

STEEL = """\
form = "solid_linear"

[parameters]
E = 2.1e11
nu = 0.3
rho = 7850.0
"""
LINK = ["--interface", "bore_1", "--interface", "bore_2", "--degree", "1"]


@pytest.fixture
def part(tmp_path, monkeypatch):
    """A link with two bores, 60 x 20 x 10 mm, in a folder with letters of other languages; and its material."""
    folder = tmp_path / "Pleuel ö 連桿"
    folder.mkdir()
    monkeypatch.chdir(folder)
    gmsh.initialize([], readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setString("Geometry.OCCTargetUnit", "MM")
        occ = gmsh.model.occ
        box = occ.addBox(0, 0, 0, 60, 20, 10)
        occ.cut([(3, box)], [(3, occ.addCylinder(x, 10, -5, 0, 0, 20, r)) for x, r in ((12, 6), (48, 4))])
        occ.synchronize()
        gmsh.write("link.step")
    finally:
        gmsh.finalize()
    (folder / "steel.toml").write_text(STEEL + "\n[damping]\nratio = 0.01\n")
    return folder / "link.step"


def by_hand(path, tags, *, h, modes, degree=1, **choices):
    from flexmbd.continuum import ContinuumModel, Interface
    from flexmbd.forms import solid_linear
    from flexmbd.reduction import craig_bampton

    steel = solid_linear.Parameters(E=2.1e11, nu=0.3, rho=7850.0)
    mesh = meshes.from_step(path, tags=tags, h=h, degree=degree)
    model = ContinuumModel(mesh, solid_linear, steel, degree=degree, interfaces=[Interface(name) for name in tags])
    return craig_bampton(model, modes=modes, frame=next(iter(tags)), **choices)


def test_reduce_a_step_file(part, capsys):
    """The command of the manual, with the size of the cells left to it."""
    from flexmbd.reduction import ModalDamping

    words = ["reduce", "link.step", "--material", "steel.toml", "--interface", "bore_1", "--interface", "bore_2"]
    words += ["--modes", "2", "-o", "link.h5"]
    assert main([*words, "--no-geometric-stiffness"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert re.search(r"8 modes, the lowest at \d+.*Hz, cells of 0.0028 m; `flexmbd inspect link.h5` shows it\n", out)
    tags = {"bore_1": lambda face: face.radius == pytest.approx(6e-3), "bore_2": (0.052, 0.01, 0.005)}
    expected = by_hand(part, tags, h=2.8e-3, modes=2, degree=2, damping=ModalDamping(0.01), geometric_stiffness=False)
    written = ReducedBody.load("link.h5")
    assert written.frame == "bore_1"
    assert written.stiffness == pytest.approx(expected.stiffness, rel=1e-9)
    assert abs(written.gram - expected.gram).max() < 1e-9 * abs(expected.gram).max()
    assert written.damping == pytest.approx(expected.damping, rel=1e-9)
    np.testing.assert_allclose(written.interface("bore_2").p_BI_B, (0.036, 0.0, 0.0), atol=1e-6)


def test_faces_by_number_by_radius_by_point(part, capsys):
    assert main(["reduce", "link.step", "--list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("link.step: 8 faces, 0.06 x 0.02 x 0.01 m, ")
    numbers = {line.split()[-1]: line.split()[0] for line in lines if line.endswith(("bore_1", "bore_2"))}
    (end,) = (line.split()[0] for line in lines if "(0, 0.01, 0.005)" in line)
    words = ["reduce", "link.step", "--material", "steel.toml", "--degree", "1", "--size", "0.004", "--modes", "0"]
    words += ["--no-geometric-stiffness", "--json"]
    ways = {
        "number": [f"big={numbers['bore_1']}", f"end={end}"],
        "radius": ["big=radius:0.006", "end=point:0,0.003,0.003"],
        "point": ["big=point:0.018,0.01,0.005", f"end={end}"],
    }
    found = {}
    for name, tags in ways.items():
        tagged = [word for tag in tags for word in ("--tag", tag)]
        named = ["--interface", "end", "--interface", "big"]
        assert main([*words, *tagged, *named, "--frame", "big", "-o", f"{name}.h5"]) == 0
        told = json.loads(capsys.readouterr().out)
        assert told["fingerprint"] == ReducedBody.load(f"{name}.h5").fingerprint()
        assert told["cell_size"] == 0.004
        found[name] = told["fingerprint"]
    assert len(set(found.values())) == 1
    # a bore that has no other name keeps its number
    more = [*words, "--tag", "big=radius:0.006", "--interface", "big", "--interface", "bore_2", "-o", "more.h5"]
    assert main(more) == 0
    assert [frame.name for frame in ReducedBody.load("more.h5").interfaces] == ["big", "bore_2"]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--tag", "foot"], "--tag foot: write NAME=12,13"),
        (["--tag", "foot=1.5"], "--tag foot=1.5: write NAME=12,13"),
        (["--tag", "foot=99"], "there is no face 99; --list shows faces 1 to 8"),
        (["--tag", "foot=radius:0.007"], "no cylinder has that radius (m); there are 0.004, 0.006"),
        (["--tag", "foot=radius:big"], "'big' is not a number"),
        (["--tag", "foot=point:1,2"], "a point has three numbers"),
        (["--tag", "foot=point:1,2,nan"], "'nan' is not a number"),
        (["--tag", "foot=point:1,2,3"], "lies on no face; the nearest"),
        (["--tag", "foot=1", "--tag", "foot=2"], "the name 'foot' is given twice"),
        (["--tag", "foot=1,2", "--tag", "top=2"], "both choose this face"),
        (["--tag", "surface=1"], "'surface' is for all faces without a tag"),
        (["--interface", "bore_3"], "bore_3"),
        (["--size", "1"], "are too big: the part measures"),
        (["--size", "-1"], "h must be a positive"),
        (["--solid", "2"], "solid is 2, and there are 1 solid"),
        (["--scale", "0"], "scale must be a positive"),
    ],
)
def test_what_is_wrong_with_a_step_file_is_one_line(part, capsys, words, message):
    given = ["reduce", "link.step", "--material", "steel.toml", *LINK, "--modes", "0", "-o", "a.h5", *words]
    assert main(given) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("flexmbd: ")
    assert message in err
    assert not os.path.exists("a.h5")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (None, "cannot read steel.toml: No such file"),
        ("folder", "cannot read steel.toml: it is not a regular file"),
        (STEEL.replace("=", ":", 1), "steel.toml is no TOML: Expected '=' after a key in a key/value pair (at line 1"),
        (STEEL.replace('"solid_linear"', '"solid_linear'), "steel.toml is no TOML: "),
        ("a = " + 3000 * "[", "steel.toml is no TOML: "),
        (b"\xff\xfe", "steel.toml is no TOML: it is not UTF-8 at byte 0"),
        (STEEL.replace("form", "from"), "steel.toml: from: is not known; did you mean 'form'?"),
        (STEEL.replace("2.1e11", '"stiff"'), "steel.toml: parameters.E: must be a number, got 'stiff'"),
        (STEEL.replace("2.1e11", "inf"), "steel.toml: parameters.E: must be a finite number, got inf"),
        (STEEL.replace("2.1e11", "true"), "steel.toml: parameters.E: must be a number, got True"),
        (STEEL.replace("2.1e11", "1" + 400 * "0"), "steel.toml: parameters.E: must be a finite number"),
        (STEEL.replace("E =", "G ="), "no E; unknown G"),
        (STEEL.replace("solid_linear", "solid_lnear"), "no 'solid_lnear'"),
        (STEEL.replace("solid_linear", "mine.py"), "mine.py: cannot be read"),
        (STEEL + "[damping]\nzeta = 1\n", "steel.toml: damping: must have ratio; or alpha and beta"),
        (STEEL + "[damping]\nratio = 2\n", "a damping ratio must lie between 0 and 1"),
    ],
)
def test_what_is_wrong_with_a_material_file_is_one_line(part, capsys, text, message):
    path = part.with_name("steel.toml")
    path.unlink()
    if text == "folder":
        path.mkdir()
    elif text is not None:
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
    assert main(["reduce", "link.step", "--material", "steel.toml", *LINK, "--modes", "0", "-o", "a.h5"]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("flexmbd: ")
    assert err.count("\n") == 1
    assert message in err


@pytest.mark.parametrize(
    ("more", "expected"),
    [
        ('[damping]\nalpha = 3.0\nbeta = 1e-6\nheld = ["bore_1"]\n', lambda k: 3.0 + 1e-6 * k),
        ("[damping]\ntau = 1e-6\n", lambda k: 1e-6 * k),
        ("[damping]\nratio = 0.5\n", lambda k: 2 * 0.02 * np.sqrt(k)),
    ],
)
def test_dampings_and_values_in_place_of_the_files(part, more, expected):
    """The command line goes before the file: rho of each, the ratio of the last."""
    part.with_name("steel.toml").write_text(STEEL + more)
    words = ["reduce", "link.step", "--material", "steel.toml", *LINK, "--modes", "0", "--size", "0.006"]
    words += ["--no-geometric-stiffness", "--parameter", "rho=1000"]
    words += ["--damping-ratio", "0.02", "--damping-held", "bore_1"] if "ratio" in more else []
    assert main([*words, "-o", "a.h5"]) == 0
    body = ReducedBody.load("a.h5")
    assert np.diag(body.damping) == pytest.approx(expected(body.stiffness), rel=1e-9)
    assert body.mass == pytest.approx(1000 * 1e-9 * (60 * 20 * 10 - np.pi * (36 + 16) * 10), rel=0.03)  # straight cells


@pytest.mark.skipif(shutil.which("mpirun") is None, reason="mpirun is not installed")
def test_two_ranks_write_the_record_of_one(part):
    """By the gates over ranks: frequencies to 1e-8, Gram matrix and modes to 1e-7; and errors are told once."""
    words = ["reduce", "link.step", "--material", "steel.toml", *LINK, "--modes", "3", "--size", "0.005"]
    assert main([*words, "-o", "one.h5"]) == 0
    given = [[*words, "--tag", "foot=99", "-o", "three.h5"], [*words, "-o", "two.h5"]]
    script = f"import sys; from flexmbd.cli import main; sys.exit(sum(main(words) for words in {given!r}))"
    outside = {key: value for key, value in os.environ.items() if not key.startswith(("OMPI_", "PMIX_", "PMI_"))}
    kept = {key: value for key, value in os.environ.items() if key.startswith(("OMPI_MCA", "OMPI_ALLOW", "PMIX_MCA"))}
    command = ["mpirun", "-n", "2", sys.executable, "-c", script]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env={**outside, **kept}, timeout=200)
    assert done.returncode == 2, done.stderr
    assert done.stdout.count("modes, the lowest at") == 1
    assert done.stderr.count("there is no face 99") == 1
    assert "Traceback" not in done.stderr
    assert not os.path.exists("three.h5")
    one, two = ReducedBody.load("one.h5"), ReducedBody.load("two.h5")
    told = ({key: text for key, text in body.provenance.items() if "error" not in key} for body in (one, two))
    assert next(told) == next(told)  # of the mesh too
    assert two.frequencies() == pytest.approx(one.frequencies(), rel=1e-8)
    assert two.frequencies(["bore_1", "bore_2"]) == pytest.approx(one.frequencies(["bore_1", "bore_2"]), rel=1e-8)
    # each field's entries relative to its own size
    size = np.sqrt(np.abs(np.diag(one.gram)))
    size[size < 1e-12 * size.max()] = 1.0
    assert (abs(two.gram - one.gram) / np.outer(size, size)).max() < 1e-7
    assert abs(two.partition - one.partition).max() < 1e-7 * abs(one.partition).max()
    assert abs(two.geometric.K - one.geometric.K).max() < 1e-7 * abs(one.geometric.K).max()
    assert abs(two.p_MB_M - one.p_MB_M).max() < 1e-13
