"""Structures of arrays that kernels take by one pointer: ``Plan``, work arrays, what a method works with.

numba would hand a tuple of n arrays from kernel to kernel as 7 n words or so, written by the caller and read by the
callee, and would compile them so at every call.  A structure is a pointer to a block of words instead (an array's data
and shape, a number, another structure's pointer); what a kernel reads of it is loaded from there.
"""

from __future__ import annotations

import ctypes
import dataclasses
from functools import cached_property
from typing import Any, Self

import numpy as np
from llvmlite import ir
from numba import typeof, types
from numba.core import cgutils
from numba.core.typing.templates import AttributeTemplate
from numba.extending import (
    NativeValue,
    infer_getattr,
    lower_getattr_generic,
    models,
    register_model,
    unbox,
)

_WORD = ir.IntType(64)


class ArrayStruct:
    """Base of frozen dataclasses of C-contiguous arrays, numbers and further structures, for kernels.

    Kernels read its fields by their names, as Python does.  Types of fields (an array's dtype and number of
    dimensions) are those of the first instance and never change, so that one compiled image serves all.

    Raises:
        TypeError: a field has another type than in the instances before, or is none that kernels take.
    """

    _numba_type_: StructType

    def __post_init__(self) -> None:
        _check_fields(type(self), vars(self))

    @cached_property
    def _block(self) -> np.ndarray:
        """The words that kernels read."""
        block = np.array([word for value in self.fields().values() for word in words(value)], np.int64)
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
                place = self._numba_type_.places[name][0]
                block[place : place + len(found)] = found
            vars(other)["_block"] = block
        return other

    def fields(self) -> dict[str, Any]:
        """Return the fields by name, in order."""
        return {name: getattr(self, name) for name in self._numba_type_.places}

    def __reduce__(self) -> Any:
        """Copies and pickles have pointers of their own."""
        return type(self), tuple(self.fields().values())


def names_of(kind: type[ArrayStruct]) -> tuple[str, ...]:
    """Return the names of a structure's fields, in order."""
    return tuple(field.name for field in dataclasses.fields(kind))  # type: ignore[arg-type]


def words(value: Any) -> list[int]:
    """Return what of a field stands in its structure's block: 64-bit words."""
    if isinstance(value, np.ndarray):
        return [address_of_data(value), *value.shape]
    if isinstance(value, ArrayStruct):
        return [value._address]
    if isinstance(value, float):
        return [int(np.float64(value).view(np.int64))]
    return [int(value)]


def address_of_data(array: np.ndarray) -> int:
    """Return where an array's numbers lie."""
    return _word_at(id(array) + _DATA).value


# An array's first field after what all Python objects begin with points to its numbers (numpy's C API, PyArrayObject):
# to read it takes a tenth of the time of `array.ctypes.data`, and a run of a machine asks some two hundred times.
_word_at = ctypes.c_size_t.from_address
_DATA = object.__basicsize__


def _field_type(value: Any) -> types.Type:
    if isinstance(value, np.ndarray):
        if not value.flags.c_contiguous:
            raise TypeError("arrays of a kernel's structure are C-contiguous")
        return types.Array(typeof(value).dtype, value.ndim, "C")
    if isinstance(value, ArrayStruct):
        return value._numba_type_
    return types.float64 if isinstance(value, float) else types.int64


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
        fields = tuple((name, _field_type(values[name])) for name in names)
        cls._numba_type_ = StructType(f"{cls.__module__}.{cls.__qualname__}", fields)  # type: ignore[attr-defined]
        _kinds[cls] = tuple((name, _kind(values[name])) for name in names)
        return
    for name, kind in known:
        if _kind(values[name]) != kind:
            raise TypeError(
                f"{cls.__name__} has fields of other types than before: {name} is {_kind(values[name])}, not {kind}"
            )


