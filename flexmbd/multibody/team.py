"""Team: who decides when several processes run the same machine side by side."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray


class Team(Protocol):
    """The interface of the processes that run one machine; numpy only.

    Every process holds the whole machine.  After each decision rank 0's is taken, so no process
    steps alone; files, prints and pictures are the root's.
    """

    @property
    def size(self) -> int:
        """Number of processes."""

    @property
    def is_root(self) -> bool:
        """Whether this process writes files, prints and pictures."""

    def agree(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return rank 0's ``x`` (any shape, the same on all ranks).  Collective."""

    def fail(self, error: Exception | None) -> None:
        """Raise on every rank if any rank brings an error.  Collective."""


class Alone:
    """The team of a single process."""

    size = 1
    is_root = True

    def agree(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return ``x``."""
        return x

    def fail(self, error: Exception | None) -> None:
        """Raise ``error`` if there is one."""
        if error is not None:
            raise error
