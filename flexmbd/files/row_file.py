"""An HDF5 file of which some datasets are filled row by row, and all else is guarded by a checksum from the beginning.

All datasets have their final size and place once the file is laid out, so that rows that come in change no other byte.
The user block says, in ASCII, what the file is, as of `tree_file`, but that its SHA-256 leaves out the bytes of the
rows, whose places follow:

    flexmbd ensemble, version 2
    HDF5 after 512 bytes
    bytes 8192
    sha256 ...
    rows at 532+4 2760+800 4096+4

Who keeps rows guards them by checksums of their own.
"""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from flexmbd.errors import RecordError
from flexmbd.files.tree_file import HEAD, FileKind, head_of, headline

if TYPE_CHECKING:
    import h5py

#: Where rows are in a file: their first byte, and how many there are.
Places = Sequence[tuple[int, int]]

_ROWS = re.compile(rb"rows at((?: \d+\+\d+)*)\n")
_PLACE = 48  # bytes of one place in the head, at most
_READ_AT_ONCE = 1 << 22
# Of the superblock of version 0, which h5py writes: flags that say that somebody has the file open for writing; whoever
# is killed leaves them set.
_OPENED = (20, 4)


def head_size(datasets: int) -> int:
    """Bytes of the user block of a file with so many datasets of rows: HDF5 takes powers of two from 512 on."""
    size = HEAD
    while size < HEAD + _PLACE * (1 + datasets):
        size *= 2
    return size


def places_of(datasets: Sequence[h5py.Dataset]) -> Places:
    """Where the rows of datasets are that are laid out in one piece, in the order of the file."""
    found = ((one.id.get_offset(), one.id.get_storage_size()) for one in datasets)
    return sorted((int(offset), int(size)) for offset, size in found if size)


def seal_rows(file: int, kind: FileKind, *, head: int, places: Places) -> None:
    """Write the head, of ``head`` bytes, of a file that was laid out and is closed by HDF5.

    Raises:
        OSError: it cannot be read or written.
    """
    size = os.fstat(file).st_size - head
    flags, length = _OPENED
    places = [(head + flags, length), *places]
    rows = "".join(f" {begin}+{length}" for begin, length in places)
    text = head_of(kind, before=head, size=size, digest=_digest(file, head, places)) + f"rows at{rows}\n".encode()
    os.pwrite(file, text.ljust(head, b"\0"), 0)


def check_rows(path: Path, *, kind: FileKind) -> None:
    """Refuse a file that is not as `seal_rows` left it, its rows apart. Not collective.

    Raises:
        RecordError: it is missing, foreign, of another version, truncated or damaged.
    """
    try:
        if path.exists() and not path.is_file():  # a pipe would be waited for
            raise RecordError(f"cannot read {path}: it is not a regular file")
        with open(path, "rb") as file:
            found = headline(path, file.read(HEAD), kind)
            head, size = int(found.group(3)), int(found.group(4))
            there = os.fstat(file.fileno()).st_size
            if there != head + size:
                raise RecordError(
                    f"{path} is truncated or was added to: it has {there} bytes of {head + size}; remove it"
                )
            file.seek(0)
            rows = _ROWS.match(file.read(head), found.end())
            places = [] if rows is None else [_place(one) for one in rows.group(1).split()]
            if rows is None or _digest(file.fileno(), head, places) != found.group(5).decode():
                raise RecordError(f"{path} is damaged outside its rows: its SHA-256 differs; remove it")
    except OSError as error:
        raise RecordError(f"cannot read {path}: {error.strerror or error}") from error


def _place(text: bytes) -> tuple[int, int]:
    begin, length = map(int, text.split(b"+"))
    return begin, length


def _digest(file: int, head: int, places: Places) -> str:
    """SHA-256 of what stands behind the head and is no row."""
    digest = hashlib.sha256()
    for begin, end in _between(head, places, os.fstat(file).st_size):
        at = begin
        while at < end and (part := os.pread(file, min(_READ_AT_ONCE, end - at), at)):
            digest.update(part)
            at += len(part)
    return digest.hexdigest()


def _between(begin: int, places: Places, end: int) -> Iterator[tuple[int, int]]:
    for place, length in places:
        yield begin, place
        begin = max(begin, place + length)
    yield begin, end
