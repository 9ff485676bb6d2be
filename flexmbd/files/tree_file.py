"""One HDF5 file of named arrays and texts: written whole or not at all, read back bit for bit.

The schema, which any HDF5 library can read (docs/record.md lists what a reduced body keeps in it):

    bytes 0-511   user block, ASCII: what the file is, its version, the number of bytes after the
                  user block and their SHA-256; h5dump and h5py skip it by themselves
    /             attributes `format` and `version`, as "flexmbd record" and 1
    arrays        datasets of little-endian 64-bit floats or integers, or 32-bit floats, contiguous
    texts         scalar datasets of UTF-8 strings of variable length
    text tuples   one-dimensional datasets of such strings
    dictionaries  groups

The user block is checked before the HDF5 library sees a byte: on a damaged file the library may
never return.  No pickle, no compression, nothing outside the file (`sound_hdf5`).
"""

from __future__ import annotations

import hashlib
import io
import os
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np

from flexmbd.errors import RecordError
from flexmbd.files.sound_hdf5 import open_hdf5
from flexmbd.files.tree_layout import HEAD as HEAD
from flexmbd.files.tree_layout import NUMBERS, lay_out, room_of, store, write_group
from flexmbd.files.tree_layout import FileKind as FileKind
from flexmbd.files.tree_layout import Tree as Tree
from flexmbd.files.whole_file import first_line, part_file

if TYPE_CHECKING:
    import h5py

_READ_AT_ONCE = 1 << 22
_HEADLINE = re.compile(rb"([a-z ]+), version (\d+)\nHDF5 after (\d+) bytes\nbytes (\d+)\nsha256 ([0-9a-f]{64})\n")


def write_tree(path: Path, tree: Mapping[str, Any], *, kind: FileKind) -> None:
    """Write a tree to a file; an existing file survives until the new one is complete.

    Not collective: under MPI, call it on one rank.

    Args:
        path: destination; a symbolic link is followed.
        tree: see `Tree`; a key is a non-empty text without "/" and NUL, and not ".".
        kind: what the file is.

    Raises:
        RecordError: the destination cannot be written, or the tree holds something else.
    """
    room = room_of(tree)
    try:
        with part_file(Path(os.path.realpath(path))) as (part, file):
            lay_out(part, file, tree, kind=kind)
            seal(file, kind)
    except OSError as error:
        raise not_written(path, error, room=room) from error


def not_written(path: Path, error: OSError, *, room: int) -> RecordError:
    """The error for a file of some ``room`` bytes that could not be written."""
    return RecordError(
        f"cannot write {path}: {first_line(error)}; nothing was changed there. Some {room} bytes are needed: choose a "
        "folder that exists, that you may write to and that has the space"
    )


def check_destination(path: Path) -> None:
    """Refuse a destination that cannot be written, before its contents are computed. Not collective.

    Raises:
        RecordError: its folder does not exist or may not be written to, or it is something else than a file.
    """
    target = Path(os.path.realpath(path))
    try:
        if not target.parent.is_dir():
            fault = f"there is no folder {target.parent}"
        elif target.exists() and not target.is_file():
            fault = "it is not a regular file"
        elif not os.access(target.parent, os.W_OK | os.X_OK):
            fault = f"the folder {target.parent} may not be written to"
        else:
            return
    except OSError as error:  # of a name that is too long
        fault = first_line(error)
    raise RecordError(f"cannot write {path}: {fault}; choose a file in a folder of yours")


def read_tree(path: Path, *, kind: FileKind) -> Tree:
    """Read a tree written by `write_tree`, bit for bit. Not collective.

    Raises:
        RecordError: the file is missing, foreign, of another version, truncated or damaged.
    """
    # before the HDF5 library sees a byte the whole is checked, which is never in memory as a whole
    with _open_checked(Path(path), kind=kind) as (file, size):
        return _tree(Path(path), file, size=size, kind=kind)


def tree_of(path: Path, image: bytes, *, kind: FileKind) -> Tree:
    """The tree of a file's bytes, whose head `check_image` has found sound.

    Raises:
        RecordError: they hold something else than a tree.
    """
    return _tree(path, io.BytesIO(image), size=len(image), kind=kind)


def _tree(path: Path, stream: BinaryIO, *, size: int, kind: FileKind) -> Tree:
    try:
        with open_hdf5(stream, size=size) as file:
            return _read_group(file)
    except (RecordError, OSError, KeyError, TypeError, ValueError, AttributeError, RuntimeError) as error:
        raise RecordError(f"{path} is not a valid {kind.format}: {error}") from error


def tree_image(tree: Mapping[str, Any], *, kind: FileKind) -> bytes:
    """The bytes of a file that holds a tree.

    Raises:
        RecordError: the tree holds something else than a file can.
    """
    import h5py

    # made in memory and written by Python: on a full disk the HDF5 library fails when it closes
    # a file, too late for a clean error
    buffer = io.BytesIO()
    with h5py.File(buffer, "w", userblock_size=HEAD) as file:
        file.attrs["format"] = kind.format
        file.attrs["version"] = kind.version
        write_group(file, tree, store=store)
    with buffer.getbuffer() as image, image[HEAD:] as body:
        head = _head(kind, size=len(body), digest=hashlib.sha256(body).hexdigest())
    buffer.seek(0)
    buffer.write(head)
    return buffer.getvalue()


