"""A Python function that numba is to compile as a kernel: what stamps know of it."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any


class KernelFunction:
    """A function that kernels call.

    Attributes:
        py_func: the function.
        reordered: whether its sums may be taken in any order.
        options: with what it is compiled as a part of others, as text.
    """

    def __init__(self, function: Callable[..., Any], *, reordered: bool = False) -> None:
        self.py_func: Any = function
        self.reordered = reordered
        self.options = "part reordered" if reordered else "part"
        functools.update_wrapper(self, function)  # type: ignore[arg-type]

    def __reduce__(self) -> str:
        """Pickled by its name, as the function would be; a copy is itself."""
        return str(self.py_func.__qualname__)

    def __repr__(self) -> str:
        return f"<kernel {self.py_func.__module__}.{self.py_func.__qualname__}>"
