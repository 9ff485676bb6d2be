"""Decorators of kernels that handle tuples of many arrays and are called again and again within a step.

Nothing in them may allocate, not even the copy of a row (``a[i] = b[j]``), for they do without numba's runtime: it
would count references, an atomic operation for each array of each tuple that is handed on.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from numba import njit

F = TypeVar("F", bound=Callable[..., Any])

_OPTIONS = {"cache": True, "error_model": "numpy", "nogil": True, "_nrt": False, "no_cfunc_wrapper": True}


def lean_kernel(function: F) -> F:
    """Compile ``function`` as a kernel that counts no references."""
    return njit(**_OPTIONS)(function)


def inner_kernel(function: F) -> F:
    """Compile ``function`` as a lean kernel that kernels alone call: there is no way in from Python."""
    return njit(no_cpython_wrapper=True, **_OPTIONS)(function)


def summing_kernel(function: F) -> F:
    """Compile ``function`` as an inner kernel whose sums may be taken in any order: they run in vector registers."""
    return njit(no_cpython_wrapper=True, fastmath={"reassoc", "contract", "nsz"}, **_OPTIONS)(function)
