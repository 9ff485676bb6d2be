"""Nastran OUTPUT4 matrices in binary form: Fortran records of a header, of columns and of an end, per matrix.

Read by `read_op4`.  A record's length in bytes stands before and after it; either order of bytes is read.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator

import numpy as np

from flexmbd.export.superelements.superelement_frames import MOST_ROWS
from flexmbd.record.groups import FloatArray

_HEADER = struct.calcsize("=4i8s")
# Bytes of the words of real single and double precision, by the header's type.
_REAL = {1: 4, 2: 8}


def is_binary(data: bytes) -> bool:
    """Whether a file begins with a binary header's length."""
    return _order(data) is not None


def binary_matrices(data: bytes) -> dict[str, FloatArray]:
    """The dense real matrices of a file by their names.

    Raises:
        ValueError: the file is damaged, or holds something else.
    """
    order = _order(data) or "<"
    matrices: dict[str, FloatArray] = {}
    records = _records(data, order)
    for header in records:
        if len(header) != _HEADER:
            raise ValueError(f"a record of {len(header)} bytes stands where a matrix's header should be")
        columns, rows, form, kind, letters = struct.unpack(f"{order}4i8s", header)
        name = letters.decode("ascii", "replace").strip().upper()
        if kind not in _REAL or not 0 < columns <= MOST_ROWS or not 0 < rows <= MOST_ROWS:
            raise ValueError(
                f"matrix {name} has {rows} rows, {columns} columns, form {form} and type {kind}; read are dense real "
                f"ones of at most {MOST_ROWS} rows"
            )
        if name in matrices:
            raise ValueError(f"matrix {name} is there twice")
        # zeros are not written, so the file's length says little; a superelement's matrices are dense
        if rows * columns > 64 * len(data):
            raise ValueError(f"matrix {name} claims {rows} x {columns} entries, and the file is too short to hold them")
        matrices[name] = _dense(records, (rows, columns), kind=f"{order}f{_REAL[kind]}", name=name)
    return matrices


def _dense(records: Iterator[bytes], shape: tuple[int, int], *, kind: str, name: str) -> FloatArray:
    """A matrix from its columns' records; the last one's column is behind all."""
    rows, columns = shape
    matrix = np.zeros(shape)
    for record in records:
        if len(record) < 12:
            raise ValueError(f"matrix {name}: a column's record has {len(record)} bytes")
        number, first, words = struct.unpack(f"{kind[0]}3i", record[:12])
        if number == columns + 1:
            return matrix
        if first == 0:
            raise ValueError(f"matrix {name} is written as a sparse one; write it dense")
        if words < 1 or len(record) != 12 + 4 * words or 4 * words % int(kind[2]):
            raise ValueError(f"matrix {name}: column {number} of {words} words has {len(record)} bytes")
        values = np.frombuffer(record, dtype=kind, offset=12)
        last = first - 1 + len(values)
        if not (0 < number <= columns and 0 < first and last <= rows):
            raise ValueError(f"matrix {name} of {rows} x {columns}: column {number} has rows {first} to {last}")
        matrix[first - 1 : last, number - 1] = values
    raise ValueError(f"matrix {name} is cut short")


def _order(data: bytes) -> str | None:
    """The order of bytes by which the file begins with the length of a header."""
    return next((order for order in "<>" if data[:4] == struct.pack(f"{order}i", _HEADER)), None)


def _records(data: bytes, order: str) -> Iterator[bytes]:
    at = 0
    while at < len(data):
        length = int.from_bytes(data[at : at + 4], "little" if order == "<" else "big", signed=True)
        end = at + 4 + length
        if length < 0 or end + 4 > len(data) or data[end : end + 4] != data[at : at + 4]:
            raise ValueError(f"the record at byte {at} is cut short or damaged")
        yield data[at + 4 : end]
        at = end + 4
