"""What a kernel's machine code follows from: its own code, that of all it calls, and the constants that these name.

A stamp is a digest of that. What stands behind an address is not part of it: of a deferred kernel its callers know the
name and what it takes and returns, and stay as they are when it is edited. Comments and docstrings change no stamp.
"""

from __future__ import annotations

import enum
import hashlib
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np

from flexmbd.multibody.kernels.base.kernel_function import KernelFunction
from flexmbd.multibody.kernels.base.on_demand import Intrinsic

#: Files by which all kernels are compiled, and callers find deferred ones.
_HOW = (
    "array_struct.py", "deferred.py", "entry_code.py", "pipeline.py", "struct_layout.py", "struct_type.py",
    "translation.py",
)  # fmt: skip
#: What is installed beside the package, and known by its names alone.
_FOREIGN = sys.stdlib_module_names | {"numpy", "numba", "llvmlite", "scipy"}
_PLAIN = (bool, int, float, complex, str, bytes, type(None), np.generic)


@dataclass(frozen=True)
class _Code:
    """A function's own contribution to a stamp, and the functions that it names."""

    digest: bytes
    named: tuple[tuple[Any, str], ...]


def stamp(function: FunctionType, options: str) -> str:
    """Digest of what the machine code of a function, compiled with some options, follows from."""
    found: dict[tuple[FunctionType, str], bytes] = {}
    waiting = [(function, options)]
    while waiting:
        one = waiting.pop()
        if one not in found:
            code = _code(*one)
            found[one] = code.digest
            waiting.extend(code.named)
    return hashlib.sha256(b"".join([_how(), *sorted(found.values())])).hexdigest()


def _sorted(value: Any) -> Any:
    return sorted(value, key=repr) if isinstance(value, set | frozenset) else value


@cache
def _how() -> bytes:
    folder = Path(__file__).parent
    return hashlib.sha256(b"".join((folder / name).read_bytes() for name in _HOW)).digest()


@cache
def _code(function: FunctionType, options: str) -> _Code:
    named: list[tuple[Any, str]] = []
    text = [function.__module__, function.__qualname__, options, *_words(function.__code__, function.__doc__)]
    closed_over = (cell.cell_contents for cell in function.__closure__ or ())
    given = (function.__defaults__, function.__kwdefaults__, *closed_over)
    attributes = set(_names(function.__code__))
    scope = function.__globals__
    values = [*((f"given {k}", one) for k, one in enumerate(given))]
    values += [(name, scope[name]) for name in sorted(attributes & scope.keys())]
    for name, value in values:
        text.append(f"{name}: {_description(value, attributes, named, function)}")
    return _Code(hashlib.sha256("\n".join(text).encode()).digest(), tuple(named))


def _names(code: CodeType) -> Iterator[str]:
    """All that a code and those within it look up by name."""
    yield from code.co_names
    for one in code.co_consts:
        if isinstance(one, CodeType):
            yield from _names(one)


def _words(code: CodeType, documentation: str | None) -> Iterator[str]:
    """What tells a code from another one; lines and files do not."""
    yield code.co_code.hex() + code.co_exceptiontable.hex()
    yield repr((code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars))
    yield repr((code.co_argcount, code.co_posonlyargcount, code.co_kwonlyargcount, code.co_flags))
    for k, one in enumerate(code.co_consts):
        if isinstance(one, CodeType):
            first = one.co_consts[0] if one.co_consts and isinstance(one.co_consts[0], str) else None
            yield from _words(one, first)
        elif k > 0 or documentation is None or one != documentation:
            yield repr(_sorted(one))


def _description(value: Any, attributes: set[str], named: list[tuple[Any, str]], user: FunctionType) -> str:
    """Text of a value that a function ``user`` names with some ``attributes``; functions among it join ``named``."""

    def described(values: Iterable[Any]) -> str:
        return ", ".join(_description(one, attributes, named, user) for one in values)

    if isinstance(value, enum.Enum):
        return f"{type(value).__qualname__}.{value.name} {described([value.value])}"
    if isinstance(value, _PLAIN):
        return f"{type(value).__name__} {value!r}"
    if isinstance(value, tuple | list):
        return f"{type(value).__name__} ({described(value)})"
    if isinstance(value, dict):
        return f"dict ({described(value)}) ({described(value.values())})"
    if isinstance(value, np.ndarray):
        return f"{value.dtype} {value.shape} {hashlib.sha256(value.tobytes()).hexdigest()}"
    if isinstance(value, enum.EnumType):
        return f"{value.__qualname__} {described(value)}"
    if isinstance(value, ModuleType):
        if _is_foreign(value.__name__):
            return value.__name__
        parts = sorted(attributes & vars(value).keys())
        return f"{value.__name__} {parts} {described(vars(value)[name] for name in parts)}"
    return _called(value, named, user)


def _called(value: Any, named: list[tuple[Any, str]], user: FunctionType) -> str:
    """Text of a function, a class or another object; functions of which it is made join ``named``."""
    if isinstance(value, KernelFunction):
        named.append((value.py_func, value.options))
        return f"kernel {value.py_func.__module__}.{value.py_func.__qualname__}"
    if isinstance(value, Intrinsic):
        if value.text:
            return value.text
        named.append((value.definition, "intrinsic"))
        return f"intrinsic {value.definition.__module__}.{value.definition.__qualname__}"
    module, name = getattr(value, "__module__", None), getattr(value, "__qualname__", None)
    if module is not None and name is not None and _is_foreign(module):
        return f"{module}.{name}"
    if isinstance(value, FunctionType):
        named.append((value, "python"))
        return f"function {module}.{name}"
    if isinstance(value, type):
        named.extend((one, "method") for one in vars(value).values() if isinstance(one, FunctionType))
        return f"class {module}.{name} {value.__mro__[1:]}"
    text = repr(value)
    if " at 0x" in text:  # no text of its own: what its user's file says of it
        return f"{type(value)} {hashlib.sha256(Path(user.__code__.co_filename).read_bytes()).hexdigest()}"
    return f"{type(value)} {text}"


def _is_foreign(module: str) -> bool:
    return module.partition(".")[0] in _FOREIGN
