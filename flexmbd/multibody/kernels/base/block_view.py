"""Views of stretches of an array as matrices, which kernels may not reshape: no memory is counted in them."""

from __future__ import annotations

from flexmbd.multibody.kernels.base.on_demand import intrinsic, types


@intrinsic
def block_view(typingctx, values, base, stride, n):
    """The array (n, n) whose entry (r, k) is ``values[base + stride * r + k]``.

    ``base`` may be negative: of the view only entries that lie in ``values`` may be touched.
    """
    kind = types.Array(values.dtype, 2, "A")

    def codegen(context, builder, signature, arguments):
        from numba.np.arrayobj import make_array, populate_array

        array = make_array(kind)(context, builder)
        own = make_array(signature.args[0])(context, builder, arguments[0])
        size = context.get_abi_sizeof(context.get_data_type(kind.dtype))
        word = context.get_value_type(types.intp)
        populate_array(
            array,
            data=builder.gep(own.data, [arguments[1]]),
            shape=[arguments[3], arguments[3]],
            strides=[builder.mul(arguments[2], word(size)), word(size)],
            itemsize=word(size),
            meminfo=None,
        )
        return array._getvalue()

    return kind(values, types.intp, types.intp, types.intp), codegen


@intrinsic
def matrix_view(typingctx, values, base, rows, columns):
    """The array (rows, columns), row by row, that begins at ``values[base]``, of an array (n,)."""
    kind = types.Array(values.dtype, 2, "C")

    def codegen(context, builder, signature, arguments):
        from numba.np.arrayobj import make_array, populate_array

        array = make_array(kind)(context, builder)
        own = make_array(signature.args[0])(context, builder, arguments[0])
        size = context.get_abi_sizeof(context.get_data_type(kind.dtype))
        word = context.get_value_type(types.intp)
        populate_array(
            array,
            data=builder.gep(own.data, [arguments[1]]),
            shape=[arguments[2], arguments[3]],
            strides=[builder.mul(arguments[3], word(size)), word(size)],
            itemsize=word(size),
            meminfo=None,
        )
        return array._getvalue()

    return kind(values, types.intp, types.intp, types.intp), codegen


@intrinsic
def integer_view(typingctx, values, base, n):
    """The array (n,) of int32 that begins at ``values[base]``, of an array of float64, which has room for it."""
    kind = types.Array(types.int32, 1, "C")

    def codegen(context, builder, signature, arguments):
        from numba.np.arrayobj import make_array, populate_array

        array = make_array(kind)(context, builder)
        own = make_array(signature.args[0])(context, builder, arguments[0])
        size = context.get_abi_sizeof(context.get_data_type(kind.dtype))
        word = context.get_value_type(types.intp)
        place = builder.gep(own.data, [arguments[1]])
        populate_array(
            array,
            data=builder.bitcast(place, context.get_data_type(kind.dtype).as_pointer()),
            shape=[arguments[2]],
            strides=[word(size)],
            itemsize=word(size),
            meminfo=None,
        )
        return array._getvalue()

    return kind(values, types.intp, types.intp), codegen
