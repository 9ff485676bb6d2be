"""Which scripts there are, by room: each file of a folder of verification/ is one."""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Mapping
from pathlib import Path
from typing import cast

from verification.reference import Script
from verification.results import Result

HERE = Path(__file__).resolve().parent
#: Folders, in the order of the page.
ROOMS = ("machines", "contact", "bending", "rotors", "reduction", "solids", "walls", "plasticity")
#: Scripts of up to so many seconds of a core are quick.
QUICK = 2.5


def names() -> list[str]:
    """All of them, as `machines.andrews`, in the order of the page."""
    return [f"{room}.{file.stem}" for room in ROOMS for file in sorted((HERE / room).glob("[!_]*.py"))]


def load(name: str) -> Script:
    """The module of a script.

    Raises:
        AttributeError: it lacks what a script has.
    """
    module = importlib.import_module(f"verification.{name}")
    for wanted in ("SOURCE", "REFERENCES", "compute"):
        if wanted not in vars(module):
            raise AttributeError(f"verification/{name.replace('.', '/')}.py has no {wanted}: see reference.py")
    return cast(Script, module)


def quick(kept: Mapping[str, Result]) -> list[str]:
    """Those that took no more than `QUICK` when they last ran, in the order of the page."""
    return [name for name in names() if name in kept and kept[name].seconds <= QUICK]


def title(name: str) -> str:
    """The problem's name: its docstring's first line, without the full stop."""
    return _text(name).splitlines()[0].rstrip(".")


def description(name: str) -> str:
    """What the docstring says below its first line."""
    return "\n".join(_text(name).splitlines()[1:]).strip()


def room_title(room: str) -> str:
    """Of a folder: what its `__init__` says."""
    return (inspect.getdoc(importlib.import_module(f"verification.{room}")) or "").rstrip(".")


def _text(name: str) -> str:
    return inspect.getdoc(importlib.import_module(f"verification.{name}")) or ""
