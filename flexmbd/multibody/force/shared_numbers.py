"""Numbers that several forces read, as the table of a shape that many bodies touch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import SceneError
from flexmbd.given import numbers

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SharedNumbers:
    """Numbers that several forces read, and that do not vary: in the plan they stand once.

    Attributes:
        values: (n,).

    Raises:
        SceneError: they are not finite numbers in one row.
    """

    values: FloatArray

    def __post_init__(self) -> None:
        given = numbers(self.values)
        if given.ndim != 1 or not np.isfinite(given).all():
            raise SceneError(f"numbers that forces share must be finite, of shape (n,), got {self.values!r:.100}")
        object.__setattr__(self, "values", given)


class WithSharedNumbers:
    """Base, beside another, of forces that read numbers which they share with others."""

    @property
    def shared_numbers(self) -> Sequence[SharedNumbers]:
        """What it reads."""
        return ()
