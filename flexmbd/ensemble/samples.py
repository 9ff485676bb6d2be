"""Samples: the values of the parameters of each variant."""

from __future__ import annotations

import hashlib
import pickle
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.errors import SceneError
from flexmbd.given import numbers

FloatArray = NDArray[np.float64]


class Samples:
    """The values of the parameters, variant by variant.

    Attributes:
        names: of the parameters.
        arrays: of the parameters whose values are numbers or arrays of them, by their names, each (n, ...).
    """

    def __init__(self, given: Mapping[str, ArrayLike] | Sequence[Mapping[str, Any]]) -> None:
        """Take arrays (n, ...) by the parameters' names, or a list of n mappings from names to values.

        Raises:
            SceneError: arrays of other lengths or of no numbers; mappings of other names; no variant at all.
        """
        self._rows: Sequence[Mapping[str, Any]] | None = None
        self.arrays: dict[str, FloatArray] = {}
        if isinstance(given, Mapping):
            self.arrays = {name: _column(name, values) for name, values in given.items()}
            self.names = tuple(self.arrays)
            lengths = {name: len(values) for name, values in self.arrays.items()}
            if len(set(lengths.values())) > 1:
                raise SceneError(f"samples must be arrays of one length, got {lengths}")
            self._count = next(iter(lengths.values()), 0)
        else:
            self._rows = list(given) if isinstance(given, Iterable) else [given]
            self._count = len(self._rows)
            wrong = [row for row in self._rows if not isinstance(row, Mapping)]
            if wrong:
                raise SceneError(
                    "samples must be arrays by the parameters' names, {'m': [1.0, 2.0]}, or a list of mappings, one a "
                    f"variant, got {wrong[0]!r:.60}"
                )
            self.names = tuple(self._rows[0]) if self._rows else ()
            other = [k for k, row in enumerate(self._rows) if set(row) != set(self.names)]
            if other:
                raise SceneError(f"sample {other[0]} has other parameters than sample 0: {[*self._rows[other[0]]]}")
        if self._count == 0:
            raise SceneError("samples hold no variant")
        if not self.names:
            raise SceneError("samples name no parameter of the machine")

    def __len__(self) -> int:
        """How many variants."""
        return self._count

    def __getitem__(self, k: int) -> dict[str, Any]:
        """The values of variant k."""
        if self._rows is not None:
            return dict(self._rows[k])
        return {name: float(part[k]) if part.ndim == 1 else part[k].copy() for name, part in self.arrays.items()}

    def digest(self) -> str:
        """Tells samples apart, in any process."""
        found = hashlib.sha256(" ".join(self.names).encode())
        for name, values in self.arrays.items():
            found.update(f"{name} {values.shape}".encode() + values.tobytes())
        for row in self._rows or ():
            found.update(pickle.dumps([row[name] for name in self.names], protocol=4))
        return found.hexdigest()


def _column(name: str, values: ArrayLike) -> FloatArray:
    array = numbers(values)
    if array.ndim == 0 or not np.isfinite(array).all():
        raise SceneError(
            f"samples of {name!r} must be an array of finite numbers, one row a variant; give values of other "
            "kinds as a list of mappings, one a variant"
        )
    return np.ascontiguousarray(array)
