"""Kernels, and those that Python calls: their arguments as 64-bit words, by which the machine code is entered."""

from __future__ import annotations

import ctypes
import inspect
import pickle
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from flexmbd.multibody.kernels.base.array_struct import ArrayStruct, address_of_data
from flexmbd.multibody.kernels.base.kernel_function import KernelFunction
from flexmbd.multibody.kernels.base.kernel_store import Image, image_of
from flexmbd.multibody.kernels.base.machine_code import load
from flexmbd.multibody.kernels.base.quick_call import FLAGS, quick_call

_WORD, _NUMBER = struct.Struct("q"), struct.Struct("d")
_OFTEN = 64  # calls after which a quicker way is worth its making


class Kernel(KernelFunction):
    """A function that kernels call; numba translates it when one that calls it is compiled."""

    @cached_property
    def _translated(self) -> Any:
        from flexmbd.multibody.kernels.base.translation import translated

        return translated(self)

    @property
    def _numba_type_(self) -> Any:
        """What kernels call."""
        return self._translated._numba_type_

    def __call__(self, *_: Any) -> Any:
        """Refuse: there is no machine code to step into.

        Raises:
            TypeError: always.
        """
        name = self.py_func.__name__
        raise TypeError(f"{name} is called by kernels alone; @entry_kernel gives it a way in from Python")


class EntryKernel(Kernel):
    """A kernel that Python calls as well, compiled at its first call, or loaded from the cache.

    It takes arrays, structures of arrays, numbers and tuples of these, and may return numbers and tuples of numbers.
    Kernels that call it get it as a part, as if it were a ``kernel``: its own machine code is for Python, and for calls
    through its address.
    """

    entry_options = "entry"

    def __init__(self, function: Callable[..., Any], *, keeps_lock: bool = False) -> None:
        """``keeps_lock``: other threads of Python wait meanwhile, which costs less than to hand its lock over."""
        super().__init__(function)
        self._keeps_lock = keeps_lock
        self._calls: dict[Any, EntryCall] = {}
        self._addresses: dict[Any, int] = {}
        self._quick: Any = None  # for arguments of those types that it is called with most
        self.images: dict[str, Image] = {}  # those in use, by what tells their arguments from others

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        """Call the compiled kernel.

        Raises:
            TypeError: the number of arguments is wrong, or one is none that kernels take.
        """
        if self._quick is not None and not named:
            return self._quick(*arguments)
        return self._any_call(*arguments, **named)

    def _any_call(self, *arguments: Any, **named: Any) -> Any:
        """A call whose arguments Python reads."""
        if named or len(arguments) != self._count:
            arguments = self._bound(arguments, named)
        key = tuple([_kind(one) for one in arguments])
        call = self._calls.get(key)
        if call is None:
            call = self._calls[key] = EntryCall.of(self.image_for(arguments), arguments, keeps_lock=self._keeps_lock)
        call.calls += 1
        if call.calls == _OFTEN and self._quick is None:
            self._quick = quick_call(
                call.address, arguments, call.returns,
                otherwise=self._any_call, raiser=_raise, keeps_lock=self._keeps_lock,
            )  # fmt: skip
        return call(arguments)

    def address(self, arguments: tuple[Any, ...]) -> int:
        """Where the machine code for arguments of these types lies, for kernels that call it."""
        key = tuple([_kind(one) for one in arguments])
        if key not in self._addresses:
            self._addresses[key] = load(self.image_for(arguments))[1]
        return self._addresses[key]

    def image_for(self, arguments: tuple[Any, ...]) -> Image:
        """Machine code for arguments of these types."""
        return self.image(" ".join(map(_text, arguments)), lambda: tuple(map(_numba_type, arguments)))

    def image(self, key: str, kinds: Callable[[], tuple[Any, ...]]) -> Image:
        """Machine code for arguments of numba's types ``kinds()``, which ``key`` tells from others."""

        def compiled() -> tuple[Image, bool]:
            from flexmbd.multibody.kernels.base.translation import compiled_image

            return compiled_image(self, kinds())

        if key not in self.images:
            self.images[key] = image_of(self, key, compiled)
        return self.images[key]

    @cached_property
    def _count(self) -> int:
        return int(self.py_func.__code__.co_argcount)

    def _bound(self, arguments: tuple[Any, ...], named: dict[str, Any]) -> tuple[Any, ...]:
        bound = inspect.signature(self.py_func).bind(*arguments, **named)
        bound.apply_defaults()
        return bound.args


