"""Calls through addresses: LAPACK and users' compiled functions, without naming them in a type.

The address travels as an integer in an array, so a kernel that calls it is compiled and cached
once, whatever function stands behind it.
"""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np

from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.extension_module import extension_module
from flexmbd.multibody.kernels.base.on_demand import cgutils, intrinsic, ir, types

N_SIZES = 6  # numbers that LAPACK is told by their places


def lapack_addresses() -> np.ndarray:
    """(2,) addresses of LAPACK's dgetrf and dgetrs, from SciPy."""
    return _addresses("dgetrf", "dgetrs")


def complex_lapack_addresses() -> np.ndarray:
    """(2,) addresses of zgetrf and zgetrs, for ``factor`` and ``solve`` of complex matrices."""
    return _addresses("zgetrf", "zgetrs")


def blas_addresses() -> np.ndarray:
    """(2,) addresses of BLAS's dgemm and dtrsm."""
    return _addresses("dgemm", "dtrsm", library="blas")


def complex_blas_addresses() -> np.ndarray:
    """(2,) addresses of zgemm and ztrsm."""
    return _addresses("zgemm", "ztrsm", library="blas")


def _addresses(*names: str, library: str = "lapack") -> np.ndarray:
    exported = extension_module(f"scipy.linalg.cython_{library}").__pyx_capi__
    return np.array([_address_in(exported[name]) for name in names], np.int64)


def _address_in(capsule: Any) -> int:
    """Address of a function that a module by Cython exports."""
    name_of, pointer_of = ctypes.pythonapi.PyCapsule_GetName, ctypes.pythonapi.PyCapsule_GetPointer
    name_of.restype, name_of.argtypes = ctypes.c_char_p, [ctypes.py_object]
    pointer_of.restype, pointer_of.argtypes = ctypes.c_void_p, [ctypes.py_object, ctypes.c_char_p]
    return int(pointer_of(capsule, name_of(capsule)))


@intrinsic
def call_scalar(typingctx, address, t):
    """Call double f(double) at an address."""

    def codegen(context, builder, signature, args):
        double = ir.DoubleType()
        function = builder.inttoptr(args[0], ir.FunctionType(double, [double]).as_pointer())
        return builder.call(function, [args[1]])

    return types.float64(types.int64, types.float64), codegen


@intrinsic
def call_row(typingctx, address, t, pointer):
    """Call void f(double, double*) at an address, the pointer given as an integer."""

    def codegen(context, builder, signature, args):
        double = ir.DoubleType()
        kind = ir.FunctionType(ir.VoidType(), [double, double.as_pointer()])
        function = builder.inttoptr(args[0], kind.as_pointer())
        builder.call(function, [args[1], builder.inttoptr(args[2], double.as_pointer())])
        return context.get_dummy_value()

    return types.void(types.int64, types.float64, types.int64), codegen


@intrinsic
def call_law(typingctx, address, t, beta, rate):
    """Call double f(double, double, double) at an address."""

    def codegen(context, builder, signature, args):
        double = ir.DoubleType()
        function = builder.inttoptr(args[0], ir.FunctionType(double, [double] * 3).as_pointer())
        return builder.call(function, args[1:])

    return types.float64(types.int64, types.float64, types.float64, types.float64), codegen


@intrinsic
def call_frame_law(typingctx, address, count, numbers, motion):
    """Call double f(int64, double*, double*, double[6]) at an address; gives the six numbers and what it returns."""

    def codegen(context, builder, signature, args):
        double, whole = ir.DoubleType(), ir.IntType(64)
        size = signature.args[3].count
        given = cgutils.alloca_once(builder, ir.ArrayType(double, size))
        answer = cgutils.alloca_once(builder, ir.ArrayType(double, 6))
        for k in range(size):
            builder.store(builder.extract_value(args[3], k), cgutils.gep_inbounds(builder, given, 0, k))
        for k in range(6):
            builder.store(ir.Constant(double, 0.0), cgutils.gep_inbounds(builder, answer, 0, k))
        pointer = double.as_pointer()
        kind = ir.FunctionType(double, [whole, pointer, pointer, pointer])
        function = builder.inttoptr(args[0], kind.as_pointer())
        places = [builder.bitcast(one, pointer) for one in (given, answer)]
        energy = builder.call(function, [args[1], builder.inttoptr(args[2], pointer), *places])
        found = [builder.load(cgutils.gep_inbounds(builder, answer, 0, k)) for k in range(6)]
        return context.make_tuple(builder, signature.return_type, [*found, energy])

    return types.UniTuple(types.float64, 7)(types.int64, types.int64, types.intp, motion), codegen