def seal(file: int, kind: FileKind) -> None:
    """Write the head of an HDF5 file that was written behind a user block of ``HEAD`` bytes, and is open for all.

    Raises:
        OSError: it cannot be read or written.
    """
    size, digest = _digest(file)
    os.pwrite(file, _head(kind, size=size, digest=digest), 0)


def is_kind(path: Path, kind: FileKind) -> bool:
    """Whether a file that can be read begins as one of this kind does."""
    try:
        if not path.is_file():
            return False
        with open(path, "rb") as file:
            found = _HEADLINE.match(file.read(HEAD))
    except OSError:
        return False
    return found is not None and found.group(1) == kind.format.encode()


def check_seal(path: Path, *, kind: FileKind) -> None:
    """Refuse a file that is not as `seal` left it. Not collective.

    Raises:
        RecordError: it is missing, foreign, of another version, truncated or damaged.
    """
    with _open_checked(path, kind=kind):
        pass


@contextmanager
def _open_checked(path: Path, *, kind: FileKind) -> Iterator[tuple[BinaryIO, int]]:
    """A file as `seal` left it, and its size; of a foreign one, however long, nothing but the head is read."""
    try:
        if path.exists() and not path.is_file():  # a pipe would be waited for
            raise RecordError(f"cannot read {path}: it is not a regular file")
        with open(path, "rb") as file:
            head = file.read(HEAD)
            size = image_size(path, head, kind=kind)
            _refuse_size(path, os.fstat(file.fileno()).st_size, size)
            _refuse_digest(path, _digest(file.fileno())[1], head, kind)
            yield file, size
    except OSError as error:
        raise RecordError(f"cannot read {path}: {first_line(error)}") from error


def _digest(file: int) -> tuple[int, str]:
    """Of what stands behind a file's head: its size and SHA-256."""
    digest, at = hashlib.sha256(), HEAD
    while part := os.pread(file, _READ_AT_ONCE, at):
        digest.update(part)
        at += len(part)
    return at - HEAD, digest.hexdigest()


def _head(kind: FileKind, *, size: int, digest: str) -> bytes:
    return head_of(kind, before=HEAD, size=size, digest=digest).ljust(HEAD, b"\0")


def head_of(kind: FileKind, *, before: int, size: int, digest: str) -> bytes:
    """The text of a user block of ``before`` bytes, of an HDF5 file of ``size`` bytes behind it."""
    text = f"{kind.format}, version {kind.version}\nHDF5 after {before} bytes\nbytes {size}\nsha256 {digest}\n"
    return text.encode("ascii")


def _headline(path: Path, data: bytes, kind: FileKind) -> re.Match[bytes]:
    found = _HEADLINE.match(data[:HEAD])
    name = kind.format.encode()
    if found is None and name.startswith(data[: len(name)]):
        raise RecordError(
            f"{path} is truncated or damaged at its beginning ({len(data)} bytes are left); "
            "copy it or write it again"
        )
    if found is None or found.group(1) != name:
        raise RecordError(f"{path} is not a {kind.format}; pass a file that {kind.writer} wrote")
    return found


def image_size(path: Path, head: bytes, *, kind: FileKind) -> int:
    """How many bytes a file's first bytes say that it has.

    Raises:
        RecordError: it is foreign or of another version, or its beginning is damaged.
    """
    found = headline(path, head, kind)
    return int(found.group(3)) + int(found.group(4))


def headline(path: Path, head: bytes, kind: FileKind) -> re.Match[bytes]:
    """The head of a file: format, version, bytes before HDF5's, bytes of these, SHA-256.

    Raises:
        RecordError: it is foreign or of another version, or its beginning is damaged.
    """
    found = _headline(path, head, kind)
    if int(found.group(2)) != kind.version:
        raise RecordError(
            f"{path} is a {kind.format} of version {int(found.group(2))}, and this flexmbd reads version "
            f"{kind.version}: use the flexmbd that wrote it, or make it again"
        )
    return found


def check_image(path: Path, image: bytes, *, kind: FileKind) -> None:
    """Refuse bytes of a file that differ from the written ones.

    Raises:
        RecordError: they are of another file, of another version, truncated or damaged.
    """
    _refuse_size(path, len(image), image_size(path, image, kind=kind))
    _refuse_digest(path, hashlib.sha256(memoryview(image)[HEAD:]).hexdigest(), image, kind)


def _refuse_size(path: Path, found: int, size: int) -> None:
    if found != size:
        raise RecordError(
            f"{path} is truncated or was added to: it has {found} bytes of {size}; copy it or write it again"
        )


def _refuse_digest(path: Path, digest: str, head: bytes, kind: FileKind) -> None:
    if digest.encode() != _headline(path, head, kind).group(5):
        raise RecordError(f"{path} is damaged: its SHA-256 differs; copy it or write it again")


def _read_group(group: h5py.Group) -> Tree:
    import h5py

    tree: Tree = {}
    for key, item in group.items():
        if isinstance(item, h5py.Group):
            tree[key] = _read_group(item)
        elif h5py.check_string_dtype(item.dtype):
            texts = item.asstr()[()]
            tree[key] = texts if isinstance(texts, str) else tuple(texts.tolist())
        elif item.dtype.newbyteorder("=") in NUMBERS:
            array = np.empty(item.shape, item.dtype.newbyteorder("="))
            if array.size:
                item.read_direct(array)
            tree[key] = array
        else:
            raise ValueError(f"{item.name} holds {item.dtype}")
    return tree
