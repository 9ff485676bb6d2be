"""The page on the architecture names what there is, its pictures are of today's imports; none go in circles."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest
from import_graph import circles, imports, imports_by_text
from importlinter import configuration
from importlinter.adapters.building import GraphBuilder
from importlinter.application.app_config import settings
from importlinter.application.use_cases import lint_imports

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
    """Imports for types, inside functions and by text included."""
    found = of_tools("tools/import_graph.py")
    assert found.returncode == 0, found.stdout + found.stderr


SMALL_PACKAGE = {
    "__init__.py": "",
    "literal.py": 'import importlib\nimportlib.import_module("flexmbd.target")\n',
    "passed.py": 'def load(name):\n    return __import__(name)\nload("flexmbd.target")\n',
    "table.py": 'import importlib\n_LAZY = {"x": "target"}\nimportlib.import_module(f"flexmbd.{_LAZY[\'x\']}")\n',
    "added.py": 'import importlib\nfor one in ("target",):\n    importlib.import_module("flexmbd." + one)\n',
    "open.py": 'import importlib\nimportlib.import_module(f"{__package__}.{input()}")\n',
    "relative.py": 'import importlib\nimportlib.import_module(".target", __package__)\n',
    "words.py": '"""Of flexmbd.target."""\nprint("flexmbd.target is a module")\n',
    "target.py": "import flexmbd.literal\n",
}


def test_imports_by_text_are_seen(tmp_path):
    """By a literal, through a function, by a table, a sum, a relative name; where nothing fills a gap, all that fit."""
    (tmp_path / "flexmbd").mkdir()
    for name, text in SMALL_PACKAGE.items():
        (tmp_path / "flexmbd" / name).write_text(text)
    found = imports_by_text(tmp_path)
    for name in ("literal", "passed", "table", "added", "relative"):
        assert found[f"flexmbd.{name}"] == {"flexmbd.target"}
    assert found["flexmbd.open"] == found.keys() - {"flexmbd", "flexmbd.open"}
    assert found["flexmbd.words"] == set()
    (tmp_path / "flexmbd" / "open.py").unlink()
    assert circles(imports(tmp_path)) == [["flexmbd.literal", "flexmbd.target"]]


def test_imports_by_text_keep_the_contracts(monkeypatch, capsys):
    """Import-linter's contracts hold of the imports by text as well, which it does not see by itself."""

    class Builder(GraphBuilder):
        def build(self, *arguments, **options):
            graph = super().build(*arguments, **options)
            for importer, targets in imports_by_text().items():
                for target in targets:
                    graph.add_import(importer=importer, imported=target)
            return graph

    configuration.configure()
    monkeypatch.setattr(settings, "GRAPH_BUILDER", Builder())
    monkeypatch.chdir(ROOT)
    kept = lint_imports(no_logo=True, cache_dir=None)
    assert kept, capsys.readouterr().out


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
