"""Nastran OUTPUT4 matrices in binary form: Fortran records of a header, of columns and of an end, per matrix.

Read by `read_op4`.  A record's length in bytes stands before and after it, in four bytes; either order of bytes is
read, and words of four bytes or of eight, as Nastran's 64-bit (ILP-64) builds write them.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from flexmbd.export.superelements.superelement_frames import MOST_ROWS
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
        """Bytes of a number of real single (1) or double (2) precision."""
        return self.size if kind == 1 else 8


_WORDS = tuple(_Words(order, *words) for order in "<>" for words in (("i", 4, 8), ("q", 8, 16)))


def is_binary(data: bytes) -> bool:
    """Whether a file begins with a binary header's length."""
    return _words(data) is not None


def binary_matrices(data: bytes) -> dict[str, FloatArray]:
    """The dense real matrices of a file by their names.

    Raises:
        ValueError: the file is damaged, or holds something else.
    """
    words = _words(data) or _WORDS[0]
    matrices: dict[str, FloatArray] = {}
    records = _records(data, words.order)
    for header in records:
        if len(header) != struct.calcsize(words.header):
            raise ValueError(f"a record of {len(header)} bytes stands where a matrix's header should be")
        columns, rows, form, kind, letters = struct.unpack(words.header, header)
        name = letters.decode("ascii", "replace").strip().upper()
        if kind not in (1, 2) or not 0 < columns <= MOST_ROWS or not 0 < rows <= MOST_ROWS:
            raise ValueError(
                f"matrix {name} has {rows} rows, {columns} columns, form {form} and type {kind}; read are dense real "
                f"ones of at most {MOST_ROWS} rows"
            )
        if name in matrices:
            raise ValueError(f"matrix {name} is there twice")
        # zeros are not written, so the file's length says little; a superelement's matrices are dense
        if rows * columns > 64 * len(data):
            raise ValueError(f"matrix {name} claims {rows} x {columns} entries, and the file is too short to hold them")
        matrices[name] = _dense(records, (rows, columns), words, size=words.real(kind), name=name)
    return matrices


def _dense(records: Iterator[bytes], shape: tuple[int, int], words: _Words, *, size: int, name: str) -> FloatArray:
    """A matrix from its columns' records, numbers of ``size`` bytes; the last one's column is behind all."""
    rows, columns = shape
    matrix = np.zeros(shape)
    head = 3 * words.size
    for record in records:
        if len(record) < head:
            raise ValueError(f"matrix {name}: a column's record has {len(record)} bytes")
        number, first, count = struct.unpack(f"{words.order}3{words.whole}", record[:head])
        if number == columns + 1:
            return matrix
        if first == 0:
            raise ValueError(f"matrix {name} is written as a sparse one; write it dense")
        if count < 1 or len(record) != head + words.size * count or words.size * count % size:
            raise ValueError(f"matrix {name}: column {number} of {count} words has {len(record)} bytes")
        values = np.frombuffer(record, dtype=f"{words.order}f{size}", offset=head)
        last = first - 1 + len(values)
        if not (0 < number <= columns and 0 < first and last <= rows):
            raise ValueError(f"matrix {name} of {rows} x {columns}: column {number} has rows {first} to {last}")
        matrix[first - 1 : last, number - 1] = values
    raise ValueError(f"matrix {name} is cut short")


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
