"""The README's example, and those of the page that goes on from it, run as they stand."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
COMING_FROM = ROOT / "docs" / "coming_from.md"
README, PAGE = ROOT / "README.md", ROOT / "docs" / "tutorials" / "slider_crank.md"


def examples(page):
    """The python blocks of a page."""
    return re.findall(r"```python\n(.*?)```", page.read_text(), re.DOTALL)


def ran(blocks, folder):
    """The blocks, each going on where the one before it ends, in a process of their own."""
    script = folder / "example.py"
    script.write_text("\n".join(blocks))
    return subprocess.run([sys.executable, str(script)], capture_output=True, text=True, cwd=folder, check=False)


def test_readme_introduces():
    text = README.read_text()
    assert len(text.splitlines()) <= 120
    (example,) = examples(README)
    statements = [line for line in example.splitlines() if line.strip() and not line.startswith(("import", "from"))]
    assert len(statements) <= 15
    for target in re.findall(r"\]\(([^)#]+)", text):
        assert (ROOT / target).exists(), target


def test_the_readme_runs(tmp_path):
    done = ran(examples(README), tmp_path)
    assert done.returncode == 0, done.stderr
    # nothing but the note of the first run on a machine
    assert all(line.startswith("flexmbd: compiling") for line in done.stderr.splitlines())


def test_the_slider_crank_runs(tmp_path):
    blocks = examples(PAGE)
    assert len(blocks) == 3
    done = ran(blocks, tmp_path)
    assert done.returncode == 0, done.stderr
    assert "loops, closed by multipliers" in done.stdout
    # nothing but the note of the first run on a machine
    assert all(line.startswith("flexmbd: compiling") for line in done.stderr.splitlines())
    assert "modes below" in done.stdout or "tolerance of eigenvalues" in done.stdout
    written = {path.name for path in tmp_path.iterdir()}
    assert {"rod.h5", "rod.fem", "rod.npz", "rod.SID_FEM", "rod.pch", "rod.fmu", "machine.fmu"} <= written


def test_the_same_scene_ends_where_exudyn_ends(tmp_path):
    text = COMING_FROM.read_text()
    (theirs,) = re.findall(r"print\(mbs.GetSensorValues\(tip\)\) +# (.*)", text)
    done = ran(examples(COMING_FROM), tmp_path)
    assert done.returncode == 0, done.stderr
    found = [float(number) for number in done.stdout.strip(" []\n").split()]
    expected = [float(number) for number in theirs.split()]
    assert max(abs(a - b) for a, b in zip(found, expected, strict=True)) < 2e-8
