"""Digests of users' functions, by their code and the values that they use; addresses change between processes."""

from __future__ import annotations

import contextlib
import dis
import functools
import hashlib
import types
from collections.abc import Callable
from typing import Any

import numpy as np

_PLAIN = (bool, int, float, complex, str, bytes, type(None), np.generic)


def fingerprint(function: Callable[..., Any]) -> str:
    """Of a function's instructions, constants, defaults, and the numbers, texts and arrays that it reads from outside.

    What it writes there itself, or may change, as a list, does not count.  The same source gives the same under one
    version of Python.
    """
    digest = hashlib.sha256()
    _add(digest, function, set())
    return digest.hexdigest()


def _add(digest: Any, value: Any, seen: set[int]) -> None:
    if isinstance(value, _PLAIN):
        digest.update(f"{type(value).__name__} {value!r};".encode())
        return
    if isinstance(value, np.ndarray) and value.dtype.kind in "biufc":
        digest.update(f"{value.shape} {value.dtype}".encode() + np.ascontiguousarray(value).tobytes())
        return
    if id(value) in seen:
        return
    seen.add(id(value))
    if isinstance(value, tuple):
        for part in value:
            _add(digest, part, seen)
    elif isinstance(value, types.CodeType):
        digest.update(value.co_code)
        digest.update(" ".join(value.co_names).encode())
        _add(digest, value.co_consts, seen)
    elif isinstance(value, types.FunctionType):
        _add_function(digest, value, seen)
    elif isinstance(value, types.MethodType):
        _add(digest, value.__func__, seen)
    elif isinstance(value, functools.partial):
        for part in (value.func, value.args, tuple(sorted(value.keywords.items()))):
            _add(digest, part, seen)
    else:
        digest.update(type(value).__qualname__.encode())
        call = next((vars(kind)["__call__"] for kind in type(value).__mro__ if "__call__" in vars(kind)), None)
        if isinstance(call, types.FunctionType):
            _add(digest, call, seen)


def _add_function(digest: Any, function: types.FunctionType, seen: set[int]) -> None:
    code = function.__code__
    _add(digest, code, seen)
    _add(digest, function.__defaults__ or (), seen)
    written = {step.argval for step in dis.get_instructions(code) if step.opname in ("STORE_DEREF", "STORE_GLOBAL")}
    for name, cell in zip(code.co_freevars, function.__closure__ or (), strict=True):
        with contextlib.suppress(ValueError):  # of a cell that nothing was put in yet
            if name not in written:
                _add(digest, cell.cell_contents, seen)
    for name in code.co_names:
        if name not in written and name in function.__globals__:
            _add(digest, function.__globals__[name], seen)
