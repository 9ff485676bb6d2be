"""Everything public that can be called, found by inspection, each with one call that is right."""

from __future__ import annotations

import enum
import importlib
import inspect
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from types import ModuleType
from typing import Any

ROOMS = (
    "", "beams", "continuum", "ensemble", "export", "force", "forms", "integrate", "joint", "meshes", "output",
    "parameter", "reduction", "visual",
)  # fmt: skip


@dataclass(frozen=True)
class Public:
    """A public function, constructor, method or attribute that can be set.

    Attributes:
        name: as users write it without `flexmbd.`; a method as Class.method, an attribute as Class.attribute=.
        function: what is called; of a method the function that takes the object first.
        owner: the class of a method; None of functions and constructors.
    """

    name: str
    function: Callable[..., Any]
    owner: type | None = None

    @property
    def room(self) -> str:
        """Empty for the root."""
        first = self.name.partition(".")[0]
        return first if first in ROOMS else ""

    @property
    def parameters(self) -> dict[str, inspect.Parameter]:
        found = dict(inspect.signature(self.function).parameters)
        if self.owner is not None and not self.is_classmethod:
            found.pop(next(iter(found)))
        return found

    @property
    def is_classmethod(self) -> bool:
        return self.owner is not None and inspect.ismethod(self.function)


def public_calls() -> Iterator[Public]:
    """Each once, of all rooms."""
    seen: set[int] = set()
    for room in ROOMS:
        module = importlib.import_module(f"flexmbd.{room}".rstrip("."))
        for name in dir(module):
            value = getattr(module, name)
            if name[0] == "_" or isinstance(value, ModuleType) or id(value) in seen:
                continue
            seen.add(id(value))
            place = f"{room}.{name}".lstrip(".")
            if inspect.isfunction(value) and value.__module__.startswith("flexmbd"):
                yield Public(place, value)
            elif inspect.isclass(value) and value.__module__.startswith("flexmbd"):
                yield from (one for one in _of_class(place, value) if one.owner is None or _is_new(one.function, seen))


def _is_new(function: Callable[..., Any], seen: set[int]) -> bool:
    """Whether no class before had it, from which this one inherits or which inherits too."""
    key = id(getattr(function, "__func__", function))
    if key in seen:
        return False
    seen.add(key)
    return True


def _of_class(place: str, value: type) -> Iterator[Public]:
    if issubclass(value, BaseException | enum.Enum) or getattr(value, "_is_protocol", False):
        return
    yield Public(place, value)
    for key in dir(value):
        member = inspect.getattr_static(value, key)
        if key[0] == "_" and key != "__call__":
            continue
        if isinstance(member, property):
            if member.fset is not None:
                yield Public(f"{place}.{key}=", member.fset, value)
        elif isinstance(member, staticmethod) and member.__func__.__module__.startswith("flexmbd"):
            yield Public(f"{place}.{key}", member.__func__)
        elif isinstance(member, classmethod):
            yield Public(f"{place}.{key}", getattr(value, key), value)
        elif inspect.isfunction(member) and member.__module__.startswith("flexmbd"):
            yield Public(f"{place}.{key}", member, value)
