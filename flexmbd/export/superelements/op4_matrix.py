"""A matrix of an OP4 file as it is stored: strings of numbers down its columns, made dense when it is asked for.

OUTPUT4 writes each column from its first to its last number that is not zero, or as several such strings ("sparse").
A string's head is one whole number, its row + 65536 (its words + 1), or with BIGMAT two: its words + 1 and its row.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from flexmbd.brief import brief
from flexmbd.export.superelements.superelement_frames import MOST_ROWS
from flexmbd.record.groups import FloatArray

#: Numbers of a matrix in a file per byte of it, at most: what claims more is refused before it is allocated.
_PER_BYTE = 64
#: Rows from which on Nastran has to say words and row of a string apart.
_BIGMAT_ROWS = 65536


@dataclass(frozen=True, eq=False)
class Op4Matrix:
    """A matrix's header and its strings.

    Attributes:
        name: upper case.
        rows: as the header says, below zero for BIGMAT.
        columns: their number.
        kind: 1 and 2: real, 3 and 4: complex, of single and double precision.
        size: of the file, bytes.
        numbers: makes reals of a string's content.
        strings: column and row from 0, the number of reals, and the content; filled while the file is read.
    """

    name: str
    rows: int
    columns: int
    kind: int
    size: int
    numbers: Callable[[Any, int], FloatArray]
    strings: list[tuple[int, int, int, Any]] = field(default_factory=list)

    __repr__ = brief

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return abs(self.rows), self.columns

    @property
    def bigmat(self) -> bool:
        """Whether words and row of a string stand apart."""
        return self.rows < 0 or self.rows >= _BIGMAT_ROWS

    @property
    def reals(self) -> int:
        """Of an entry."""
        return 1 if self.kind < 3 else 2

    def add(self, column: int, row: int, count: int, content: Any) -> None:
        """Take a string of so many reals, from a column and row that are counted from 1.

        Raises:
            ValueError: it lies outside.
        """
        last = row - 1 + count // self.reals
        if not (0 < column <= self.columns and row > 0 and count > 0 and last <= abs(self.rows)):
            raise ValueError(
                f"matrix {self.name} of {abs(self.rows)} x {self.columns}: column {column} has rows {row} to {last}"
            )
        self.strings.append((column - 1, row - 1, count, content))

    def dense(self) -> FloatArray:
        """The numbers (rows, columns).

        Raises:
            ValueError: they are complex, too many, or no numbers.
        """
        rows, columns = self.shape
        if self.reals == 2:
            raise ValueError(f"matrix {self.name} is complex (type {self.kind}); read are real ones, of types 1 and 2")
        if not (0 < columns <= MOST_ROWS and 0 < rows <= MOST_ROWS):
            raise ValueError(
                f"matrix {self.name} has {rows} rows and {columns} columns; read are real ones of 1 to {MOST_ROWS}"
            )
        # zeros are not written, so the file's length says little; a superelement's boundary is dense
        if rows * columns > _PER_BYTE * self.size:
            raise ValueError(
                f"matrix {self.name} claims {rows} x {columns} entries, and the file is too short to hold them"
            )
        matrix = np.zeros((rows, columns))
        for column, row, count, content in self.strings:
            matrix[row : row + count, column] = self.numbers(content, count)
        return matrix


def check_kind(name: str, kind: int) -> None:
    """Raise ValueError where a header's type is none."""
    if kind not in (1, 2, 3, 4):
        raise ValueError(f"matrix {name} is of type {kind}; there are types 1 to 4")


def string_head(words: int) -> tuple[int, int]:
    """Words and row of a string by its head, without BIGMAT."""
    length = (words >> 16) - 1
    return length, words - ((length + 1) << 16)
