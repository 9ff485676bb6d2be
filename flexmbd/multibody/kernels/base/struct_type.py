"""Numba's side of structures of arrays (`array_struct`): their type, and how kernels read their fields."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.core.typing.templates import AttributeTemplate
from numba.extending import infer_getattr, lower_getattr_generic, models, register_model
from numba.np.numpy_support import from_dtype

from flexmbd.multibody.kernels.base.struct_layout import Layout

_WORD = ir.IntType(64)


@cache
def type_of(layout: Layout) -> StructType:
    """Numba's type of a structure."""
    return StructType(layout.qualified, tuple((name, _field_type(kind)) for name, kind in layout.fields))


def _field_type(kind: Any) -> types.Type:
    if isinstance(kind, Layout):
        return type_of(kind)
    if isinstance(kind, tuple):
        dtype, ndim = kind
        return types.Array(from_dtype(np.dtype(dtype)), ndim, "C")
    return types.float64 if kind == "d" else types.int64


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
    data = load(0, context.get_data_type(field.dtype).as_pointer())
    return array_of(context, builder, field, data, [load(1 + axis) for axis in range(field.ndim)])


def array_of(context: Any, builder: Any, field: types.Array, data: Any, shape: list[Any], given: Any = None) -> Any:
    """An array, set up as one value; its strides are ``given`` unless it is contiguous in C's order.

    numba's own way writes each part to the stack and reads it back, three times the text for LLVM to read.
    """
    model = context.data_model_manager[field]
    size = context.get_abi_sizeof(context.get_data_type(field.dtype))
    strides = given or [ir.Constant(_WORD, size)]
    for length in () if given else reversed(shape[1:]):
        strides.insert(0, builder.mul(strides[0], length, flags=("nsw",)))
    count = shape[0] if shape else _WORD(1)
    for length in shape[1:]:
        count = builder.mul(count, length, flags=("nsw",))
    kinds = [model.get_type(name) for name in model._fields]
    kinds = [context.data_model_manager[kind].get_value_type() for kind in kinds]
    places = {name: model.get_field_position(name) for name in model._fields}
    constants = [ir.Constant(kind, None) for kind in kinds]
    constants[places["itemsize"]] = ir.Constant(_WORD, size)
    constant_strides = field.ndim == 1 and not given
    if constant_strides:
        constants[places["strides"]] = ir.Constant(kinds[places["strides"]], strides)
    array = ir.Constant(ir.LiteralStructType(kinds), constants)
    array = builder.insert_value(array, count, places["nitems"])
    array = builder.insert_value(array, data, places["data"])
    for axis in range(field.ndim):
        array = builder.insert_value(array, shape[axis], (places["shape"], axis))
        if not constant_strides:
            array = builder.insert_value(array, strides[axis], (places["strides"], axis))
    return array
