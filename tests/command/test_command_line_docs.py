"""The page on the command line: its files and commands, as they stand, from a STEP file to a picture."""

import re
import shlex
import subprocess
from pathlib import Path

import numpy as np
import pytest

import flexmbd as fm
from flexmbd.cli import main
from flexmbd.command.subcommands import SUBCOMMANDS
from flexmbd.files.result_table import read_table
from flexmbd.scene_file.entry_kinds import COUPLINGS, FORCES, INTEGRATORS, JOINTS

gmsh = pytest.importorskip("gmsh")

PAGE = (Path(__file__).parents[2] / "docs/command_line.md").read_text(encoding="utf-8")


def commands():
    """The lines of the console blocks that are whole and for one rank."""
    blocks = re.findall(r"^```console\n(.*?)^```$", PAGE, re.DOTALL | re.MULTILINE)
    lines = [line for block in blocks for line in block.splitlines()]
    return [shlex.split(line)[1:] for line in lines if line.startswith("flexmbd ") and not line.endswith("...")]


def write_link(path):
    """60 x 20 x 10 mm with bores of radius 6 and 4 mm, 36 mm apart."""
    gmsh.initialize([], readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setString("Geometry.OCCTargetUnit", "MM")
        occ = gmsh.model.occ
        box = occ.addBox(0, 0, 0, 60, 20, 10)
        occ.cut([(3, box)], [(3, occ.addCylinder(x, 10, -5, 0, 0, 20, r)) for x, r in ((12, 6), (48, 4))])
        occ.synchronize()
        gmsh.write(str(path))
    finally:
        gmsh.finalize()


def machine(record):
    """The page's scene in Python."""
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    link = scene.add(fm.FlexibleBody(record), name="link")
    weight = scene.add(fm.RigidBody(0.2, (2e-5, 2e-5, 2e-5), (0.0, -0.02, 0.0)), name="weight")
    pivot = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), link.frame("bore_1"))
    pin = scene.connect(fm.joint.Revolute("z"), link.frame("bore_2"), weight.frame())
    pivot.position = -0.5
    scene.add_force(fm.force.JointSpring(pin, stiffness=0.05, damping=2e-4))
    scene.add_force(fm.force.FrameForce(weight.frame(), (fm.Sine(0.3, 60.0), 0.0, 0.0)))
    return scene, link, weight, pivot


def test_the_page_from_end_to_end(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write_link(tmp_path / "link.step")
    for name, text in re.findall(r"^```toml file=(\S+)\n(.*?)^```$", PAGE, re.DOTALL | re.MULTILINE):
        (tmp_path / name).write_text(text, encoding="utf-8")
    done = [words[0] for words in commands() if main(words) == 0]
    assert done == ["reduce", "reduce", "export", "convert", *["simulate"] * 2, "plot", *["simulate"] * 2, "sweep"]
    assert capsys.readouterr().err == ""
    assert (tmp_path / "swing.png").exists()
    record = fm.ReducedBody.load("link.h5")
    assert record.provenance["fixed-interface modes"] == "20"
    assert fm.ReducedBody.load("again.h5").fingerprint() == record.fingerprint()
    table = read_table(tmp_path / "swing/results.npz")
    scene, link, weight, pivot = machine(record)
    run = scene.simulate(0.2, rtol=1e-7)
    t = table.column("t")
    assert len(t) == 201
    expected = {
        "pivot.angle": run.beta(pivot, t=t),
        "pivot.angle_rate": run.beta_rate(pivot, t=t),
        "link:bore_2.x": run.position(link.frame("bore_2"), t=t)[:, 0],
        "link:bore_2.vy": run.velocity(link.frame("bore_2"), t=t)[:, 1],
        "centre.y": run.position(weight.frame((0.0, -0.02, 0.0)), t=t)[:, 1],
        "link.q1": run.q(link, t=t)[:, 0],
        "energy.total": run.energy(t=t).total,
    }
    for name, values in expected.items():
        np.testing.assert_allclose(table.column(name), values, rtol=1e-9, atol=1e-12 * abs(values).max())
    # it swings: down from where it was let go
    assert table.column("centre.y").min() < table.column("centre.y")[0] - 1e-3
    laws = re.search(r"^```python file=laws.py\n(.*?)^```$", PAGE, re.DOTALL | re.MULTILINE)[1]
    (tmp_path / "laws.py").write_text(laws, encoding="utf-8")
    elements = re.search(r"^```toml\n(\[\[force\]\]\nkind = \"joint_law\".*?)^```$", PAGE, re.DOTALL | re.MULTILINE)[1]
    (tmp_path / "laws.toml").write_text((tmp_path / "swing.toml").read_text(encoding="utf-8") + elements)
    assert main(["simulate", "laws.toml"]) == 0
    told = capsys.readouterr().out
    assert "event 'is low' at t = " in told
    assert "event 'bounces' at t = " in told


def test_every_word_is_on_the_page():
    missing = [one.name for one in SUBCOMMANDS if f"| `{one.name}` |" not in PAGE]
    missing += [name for name in (*JOINTS, *FORCES, *COUPLINGS, *INTEGRATORS) if f"`{name}`" not in PAGE]
    missing += [key for kind in FORCES.values() for key in kind.keys if f"`{key}`" not in PAGE]
    assert missing == []


def test_the_command_is_installed():
    done = subprocess.run(["flexmbd", "--version"], capture_output=True, text=True, check=True)
    assert done.stdout == f"flexmbd {fm.__version__}\n"