class StructType(types.Type):
    """numba's type of a structure: its name and its fields' types."""

    def __init__(self, qualified: str, fields: tuple[tuple[str, types.Type], ...]) -> None:
        self.qualified = qualified
        self.fields = fields
        self.places: dict[str, tuple[int, types.Type]] = {}
        at = 0
        for name, kind in fields:
            self.places[name] = at, kind
            at += 1 + (kind.ndim if isinstance(kind, types.Array) else 0)
        super().__init__(name=f"{qualified.rpartition('.')[2]}*")
        self._hash = hash(self.key)  # numba asks for it some hundred thousand times as it finds a method's types

    @property
    def key(self) -> Any:
        """What tells one structure from another."""
        return self.qualified, self.fields

    def __eq__(self, other: object) -> bool:
        return self is other or (isinstance(other, StructType) and self.key == other.key)

    def __hash__(self) -> int:
        return self._hash

    def __reduce__(self) -> Any:
        """Hashes of strings differ from process to process: it is made anew."""
        return StructType, (self.qualified, self.fields)


@register_model(StructType)
class _StructModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: StructType) -> None:
        super().__init__(manager, kind, _WORD.as_pointer())


@infer_getattr
class _StructAttributes(AttributeTemplate):
    key = StructType

    def generic_resolve(self, kind: StructType, name: str) -> types.Type | None:
        place = kind.places.get(name)
        return None if place is None else place[1]


@lower_getattr_generic(StructType)
def _load_field(context: Any, builder: Any, kind: StructType, pointer: Any, name: str) -> Any:
    at, field = kind.places[name]

    def load(offset: int, kind: Any = _WORD) -> Any:
        place = cgutils.gep_inbounds(builder, pointer, at + offset)
        word = builder.load(builder.bitcast(place, kind.as_pointer()))
        # the block is written before a kernel sees it, and never again: no store can change what was loaded
        word.set_metadata("invariant.load", builder.module.add_metadata([]))
        return word

    if isinstance(field, StructType):
        return load(0, _WORD.as_pointer())
    if not isinstance(field, types.Array):
        return load(0, context.get_value_type(field))
    return _array_of(context, builder, field, load)


def _array_of(context: Any, builder: Any, field: types.Array, load: Any) -> Any:
    """The array whose words ``load`` loads, set up as one value.

    numba's own way writes each part to the stack and reads it back, three times the text for LLVM to read.
    """
    model = context.data_model_manager[field]
    shape = [load(1 + axis) for axis in range(field.ndim)]
    size = context.get_abi_sizeof(context.get_data_type(field.dtype))
    strides = [ir.Constant(_WORD, size)]
    for length in reversed(shape[1:]):
        strides.insert(0, builder.mul(strides[0], length, flags=("nsw",)))
    count = shape[0]
    for length in shape[1:]:
        count = builder.mul(count, length, flags=("nsw",))
    kinds = [model.get_type(name) for name in model._fields]
    kinds = [context.data_model_manager[kind].get_value_type() for kind in kinds]
    places = {name: model.get_field_position(name) for name in model._fields}
    constants = [ir.Constant(kind, None) for kind in kinds]
    constants[places["itemsize"]] = ir.Constant(_WORD, size)
    if field.ndim == 1:
        constants[places["strides"]] = ir.Constant(kinds[places["strides"]], strides)
    array = ir.Constant(ir.LiteralStructType(kinds), constants)
    array = builder.insert_value(array, count, places["nitems"])
    array = builder.insert_value(array, load(0, kinds[places["data"]]), places["data"])
    for axis in range(field.ndim):
        array = builder.insert_value(array, shape[axis], (places["shape"], axis))
        if field.ndim > 1:
            array = builder.insert_value(array, strides[axis], (places["strides"], axis))
    return array


@unbox(StructType)
def _unbox_struct(kind: StructType, value: Any, c: Any) -> NativeValue:
    address = c.pyapi.object_getattr_string(value, "_address")
    number = cgutils.alloca_once_value(c.builder, ir.Constant(_WORD, 0))
    # the words may be written by Python, where Ctrl-C may strike: then there is no address
    with c.builder.if_then(cgutils.is_not_null(c.builder, address), likely=True):
        c.builder.store(c.pyapi.long_as_longlong(address), number)
        c.pyapi.decref(address)
    pointer = c.builder.inttoptr(c.builder.load(number), _WORD.as_pointer())
    return NativeValue(pointer, is_error=cgutils.is_not_null(c.builder, c.pyapi.err_occurred()))
