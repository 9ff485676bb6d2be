"""Which files are benchmarks, and what they say of themselves before they are imported."""

from __future__ import annotations

import ast
import importlib.util
import sys
from pathlib import Path
from typing import cast

from benchmark import Benchmark

HERE = Path(__file__).resolve().parent


def benchmarks() -> list[Path]:
    """The files of this folder that are benchmarks, by name."""
    return [file for file in sorted(HERE.glob("*.py")) if is_benchmark(file)]


def is_benchmark(file: Path) -> bool:
    """Whether a file has functions `quick` and `full`."""
    return {"quick", "full"} <= {node.name for node in _tree(file).body if isinstance(node, ast.FunctionDef)}


def minutes_of(file: Path) -> float:
    """About what a whole run takes.

    Raises:
        LookupError: the file does not say.
    """
    for node in _tree(file).body:
        if isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") == "MINUTES":
            return float(ast.literal_eval(node.value))
    raise LookupError(f"{file} has no MINUTES: see benchmarks/benchmark.py")


def is_timed(file: Path) -> bool:
    """Whether a file measures times, so that other work on the machine spoils it: unless it says `TIMED = False`."""
    given = (node for node in _tree(file).body if isinstance(node, ast.Assign))
    return not any(getattr(node.targets[0], "id", "") == "TIMED" and not ast.literal_eval(node.value) for node in given)


def text_of(file: Path) -> str:
    """Its docstring."""
    return ast.get_docstring(_tree(file)) or ""


def load(file: Path) -> Benchmark:
    """Import it, with its folder on the search path.

    Raises:
        Exception: whatever its import raises.
    """
    sys.path.insert(0, str(file.parent))
    spec = importlib.util.spec_from_file_location(file.stem, file)
    if spec is None or spec.loader is None:
        raise ImportError(f"{file} is no Python file")
    module = importlib.util.module_from_spec(spec)
    sys.modules[file.stem] = module
    spec.loader.exec_module(module)
    return cast(Benchmark, module)


def _tree(file: Path) -> ast.Module:
    return ast.parse(file.read_text(encoding="utf-8"))
