"""A call of one of several kernels by a number, for numba neither loops over functions nor takes them from a table."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from flexmbd.multibody.kernels.base.on_demand import cgutils, intrinsic, ir, types


def by_kind(kernels: Mapping[int, Any]) -> Any:
    """What kernels call as ``f(kind, *arguments)``: the kernel of that number, called with the arguments.

    All must take the same arguments.  Gives zeros of the type that they return where no kernel has the number.
    """
    numbers: dict[Any, list[int]] = {}
    for number, called in kernels.items():
        numbers.setdefault(called, []).append(number)
    cases = tuple((called, tuple(places)) for called, places in numbers.items())

    @intrinsic
    def call(typingctx: Any, kind: Any, arguments: Any) -> Any:
        given = tuple(types.unliteral(one) for one in arguments)
        kinds = [called._numba_type_ for called, _ in cases]
        found = [typingctx.resolve_function_type(one, given, {}) for one in kinds]
        returned = typingctx.unify_types(*(one.return_type for one in found)) if found else types.none

        def codegen(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            passed = [
                context.cast(builder, one, of, to)
                for one, of, to in zip(cgutils.unpack_tuple(builder, values[1]), signature.args[1], given, strict=True)
            ]
            result = None if returned == types.none else cgutils.alloca_once(builder, context.get_value_type(returned))
            if result is not None:
                builder.store(ir.Constant(result.type.pointee, None), result)
            behind = builder.append_basic_block("behind")
            choice = builder.switch(values[0], behind)
            for (_, places), of, one in zip(cases, kinds, found, strict=True):
                block = builder.append_basic_block("kind")
                for number in places:
                    choice.add_case(ir.Constant(values[0].type, number), block)
                builder.position_at_end(block)
                function = context.get_function(of, one)
                value = function(builder, passed)
                if result is not None:
                    builder.store(context.cast(builder, value, one.return_type, returned), result)
                builder.branch(behind)
            builder.position_at_end(behind)
            return context.get_dummy_value() if result is None else builder.load(result)

        return returned(types.int64, arguments), codegen

    return call
