"""Translated kernels on disk, for those that are compiled with them: an edit then takes what it reaches, no more."""

from __future__ import annotations

import os
import pickle
import sys
from functools import cached_property
from pathlib import Path
from typing import Any

from numba.core import caching, types
from numba.core.compiler import CompileResult
from numba.core.sigutils import normalize_signature
from numba.core.typing.templates import Signature

from flexmbd.multibody.kernels.base.kernel_function import KernelFunction
from flexmbd.multibody.kernels.base.kernel_stamp import stamp
from flexmbd.multibody.kernels.base.kernel_store import note_written, place_of, read_checked, write_checked
from flexmbd.multibody.kernels.base.pipeline import part_from, part_payload


class PartCache(caching._Cache):
    """The translations of one kernel.

    Where the cache cannot be written to what is there is used, and what is not there is translated in each process.
    """

    def __init__(self, kernel: KernelFunction) -> None:
        self._kernel = kernel
        self._enabled = True

    @cached_property
    def _files(self) -> _CheckedFiles:
        """Found at the first use: by then all that a kernel calls is defined, and few kernels of many are used."""
        known = stamp(self._kernel.py_func, self._kernel.options)
        folder, name = place_of(self._kernel.py_func, known)
        python = f"py{sys.version_info.major}{sys.version_info.minor}{sys.abiflags}"
        return _CheckedFiles(str(folder), f"{name}.{python}.part", known)

    @property
    def cache_path(self) -> str:
        """The folder of the entries."""
        return str(self._files._cache_path)

    def load_overload(self, sig: Any, target_context: Any) -> CompileResult | None:
        """What was translated for these types of arguments; None where it is not there."""
        target_context.refresh()
        payload = self._files.load(_key(sig, target_context.codegen())) if self._enabled else None
        return None if payload is None else part_from(target_context, *payload)

    def save_overload(self, sig: Any, data: CompileResult) -> None:
        """Write what was translated."""
        if not self._enabled or data.library.has_dynamic_globals:
            return
        try:
            os.makedirs(self.cache_path, exist_ok=True)
            self._files.save(_key(sig, data.library.codegen), part_payload(data))
        except OSError:
            return  # a read-only or a full disk: the next process translates it again

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
    kinds = sig.args if isinstance(sig, Signature) else normalize_signature(sig)[0]
    return sig, codegen.magic_tuple(), _field_names(kinds)


def _field_names(kinds: Any) -> tuple[Any, ...]:
    """Names and order of the fields of named tuples, which are no part of numba's types, and may change."""
    return tuple([
        (kind.fields if isinstance(kind, types.BaseNamedTuple) else (), _field_names(kind))
        for kind in kinds
        if isinstance(kind, types.BaseTuple)
    ])  # fmt: skip


class _CheckedFiles(caching.IndexDataCacheFile):
    """A kernel's entries in the cache: an index by types of arguments, and a file for each.

    numba itself would stop at some that are damaged, and run the others.
    """

    def _read(self, name: str) -> Any:
        """What a file holds; None where it is absent."""
        content = read_checked(Path(self._cache_path, name), self._known)
        try:
            return None if content is None else pickle.loads(content)
        except (ImportError, AttributeError):  # types of arguments that have since moved to another module
            return None

    def _write(self, name: str, value: Any) -> None:
        write_checked(Path(self._cache_path, name), self._known, self._dump(value))

    @property
    def _known(self) -> str:
        return f"{self._version} {self._source_stamp}"

    def _load_index(self) -> dict[Any, str]:
        return self._read(self._index_name) or {}

    def _save_index(self, overloads: dict[Any, str]) -> None:
        self._write(self._index_name, overloads)

    def _load_data(self, name: str) -> Any:
        return self._read(name)

    def _save_data(self, name: str, data: Any) -> None:
        self._write(name, data)
        note_written(Path(name))