@intrinsic
def call_memory_law(typingctx, address, sizes, pointers, begin, end):
    """Call double f(int64, double*, int64, double*, double, double, double[3]) at an address.

    ``sizes`` and ``pointers`` are those of its numbers and of its memory; gives force, slope, piece and energy.
    """

    def codegen(context, builder, signature, args):
        double, whole = ir.DoubleType(), ir.IntType(64)
        pointer = double.as_pointer()
        answer = cgutils.alloca_once(builder, ir.ArrayType(double, 3))
        for k in range(3):
            builder.store(ir.Constant(double, 0.0), cgutils.gep_inbounds(builder, answer, 0, k))
        kind = ir.FunctionType(double, [whole, pointer, whole, pointer, double, double, pointer])
        function = builder.inttoptr(args[0], kind.as_pointer())
        counts = [builder.extract_value(args[1], k) for k in range(2)]
        places = [builder.inttoptr(builder.extract_value(args[2], k), pointer) for k in range(2)]
        out = builder.bitcast(answer, pointer)
        energy = builder.call(function, [counts[0], places[0], counts[1], places[1], args[3], args[4], out])
        found = [builder.load(cgutils.gep_inbounds(builder, answer, 0, k)) for k in range(3)]
        return context.make_tuple(builder, signature.return_type, [*found, energy])

    counts, places = types.UniTuple(types.int64, 2), types.UniTuple(types.intp, 2)
    arguments = types.int64, counts, places, types.float64, types.float64
    return types.UniTuple(types.float64, 4)(*arguments), codegen


@intrinsic
def _call_state(typingctx, address, t, sizes, pointers):
    """Call void f(double, int64, int64, double*, double*, double*) at an address."""

    def codegen(context, builder, signature, args):
        double, whole, pointer = ir.DoubleType(), ir.IntType(64), ir.DoubleType().as_pointer()
        kind = ir.FunctionType(ir.VoidType(), [double, whole, whole, pointer, pointer, pointer])
        function = builder.inttoptr(args[0], kind.as_pointer())
        counts = [builder.extract_value(args[2], k) for k in range(2)]
        addresses = [builder.inttoptr(builder.extract_value(args[3], k), pointer) for k in range(3)]
        builder.call(function, [args[1], *counts, *addresses])
        return context.get_dummy_value()

    signature = types.void(
        types.int64, types.float64, types.UniTuple(types.int64, 2), types.UniTuple(types.int64, 3)
    )
    return signature, codegen


@kernel
def call_state(address, t, x, v, out):
    """Let the user's function at an address write its generalised forces (nv,) into ``out``."""
    _call_state(
        address, t, (x.shape[0], v.shape[0]), (x.ctypes.data, v.ctypes.data, out.ctypes.data)
    )


@intrinsic
def _call_relation(typingctx, address, sizes, lengths, pointers):
    """Call void f(int64, int64, int64, double, double, double* five times) at an address."""

    def codegen(context, builder, signature, args):
        double, whole, pointer = ir.DoubleType(), ir.IntType(64), ir.DoubleType().as_pointer()
        kind = ir.FunctionType(ir.VoidType(), [*[whole] * 3, double, double, *[pointer] * 5])
        function = builder.inttoptr(args[0], kind.as_pointer())
        counts = [builder.extract_value(args[1], k) for k in range(3)]
        steps = [builder.extract_value(args[2], k) for k in range(2)]
        places = [builder.inttoptr(builder.extract_value(args[3], k), pointer) for k in range(5)]
        builder.call(function, [*counts, *steps, *places])
        return context.get_dummy_value()

    counts, steps = types.UniTuple(types.int64, 3), types.UniTuple(types.float64, 2)
    return types.void(types.int64, counts, steps, types.UniTuple(types.intp, 5)), codegen


