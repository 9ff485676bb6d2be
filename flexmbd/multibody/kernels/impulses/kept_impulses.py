"""The impulses of the step before, by the ids of their contacts: where those of a step begin."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.kernels.algebra.so3 import load3, store3
from flexmbd.multibody.kernels.base.array_struct import ArrayStruct
from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_NONE = -1  # a place without a key
_FACTOR = 6364136223846793005  # Knuth's, by which ids are scattered
_ZERO = (0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class KeptImpulses(ArrayStruct):
    """A table with open addressing: ``key`` (2^p,), -1 where it is free, ``impulse`` (2^p, 3), N s, of each."""

    key: IntArray
    impulse: FloatArray


def new_kept(count: int) -> KeptImpulses:
    """Room for so many."""
    size = 1 << max(4, (2 * count).bit_length())
    return KeptImpulses(np.full(size, _NONE), np.zeros((size, 3)))


def forget(kept: KeptImpulses) -> None:
    """Let go of all."""
    kept.key[:] = _NONE


def grown(kept: KeptImpulses, count: int) -> KeptImpulses:
    """With room for so many, what is there kept."""
    larger = new_kept(count)
    for key, impulse in zip(kept.key, kept.impulse, strict=True):
        if key != _NONE:
            _keep(larger, int(key), impulse)
    return larger


@entry_kernel
def _keep(kept, key, impulse):
    keep(kept, key, load3(impulse, 0))


@kernel
def clear(kept):
    """The same for kernels."""
    for i in range(kept.key.shape[0]):
        kept.key[i] = _NONE


@kernel
def _place(kept, key):
    """Where a key stands, or where it would."""
    mask = kept.key.shape[0] - 1
    i = ((key * _FACTOR) >> 33) & mask
    while kept.key[i] != _NONE and kept.key[i] != key:
        i = (i + 1) & mask
    return i


@kernel
def keep(kept, key, impulse):
    """Enter an impulse."""
    i = _place(kept, key)
    kept.key[i] = key
    store3(kept.impulse[i], 0, impulse)


@kernel
def recall(kept, key):
    """The impulse of a key, zero of one that is not there."""
    i = _place(kept, key)
    return load3(kept.impulse[i], 0) if kept.key[i] == key else _ZERO
