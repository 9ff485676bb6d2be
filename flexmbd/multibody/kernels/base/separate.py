"""Calls of large kernels through their addresses, so that what calls them is compiled without them.

LLVM optimises all that a kernel calls anew with each kernel that calls it; behind an address it is compiled once.
"""

from __future__ import annotations

from typing import Any

from flexmbd.multibody.kernels.base.on_demand import cgutils, intrinsic, ir, types


def address_of(function: Any, arguments: tuple[Any, ...]) -> int:
    """Address of an entry kernel compiled, or loaded from the cache, for arguments of these types.

    It must return nothing.
    """
    return int(function.address(arguments))


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
