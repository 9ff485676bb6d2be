"""Kernels translated and compiled by numba, where the cache does not hold them."""

from __future__ import annotations

import os
from typing import Any

from numba import njit

from flexmbd.multibody.kernels.base.entry_code import entry_name, kind_of, layout_of
from flexmbd.multibody.kernels.base.kernel_store import Image
from flexmbd.multibody.kernels.base.part_cache import PartCache
from flexmbd.multibody.kernels.base.pipeline import EntryCompiler, PartCompiler

_OPTIONS: dict[str, Any] = {
    "error_model": "numpy", "nogil": True, "_nrt": False, "no_cfunc_wrapper": True, "no_cpython_wrapper": True,
}  # fmt: skip
_REORDERED = {"reassoc", "contract", "nsz"}


def translated(kernel: Any) -> Any:
    """Numba's dispatcher of a kernel that becomes part of others."""
    options = {"fastmath": _REORDERED} if kernel.reordered else {}
    dispatcher = _dispatcher(kernel.py_func, PartCompiler, **options)
    if os.path.isfile(kernel.py_func.__code__.co_filename):  # else typed in: there is no source to know it by
        dispatcher._cache = PartCache(kernel)
    return dispatcher


def compiled_image(kernel: Any, kinds: tuple[Any, ...]) -> tuple[Image, bool]:
    """An entry compiled for arguments of these types, and whether other processes can use it.

    Raises:
        numba.TypingError: it does not compile for them.
        TypeError: it returns what Python cannot take.
    """
    dispatcher = _dispatcher(kernel.py_func, EntryCompiler)
    dispatcher.compile(kinds)
    (compiled,) = dispatcher.overloads.values()
    library, fndesc = compiled.library, compiled.fndesc
    module = library._final_module
    needs = [one.name for one in module.functions if one.is_declaration and not one.name.startswith("llvm.")]
    image = Image(
        entry=library.names[entry_name(fndesc)],
        symbol=library.names[fndesc.llvm_func_name],
        returns=layout_of(compiled.signature.return_type),
        kind=kind_of(compiled.signature.return_type),
        needs=tuple(needs),
        triple=module.triple,
        code=library.code,
        program=module.as_bitcode(),
    )
    return image, not library.has_dynamic_globals


def _dispatcher(function: Any, compiler: Any, **options: Any) -> Any:
    dispatcher = njit(**_OPTIONS, **options, pipeline_class=compiler)(function)
    # numba enters what it compiled into a table for calls from Python
    dispatcher._insert = lambda *_: None
    return dispatcher
