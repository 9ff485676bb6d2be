"""Nastran OUTPUT4 matrices in text form: a header, columns of numbers in fixed fields, and an end, per matrix.

Read by `read_op4`.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from flexmbd.export.superelements.op4_matrix import Op4Matrix, check_kind, string_head
from flexmbd.record.groups import FloatArray

_HEADER = re.compile(r"([ \d-]{8})([ \d-]{8})([ \d]{8})([ \d]{8})(.{8})(.*)", re.ASCII)
# of 64-bit Nastran, where eight digits do not do
_WIDE_HEADER = re.compile(r"([ \d-]{16})([ \d-]{16})([ \d]{8})([ \d]{8})(.{8})(.*)\|I16", re.ASCII)
_FORMAT = re.compile(r"\s*(?:\d+P,?)?(\d+)[ED](\d+)\.\d+\s*", re.ASCII | re.IGNORECASE)
_DEFAULT_FORMAT = (5, 16)


@dataclass(frozen=True)
class _Layout:
    """How many numbers of how many characters a line has."""

    per_line: int
    width: int

    def lines(self, reals: int) -> int:
        """How many lines so many reals take."""
        return -(-reals // self.per_line)

    def numbers(self, content: list[str], count: int) -> FloatArray:
        """The reals of these lines, or ValueError."""
        w, n = self.width, self.per_line
        words = [line.ljust(n * w)[i * w : (i + 1) * w] for line in content for i in range(n)][:count]
        return np.array([float(word.replace("D", "E")) for word in words])


def text_matrices(text: str) -> list[Op4Matrix]:
    """The matrices of a file, in order.

    Raises:
        ValueError: the file is damaged, or holds something else.
        IndexError: it is cut short.
    """
    lines = text.splitlines()
    matrices = []
    at = 0
    while at < len(lines):
        if not lines[at].strip():
            at += 1
            continue
        matrix, layout = _header(lines[at], at, len(text))
        at = _read_columns(matrix, lines, at + 1, layout)
        matrices.append(matrix)
    return matrices


def _header(line: str, at: int, size: int) -> tuple[Op4Matrix, _Layout]:
    header = _WIDE_HEADER.fullmatch(line.rstrip()) or _HEADER.fullmatch(line.ljust(40))
    told = None if header is None else _FORMAT.fullmatch(header[6])
    if header is None or (told is None and header[6].strip()):
        raise ValueError(f"line {at + 1} is not a header of a matrix in text form: {line[:60]!r}")
    columns, rows, _, kind = (int(header[i]) for i in range(1, 5))
    name = header[5].strip().upper()
    check_kind(name, kind)
    layout = _Layout(*(_DEFAULT_FORMAT if told is None else (int(told[1]), int(told[2]))))
    if not (0 < layout.per_line <= 20 and 8 <= layout.width <= 40):
        raise ValueError(f"matrix {name} has {layout.per_line} numbers of {layout.width} characters a line")
    return Op4Matrix(name, rows, columns, kind, size, layout.numbers), layout


def _read_columns(matrix: Op4Matrix, lines: list[str], at: int, layout: _Layout) -> int:
    """Take a matrix's columns, and return the line after its end."""
    words_per_real = 1 if matrix.kind % 2 else 2
    while True:
        column, first, words = _whole(lines[at], 3)
        at += 1
        if column == matrix.columns + 1:
            return at + layout.lines(max(words, 1))
        if words < 1:
            raise ValueError(f"matrix {matrix.name}: column {column} is cut short")
        while words > 0:
            if first > 0:
                reals, row, words = words, first, 0
            else:
                if matrix.bigmat:
                    length, row = _whole(lines[at], 2)
                    length, words = length - 1, words - 1
                else:
                    length, row = string_head(int(lines[at]))
                at, words, reals = at + 1, words - 1 - length, length // words_per_real
            end = at + layout.lines(reals)
            if reals < 1 or words < 0 or end > len(lines):
                raise ValueError(f"matrix {matrix.name}: column {column} is cut short")
            matrix.add(column, row, reals, lines[at:end])
            at = end


def _whole(line: str, count: int) -> tuple[int, ...]:
    """Whole numbers in fields of eight characters."""
    return tuple(int(line[8 * i : 8 * i + 8]) for i in range(count))
