"""BLAS's products and triangular solves of row-ordered matrices that lie in flat arrays, through SciPy's addresses."""

from __future__ import annotations

from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.native import call_gemm, call_trsm

N_BLAS_SIZES = 10  # numbers that BLAS is told by their places


@kernel
def _place(array, offset):
    return array.ctypes.data + array.itemsize * offset


@kernel
def _tell(sizes, m, n, k, a, b, c):
    """Write three orders and three strides, after letters; the address of the first letter."""
    sizes[0], sizes[1], sizes[2], sizes[3] = 78, 76, 82, 85  # N, L, R, U
    sizes[4], sizes[5], sizes[6], sizes[7], sizes[8], sizes[9] = m, n, k, a, b, c
    return sizes.ctypes.data


@kernel
def subtract_product(blas, sizes, units, values, left, upper, stack, to, p, u, w):
    """(u, u) at ``to`` of ``stack`` less L (u, p) at ``left`` times U (p, u) at ``upper``, whose rows are w apart."""
    at = _tell(sizes, u, u, p, w, p, u)
    one = units.ctypes.data
    call_gemm(
        blas[0],
        (
            at, at, at + 16, at + 20, at + 24, one + units.itemsize, _place(values, upper), at + 28,
            _place(values, left), at + 32, one, _place(stack, to), at + 36,
        ),
    )  # fmt: skip


@kernel
def solve_upper_rows(blas, sizes, units, values, begin, p, u, w):
    """The columns p to w of p rows at ``begin``, in place, by the unit lower triangle of the first p columns."""
    at = _tell(sizes, u, p, 0, w, w, 0)
    call_trsm(
        blas[1],
        (
            at + 8, at + 12, at, at + 12, at + 16, at + 20, units.ctypes.data, _place(values, begin), at + 28,
            _place(values, begin + p), at + 32,
        ),
    )  # fmt: skip


@kernel
def solve_left_columns(blas, sizes, units, values, begin, left, p, u, w):
    """The rows (u, p) at ``left``, in place, by the upper triangle of the first p columns at ``begin``."""
    at = _tell(sizes, p, u, 0, w, p, 0)
    call_trsm(
        blas[1],
        (
            at + 4, at + 4, at, at, at + 16, at + 20, units.ctypes.data, _place(values, begin), at + 28,
            _place(values, left), at + 32,
        ),
    )  # fmt: skip
