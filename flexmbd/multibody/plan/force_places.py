"""Where force elements have entered their rows and numbers; of long runs of elements alike it is told when asked."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import overload

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.force.protocol import BetweenFrames
from flexmbd.multibody.scene_index import ForceRows

IntArray = NDArray[np.int64]


@dataclass(frozen=True)
class ForceSpan:
    """Parameters that a force element has entered beside its rows.

    Attributes:
        data: places in ``Plan.data``.
        times: rows of ``Plan.times``.
        frames: rows of ``Plan.frames`` that it uses, in order.
        memories: places in x where its memories begin, in order.
        links: of its states the first place in v, and the first row of ``Plan.tree``.
    """

    data: range
    times: range
    frames: tuple[int, ...]
    memories: tuple[int, ...] = ()
    links: tuple[tuple[int, int], ...] = ()


@dataclass(frozen=True, eq=False)
class AlikeSpans:
    """The spans of a run of elements alike.

    Attributes:
        first: place in ``Plan.data`` of the first one's numbers, which those of the others follow.
        size: how many each has.
        time: rows of ``Plan.times`` before them.
        frames: (n, 2) rows of ``Plan.frames``.
    """

    first: int
    size: int
    time: int
    frames: IntArray

    def __getitem__(self, number: int, /) -> ForceSpan:
        """That of one."""
        begin = self.first + self.size * number
        one, other = map(int, self.frames[number])
        return ForceSpan(range(begin, begin + self.size), range(self.time, self.time), (one, other))


@dataclass(frozen=True, eq=False)
class AlikeRows:
    """The rows of a run of elements alike.

    Attributes:
        force: rows of ``Plan.forces`` before them.
        ends: (n + 1,) row of ``Plan.elements`` at which each begins, and the last one ends.
    """

    force: int
    ends: IntArray

    def __getitem__(self, number: int, /) -> ForceRows:
        """Those of one."""
        return ForceRows(range(self.force, self.force), range(int(self.ends[number]), int(self.ends[number + 1])))


class ElementNames(Sequence[str]):
    """Names of the rows of ``Plan.elements``, of elements alike made when they are asked for."""

    def __init__(self, names: Iterable[str | BetweenFrames]) -> None:
        self._names = tuple(names)

    @overload
    def __getitem__(self, number: int) -> str: ...

    @overload
    def __getitem__(self, number: slice) -> tuple[str, ...]: ...

    def __getitem__(self, number: int | slice) -> str | tuple[str, ...]:
        """The name of one row, or of several."""
        if isinstance(number, slice):
            return tuple(map(_said, self._names[number]))
        return _said(self._names[number])

    def __len__(self) -> int:
        """How many rows."""
        return len(self._names)


def _said(name: str | BetweenFrames) -> str:
    return name if isinstance(name, str) else name.what
