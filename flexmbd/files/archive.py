"""Archives of numpy arrays (.npz) from anywhere: no pickles, and no more memory than the file is worth."""

from __future__ import annotations

import io
import sys
import tokenize
import zipfile
import zlib
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import ExportError
from flexmbd.files.whole_file import first_line, read_file, write_file

#: Arrays in one archive, and bytes of them all together; an archive may claim any size at no cost in the file.
MOST_ARRAYS = 10_000
MOST_BYTES = 2**31


def write_archive(path: str | Path, arrays: Mapping[str, Any]) -> Path:
    """Write arrays without pickles, whole or not at all.

    Raises:
        ExportError: the destination cannot be written.
    """
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, **arrays)
    return write_file(path, buffer.getvalue())


def read_archive(
    path: str | Path, *, requested: Collection[str] | None = None, compressed: bool = True
) -> dict[str, NDArray[Any]]:
    """The arrays of an archive by name.

    Args:
        path: a file of zipped .npy members.
        requested: names to read, others are passed over unread; all by default.
        compressed: whether the file may be so; one that is not may have any size.

    Raises:
        ExportError: the file is missing, damaged, no such archive, or claims more than is sensible; an array is of
            Python objects.
    """
    data = read_file(path) if compressed else read_file(path, largest=sys.maxsize)
    most = MOST_BYTES if compressed else len(data)
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            members = [
                item
                for item in archive.infolist()
                if requested is None or item.filename.removesuffix(".npy") in requested
            ]
            _refuse_excess(path, members, most)
            return {item.filename.removesuffix(".npy"): _array(archive, item) for item in members}
    except ExportError:
        raise
    except (
        OSError, EOFError, KeyError, ValueError, RuntimeError, NotImplementedError, OverflowError, SyntaxError,
        MemoryError, TypeError, tokenize.TokenError, zipfile.BadZipFile, zlib.error,
    ) as error:  # fmt: skip
        raise ExportError(f"{path} is not an archive of arrays that can be read: {first_line(error)}") from error


def _refuse_excess(path: str | Path, members: list[zipfile.ZipInfo], most: int) -> None:
    total = sum(item.file_size for item in members)
    if len(members) > MOST_ARRAYS or total > most:
        raise ExportError(
            f"{path} claims {len(members)} arrays of {total} bytes; {MOST_ARRAYS} arrays of {most} bytes are the "
            "most that are read"
        )


def _array(archive: zipfile.ZipFile, item: zipfile.ZipInfo) -> NDArray[Any]:
    with archive.open(item) as member:
        # no more than the directory said, whatever the stream goes on to hold
        content = member.read(item.file_size)
    stream = io.BytesIO(content)
    version = np.lib.format.read_magic(stream)
    header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, _, kind = header(stream)
    if kind.hasobject:
        raise ValueError(f"{item.filename} holds Python objects, which are not read")
    size = kind.itemsize
    for length in shape:
        size *= length
    if size != len(content) - stream.tell():
        raise ValueError(f"{item.filename} claims {shape} of {kind}, and has {len(content) - stream.tell()} bytes")
    stream.seek(0)
    array: NDArray[Any] = np.lib.format.read_array(stream, allow_pickle=False)
    return array
