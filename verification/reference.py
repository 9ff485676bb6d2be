"""What a script of verification/ is: where its numbers are from, which these are, and what is computed for them."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike


class Sureness(Enum):
    """How sure a published number is; the page's legend is made of these."""

    PRIMARY = "A"
    SECONDARY = "B"
    RECALLED = "C"
    OWN = "own"

    @property
    def meaning(self) -> str:
        """A line for the page."""
        return {
            Sureness.PRIMARY: "seen in a primary source, or a closed form evaluated",
            Sureness.SECONDARY: "from a secondary text, another program's examples or a digitised curve",
            Sureness.RECALLED: "recalled from the literature, and met by what was derived again",
            Sureness.OWN: "the published problem's equations, solved apart from this program",
        }[self]


@dataclass(frozen=True)
class Source:
    """Where a problem and its numbers are from.

    Attributes:
        text: authors, year, title or place.
        doi: without `https://doi.org/`; empty where it is not known.
    """

    text: str
    doi: str = ""


@dataclass(frozen=True)
class Reference:
    """One published quantity.

    Attributes:
        quantity: what it is, as the page says it.
        unit: of the numbers; empty for pure numbers.
        published: the number, or the components of one quantity.
        within: the largest difference, over `size`, that the digits of the source and the discretisation explain.
        sure: how sure the number is.
        size: what differences are over, in the unit; by default the largest of the published numbers.
        fails: why it is not met, where that is known to be so; the page lists it as such.
    """

    quantity: str
    unit: str
    published: tuple[float, ...]
    within: float
    sure: Sureness
    size: float | None = None
    fails: str = ""

    @property
    def scale(self) -> float:
        """What differences are over, in the unit."""
        return self.size if self.size is not None else max(abs(one) for one in self.published)

    def difference(self, ours: tuple[float, ...]) -> float:
        """The largest difference of a component, over the scale, with the sign that it has there.

        Raises:
            ValueError: as many numbers were not computed as are published.
        """
        if len(ours) != len(self.published):
            raise ValueError(f"'{self.quantity}' has {len(self.published)} numbers, and {len(ours)} were computed")
        apart = (np.array(ours) - np.array(self.published)) / self.scale
        return float(apart[np.argmax(np.abs(apart))])

    def is_met(self, ours: tuple[float, ...]) -> bool:
        """Whether it is, within what is explained."""
        return bool(abs(self.difference(ours)) <= self.within)


def numbers(*found: ArrayLike) -> tuple[float, ...]:
    """Numbers and arrays, one after the other, as a tuple of floats."""
    return tuple(float(one) for part in found for one in np.ravel(np.asarray(part, dtype=float)))


@dataclass(frozen=True)
class Computed:
    """What a script found.

    Attributes:
        values: for each of its references the numbers, in their order.
        mesh: elements, modes, or whatever discretises space; empty where nothing does.
        accuracy: of time or of the solution: rtol, steps.
    """

    values: tuple[tuple[float, ...], ...]
    mesh: str = ""
    accuracy: str = ""


class Script(Protocol):
    """The module of a script; its docstring has the problem's name in its first line and what it is below.

    Attributes:
        SOURCE: of the problem.
        REFERENCES: what is compared.
    """

    SOURCE: Source
    REFERENCES: tuple[Reference, ...]

    @staticmethod
    def compute() -> Computed:
        """Compute all of it."""
