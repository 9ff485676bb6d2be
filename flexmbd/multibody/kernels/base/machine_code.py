"""Machine code of kernels in this process: loaded by LLVM's own loader, for which numba is not needed."""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import cache
from typing import Any

import llvmlite.binding as llvm

from flexmbd.multibody.kernels.base.extension_module import extension_module
from flexmbd.multibody.kernels.base.kernel_store import Image


def load(image: Image) -> tuple[int, int]:
    """Addresses of an image's entry and of the kernel itself."""
    with _lock:
        if image.symbol not in _loaded:
            _provide(image.needs)
        address_in(image.symbol, lambda: image.code)
        return _engine().get_function_address(image.entry), _loaded[image.symbol]


def address_in(symbol: str, code: Callable[[], bytes]) -> int:
    """Address of a symbol in object code, which is loaded unless it has been before."""
    with _lock:
        if symbol not in _loaded:
            engine = _engine()
            engine.add_object_file(llvm.ObjectFileRef.from_data(code()))
            engine.finalize_object()
            _loaded[symbol] = engine.get_function_address(symbol)
        return _loaded[symbol]


_loaded: dict[str, int] = {}  # symbols hold a digest of the program
_lock = threading.RLock()


def _provide(symbols: tuple[str, ...]) -> None:
    """Let LLVM know numba's own C functions that code calls.

    Raises:
        RuntimeError: nobody knows a symbol.
    """
    _engine()  # with it LLVM finds what this process has loaded
    for name in symbols:
        if llvm.address_of_symbol(name) is None:
            address = _helpers().get(name.removeprefix("numba_"))
            if address is None:
                raise RuntimeError(f"a kernel calls {name}, which this process does not know")
            llvm.add_symbol(name, address)


@cache
def _helpers() -> dict[str, int]:
    """Addresses of numba's C functions."""
    return dict(extension_module("numba._helperlib").c_helpers)


@cache
def _engine() -> Any:
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    target = llvm.Target.from_triple(llvm.get_process_triple())
    return llvm.create_mcjit_compiler(llvm.parse_assembly(""), target.create_target_machine(jit=True))
