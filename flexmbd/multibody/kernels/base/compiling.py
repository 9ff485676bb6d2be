"""What makes functions kernels, and what tells that they are compiled."""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

from flexmbd.multibody.kernels.base.entry import EntryKernel, Kernel
from flexmbd.multibody.kernels.base.kernel_store import cache_folder

F = TypeVar("F", bound=Callable[..., Any])

_PACKAGE = Path(__file__).resolve().parents[3]
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


@contextmanager
def compiling(purpose: str, *, aloud: bool) -> Iterator[None]:
    """Announce the kernels of a purpose where this process is to tell (``aloud``); note them once all went well."""
    if aloud:
        announce_compilation(purpose)
    yield
    mark_compiled(purpose)


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
    """Let kernels call ``function``; it is compiled with what Python or an address enters.

    There is no way in from Python, for which see ``entry_kernel``, and no machine code of its own: LLVM decides
    what becomes part of its caller.  What many large kernels call had better be entered through its address
    (``separate``).
    Arrays are not counted (``_nrt``): each call would count the arrays that it takes up and down.
    So a kernel can allocate nothing, not even the copy of a row
    (``a[i] = b[j]``); numba refuses one that does.
    """
    return Kernel(function)  # type: ignore[return-value]


def entry_kernel(function: F) -> F:
    """Let Python call ``function`` compiled, and kernels as if it were a ``kernel`` or through its address."""
    return EntryKernel(function)  # type: ignore[return-value]


def brief_entry_kernel(function: F) -> F:
    """An ``entry_kernel`` of some microseconds, which keeps Python's lock meanwhile.

    To hand the lock to another thread and to wait for it again takes longer than such a kernel.
    """
    return EntryKernel(function, keeps_lock=True)  # type: ignore[return-value]


def summing_kernel(function: F) -> F:
    """A kernel whose sums may be taken in any order: they run in vector registers."""
    return Kernel(function, reordered=True)  # type: ignore[return-value]


def pickled_function(function: Callable[..., Any]) -> bytes:
    """A Python function by value, with what it refers to, for ``pickle.loads``."""
    from numba.core import serialize

    return bytes(serialize.dumps(function))
