"""The ``kernel`` decorator: numba compilation with a disk cache that knows all its sources."""

from __future__ import annotations

import hashlib
import os
import pickle
import re
import sys
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

from numba import njit
from numba.core import caching, serialize
from numba.core.registry import CPUDispatcher

from flexmbd.multibody.kernels.base.pipeline import EntryCompiler, PartCache, PartCompiler

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
def _source_stamp(path: str) -> str:
    """Digest of a source and of all kernel sources that it imports, which numba would not look at."""
    digest = hashlib.sha256()
    for source in sorted(_kernel_sources(path)):
        digest.update(_digest(source))
    return digest.hexdigest()


def _kernel_sources(path: str) -> set[str]:
    """``path``, the kernel sources that it imports, directly or not, and how structures are read."""
    found: set[str] = set()
    waiting = [path, str(Path(__file__).resolve().with_name("array_struct.py"))]
    while waiting:
        source = waiting.pop()
        if source not in found:
            found.add(source)
            waiting.extend(_imported(source))
    return found


# Statements that import, by their text: to parse all kernels would be half of the time that flexmbd takes to load.
_FROM = re.compile(r"^[ \t]*from[ \t]+([\w.]+)[ \t]+import[ \t]*(\([^)]*\)|[^\n]*)", re.MULTILINE)
_IMPORT = re.compile(r"^[ \t]*import[ \t]+([^\n]*)", re.MULTILINE)
_RENAMED = re.compile(r"\bas[ \t]+\w+")
_KERNEL_MODULES = tuple(f"flexmbd.{folder.replace('/', '.')}." for folder in _KERNEL_FOLDERS)


@cache
def _imported(source: str) -> tuple[str, ...]:
    """Files of the kernels' modules that a source imports."""
    text = _text(source).decode("utf-8")
    modules = [name.split()[0] for names in _IMPORT.findall(text) for name in names.split(",") if name.strip()]
    for module, names in _FROM.findall(text):
        modules += [module, *(f"{module}.{name}" for name in re.findall(r"\w+", _RENAMED.sub("", names)))]
    found = {name for name in modules if name.startswith(_KERNEL_MODULES)}
    paths = (os.path.join(_PACKAGE.parent, *name.split(".")) + ".py" for name in sorted(found))
    return tuple(path for path in paths if os.path.isfile(path))


@cache
def _text(source: str) -> bytes:
    return Path(source).read_bytes()


@cache
def _digest(source: str) -> bytes:
    return hashlib.sha256(_text(source)).digest()


def _is_own(source: str) -> bool:
    return source.startswith(f"{_PACKAGE}{os.sep}")


#: Files outside of the package that hold kernels, of integrators of users.
_users_sources: set[str] = set()


class _KernelCacheLocator(caching._CacheLocator):
    """Places flexmbd's kernels and those of users' integrators, and nothing else, in ``cache_folder()``."""

    def __init__(self, py_func: Callable[..., Any], py_file: str) -> None:
        self._line = py_func.__code__.co_firstlineno
        source = _resolved(py_file)
        if _is_own(source):
            self._stamp = _source_stamp(source)
            inside = os.path.relpath(os.path.dirname(source), _PACKAGE)
        else:  # which may call any of ours
            self._stamp = hashlib.sha256(_digest(source) + _all_sources().encode()).hexdigest()
            inside = hashlib.sha256(source.encode()).hexdigest()[:16]
        # a folder for these very sources, wherever they lie: numba cannot even read what others left under its names
        self._path = os.path.join(cache_folder(), _version_name(self._stamp), inside)

    def get_cache_path(self) -> str:
        return self._path

    def get_source_stamp(self) -> str:
        return self._stamp

    def get_disambiguator(self) -> str:
        return str(self._line)

    @classmethod
    def from_function(
        cls, py_func: Callable[..., Any], py_file: str
    ) -> _KernelCacheLocator | None:
        source = _resolved(py_file)
        if not _is_own(source) and source not in _users_sources:
            return None
        locator = cls(py_func, py_file)
        # numba's own choices follow where it cannot be written to: beside the source, then user-wide
        return locator if _is_writable(locator.get_cache_path()) else None


@cache
def _resolved(path: str) -> str:
    return os.path.realpath(path)


@cache
def _is_writable(folder: str) -> bool:
    """Whether files can be made in a folder, which is made where it is not there."""
    try:
        os.makedirs(folder, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def is_cache_writable() -> bool:
    """Whether kernels can be kept in ``cache_folder()``."""
    return _is_writable(str(cache_folder()))


def kernels_written() -> int:
    """Return the number of kernels, parts of others included, that this process has put into the cache."""
    return len(_written)


_written: list[str] = []
caching.CacheImpl._locator_classes.insert(0, _KernelCacheLocator)


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
    return cache_folder() / _version_name(stamp)


def _version_name(stamp: str) -> str:
    return f"flexmbd-{stamp[:16]}"


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
    source = _resolved(function.__code__.co_filename)
    if not os.path.isfile(source):  # typed in: there is no source to know it by
        return njit(**_OPTIONS, **options)(function)
    if not _is_own(source):
        _users_sources.add(source)
    dispatcher = njit(cache=True, **_OPTIONS, **options)(function)
    store = dispatcher._cache
    base = store._impl.filename_base
    if options.get("pipeline_class") is PartCompiler:
        store._impl = PartCache(function)
        base += ".part"
    stamp = store._impl.locator.get_source_stamp()
    store._cache_file = _CheckedFiles(store.cache_path, base, stamp)
    return dispatcher


class _CheckedFiles(caching.IndexDataCacheFile):
    """A kernel's entries in the cache: an index by types of arguments, and a file of machine code for each.

    Each file begins with a digest of what follows, of its name, of the sources and of numba's version.  A file that is
    cut short, damaged or another one's has the wrong digest and counts as absent, so that it is compiled anew and
    written over; numba itself would stop at some, and run the others.
    """

    def _digest(self, name: str, content: bytes) -> bytes:
        head = "\0".join((self._version, str(self._source_stamp), name, ""))
        return hashlib.sha256(head.encode() + content).digest()

    def _read(self, name: str) -> Any:
        """What a file holds; None where it is absent."""
        try:
            content = Path(self._cache_path, name).read_bytes()
        except OSError:
            return None
        size = hashlib.sha256().digest_size
        if content[:size] != self._digest(name, content[size:]):
            return None
        try:
            return pickle.loads(content[size:])
        except (ImportError, AttributeError):  # types of arguments that have since moved to another module
            return None

    def _write(self, name: str, value: Any) -> None:
        content = self._dump(value)
        with self._open_for_write(os.path.join(self._cache_path, name)) as file:
            file.write(self._digest(name, content) + content)

    def _load_index(self) -> dict[Any, str]:
        return self._read(self._index_name) or {}

    def _save_index(self, overloads: dict[Any, str]) -> None:
        self._write(self._index_name, overloads)

    def _load_data(self, name: str) -> Any:
        return self._read(name)

    def _save_data(self, name: str, data: Any) -> None:
        self._write(name, data)
        _written.append(name)


def _closed(dispatcher: Any) -> Any:
    """``dispatcher`` with a refusal where Python would step into code that is not there."""

    def refuse(*_: Any) -> None:
        name = dispatcher.py_func.__name__
        raise TypeError(f"{name} is called by kernels alone; @entry_kernel gives it a way in from Python")

    # numba enters what it compiled into a table for calls from Python, and asks for what is not there
    dispatcher._insert = lambda *_: None
    dispatcher._compile_for_args = refuse
    return dispatcher
