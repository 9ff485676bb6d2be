"""Modules in C of other packages, without the package around them, whose import may take long."""

from __future__ import annotations

import importlib.util
import sys
from importlib.machinery import PathFinder
from types import ModuleType


def extension_module(name: str) -> ModuleType:
    """A package's module that asks for nothing of the package: it is loaded from its file unless it is there.

    Raises:
        ModuleNotFoundError: there is none of this name.
    """
    if name in sys.modules:
        return sys.modules[name]
    first, *further = name.split(".")
    spec = importlib.util.find_spec(first)
    for k, _ in enumerate(further):
        places = None if spec is None else spec.submodule_search_locations
        spec = None if places is None else PathFinder.find_spec(".".join((first, *further[: k + 1])), places)
    if spec is None or spec.loader is None:
        raise ModuleNotFoundError(f"No module named {name!r}", name=name)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
