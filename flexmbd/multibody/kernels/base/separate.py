"""Calls of large kernels through their addresses, so that what calls them is compiled without them.

LLVM optimises all that a kernel calls anew with each kernel that calls it; behind an address it is compiled once.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba import typeof, types
from numba.core import cgutils
from numba.extending import intrinsic


def address_of(function: Any, arguments: tuple[Any, ...]) -> int:
    """Address of a kernel compiled, or loaded from the cache, for arguments of these types; it must return nothing.

    Contiguous arrays, numbers, and structures of arrays (`array_struct`): asked again, it is looked up by
    what kinds of tuples they are, for to find numba's types of some hundred arrays takes as long as many steps.
    """
    key = (function, *(_kind(argument) for argument in arguments))
    if key not in _addresses:
        kinds = tuple(typeof(argument) for argument in arguments)
        function.compile(kinds)
        compiled = function.overloads[kinds]
        address = int(compiled.library.get_pointer_to_function(compiled.fndesc.llvm_func_name))
        if address == 0:
            raise TypeError(f"{function.py_func.__name__} has no code of its own; @separate_kernel gives it one")
        _addresses[key] = address
    return _addresses[key]


_addresses: dict[tuple[Any, ...], int] = {}


def _kind(argument: Any) -> Any:
    return (argument.dtype, argument.ndim) if isinstance(argument, np.ndarray) else type(argument)


@intrinsic
def call_separate(typingctx, address, arguments):
    """Call the kernel at an address of `address_of` with a tuple of its arguments."""

    def codegen(context, builder, signature, args):
        kinds = list(signature.args[1])
        values = [builder.extract_value(args[1], k) for k in range(len(kinds))]
        kind = context.call_conv.get_function_type(types.none, kinds)
        function = builder.inttoptr(args[0], ir.PointerType(kind))
        status, _ = context.call_conv.call_function(builder, function, types.none, kinds, values)
        with cgutils.if_unlikely(builder, status.is_error):
            context.call_conv.return_status_propagate(builder, status)
        return context.get_dummy_value()

    return types.void(types.int64, arguments), codegen
