"""Team: who runs a machine, and who decides, when there are several processes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, TypeVar, runtime_checkable

import numpy as np
from numpy.typing import NDArray

T = TypeVar("T")


@runtime_checkable
class Team(Protocol):
    """The interface of the processes that run one machine; numpy only.

    Every process holds the whole machine and gets the whole trajectory.  Rank 0 alone runs a machine without bodies
    with history, and alone calls the user's functions meanwhile.  Where the bodies' cells are divided among the
    processes, or the user's functions are collective, all of them step, and after each decision rank 0's is taken.
    Files, prints and pictures are the root's.
    """

    @property
    def size(self) -> int:
        """Number of processes."""

    @property
    def is_root(self) -> bool:
        """Whether this process writes files, prints and pictures."""

    @property
    def collective_functions(self) -> bool:
        """Whether the user's functions are collective, so that all processes must step and call them."""

    def agree(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return rank 0's ``x`` (any shape, the same on all ranks).  Collective."""

    def fail(self, error: Exception | None) -> None:
        """Raise on every rank if any rank brings an error.  Collective."""

    def on_root(self, function: Callable[[], T]) -> T:
        """The result of ``function`` on rank 0 (it must pickle), or its error, on every rank.  Collective.

        The others leave their processors to others meanwhile.
        """

    def tell(self, what: str, error: Exception | None) -> None:
        """Raise on every process that asks about ``what`` the error that rank 0 has of it, if any.

        Rank 0 tells and goes on; another one that calls waits until it has told, of the same thing.
        """


class Alone:
    """The team of a single process."""

    size = 1
    is_root = True
    collective_functions = False

    def agree(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return ``x``."""
        return x

    def fail(self, error: Exception | None) -> None:
        """Raise ``error`` if there is one."""
        if error is not None:
            raise error

    def on_root(self, function: Callable[[], T]) -> T:
        """Return what ``function`` gives."""
        return function()

    def tell(self, what: str, error: Exception | None) -> None:
        """Raise ``error`` if there is one."""
        self.fail(error)


def on_every_rank(team: Team, function: Callable[[], T]) -> T:
    """Call ``function`` on every rank; an error on one of them is raised on all.  Collective over the team.

    For what each rank checks before anything collective begins.
    """
    if team.size == 1:
        return function()
    result: list[T] = []
    error: Exception | None = None
    try:
        result.append(function())
    except Exception as reason:  # noqa: BLE001  (whatever it is, all ranks must hear of it)
        error = reason
    team.fail(error)
    return result[0]
