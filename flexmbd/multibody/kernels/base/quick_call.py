"""Calls of kernels that are called often: their arguments are read by machine code in place of Python.

Of each list of arguments' types there is one function, which Python calls as its own builtin ones. It fills the words
that `entry` fills, a tenth as long, and calls the machine code; where an argument is of another type than it is for it
hands all of them to `entry` itself. What it needs of this process stands in a table of words.
"""

from __future__ import annotations

import ctypes
import hashlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from flexmbd.multibody.kernels.base.array_struct import ArrayStruct
from flexmbd.multibody.kernels.base.kernel_store import kept_code
from flexmbd.multibody.kernels.base.machine_code import address_in

FLAGS = 0x503  # of arrays, numpy's: contiguous in C's order, in Fortran's; aligned; may be written to
_KINDS = {float: "d", np.float64: "d", int: "q", bool: "?", type(None): "n"}


def quick_call(
    entry: int,
    arguments: tuple[Any, ...],
    returns: Any,
    *,
    otherwise: Callable[..., Any],
    raiser: Callable[[int], Any],
    keeps_lock: bool,
) -> Any:
    """A builtin function that enters machine code with arguments of such types; None where there is none for them.

    Args:
        entry: address of the C function.
        arguments: some of the types.
        returns: what is returned, as `kernel_store.Image` has it.
        otherwise: called with arguments of other types.
        raiser: raises the exception at an address.
        keeps_lock: whether Python's lock is kept meanwhile.
    """
    kinds: list[Any] = []
    types: list[Any] = []
    if not all(_describe(one, kinds, types) for one in arguments):
        return None
    what = repr((kinds, returns, keeps_lock, _how()))
    name = f"flexmbd_call_{hashlib.sha256(what.encode()).hexdigest()[:16]}"

    def written() -> bytes:
        from flexmbd.multibody.kernels.base.quick_call_code import object_code

        return object_code(name, kinds, returns, keeps_lock=keeps_lock)

    address = address_in(name, lambda: kept_code(name, what, written))
    objects = [_ADDRESS, None, otherwise, raiser, *types]
    table = (ctypes.c_int64 * (len(objects) + 1))(entry, *map(id, objects))
    method = _Method(name.encode(), address, _FASTCALL, None)
    function = _new_function()(ctypes.addressof(method), ctypes.addressof(table), None)
    _kept.append((objects, table, method))
    return function


@cache
def _how() -> str:
    """Digest of how the functions are written."""
    return hashlib.sha256(Path(__file__).with_name("quick_call_code.py").read_bytes()).hexdigest()


_kept: list[Any] = []  # what functions stand on, as long as the process


def _describe(value: Any, kinds: list[Any], types: list[Any]) -> bool:
    """Note how an argument is read, and the types of the objects in it; False where it is of none that is read."""
    kind = type(value)
    types.append(kind)
    if isinstance(value, ArrayStruct):
        kinds.append("s")
    elif kind is np.ndarray:
        strided = not value.flags.c_contiguous
        kinds.append((value.dtype.num, ord(value.dtype.byteorder), value.ndim, FLAGS, value.flags.num & FLAGS, strided))
    elif kind is tuple:
        inner: list[Any] = []
        if not all(_describe(one, inner, types) for one in value):
            return False
        kinds.append(inner)
    elif kind in _KINDS:
        kinds.append(_KINDS[kind])
    else:
        return False
    return True


class _Method(ctypes.Structure):
    """CPython's PyMethodDef."""

    _fields_ = (
        ("name", ctypes.c_char_p), ("address", ctypes.c_void_p), ("flags", ctypes.c_int), ("doc", ctypes.c_char_p),
    )  # fmt: skip


_FASTCALL = 0x80
_ADDRESS = "_address"  # interned, as all names in code


@cache
def _new_function() -> Any:
    make = ctypes.pythonapi.PyCFunction_NewEx
    make.argtypes, make.restype = [ctypes.c_void_p, ctypes.py_object, ctypes.c_void_p], ctypes.py_object
    return make
