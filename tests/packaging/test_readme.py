"""The README's examples run as they stand."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

README = Path(__file__).parents[2] / "README.md"


def example():
    """The first python block of the README."""
    found = re.search(r"```python\n(.*?)```", README.read_text(), re.DOTALL)
    assert found
    return found.group(1)


def test_the_example_is_short():
    lines = [line for line in example().splitlines() if line.strip()]
    assert len(lines) <= 27  # twenty-five statements, two of them on two lines


def test_the_examples_run(tmp_path):
    """Each goes on where the one before it ends."""
    script = tmp_path / "example.py"
    blocks = re.findall(r"```python\n(.*?)```", README.read_text(), re.DOTALL)
    assert len(blocks) == 3
    script.write_text("\n".join(blocks))
    done = subprocess.run(
        [sys.executable, str(script)], capture_output=True, text=True, cwd=tmp_path, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "loops, closed by multipliers" in done.stdout
    # nothing but the note of the first run on a machine
    assert all(line.startswith("flexmbd: compiling") for line in done.stderr.splitlines())
    assert "modes below" in done.stdout or "tolerance of eigenvalues" in done.stdout
    written = {path.name for path in tmp_path.iterdir()}
    assert {"rod.h5", "rod.fem", "rod.npz", "rod.SID_FEM", "rod.pch", "rod.fmu", "machine.fmu"} <= written