@dataclass
class EntryCall:
    """A way into machine code for arguments of known types."""

    address: int
    function: Any
    block: Any  # ctypes' type of the words: arguments, then results
    results: int
    returns: Any
    calls: int = 0

    @classmethod
    def of(cls, image: Image, arguments: tuple[Any, ...], *, keeps_lock: bool) -> EntryCall:
        """The way into an image that is for arguments as these, with Python's lock or without it."""
        count = len(list(_words(arguments)))
        results = max(1, _size(image.returns))  # an exception's address takes one
        address = load(image)[0]
        function = (_LOCKED_FUNCTION if keeps_lock else _FUNCTION)(address)
        return cls(address, function, ctypes.c_int64 * (count + results), count, image.returns)

    def __call__(self, arguments: tuple[Any, ...]) -> Any:
        """What the kernel returns, or raises."""
        words = self.block(*_words(arguments))
        status = self.function(words)
        if status:
            _raise(words[self.results])
        return None if self.returns is None else _read(self.returns, iter(words[self.results :]))


_FUNCTION = ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.c_void_p)
_LOCKED_FUNCTION = ctypes.PYFUNCTYPE(ctypes.c_int32, ctypes.c_void_p)


def _words(arguments: tuple[Any, ...]) -> list[int]:
    """The words of some arguments, in order."""
    words: list[int] = []
    for one in arguments:
        if isinstance(one, ArrayStruct):
            words.append(one._address)
        elif isinstance(one, np.ndarray):
            words.append(address_of_data(one))
            words += one.shape
            if not one.flags.c_contiguous:
                words += one.strides
        elif isinstance(one, float):
            words += _WORD.unpack(_NUMBER.pack(one))
        elif isinstance(one, tuple):
            words += _words(one)
        elif one is not None:
            words.append(_whole(int(one)))
    return words


def _whole(value: int) -> int:
    if not -(2**63) <= value < 2**63:
        raise OverflowError(f"{value:.3g} does not fit into 64 bits")
    return value


def _kind(value: Any) -> Any:
    """What tells the type of an argument from others in this process, found in little time."""
    kind = type(value)
    if kind is np.ndarray:
        return value.dtype.char, value.ndim, value.flags.num & FLAGS
    if isinstance(value, tuple):
        return kind, *[_kind(one) for one in value]
    return kind if not isinstance(value, np.ndarray) else _text(value)


def _text(value: Any) -> str:
    """What tells the type of an argument from others in any process.

    Raises:
        TypeError: kernels take no such arguments.
    """
    if isinstance(value, ArrayStruct):
        return value._layout.text
    if isinstance(value, np.ndarray):
        flags = value.flags
        order = "C" if flags.c_contiguous else "F" if flags.f_contiguous else "A"
        marks = f"{'' if flags.writeable else ' constant'}{'' if flags.aligned else ' unaligned'}"
        return f"{value.dtype.str}{value.ndim}{order}{marks}"
    if isinstance(value, tuple):
        parts = map(_text, value)
        if type(value) is not tuple:  # of named ones the order of the names may change
            parts = map("{}: {}".format, value._fields, parts)  # type: ignore[attr-defined]
        return f"{type(value).__qualname__}({', '.join(parts)})"
    if value is None:
        return "none"
    for kind, name in _NUMBERS:
        if isinstance(value, kind):
            return name
    raise TypeError(f"kernels take arrays, structures of arrays, numbers and tuples of these, not {value!r:.100}")


#: Kinds of numbers, the first that fits, and numba's names for them.
_NUMBERS: tuple[tuple[Any, str], ...] = (
    ((bool, np.bool_), "boolean"), (float, "float64"), ((int, np.int64), "int64"), (np.int32, "int32"),
)  # fmt: skip


def _numba_type(value: Any) -> Any:
    from numba import typeof, types

    for kind, name in _NUMBERS:
        if isinstance(value, kind):
            return getattr(types, name)
    if isinstance(value, tuple):
        return types.BaseTuple.from_types(tuple(map(_numba_type, value)), type(value))
    return typeof(value)


def _size(returns: Any) -> int:
    """Words of a result: None, "d" a number, "q" a whole one, "?" a truth, or a list of these."""
    if isinstance(returns, list):
        return sum(map(_size, returns))
    return 0 if returns is None else 1


def _read(returns: Any, words: Iterator[int]) -> Any:
    if isinstance(returns, list):
        return tuple([_read(one, words) for one in returns])
    if returns is None:
        return None
    word = next(words)
    if returns == "d":
        return _NUMBER.unpack(_WORD.pack(word))[0]
    return word if returns == "q" else bool(word)


def _raise(place: int) -> None:
    """Raise the exception that numba wrote at an address: a pickle's address and size stand there first."""
    data, size = ctypes.c_uint64.from_address(place).value, ctypes.c_int32.from_address(place + 8).value
    kind, arguments, _ = pickle.loads(ctypes.string_at(data, size))
    raise kind(*arguments)