@kernel
def call_relation(address, data, lengths, nodes, position, velocity, remember):
    """Let the user's function at an address write the weights of a step's relation, which come as zeros.

    ``lengths``: of the step and of the one before (s).
    """
    sizes = data.shape[0], nodes.shape[0], remember.shape[0]
    places = data.ctypes.data, nodes.ctypes.data, position.ctypes.data, velocity.ctypes.data, remember.ctypes.data
    _call_relation(address, sizes, lengths, places)


def _caller(n_pointers):
    """Make an intrinsic that calls void f(pointer, ...) with addresses given as integers."""

    def codegen(context, builder, signature, args):
        pointer = ir.IntType(8).as_pointer()
        kind = ir.FunctionType(ir.VoidType(), [pointer] * n_pointers).as_pointer()
        function = builder.inttoptr(args[0], kind)
        addresses = [
            builder.inttoptr(builder.extract_value(args[1], k), pointer)
            for k in range(n_pointers)
        ]
        builder.call(function, addresses)
        return context.get_dummy_value()

    return types.void(types.int64, types.UniTuple(types.int64, n_pointers)), codegen


@intrinsic
def _call_getrf(typingctx, address, pointers):
    return _caller(6)


@intrinsic
def _call_getrs(typingctx, address, pointers):
    return _caller(9)


@intrinsic
def call_gemm(typingctx, address, pointers):
    """Call BLAS's product at an address, with the 13 addresses of its arguments."""
    return _caller(13)


@intrinsic
def call_trsm(typingctx, address, pointers):
    """Call BLAS's triangular solve at an address, with the 11 addresses of its arguments."""
    return _caller(11)


@kernel
def factor(lapack, matrix, pivot, sizes):
    """LU-factor the square ``matrix`` in place; return LAPACK's info (0: regular).

    A C-ordered matrix is LAPACK's transpose; ``solve`` asks for the transposed system.
    ``pivot`` and ``sizes`` (N_SIZES,) are int32 scratch.
    """
    if matrix.shape[0] == 0:
        return 0
    sizes[0] = matrix.shape[0]
    n = sizes.ctypes.data
    _call_getrf(lapack[0], (n, n, matrix.ctypes.data, n, pivot.ctypes.data, n + 4))
    return int(sizes[1])


@kernel
def factor_part(lapack, matrix, first, last, pivot, sizes):
    """As ``factor`` of a block in the rows ``first`` to before ``last`` of ``matrix``, whose columns begin with it."""
    if last == first:
        return 0
    sizes[0] = last - first
    sizes[4] = matrix.shape[1]
    n = sizes.ctypes.data
    begin = matrix.ctypes.data + matrix.itemsize * first * matrix.shape[1]
    _call_getrf(lapack[0], (n, n, begin, n + 16, pivot.ctypes.data + 4 * first, n + 4))
    return int(sizes[1])


@kernel
def solve(lapack, matrix, pivot, sizes, rhs):
    """Solve with the factors; each row of the (k, n) ``rhs`` is one right-hand side, in place."""
    if matrix.shape[0] == 0:
        return
    sizes[0] = matrix.shape[0]
    sizes[2] = rhs.shape[0]
    sizes[3] = 84  # 'T'
    n = sizes.ctypes.data
    right = rhs.ctypes.data
    _call_getrs(lapack[1], (n + 12, n, n + 8, matrix.ctypes.data, n, pivot.ctypes.data, right, n, n + 4))


@kernel
def solve_part(lapack, matrix, first, last, pivot, sizes, rhs, above, below):
    """Solve with the factors of ``factor_part``; right-hand sides: the columns ``first`` to before ``last`` of ``rhs``.

    Of its rows ``above`` to before ``below``.
    """
    if last == first or below == above:
        return
    sizes[0] = last - first
    sizes[2] = below - above
    sizes[3] = 84  # 'T'
    sizes[4] = matrix.shape[1]
    sizes[5] = rhs.shape[1]
    n = sizes.ctypes.data
    begin = matrix.ctypes.data + matrix.itemsize * first * matrix.shape[1]
    right = rhs.ctypes.data + rhs.itemsize * (above * rhs.shape[1] + first)
    pivots = pivot.ctypes.data + 4 * first
    _call_getrs(lapack[1], (n + 12, n, n + 8, begin, n + 16, pivots, right, n + 20, n + 4))
