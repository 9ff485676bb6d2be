"""Nastran OUTPUT4 matrices in binary form: Fortran records of a header, of columns and of an end, per matrix.

Read by `read_op4`.  A record's length in bytes stands before and after it, in four bytes; either order of bytes is
read, and words of four bytes or of eight, as Nastran's 64-bit (ILP-64) builds write them.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from flexmbd.export.superelements.op4_matrix import Op4Matrix, check_kind, string_head
from flexmbd.record.groups import FloatArray


@dataclass(frozen=True)
class _Words:
    """How a file's numbers stand: order of bytes, whole numbers, bytes of a word, letters of a name."""

    order: str
    whole: str
    size: int
    letters: int

    @property
    def header(self) -> str:
        """The format of a header."""
        return f"{self.order}4{self.whole}{self.letters}s"

    def real(self, kind: int) -> int:
        """Bytes of a real of single (types 1 and 3) or double precision."""
        return self.size if kind % 2 else 8

    def unpack(self, record: bytes, at: int, count: int) -> tuple[int, ...]:
        """Whole numbers of a record, or ValueError."""
        end = at + count * self.size
        if end > len(record):
            raise ValueError(f"a column's record of {len(record)} bytes is cut short")
        return struct.unpack(f"{self.order}{count}{self.whole}", record[at:end])

    def name(self, letters: bytes) -> str:
        """Of a matrix: words of eight bytes hold four letters each, or eight."""
        first, second = letters[: self.letters // 2], letters[self.letters // 2 :]
        if self.size == 8 and second.strip():
            letters = first[:4] + second[:4]
        return letters.decode("ascii", "replace").strip().upper()


_WORDS = tuple(_Words(order, *words) for order in "<>" for words in (("i", 4, 8), ("q", 8, 16)))


def is_binary(data: bytes) -> bool:
    """Whether a file begins with a binary header's length."""
    return _words(data) is not None


def binary_matrices(data: bytes) -> list[Op4Matrix]:
    """The matrices of a file, in order.

    Raises:
        ValueError: the file is damaged, or holds something else.
    """
    words = _words(data) or _WORDS[0]
    matrices = []
    records = _records(data, words.order)
    for header in records:
        if len(header) != struct.calcsize(words.header):
            raise ValueError(f"a record of {len(header)} bytes stands where a matrix's header should be")
        columns, rows, _, kind, letters = struct.unpack(words.header, header)
        name = words.name(letters)
        check_kind(name, kind)
        size = words.real(kind)

        def numbers(content: bytes, count: int, size: int = size) -> FloatArray:
            return np.frombuffer(content, dtype=f"{words.order}f{size}", count=count).astype(np.float64)

        matrix = Op4Matrix(name, rows, columns, kind, len(data), numbers)
        _read_columns(matrix, records, words)
        matrices.append(matrix)
    return matrices


def _read_columns(matrix: Op4Matrix, records: Iterator[bytes], words: _Words) -> None:
    """Take a matrix's columns from their records; the last one's column is behind all."""
    head, real = 3 * words.size, words.real(matrix.kind)
    for record in records:
        column, first, count = words.unpack(record, 0, 3)
        if column == matrix.columns + 1:
            return
        if count < 1 or len(record) != head + words.size * count:
            raise ValueError(f"matrix {matrix.name}: column {column} of {count} words has {len(record)} bytes")
        at = head
        while at < len(record):
            if first > 0:
                length, row = count, first
            elif matrix.bigmat:
                length, row = words.unpack(record, at, 2)
                length, at = length - 1, at + 2 * words.size
            else:
                length, row = string_head(words.unpack(record, at, 1)[0])
                at += words.size
            end = at + length * words.size
            if length < 1 or end > len(record) or length * words.size % (real * matrix.reals):
                raise ValueError(f"matrix {matrix.name}: column {column} has a string of {length} words")
            matrix.add(column, row, (end - at) // real, record[at:end])
            at = end
    raise ValueError(f"matrix {matrix.name} is cut short")


def _words(data: bytes) -> _Words | None:
    """The words by which the file begins with the length of a header."""
    return next((one for one in _WORDS if data[:4] == struct.pack(f"{one.order}i", struct.calcsize(one.header))), None)


def _records(data: bytes, order: str) -> Iterator[bytes]:
    at = 0
    while at < len(data):
        length = int.from_bytes(data[at : at + 4], "little" if order == "<" else "big", signed=True)
        end = at + 4 + length
        if length < 0 or end + 4 > len(data) or data[end : end + 4] != data[at : at + 4]:
            raise ValueError(f"the record at byte {at} is cut short or damaged")
        yield data[at + 4 : end]
        at = end + 4
