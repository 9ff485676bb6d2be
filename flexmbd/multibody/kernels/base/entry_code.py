"""C functions by which kernels are entered: ``int32 entry(int64 *words)``, as LLVM's code.

The words are those of `entry`: of an array its numbers' address, its shape and, unless it is contiguous in C's order,
its strides; of a structure its address; a number; a tuple's in their order. What the kernel returns is written behind
them, or there the address of what numba knows of an exception, where the function does not return 0.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba.core import cgutils, types

from flexmbd.multibody.kernels.base.struct_type import StructType, array_of

_WORD, _STATUS = ir.IntType(64), ir.IntType(32)


def add_entry(context: Any, library: Any, fndesc: Any) -> None:
    """Add the entry of a translated function to its library; it is called ``entry_name(fndesc)``."""
    module = library.create_ir_module("entry")
    kind = context.call_conv.get_function_type(fndesc.restype, fndesc.argtypes)
    kernel = ir.Function(module, kind, fndesc.llvm_func_name)
    entry = ir.Function(module, ir.FunctionType(_STATUS, [_WORD.as_pointer()]), entry_name(fndesc))
    builder = ir.IRBuilder(entry.append_basic_block())
    place = 0

    def word(kind: Any = _WORD) -> Any:
        """The next word, as a value of a kind of 64 bits."""
        nonlocal place
        where = builder.bitcast(cgutils.gep_inbounds(builder, entry.args[0], place), kind.as_pointer())
        place += 1
        return builder.load(where)

    arguments = [_argument(context, builder, kind, word) for kind in fndesc.argtypes]
    status, returned = context.call_conv.call_function(
        builder, kernel, fndesc.restype, fndesc.argtypes, arguments, attrs=("noinline",)
    )
    behind = cgutils.gep_inbounds(builder, entry.args[0], place)
    with cgutils.if_unlikely(builder, status.is_error):
        builder.store(builder.ptrtoint(status.excinfoptr, _WORD), behind)
        builder.ret(_STATUS(1))
    for k, value in enumerate(_results(builder, fndesc.restype, returned)):
        builder.store(value, cgutils.gep_inbounds(builder, entry.args[0], place + k))
    builder.ret(_STATUS(0))
    library.add_ir_module(module)


def entry_name(fndesc: Any) -> str:
    """What the entry of a function is called."""
    return f"{fndesc.llvm_func_name}.entry"


def layout_of(kind: Any) -> Any:
    """A result's words, for `entry.EntryCall`: "d" of a number, "q" of a whole one, "?" of a truth; lists of these.

    Raises:
        TypeError: it can be no result for Python.
    """
    if isinstance(kind, types.BaseTuple):
        return [layout_of(one) for one in kind]
    if isinstance(kind, types.Boolean):
        return "?"
    if isinstance(kind, types.Integer):
        return "q"
    if kind == types.none:
        return None
    if kind == types.float64:
        return "d"
    raise TypeError(f"a kernel returns numbers, truths, tuples of these or nothing, not {kind}")


def kind_of(kind: Any) -> str:
    """A result's type as text: numba's names of numbers, tuples of these in brackets."""
    if isinstance(kind, types.BaseTuple):
        return f"({', '.join(map(kind_of, kind))})"
    return "boolean" if kind == types.boolean else str(kind)


def _argument(context: Any, builder: Any, kind: Any, word: Callable[..., Any]) -> Any:
    """The value of an argument, made of the next words."""
    if isinstance(kind, StructType):
        return word(_WORD.as_pointer())
    if isinstance(kind, types.Array):
        return _array(context, builder, kind, word)
    if isinstance(kind, types.BaseTuple):
        return context.make_tuple(builder, kind, [_argument(context, builder, one, word) for one in kind])
    if isinstance(kind, types.Boolean):
        return builder.icmp_signed("!=", word(), _WORD(0))
    if isinstance(kind, types.Integer):
        return builder.trunc(word(), value) if (value := context.get_value_type(kind)) != _WORD else word()
    if kind == types.float64:
        return word(ir.DoubleType())
    if kind == types.none:
        return context.get_dummy_value()
    raise TypeError(f"a kernel's argument can be no {kind}")


def _array(context: Any, builder: Any, kind: types.Array, word: Callable[..., Any]) -> Any:
    data = word(context.get_data_type(kind.dtype).as_pointer())
    shape = [word() for _ in range(kind.ndim)]
    if kind.layout == "C":
        return array_of(context, builder, kind, data, shape)
    return array_of(context, builder, kind, data, shape, [word() for _ in range(kind.ndim)])


def _results(builder: Any, kind: Any, value: Any) -> list[Any]:
    """The words of a result."""
    if isinstance(kind, types.BaseTuple):
        parts = [_results(builder, one, builder.extract_value(value, k)) for k, one in enumerate(kind)]
        return [word for part in parts for word in part]
    if isinstance(kind, types.Boolean):
        return [builder.zext(value, _WORD)]
    if isinstance(kind, types.Integer):
        extend = builder.sext if kind.signed else builder.zext
        return [value if value.type == _WORD else extend(value, _WORD)]
    if kind == types.float64:
        return [builder.bitcast(value, _WORD)]
    return []
