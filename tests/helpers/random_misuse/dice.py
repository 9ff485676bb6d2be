"""Draws of a seed: right values, values of another size, and wrong ones."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np


class Thing:
    """An object that no library knows."""

    def __repr__(self) -> str:
        return "<a thing of the user's>"


#: What a user may give in the place of a right value, made of it.
WRONG: tuple[Any, ...] = (
    lambda right: float("nan"), lambda right: float("inf"), lambda right: -float("inf"), lambda right: None,
    lambda right: 1j, lambda right: "text", lambda right: "", lambda right: b"abc", lambda right: True,
    lambda right: 10**30, lambda right: Thing(), lambda right: Thing, lambda right: [], lambda right: {},
    lambda right: [right, right], lambda right: [[right], [right, right]], lambda right: [None, right],
    lambda right: np.full(3, np.nan), lambda right: np.zeros((3, 3)), lambda right: np.zeros((2, 2, 2)),
    lambda right: np.zeros(0), lambda right: np.array(right), lambda right: np.ma.masked,
    lambda right: lambda *given: right, lambda right: lambda *given: float("nan"), lambda right: lambda: None,
    lambda right: np.array(["2020-01-01"], dtype="datetime64[D]"), lambda right: "a\0b", lambda right: 2**63,
)  # fmt: skip
#: Numbers that are numbers, and of another size or sign.
ODD: tuple[Any, ...] = (
    lambda right: -right, lambda right: 0.0 * right, lambda right: 1e-300, lambda right: 1e300, lambda right: 5e-324,
    lambda right: 1e12 * right, lambda right: 1e-12 * right, lambda right: 1e6 * right, lambda right: 1e-6 * right,
    lambda right: np.float32(right), lambda right: np.int64(1), lambda right: -0.0,
    lambda right: 1.7976931348623157e308,
)  # fmt: skip


class Dice:
    """What a seed decides.

    Attributes:
        wrong: share of values that are replaced by wrong ones, ``odd`` by odd ones.
    """

    def __init__(self, seed: int) -> None:
        self._random = np.random.default_rng([seed, 20])
        self.wrong, self.odd = self.one_of([(0.0, 0.0), (0.0, 0.03), (0.02, 0.0), (0.02, 0.02), (0.1, 0.05)])

    def chance(self, share: float) -> bool:
        return bool(self._random.random() < share)

    def one_of(self, things: Sequence[Any]) -> Any:
        return things[int(self._random.integers(len(things)))]

    def whole(self, least: int, most: int) -> int:
        return int(self._random.integers(least, most + 1))

    def value(self, right: Any) -> Any:
        """A right value, or another one."""
        if self.chance(self.wrong):
            try:
                return self.one_of(WRONG)(right)
            except ValueError:  # of a vector with something wrong in it no array can be made
                return right
        if isinstance(right, float) and self.chance(self.odd):
            return self.one_of(ODD)(right)
        return right

    def size(self, least: float, most: float) -> Any:
        """A positive number, as often in each decade."""
        return self.value(float(np.exp(self._random.uniform(np.log(least), np.log(most)))))

    def number(self, most: float) -> Any:
        """A number of either sign."""
        return self.value(float(self._random.uniform(-most, most)))

    def vector(self, most: float, length: int = 3) -> Any:
        return self.value(tuple(self.number(most) for _ in range(length)))

    def rotation(self) -> Any:
        Q, _ = np.linalg.qr(self._random.normal(size=(3, 3)))
        return self.value(Q * np.linalg.det(Q))

    def options(self, **candidates: Any) -> dict[str, Any]:
        """Some of these arguments; each is given by a function of no argument."""
        return {name: make() for name, make in candidates.items() if self.chance(0.25)}
