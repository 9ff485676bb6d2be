"""Numba and LLVM's builder as names that load them at their first use: who runs compiled kernels needs neither."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from functools import cached_property
from typing import Any


class _Module:
    """A module that is imported when something of it is asked for."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __getattr__(self, attribute: str) -> Any:
        if attribute.startswith("_"):
            raise AttributeError(attribute)
        return getattr(importlib.import_module(self._name), attribute)

    def __repr__(self) -> str:
        return f"<{self._name}>"


cgutils: Any = _Module("numba.core.cgutils")
ir: Any = _Module("llvmlite.ir")
types: Any = _Module("numba.core.types")


class Intrinsic:
    """What kernels call by its name and numba writes as LLVM's code: made by numba when a kernel is compiled.

    Attributes:
        definition: as of ``numba.extending.intrinsic``.
        text: what stands for it in stamps of kernels, in place of the definition; "" where that stands for itself.
    """

    def __init__(self, definition: Callable[..., Any], *, text: str = "", prefer_literal: bool = False) -> None:
        self.definition = definition
        self.text = text
        self._prefer_literal = prefer_literal
        self.__doc__ = definition.__doc__

    @cached_property
    def _made(self) -> Any:
        import numba.extending

        return numba.extending.intrinsic(prefer_literal=self._prefer_literal)(self.definition)

    @cached_property
    def _numba_type_(self) -> Any:
        """What numba takes the name for."""
        from numba.core.registry import cpu_target

        made = self._made
        cpu_target.typing_context.refresh()  # it was registered by then
        return cpu_target.typing_context.resolve_value_type(made)


def intrinsic(definition: Callable[..., Any] | None = None, *, text: str = "", prefer_literal: bool = False) -> Any:
    """Make a definition an `Intrinsic`; a decorator, with or without arguments."""
    if definition is None:
        return lambda later: Intrinsic(later, text=text, prefer_literal=prefer_literal)
    return Intrinsic(definition, text=text, prefer_literal=prefer_literal)
