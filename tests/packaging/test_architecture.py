"""The page on the architecture names what there is, its pictures are of today's imports; none go in circles."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "architecture.md").read_text()
# a function's name at the beginning of a line of code, and at its end the file that has it
_LINE = r"^ *(?:def |\w+ = |return )?(?:integration\.)?(\w+)\(.*?(\w+(?:/\w+)+\.py)"
CALLS = re.findall(_LINE, PAGE, re.MULTILINE)


def of_tools(*command):
    return subprocess.run([sys.executable, *command], cwd=ROOT, capture_output=True, text=True, check=False)


@pytest.mark.parametrize(("name", "file"), sorted(set(CALLS)))
def test_every_function_named_is_where_the_page_says(name, file):
    source = (ROOT / "flexmbd" / file).read_text()
    assert re.search(rf"^ *(def|class) {name}\b", source, re.MULTILINE), f"{file} has no {name}"


def test_the_page_names_the_step_from_end_to_end():
    named = {name for name, _ in CALLS}
    assert {"advance", "next_step", "forward_dynamics", "residual", "build", "consistent_start"} <= named


def test_pictures_are_of_today_s_imports():
    found = of_tools("tools/draw_rooms.py", "--check")
    assert found.returncode == 0, found.stdout + found.stderr


def test_no_files_import_each_other():
    """Imports for types and inside functions included."""
    found = of_tools("tools/import_graph.py")
    assert found.returncode == 0, found.stdout + found.stderr


def test_numba_s_inside_is_touched_in_one_room() -> None:
    """All that numba and llvmlite are asked for, the kernels' base asks."""
    base = ROOT / "flexmbd" / "multibody" / "kernels" / "base"
    found = set()
    for path in (ROOT / "flexmbd").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            modules = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            modules += [one.name for one in node.names] if isinstance(node, ast.Import) else []
            if any(module.split(".")[0] in ("numba", "llvmlite") for module in modules):
                found.add(path)
    assert {path.name for path in found if path.parent != base} == set()
    assert len(found) > 5
