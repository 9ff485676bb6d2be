"""Digests of users' functions, by their code and the values that they use; addresses change between processes."""

from __future__ import annotations

import contextlib
import dis
import functools
import hashlib
import sys
import types
from collections.abc import Callable, Iterator
from enum import Enum
from typing import Any

import numpy as np

from flexmbd.multibody.kernels.base.kernel_function import KernelFunction

_PLAIN = (bool, int, float, complex, str, bytes, type(None), np.generic)


def fingerprint(function: Callable[..., Any]) -> str:
    """Of a function's instructions, constants, defaults, and the numbers, texts and arrays that it reads from outside.

    What it writes there itself, or may change, as a list, does not count.  The same source gives the same under one
    version of Python.
    """
    digest = hashlib.sha256()
    _add(digest, function, set())
    return digest.hexdigest()


def called_fingerprint(function: Callable[..., Any]) -> str:
    """Of the functions alone that numba compiled and that a function calls, at any depth; "" where there are none.

    Their machine code keeps the values that they read when they were compiled.
    """
    found = [value for value in _reached(function, set()) if _is_compiled(value)]
    digest = hashlib.sha256()
    for value in found:
        _add(digest, value.py_func, set())
    return digest.hexdigest() if found else ""


def _is_compiled(value: Any) -> bool:
    """Whether it is a kernel, or numba, which is then loaded, has compiled it."""
    dispatcher = sys.modules.get("numba.core.dispatcher")
    return isinstance(value, KernelFunction) or (dispatcher is not None and isinstance(value, dispatcher.Dispatcher))


def _reached(function: Any, seen: set[int]) -> Iterator[Any]:
    """What a function names outside itself, and what the functions among that name, each once."""
    if id(function) in seen or not isinstance(function, types.FunctionType):
        return
    seen.add(id(function))
    for value in _named_outside(function):
        yield value
        yield from _reached(value.py_func if _is_compiled(value) else value, seen)


def _add(digest: Any, value: Any, seen: set[int]) -> None:
    if isinstance(value, Enum):
        digest.update(f"{value!r};".encode())
        return
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
    elif _is_compiled(value):
        _add(digest, value.py_func, seen)
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
    _add(digest, function.__code__, seen)
    _add(digest, function.__defaults__ or (), seen)
    for value in _named_outside(function):
        _add(digest, value, seen)


def _named_outside(function: types.FunctionType) -> Iterator[Any]:
    """Values of the outer variables and globals that a function reads and does not write, and of modules among them.

    Of a module those that the function names: ``config.k`` is the value of ``k``.
    """
    codes = list(_with_inner(function.__code__))
    steps = [step for code in codes for step in dis.get_instructions(code)]
    written = {step.argval for step in steps if step.opname in ("STORE_DEREF", "STORE_GLOBAL")}
    for name, cell in zip(function.__code__.co_freevars, function.__closure__ or (), strict=True):
        with contextlib.suppress(ValueError):  # of a cell that nothing was put in yet
            if name not in written:
                yield cell.cell_contents
    names = {name: None for code in codes for name in code.co_names}
    found = [function.__globals__[name] for name in names if name not in written and name in function.__globals__]
    modules: list[types.ModuleType] = []  # import each other in circles
    while found:
        value = found.pop(0)
        yield value
        if isinstance(value, types.ModuleType) and value not in modules:
            modules.append(value)
            found += [vars(value)[name] for name in names if name in vars(value)]


def _with_inner(code: types.CodeType) -> Iterator[types.CodeType]:
    """A function's code, and that of the functions and comprehensions in it."""
    yield code
    for part in code.co_consts:
        if isinstance(part, types.CodeType):
            yield from _with_inner(part)
