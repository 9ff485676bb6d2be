"""Structures of arrays that kernels take by one pointer: ``Plan``, work arrays, what a method works with.

numba would hand a tuple of n arrays from kernel to kernel as 7 n words or so, written by the caller and read by the
callee, and would compile them so at every call.  A structure is a pointer to a block of words instead (an array's data
and shape, a number, another structure's pointer); what a kernel reads of it is loaded from there.
"""

from __future__ import annotations

import dataclasses
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

    _block: np.ndarray
    _numba_type_: StructType
    _address: int

    def __post_init__(self) -> None:
        cls = type(self)
        values = [getattr(self, field.name) for field in dataclasses.fields(self)]  # type: ignore[arg-type]
        kind = _struct_type(cls, values)
        block = np.array([word for value in values for word in words(value)], np.int64)
        object.__setattr__(self, "_block", block)
        object.__setattr__(self, "_numba_type_", kind)
        object.__setattr__(self, "_address", block.ctypes.data)

    def replace(self, **changes: Any) -> Self:
        """Return a copy with other fields."""
        return dataclasses.replace(self, **changes)  # type: ignore[type-var]

    def fields(self) -> dict[str, Any]:
        """Return the fields by name, in order."""
        return {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}  # type: ignore[arg-type]

    def __reduce__(self) -> Any:
        """Copies and pickles have pointers of their own."""
        return type(self), tuple(self.fields().values())


def names_of(kind: type[ArrayStruct]) -> tuple[str, ...]:
    """Return the names of a structure's fields, in order."""
    return tuple(field.name for field in dataclasses.fields(kind))  # type: ignore[arg-type]


def words(value: Any) -> list[int]:
    """Return what of a field stands in its structure's block: 64-bit words."""
    if isinstance(value, np.ndarray):
        return [value.__array_interface__["data"][0], *value.shape]
    if isinstance(value, ArrayStruct):
        return [value._address]
    if isinstance(value, float):
        return [int(np.float64(value).view(np.int64))]
    return [int(value)]


def _field_type(value: Any) -> types.Type:
    if isinstance(value, np.ndarray):
        if not value.flags.c_contiguous:
            raise TypeError("arrays of a kernel's structure are C-contiguous")
        return types.Array(typeof(value).dtype, value.ndim, "C")
    if isinstance(value, ArrayStruct):
        return value._numba_type_
    return types.float64 if isinstance(value, float) else types.int64


_struct_types: dict[type, tuple[Any, StructType]] = {}


def _kind(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.dtype.char, value.ndim, value.flags.c_contiguous
    return float if isinstance(value, float) else type(value)  # numpy's float64 is one


def _struct_type(cls: type, values: list[Any]) -> StructType:
    kinds = [_kind(value) for value in values]
    known = _struct_types.get(cls)
    if known is None:
        names = [field.name for field in dataclasses.fields(cls)]
        fields = tuple(zip(names, map(_field_type, values), strict=True))
        kind = StructType(f"{cls.__module__}.{cls.__qualname__}", fields)
        _struct_types[cls] = kinds, kind
        return kind
    if known[0] != kinds:
        raise TypeError(f"{cls.__name__} has fields of other types than before: {kinds} for {known[0]}")
    return known[1]


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

    @property
    def key(self) -> Any:
        """What tells one structure from another."""
        return self.qualified, self.fields


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
    array = context.make_array(field)(context, builder)
    shape = [load(1 + axis) for axis in range(field.ndim)]
    size = context.get_abi_sizeof(context.get_data_type(field.dtype))
    strides = [ir.Constant(_WORD, size)]
    for length in reversed(shape[1:]):
        strides.insert(0, builder.mul(strides[0], length, flags=("nsw",)))
    count = shape[0]
    for length in shape[1:]:
        count = builder.mul(count, length, flags=("nsw",))
    array.meminfo = ir.Constant(array.meminfo.type, None)
    array.parent = ir.Constant(array.parent.type, None)
    array.data = load(0, array.data.type)
    array.shape = cgutils.pack_array(builder, shape)
    array.strides = cgutils.pack_array(builder, strides)
    array.itemsize = ir.Constant(_WORD, size)
    array.nitems = count
    return array._getvalue()


@unbox(StructType)
def _unbox_struct(kind: StructType, value: Any, c: Any) -> NativeValue:
    address = c.pyapi.object_getattr_string(value, "_address")
    pointer = c.builder.inttoptr(c.pyapi.long_as_longlong(address), _WORD.as_pointer())
    c.pyapi.decref(address)
    return NativeValue(pointer, is_error=cgutils.is_not_null(c.builder, c.pyapi.err_occurred()))
