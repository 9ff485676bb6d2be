"""The layout of a tree in its HDF5 file: texts and heads by HDF5, numbers by whoever has them."""

from __future__ import annotations

import errno
import math
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import RecordError
from flexmbd.files.whole_file import first_line, refuse_no_room, take_room

if TYPE_CHECKING:
    import h5py

#: A dictionary of float64, float32 and int64 arrays, texts, tuples of texts, and further such dictionaries.
Tree = dict[str, Any]

#: Bytes before the HDF5 file proper.
HEAD = 512
#: The numbers that arrays may hold, and how HDF5 calls them in a file.
NUMBERS = {np.dtype(np.float64): "<f8", np.dtype(np.float32): "<f4", np.dtype(np.int64): "<i8"}
# Bytes that a file needs beside its arrays: of itself, and of an item.
_HEADERS, _HEADER = 1 << 16, 1 << 10


@dataclass(frozen=True)
class FileKind:
    """The kind of a file: its format, version and writer.

    Attributes:
        format: its name, small letters and blanks.
        version: raised by whatever is added or changed after the first release.
        writer: what a user calls to write one.
    """

    format: str
    version: int
    writer: str


@dataclass(frozen=True)
class Reserved:
    """An array of a tree whose numbers are written to their place in the file by others.

    Attributes:
        shape: of one dimension at least.
        dtype: a number's.
    """

    shape: tuple[int, ...]
    dtype: np.dtype[Any]

    @property
    def size(self) -> int:
        """How many numbers."""
        return math.prod(self.shape)

    @property
    def nbytes(self) -> int:
        """Bytes of all numbers."""
        return self.size * self.dtype.itemsize


def lay_out(part: Path, file: int, tree: Mapping[str, Any], *, kind: FileKind) -> dict[str, int]:
    """Write a tree to an empty file, open for all, whose room is taken before; `seal` makes it whole.

    HDF5 writes the texts and says where arrays are to stand. Their numbers are written by us, none of which needs
    memory or is copied, and an error of the disk's is one of ours.

    Args:
        part: the file's path.
        file: its descriptor.
        tree: see `Tree`; arrays may be `Reserved`.
        kind: what the file is.

    Returns:
        Where the numbers of each `Reserved` array begin, in bytes, by "/group/name"; empty ones are left out.

    Raises:
        OSError: it cannot be written.
        RecordError: the tree holds something else than a file can.
    """
    import h5py

    room = room_of(tree)
    refuse_no_room(file, room)
    arrays: dict[str, tuple[int, NDArray[Any] | Reserved]] = {}

    def reserve(group: h5py.Group, key: str, array: NDArray[Any] | Reserved, item: str) -> None:
        if not array.shape or array.size == 0:  # HDF5 keeps no place for these
            store(group, key, np.empty(array.shape, array.dtype) if isinstance(array, Reserved) else array, item)
            return
        early = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        early.set_alloc_time(h5py.h5d.ALLOC_TIME_EARLY)
        early.set_fill_time(h5py.h5d.FILL_TIME_NEVER)
        dataset = group.create_dataset(key, array.shape, NUMBERS[array.dtype], dcpl=early)
        arrays[item] = dataset.id.get_offset(), array

    try:
        with h5py.File(part, "w", userblock_size=HEAD, locking=False) as image:  # the part has a lock of ours
            image.attrs["format"] = kind.format
            image.attrs["version"] = kind.version
            write_group(image, tree, store=reserve)
    except RuntimeError as error:  # of HDF5, on a disk
        raise OSError(errno.EIO, first_line(error)) from error
    take_room(file)
    for place, array in arrays.values():
        if not isinstance(array, Reserved):
            put(file, place, array)
    return {item: place for item, (place, array) in arrays.items() if isinstance(array, Reserved)}


def put(file: int, place: int, array: NDArray[Any]) -> None:
    """Write the numbers of an array to their place in an open file.

    Raises:
        OSError: they cannot be written.
    """
    left = memoryview(np.ascontiguousarray(array, NUMBERS[array.dtype]).reshape(-1).view(np.uint8))
    while left:  # a disk that is nearly full takes a part
        written = os.pwrite(file, left, place)
        left, place = left[written:], place + written


def room_of(tree: Mapping[str, Any]) -> int:
    """Bytes that a file of a tree needs at most."""
    return _HEADERS + _bytes(tree)


def _bytes(tree: Mapping[str, Any]) -> int:
    total = 0
    for value in tree.values():
        if isinstance(value, Mapping):
            total += _HEADER + _bytes(value)
        elif isinstance(value, np.ndarray | Reserved):
            total += _HEADER + value.nbytes
        else:
            texts = value if isinstance(value, tuple) else (value,)
            total += _HEADER + sum(_HEADER + 4 * len(text) for text in texts if isinstance(text, str))
    return total


def write_group(
    group: h5py.Group, tree: Mapping[str, Any], *, store: Callable[[h5py.Group, str, Any, str], None], where: str = ""
) -> None:
    """Write a tree; arrays, with their key in a group and their place in the whole, go to ``store``.

    Raises:
        RecordError: the tree holds something else than a file can.
    """
    import h5py

    for key, value in tree.items():
        item = f"{where}/{key}"
        if not isinstance(key, str) or key in ("", ".") or "/" in key or "\0" in key:
            raise RecordError(f"a file cannot have an item named {key!r}")
        if isinstance(value, Mapping):
            write_group(group.create_group(key), value, store=store, where=item)
        elif isinstance(value, np.ndarray | Reserved) and value.dtype in NUMBERS:
            store(group, key, value, item)
        elif _is_text(value) or (isinstance(value, tuple) and all(map(_is_text, value))):
            group.create_dataset(key, data=value, dtype=h5py.string_dtype("utf-8"))
        else:
            raise RecordError(
                f"a file holds float64, float32 and int64 arrays, texts without NUL and tuples of them; "
                f"item {item} is {getattr(value, 'dtype', type(value).__name__)}"
            )


def store(group: h5py.Group, key: str, array: NDArray[Any], _: str) -> None:
    """Have HDF5 write an array."""
    group.create_dataset(key, data=array.astype(NUMBERS[array.dtype], copy=False))


def _is_text(value: object) -> bool:
    return isinstance(value, str) and "\0" not in value
