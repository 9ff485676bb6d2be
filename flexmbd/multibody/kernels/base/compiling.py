"""The ``kernel`` decorator: numba compilation with a disk cache that knows all its sources."""

from __future__ import annotations

import ast
import hashlib
import os
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

from numba import njit
from numba.core import caching, serialize

F = TypeVar("F", bound=Callable[..., Any])

_PACKAGE = Path(__file__).resolve().parents[3]
_OPTIONS: dict[str, Any] = {"error_model": "numpy", "nogil": True, "_nrt": False, "no_cfunc_wrapper": True}
_KERNEL_FOLDERS = ("multibody/kernels", "integrate")


def cache_folder() -> Path:
    """Return the folder of compiled kernels.

    ``NUMBA_CACHE_DIR`` where set, else ``$XDG_CACHE_HOME/flexmbd/kernels`` (by default
    ``~/.cache/flexmbd/kernels``): never inside the install, which may be read-only.
    """
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    if chosen:
        return Path(chosen)
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "flexmbd" / "kernels"


@cache
def _source_stamp(path: Path) -> str:
    """Digest of a source and of all kernel sources that it imports, which numba would not look at."""
    digest = hashlib.sha256()
    for source in sorted(_kernel_sources(path)):
        digest.update(source.read_bytes())
    return digest.hexdigest()


def _kernel_sources(path: Path) -> set[Path]:
    """``path`` and the kernel sources that it imports, directly or not."""
    found: set[Path] = set()
    waiting = [path]
    while waiting:
        source = waiting.pop()
        if source not in found:
            found.add(source)
            waiting.extend(_imported(source))
    return found


@cache
def _imported(source: Path) -> tuple[Path, ...]:
    modules: list[str] = []
    for node in ast.walk(ast.parse(source.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module:
            modules += [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
        elif isinstance(node, ast.Import):
            modules += [alias.name for alias in node.names]
    paths = [_PACKAGE.parent.joinpath(*name.split(".")).with_suffix(".py") for name in modules]
    folders = {_PACKAGE / folder for folder in _KERNEL_FOLDERS}
    return tuple(path for path in paths if folders.intersection(path.parents) and path.is_file())


class _KernelCacheLocator(caching._CacheLocator):
    """Places flexmbd's kernels, and nothing else, in ``cache_folder()``."""

    def __init__(self, py_func: Callable[..., Any], py_file: str) -> None:
        self._line = py_func.__code__.co_firstlineno
        self._stamp = _source_stamp(Path(py_file).resolve())
        # a folder for these very sources, wherever they lie: numba cannot even read what others left under its names
        self._path = _version_folder(self._stamp) / Path(py_file).resolve().parent.relative_to(_PACKAGE)

    def get_cache_path(self) -> str:
        return str(self._path)

    def get_source_stamp(self) -> str:
        return self._stamp

    def get_disambiguator(self) -> str:
        return str(self._line)

    @classmethod
    def from_function(
        cls, py_func: Callable[..., Any], py_file: str
    ) -> _KernelCacheLocator | None:
        if _PACKAGE not in Path(py_file).resolve().parents:
            return None
        locator = cls(py_func, py_file)
        try:
            locator.ensure_cache_path()
        except OSError:
            return None  # numba's own choices follow: beside the source, then user-wide
        return locator


caching.CacheImpl._locator_classes.insert(0, _KernelCacheLocator)


def announce_compilation(purpose: str) -> bool:
    """Tell on stderr, once, that kernels for a purpose are about to be compiled; False if they are cached."""
    if purpose in _announced or _marker(purpose).exists():
        return False
    _announced.add(purpose)
    sys.stderr.write(
        f"flexmbd: compiling the kernels of {purpose}, once for this machine (half a minute to two; kept in "
        f"{cache_folder()})\n"
    )
    return True


def mark_compiled(purpose: str) -> None:
    """Note that the kernels for a purpose, as they stand, are in the cache."""
    marker = _marker(purpose)
    if not marker.exists():
        try:
            marker.parent.mkdir(parents=True, exist_ok=True)
            marker.touch()
        except OSError:
            return  # a read-only cache: the next process says it again, and is right


def _marker(purpose: str) -> Path:
    return _version_folder(_all_sources()) / f"compiled {purpose}"


@cache
def _all_sources() -> str:
    digest = hashlib.sha256()
    for folder in _KERNEL_FOLDERS:
        for path in sorted((_PACKAGE / folder).rglob("*.py")):
            digest.update(path.read_bytes())
    return digest.hexdigest()


def _version_folder(stamp: str) -> Path:
    return cache_folder() / f"flexmbd-{stamp[:16]}"


_announced: set[str] = set()


def kernel(function: F) -> F:
    """Compile ``function`` where a kernel first calls it, without the GIL's objects, cached on disk.

    There is no way in from Python, for which see ``entry_kernel``: taking a plan's arrays out of their objects is
    much code, a quarter of all that would be compiled.  Nor is there one for C.
    Arrays are not counted (``_nrt``): each call would count all arrays of its plan up and down, more than
    half of a small scene's time.  So a kernel can allocate nothing, not even the copy of a row
    (``a[i] = b[j]``); numba refuses one that does.
    """
    return _closed(_cached(function, no_cpython_wrapper=True))


def entry_kernel(function: F) -> F:
    """Compile ``function`` as a kernel that Python calls as well, at its first call."""
    return _cached(function)


def summing_kernel(function: F) -> F:
    """Compile ``function`` as a kernel whose sums may be taken in any order: they run in vector registers."""
    reordered = {"reassoc", "contract", "nsz"}
    return _closed(_cached(function, no_cpython_wrapper=True, fastmath=reordered))


def part_of_kernel(function: F) -> F:
    """Compile ``function`` as text of its caller; for what is called from one place alone.

    It saves the calls' arguments.  The time to compile a caller grows faster than its length, though: what is long
    had better be a kernel, and what is longer still stand behind an address (``separate``).
    """
    return njit(inline="always", error_model="numpy", nogil=True, _nrt=False)(function)


def pickled_function(function: Callable[..., Any]) -> bytes:
    """A Python function by value, with what it refers to, for ``pickle.loads``."""
    return bytes(serialize.dumps(function))


def _cached(function: Callable[..., Any], **options: Any) -> Any:
    """``function`` compiled by numba with the options of all kernels, and ``options``.

    What the cache holds for argument types that have since moved to another module counts as not there.
    """
    dispatcher = njit(cache=True, **_OPTIONS, **options)(function)
    store = dispatcher._cache
    load = store.load_overload

    def load_known(signature: Any, context: Any) -> Any:
        try:
            return load(signature, context)
        except (ImportError, AttributeError):
            store.flush()
            return None

    store.load_overload = load_known
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
