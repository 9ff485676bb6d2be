"""The ``kernel`` decorator: numba compilation with a disk cache that knows all its sources."""

from __future__ import annotations

import hashlib
import os
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

from numba import njit
from numba.core import serialize
from numba.core.registry import CPUDispatcher

from flexmbd.multibody.kernels.base.kernel_cache import KernelCache, cache_folder
from flexmbd.multibody.kernels.base.pipeline import EntryCompiler, PartCompiler

F = TypeVar("F", bound=Callable[..., Any])

_PACKAGE = Path(__file__).resolve().parents[3]
_OPTIONS: dict[str, Any] = {"error_model": "numpy", "nogil": True, "_nrt": False, "no_cfunc_wrapper": True}
_KERNEL_FOLDERS = ("multibody/kernels", "integrate")


def announce_compilation(purpose: str) -> bool:
    """Tell on stderr, once, that kernels for a purpose are about to be compiled; False if they are cached."""
    if purpose in _announced:
        return False
    _announced.add(purpose)
    if _marker(purpose).exists():
        _marked.add(purpose)
        return False
    sys.stderr.write(
        f"flexmbd: compiling the kernels of {purpose}, once for this machine (a quarter of a minute to one; kept in "
        f"{cache_folder()})\n"
    )
    return True


def mark_compiled(purpose: str) -> None:
    """Note that the kernels for a purpose, as they stand, are in the cache."""
    if purpose in _marked:
        return
    _marked.add(purpose)
    marker = _marker(purpose)
    if not marker.exists():
        try:
            marker.parent.mkdir(parents=True, exist_ok=True)
            marker.touch()
        except OSError:
            return  # a read-only cache: the next process says it again, and is right


def is_compiled(purpose: str) -> bool:
    """Whether the kernels for a purpose, as they stand, are known to be in the cache."""
    return purpose in _marked or _marker(purpose).exists()


def _marker(purpose: str) -> Path:
    return cache_folder() / f"flexmbd-{_all_sources()[:16]}" / f"compiled {purpose}"


@cache
def _all_sources() -> str:
    digest = hashlib.sha256()
    for folder in _KERNEL_FOLDERS:
        for path in sorted((_PACKAGE / folder).rglob("*.py")):
            digest.update(path.read_bytes())
    return digest.hexdigest()


_announced: set[str] = set()  # purposes that this process has asked about
_marked: set[str] = set()  # and those noted


def kernel(function: F) -> F:
    """Translate ``function`` where a kernel first calls it; it is compiled with what Python or an address enters.

    There is no way in from Python, for which see ``entry_kernel``, and no machine code of its own: LLVM decides
    what becomes part of its caller.  What many large kernels call had better be a ``separate_kernel``.
    Arrays are not counted (``_nrt``): each call would count the arrays that it takes up and down.
    So a kernel can allocate nothing, not even the copy of a row
    (``a[i] = b[j]``); numba refuses one that does.
    """
    return _part(function)


def entry_kernel(function: F) -> F:
    """Compile ``function`` as a kernel that Python calls as well, at its first call.

    Kernels that call it get it as a part, as if it were a ``kernel``: its own machine code is for Python alone.
    """
    dispatcher = _cached(function, pipeline_class=EntryCompiler)
    dispatcher.__class__ = _Entry
    dispatcher.part = _part(function)
    return dispatcher


class _Entry(CPUDispatcher):
    part: Any

    @property
    def _numba_type_(self) -> Any:
        """What kernels call."""
        return self.part._numba_type_


def separate_kernel(function: F) -> F:
    """Compile ``function`` as a kernel of its own that kernels call through its address (``separate``)."""
    return _closed(_cached(function, no_cpython_wrapper=True, pipeline_class=EntryCompiler))


def summing_kernel(function: F) -> F:
    """Compile ``function`` as a kernel whose sums may be taken in any order: they run in vector registers."""
    reordered = {"reassoc", "contract", "nsz"}
    return _part(function, fastmath=reordered)


def pickled_function(function: Callable[..., Any]) -> bytes:
    """A Python function by value, with what it refers to, for ``pickle.loads``."""
    return bytes(serialize.dumps(function))


def _part(function: Callable[..., Any], **options: Any) -> Any:
    return _closed(_cached(function, no_cpython_wrapper=True, pipeline_class=PartCompiler, **options))


def _cached(function: Callable[..., Any], **options: Any) -> Any:
    """``function`` compiled by numba with the options of all kernels, and ``options``."""
    dispatcher = njit(**_OPTIONS, **options)(function)
    if os.path.isfile(function.__code__.co_filename):  # else typed in: there is no source to know it by
        dispatcher._cache = KernelCache(dispatcher)
    return dispatcher


def _closed(dispatcher: Any) -> Any:
    """``dispatcher`` with a refusal where Python would step into code that is not there."""

    def refuse(*_: Any) -> None:
        name = dispatcher.py_func.__name__
        raise TypeError(f"{name} is called by kernels alone; @entry_kernel gives it a way in from Python")

    # numba enters what it compiled into a table for calls from Python, and asks for what is not there
    dispatcher._insert = lambda *_: None
    dispatcher._compile_for_args = refuse
    return dispatcher
