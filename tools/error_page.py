"""The site's page of errors: what each means, what to do, and which public calls raise it, from the docstrings."""

from __future__ import annotations

import importlib
import inspect
import re
import textwrap
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import reference

from flexmbd.errors import FlexmbdError
from flexmbd.run.stopped import SimulationInterrupted

_BEGIN = """# Errors and warnings

What flexmbd raises on purpose is an `fm.FlexmbdError`, so that one `except` catches all; each message names the
thing at fault and the remedy. Under several processes a collective call raises the same error on every rank. This
page is made from the docstrings: what an error means, what helps, and which public calls raise it, for what.
"""


def write_page(path: Path) -> None:
    """Write the page into the site's sources."""
    path.write_text(page(), encoding="utf-8")


def page() -> str:
    """The page's text: errors, then warnings, each with its callers.

    Raises:
        LookupError: a docstring names an error that neither flexmbd nor Python has.
    """
    raisers: dict[str, dict[str, str]] = {}
    kinds = error_classes()
    for call, docstring in public_docstrings():
        for names, why in raised(docstring):
            for name in names:
                if name not in kinds and not hasattr(importlib.import_module("builtins"), name):
                    raise LookupError(f"{call} says that it raises {name}, which there is not")
                raisers.setdefault(name, {})[call] = why
    parts = [_BEGIN]
    for name, kind in kinds.items():
        base = " and ".join(f"`{one.__name__}`" for one in kind.__bases__)
        parts.append(f"## {name}\n\n{_text(_words(kind))}\n\nA kind of {base}; {_place(kind)}.")
        callers = raisers.get(name, {})
        if callers:
            lines = "\n".join(f"- `{call}`: {_text(why)}" for call, why in sorted(callers.items()))
            number = "one public call" if len(callers) == 1 else f"{len(callers)} public calls"
            parts.append(f":::{{dropdown}} Raised by {number}\n{lines}\n:::")
    return "\n\n".join(parts) + "\n"


def error_classes() -> dict[str, type[BaseException]]:
    """All errors and warnings of the package by name: the general ones before their kinds, warnings last."""
    _modules()  # which define them
    found: dict[str, type[BaseException]] = {}
    waiting: list[type[BaseException]] = [FlexmbdError, SimulationInterrupted, *UserWarning.__subclasses__()]
    for kind in waiting:
        if kind.__module__.startswith("flexmbd"):
            found[kind.__name__] = kind
            waiting += kind.__subclasses__()
    return dict(sorted(found.items(), key=lambda one: (issubclass(one[1], Warning), len(one[1].__mro__), one[0])))


def public_docstrings() -> Iterator[tuple[str, str]]:
    """Every public function, class and method by the name a user calls it, with its docstring."""
    root = importlib.import_module("flexmbd")
    told: set[int] = set()
    named = [(f"fm.{name}", getattr(root, name)) for _, names, _ in reference.PAGES.values() for name in names.split()]
    for module in _modules():
        room = module.__name__.replace("flexmbd", "fm", 1)
        named += [(f"{room}.{name}", thing) for name, thing in vars(module).items() if not name.startswith("_")]
    for label, thing in named:
        own = (getattr(thing, "__module__", "") or "").startswith("flexmbd")
        if not own or id(thing) in told or not (inspect.isclass(thing) or inspect.isroutine(thing)):
            continue
        told.add(id(thing))
        yield label, inspect.getdoc(thing) or ""
        for name, member in inspect.getmembers(thing) if inspect.isclass(thing) else ():
            if not name.startswith("_") and _has_text(member):
                yield f"{label}.{name}", inspect.getdoc(member) or ""


def raised(docstring: str) -> Iterator[tuple[list[str], str]]:
    """The entries of a docstring's Raises section: names of errors, and for what."""
    section = re.search(r"^Raises:\n((?:[ \t]+.*\n?|\n)*)", docstring, re.MULTILINE)
    if section is None:
        return
    entries: list[str] = []
    for line in textwrap.dedent(section.group(1)).splitlines():
        if not line.startswith(" ") and line:
            entries.append(line)
        elif line:
            entries[-1] += f" {line.strip()}"
    for entry in entries:
        names, _, why = entry.partition(": ")
        yield [name.strip() for name in names.split(",")], why


def _words(kind: type[BaseException]) -> str:
    """What an error means, and the remedy; without its attributes."""
    return re.split(r"^(?:Attributes|Args):", inspect.getdoc(kind) or "", flags=re.MULTILINE)[0].strip()


def _place(kind: type[BaseException]) -> str:
    """Where a user finds it."""
    for module in [importlib.import_module("flexmbd"), *_modules()]:
        if getattr(module, kind.__name__, None) is kind:
            return f"`{module.__name__.replace('flexmbd', 'fm', 1)}.{kind.__name__}`"
    return f"`{kind.__module__}.{kind.__name__}`"


def _modules() -> list[Any]:
    rooms = [room for _, _, rooms in reference.PAGES.values() for room in rooms.split()]
    return [importlib.import_module(f"flexmbd.{room}") for room in rooms]


def _has_text(member: object) -> bool:
    return inspect.isroutine(member) or isinstance(member, property)


def _text(text: str) -> str:
    """Text of a docstring as Markdown: words in backticks are code, all else is plain."""
    parts = text.replace("``", "`").split("`")
    parts[::2] = [re.sub(r"([\\*|<]|(?<=\w)_(?!\w))", r"\\\1", part) for part in parts[::2]]
    return "`".join(parts)
