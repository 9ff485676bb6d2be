"""What tests share is in tests/helpers: no test file imports another or changes where python looks."""

from __future__ import annotations

import ast
from collections import Counter
from pathlib import Path

TESTS = Path(__file__).parents[1]
FILES = sorted(TESTS.rglob("test_*.py"))
NAMES = {path.stem for path in FILES}


def imported(tree):
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            yield node.module
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)


def test_no_test_file_imports_another():
    found = [(path.name, name) for path in FILES for name in imported(ast.parse(path.read_text())) if name in NAMES]
    assert not found


def test_none_changes_the_search_path():
    """Scripts for other processes, which are texts, may."""
    asked = {
        path.name
        for path in FILES
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Attribute) and ast.unparse(node) in ("sys.path", "monkeypatch.syspath_prepend")
    }
    assert not asked


def test_names_of_files_are_unique():
    """Folders of tests are no packages."""
    names = Counter(path.name for path in TESTS.rglob("*.py") if path.name not in ("conftest.py", "__init__.py"))
    assert max(names.values()) == 1, names.most_common(3)
