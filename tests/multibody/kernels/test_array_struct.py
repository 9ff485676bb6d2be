"""Structures of arrays that kernels take by one pointer: what they hold, and pointers of copies."""

import pickle
from dataclasses import dataclass

import numpy as np
import pytest

from flexmbd.multibody.kernels.base.array_struct import ArrayStruct
from flexmbd.multibody.kernels.base.compiling import entry_kernel


@dataclass(frozen=True, eq=False)
class Pair(ArrayStruct):
    table: np.ndarray
    share: float


@entry_kernel
def scaled_entry(pair, i, j):
    return pair.share * pair.table[i, j]


def test_a_kernel_reads_what_python_reads():
    table = np.arange(6.0).reshape(2, 3)
    for share in (0.5, np.float64(0.25)):
        pair = Pair(table, share)
        copy = pickle.loads(pickle.dumps(pair))
        table[1, 2] += 1.0
        assert scaled_entry(pair, 1, 2) == share * table[1, 2]
        assert scaled_entry(copy, 1, 2) == share * (table[1, 2] - 1.0)


@pytest.mark.parametrize("table", [np.zeros((2, 3), np.int64), np.zeros(3), np.zeros((3, 2)).T])
def test_other_types_than_before_are_refused(table):
    Pair(np.zeros((2, 3)), 1.0)
    with pytest.raises(TypeError, match="Pair has fields of other types"):
        Pair(table, 1.0)


def test_ctrl_c_while_a_structure_is_handed_over_ends_the_call(monkeypatch):
    """Its words are written by Python at the first call, where an interrupt may strike."""

    def strike(pair):
        raise KeyboardInterrupt

    assert scaled_entry(Pair(np.ones((2, 3)), 0.5), 0, 0) == 0.5
    monkeypatch.setattr(Pair, "_block", property(strike))
    with pytest.raises(KeyboardInterrupt):
        scaled_entry(Pair(np.ones((2, 3)), 0.5), 0, 0)
