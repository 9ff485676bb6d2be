"""Calls of one of several kernels by a number."""

from __future__ import annotations

import numpy as np
import pytest

from flexmbd.multibody.kernels.base.by_kind import by_kind
from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel


@kernel
def _pair(x, k):
    return x + k, 2.0 * x


@kernel
def _whole(x, k):
    return k, -x


@kernel
def _add(out, k):
    out[0] += k


_value = by_kind({0: _pair, 3: _whole, 5: _pair})
_effect = by_kind({1: _add})


@entry_kernel
def _ask(kind, x, out):
    out[0], out[1] = _value(kind, (x, 7))
    _effect(kind, (out, 100))


@pytest.mark.parametrize(
    ("kind", "expected"), [(0, (9.5, 5.0)), (1, (100.0, 0.0)), (2, (0.0, 0.0)), (3, (7.0, -2.5)), (5, (9.5, 5.0))]
)
def test_the_kernel_of_the_number_answers_and_zeros_where_there_is_none(
    kind: int, expected: tuple[float, float]
) -> None:
    out = np.full(2, np.nan)
    _ask(kind, 2.5, out)
    np.testing.assert_array_equal(out, expected)
