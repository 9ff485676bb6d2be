"""Compiled kernels on disk: each under a digest of what it follows from, whatever checkout compiled it."""

from __future__ import annotations

import hashlib
import os
import pickle
import sys
import tempfile
from functools import cache, cached_property
from pathlib import Path
from typing import Any

from numba.core import caching
from numba.core.compiler import CompileResult
from numba.core.registry import CPUDispatcher

from flexmbd.multibody.kernels.base.cache_pruning import note_use, prune
from flexmbd.multibody.kernels.base.kernel_stamp import options_of, stamp
from flexmbd.multibody.kernels.base.pipeline import PartCompiler, part_from, part_payload

_PACKAGE = Path(__file__).resolve().parents[3]


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
def is_cache_writable() -> bool:
    """Whether kernels can be kept in ``cache_folder()``, which is made where it is not there."""
    folder = cache_folder()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def kernels_written() -> int:
    """Return the number of kernels, parts of others included, that this process has put into the cache."""
    return len(_written)


_written: list[str] = []


class KernelCache(caching._Cache):
    """The entries of one kernel: as it was translated where it is a part of others, else with its machine code.

    Where the cache cannot be written to what is there is used, and what is not there is compiled in each process.
    """

    def __init__(self, dispatcher: CPUDispatcher) -> None:
        self._dispatcher = dispatcher
        self._is_part = issubclass(dispatcher._compiler.pipeline_class, PartCompiler)
        self._enabled = True

    @cached_property
    def _files(self) -> _CheckedFiles:
        """Found at the first use: by then all that a kernel calls is defined, and few kernels of many are used."""
        function = self._dispatcher.py_func
        known = stamp(function, options_of(self._dispatcher))
        name = f"{function.__module__.rpartition('.')[2]}.{function.__qualname__.replace('<', '').replace('>', '')}"
        python = f"py{sys.version_info.major}{sys.version_info.minor}{sys.abiflags}"
        base = f"{name}-{known[:16]}.{python}" + (".part" if self._is_part else "")
        source = Path(function.__code__.co_filename).resolve()
        inside = source.relative_to(_PACKAGE).parent if source.is_relative_to(_PACKAGE) else Path("users")
        return _CheckedFiles(str(cache_folder() / "flexmbd" / inside), base, known)

    @property
    def cache_path(self) -> str:
        """The folder of the entries."""
        return str(self._files._cache_path)

    def load_overload(self, sig: Any, target_context: Any) -> CompileResult | None:
        """What was compiled for these types of arguments; None where it is not there."""
        target_context.refresh()
        payload = self._files.load(_key(sig, target_context.codegen())) if self._enabled else None
        if payload is None:
            return None
        rebuild = part_from if self._is_part else CompileResult._rebuild
        return rebuild(target_context, *payload)

    def save_overload(self, sig: Any, data: CompileResult) -> None:
        """Write what was compiled."""
        if not self._enabled or data.library.has_dynamic_globals or any(not one.can_cache for one in data.lifted):
            return
        payload = part_payload(data) if self._is_part else data._reduce()
        try:
            os.makedirs(self.cache_path, exist_ok=True)
            self._files.save(_key(sig, data.library.codegen), payload)
        except OSError:
            return  # a read-only or a full disk: the next process compiles it again

    def enable(self) -> None:
        """Read and write from now on."""
        self._enabled = True

    def disable(self) -> None:
        """Neither read nor write from now on."""
        self._enabled = False

    def flush(self) -> None:
        """Forget all entries."""
        self._files.flush()


def _key(sig: Any, codegen: Any) -> Any:
    return sig, codegen.magic_tuple()


class _CheckedFiles(caching.IndexDataCacheFile):
    """A kernel's entries in the cache: an index by types of arguments, and a file of machine code for each.

    Each file begins with a digest of what follows, of its name, of the stamp and of numba's version.  A file that is
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
        note_use(os.path.join(self._cache_path, name))
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
        if not _written:
            prune(cache_folder() / "flexmbd")
        _written.append(name)
