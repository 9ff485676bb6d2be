"""Matrices and texts of MAT files of version 5 to 7, from anywhere.

Scipy's reader ends the process on some damaged files, so this one takes no more than it needs: full real matrices and
texts at the top level; what else is there is passed over.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Collection, Iterator
from pathlib import Path

import numpy as np

from flexmbd.errors import ExportError
from flexmbd.files.whole_file import read_file
from flexmbd.record.groups import FloatArray

#: Bytes that the compressed variables of a file may come to.
MOST_BYTES = 2**31

_HEADER = 128
_MATRIX, _COMPRESSED = 14, 15
_FLAGS, _DIMENSIONS, _NAME = 6, 5, 1
_COMPLEX = 0x800
_CHARACTERS, _SPARSE = 4, 5
_NUMERIC = range(6, 16)
# Types of stored data: numbers and the encodings of texts.
_NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_TEXTS = {2: "latin-1", 4: "utf-16", 16: "utf-8", 17: "utf-16", 18: "utf-32"}


def read_mat(path: str | Path, *, requested: Collection[str]) -> dict[str, FloatArray | list[str]]:
    """Variables by name: a float64 matrix, or a text's rows.

    Args:
        path: the file.
        requested: names of variables; others are passed over.

    Raises:
        ExportError: the file is missing, damaged, of version 7.3, or a requested variable is neither a full real matrix
            nor text.
    """
    data = read_file(path)
    try:
        return dict(_variables(data, requested))
    except (ValueError, LookupError, OverflowError, MemoryError, struct.error, zlib.error) as error:
        raise ExportError(
            f"{path} is no MAT file of version 5 to 7 that can be read: {error}; Matlab writes one by save -v7"
        ) from error


def _variables(data: bytes, requested: Collection[str]) -> Iterator[tuple[str, FloatArray | list[str]]]:
    if len(data) < _HEADER or data[126:128] not in (b"IM", b"MI"):
        raise ValueError("it has no header of version 5")
    order = "<" if data[126:128] == b"IM" else ">"
    at, left, seen = _HEADER, MOST_BYTES, set()
    while at < len(data):
        kind, size = struct.unpack_from(f"{order}II", data, at)
        if kind not in (_MATRIX, _COMPRESSED) or at + 8 + size > len(data):
            raise ValueError(f"the variable at byte {at} is damaged or cut short")
        content = data[at + 8 : at + 8 + size]
        if kind == _COMPRESSED:
            unpack = zlib.decompressobj()
            content = unpack.decompress(content, left)
            left -= len(content)
            if unpack.unconsumed_tail or left <= 0:
                raise ValueError(f"its variables come to more than {MOST_BYTES} bytes")
            kind, inner = struct.unpack_from(f"{order}II", content)
            content = content[8 : 8 + inner]
            if kind != _MATRIX or len(content) != inner:
                raise ValueError(f"the variable at byte {at} is damaged")
        at += 8 + size
        name, value = _variable(content, order, requested)
        if value is None:
            continue
        if name in seen:
            raise ValueError(f"variable {name} is there twice")
        seen.add(name)
        yield name, value


def _variable(content: bytes, order: str, requested: Collection[str]) -> tuple[str, FloatArray | list[str] | None]:
    parts = _elements(content, order)
    kind, flags_data = next(parts, (0, b""))
    if kind != _FLAGS or len(flags_data) != 8:
        raise ValueError("a variable is damaged")
    flags = struct.unpack(f"{order}I", flags_data[:4])[0]
    kind, shape_data = next(parts, (0, b""))
    if kind != _DIMENSIONS or len(shape_data) % 4 != 0:
        raise ValueError("a variable has no dimensions")
    shape = struct.unpack(f"{order}{len(shape_data) // 4}i", shape_data)
    kind, name_data = next(parts, (0, b""))
    name = name_data.decode("ascii")
    if kind != _NAME or name not in requested:
        return name, None
    what = flags & 0xFF
    if flags & _COMPLEX or len(shape) != 2 or min(shape) < 0 or not (what in _NUMERIC or what == _CHARACTERS):
        hint = f"; store full({name})" if what == _SPARSE else ""
        raise ValueError(f"variable {name} is not a full real matrix and no text{hint}")
    kind, values = next(parts, (0, b""))
    if what == _CHARACTERS:
        return name, _rows_of_text(values, kind, order, shape, name)
    array = np.frombuffer(values, dtype=f"{order}{_NUMBERS[kind]}")
    if len(array) != shape[0] * shape[1]:
        raise ValueError(f"variable {name} claims {shape} numbers, and has {len(array)}")
    matrix: FloatArray = array.astype(np.float64).reshape(shape, order="F")
    return name, matrix


def _rows_of_text(values: bytes, kind: int, order: str, shape: tuple[int, ...], name: str) -> list[str]:
    encoding = _TEXTS[kind]
    if encoding in ("utf-16", "utf-32"):
        encoding += "-le" if order == "<" else "-be"
    letters = values.decode(encoding)
    if len(letters) != shape[0] * shape[1]:
        raise ValueError(f"text {name} claims {shape} characters, and has {len(letters)}")
    # a text of no rows may claim any number of columns, and one of no columns any number of rows
    return [letters[row :: shape[0]].rstrip(" ") for row in range(shape[0])] if letters else []


def _elements(content: bytes, order: str) -> Iterator[tuple[int, bytes]]:
    """Type and data of each part of a variable."""
    at = 0
    while at + 8 <= len(content):
        kind, size = struct.unpack_from(f"{order}II", content, at)
        if kind >> 16:  # up to four bytes stand in the tag itself
            size, kind = kind >> 16, kind & 0xFFFF
            if size > 4:
                raise ValueError("a part of a variable is damaged")
            yield kind, content[at + 4 : at + 4 + size]
            at += 8
            continue
        if at + 8 + size > len(content):
            raise ValueError("a variable is cut short")
        yield kind, content[at + 8 : at + 8 + size]
        at += 8 + -(-size // 8) * 8
