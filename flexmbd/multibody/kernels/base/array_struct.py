"""Structures of arrays that kernels take by one pointer: ``Plan``, work arrays, arrays of methods.

numba would hand a tuple of n arrays from kernel to kernel as 7 n words or so, written by the caller and read by the
callee, and would compile them so at every call.  A structure is a pointer to a block of words instead (an array's data
and shape, a number, another structure's pointer); what a kernel reads of it is loaded from there.
"""

from __future__ import annotations

import ctypes
import dataclasses
import struct
from functools import cached_property
from typing import Any, Self

import numpy as np

from flexmbd.multibody.kernels.base.struct_layout import Layout


class _NumbaType:
    """What numba takes a structure for."""

    def __get__(self, instance: Any, kind: Any) -> Any:
        from flexmbd.multibody.kernels.base.struct_type import type_of

        return type_of(kind._layout)


class ArrayStruct:
    """Base of frozen dataclasses of C-contiguous arrays, numbers and further structures, for kernels.

    Kernels read its fields by their names, as Python does.  Types of fields (an array's dtype and number of
    dimensions) are those of the first instance and never change, so that one compiled image serves all.

    Raises:
        TypeError: a field has another type than in the instances before, or is none that kernels take.
    """

    _layout: Layout
    _numba_type_ = _NumbaType()

    def __post_init__(self) -> None:
        _check_fields(type(self), vars(self))

    @cached_property
    def _block(self) -> np.ndarray:
        """The words that kernels read."""
        own, found = vars(self), list[int]()
        for name in self._layout.places:
            value = own[name]
            if type(value) is np.ndarray:  # as most are; see ``words``
                found.append(_word_at(id(value) + _DATA).value)
                found.extend(value.shape)
            else:
                found.extend(words(value))
        block = np.array(found, np.int64)
        return vars(self).setdefault("_block", block)  # of threads that ask at once one is right, for it has an address

    @cached_property
    def _address(self) -> int:
        return address_of_data(self._block)

    def lay_out(self) -> None:
        """Write the words that kernels read, which otherwise the first call of one does."""
        _ = self._address

    def replace(self, **changes: Any) -> Self:
        """Return a copy with other fields.

        Raises:
            TypeError: as of the structure; or it has no such field.
        """
        kept = vars(self)
        other = object.__new__(type(self))
        vars(other).update(kept)
        vars(other).pop("_address", None)
        block = vars(other).pop("_block", None)
        if not changes.keys() <= kept.keys():
            raise TypeError(f"{type(self).__name__} has no fields {sorted(changes.keys() - kept.keys())}")
        vars(other).update(changes)
        other.__post_init__()
        if block is not None:  # all words but those of the changed fields are there
            block = block.copy()
            for name, value in changes.items():
                found = words(value)
                place = self._layout.places[name]
                block[place : place + len(found)] = found
            vars(other)["_block"] = block
        return other

    def fields(self) -> dict[str, Any]:
        """Return the fields by name, in order."""
        return {name: getattr(self, name) for name in self._layout.places}

    def __reduce__(self) -> Any:
        """Copies and pickles have pointers of their own."""
        return type(self), tuple(self.fields().values())


def names_of(kind: type[ArrayStruct]) -> tuple[str, ...]:
    """Return the names of a structure's fields, in order."""
    return tuple(field.name for field in dataclasses.fields(kind))  # type: ignore[arg-type]


_WORD, _NUMBER = struct.Struct("q"), struct.Struct("d")


def words(value: Any) -> list[int]:
    """Return the 64-bit words that encode a field in its structure's block."""
    if isinstance(value, np.ndarray):
        return [address_of_data(value), *value.shape]
    if isinstance(value, ArrayStruct):
        return [value._address]
    if isinstance(value, float):
        return [_WORD.unpack(_NUMBER.pack(value))[0]]
    return [int(value)]


def address_of_data(array: np.ndarray) -> int:
    """Return where an array's numbers lie."""
    return _word_at(id(array) + _DATA).value


# An array's first field after what all Python objects begin with points to its numbers (numpy's C API, PyArrayObject):
# to read it takes a tenth of the time of `array.ctypes.data`, and a run of a machine asks some two hundred times.
_word_at = ctypes.c_size_t.from_address
_DATA = object.__basicsize__


def _field_kind(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        if not value.flags.c_contiguous:
            raise TypeError("arrays of a kernel's structure are C-contiguous")
        return value.dtype.char, value.ndim
    if isinstance(value, ArrayStruct):
        return value._layout
    return "d" if isinstance(value, float) else "q"


_kinds: dict[type, tuple[tuple[str, Any], ...]] = {}


def _kind(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.dtype.char, value.ndim, value.flags.c_contiguous
    return float if isinstance(value, float) else type(value)  # numpy's float64 is one


def _check_fields(cls: type, values: dict[str, Any]) -> None:
    """Raise TypeError unless the fields have the types of those of the first instance, which sets them."""
    known = _kinds.get(cls)
    if known is None:
        names = [field.name for field in dataclasses.fields(cls)]
        fields = tuple((name, _field_kind(values[name])) for name in names)
        cls._layout = Layout(f"{cls.__module__}.{cls.__qualname__}", fields)  # type: ignore[attr-defined]
        _kinds[cls] = tuple((name, _kind(values[name])) for name in names)
        return
    for name, kind in known:
        value = values[name]
        if type(value) is np.ndarray and type(kind) is tuple:
            fits = value.dtype.char == kind[0] and value.ndim == kind[1] and value.flags.c_contiguous == kind[2]
        else:
            fits = _kind(value) == kind
        if not fits:
            raise TypeError(
                f"{cls.__name__} has fields of other types than before: {name} is {_kind(values[name])}, not {kind}"
            )
