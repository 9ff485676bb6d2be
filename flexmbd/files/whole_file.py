"""Files from anywhere: written whole or not at all, read within bounds.

A reader here takes a file from anywhere: sizes are checked before anything is allocated, numbers before
they are used, and whatever is wrong ends in one `ExportError` that names the file.
"""

from __future__ import annotations

import errno
import os
import secrets
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import ExportError

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

# Names of parts: ".", so many bytes of the target's name at most, random digits (two a byte) and what they end in.
_LONGEST_STEM, _TOKEN, _PART = 100, 8, ".part"
_LONGEST_WORDS = 300
#: What `os.open` is given beside how: Windows would write two bytes for b"\n".
AS_IT_IS = getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_BINARY", 0)
#: Where no open file is renamed.
WINDOWS = sys.platform == "win32"

#: No file of a reduced body is larger (bytes); what claims more is refused before it is read.
LARGEST = 2**31


def replace_file(path: Path, *parts: bytes) -> None:
    """Put the parts into a new file and rename it to `path`.

    Raises:
        OSError: it cannot be written; what was there is there still.
    """
    with part_file(path) as (_, file):
        for part in parts:
            left = memoryview(part)
            while left:  # a disk that is nearly full takes a part
                left = left[os.write(file, left) :]


@contextmanager
def part_file(target: Path) -> Iterator[tuple[Path, int]]:
    """A new file, by its path and descriptor, which takes the place of the target when it is complete.

    Raises:
        OSError: it cannot be written; what was there is there still, and nothing else.
    """
    temporary, file = open_part(target)
    try:
        yield temporary, file
        take_part(temporary, target, file=file)
    except BaseException:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)
        raise
    finally:
        os.close(file)


def open_part(target: Path) -> tuple[Path, int]:
    """A new empty file beside the target, by its path and descriptor.

    It is locked until the descriptor is closed, by the end of its process too: parts of this target that nobody has
    locked are what killed writers left, and are removed.

    Raises:
        OSError: it cannot be made, or the target is something else than a file.
    """
    if target.exists() and not target.is_file():
        # the rename would put a file in the place of a device
        raise OSError(errno.EINVAL, "it is not a regular file")
    _remove_left(target)
    while True:
        # nobody can guess the name and plant a link there
        temporary = target.with_name(f"{_part_prefix(target)}{secrets.token_hex(_TOKEN)}{_PART}")
        file = os.open(temporary, os.O_RDWR | os.O_CREAT | os.O_EXCL | AS_IT_IS, 0o666)
        if not lock_alone(file) or temporary.exists():
            return temporary, file
        os.close(file)  # another writer took it for one that was left


def refuse_no_room(file: int, size: int) -> None:
    """Raise OSError where so many bytes have no room in an empty open file.

    For what the HDF5 library writes: on a full disk it fails when it closes the file, with a trace of its own or with
    the process.
    """
    if size and hasattr(os, "posix_fallocate"):
        os.posix_fallocate(file, 0, size)
        os.ftruncate(file, 0)


def take_room(file: int) -> None:
    """Have the disk keep room for all bytes of an open file, also for those that nobody has written.

    Raises:
        OSError: it has none.
    """
    size = os.fstat(file).st_size
    if size and hasattr(os, "posix_fallocate"):
        os.posix_fallocate(file, 0, size)


def first_line(error: BaseException) -> str:
    """The first line of an error, without the libraries' traces and quotations of a file."""
    told = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
    return next((line for line in told.splitlines() if line.strip()), type(error).__name__)[:_LONGEST_WORDS]


def take_part(temporary: Path, target: Path, *, file: int) -> None:
    """Let a complete part take its target's place, for good.

    On Windows the descriptor is none of the file's afterwards; it is to be closed all the same.

    Raises:
        OSError: it cannot.
    """
    os.fsync(file)
    if WINDOWS:  # where no folder can be opened either
        nothing = os.open(os.devnull, os.O_RDONLY)  # takes the descriptor's place, for the caller to close
        os.dup2(nothing, file)
        os.close(nothing)
        os.replace(temporary, target)
        return
    os.replace(temporary, target)
    folder = os.open(target.parent, os.O_RDONLY)
    try:
        # the rename itself must survive a power cut; some network file systems cannot promise it
        with suppress(OSError):
            os.fsync(folder)
    finally:
        os.close(folder)


def is_locked_elsewhere(file: int) -> bool:
    """Lock an open file that grows, until it is closed; whether another process, or another part of this one, has."""
    if fcntl is None:
        return False
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:  # of file systems without locks
        return False
    return False


def _part_prefix(target: Path) -> str:
    # names have 255 bytes at most
    return f".{os.fsdecode(os.fsencode(target.name)[:_LONGEST_STEM])}."


def _remove_left(target: Path) -> None:
    """Remove the parts of a target that killed writers left."""
    prefix, length = _part_prefix(target), 2 * _TOKEN + len(_PART)
    with suppress(OSError), os.scandir(target.parent) as entries:
        for entry in entries:
            name = entry.name
            if not (name.startswith(prefix) and name.endswith(_PART) and len(name) == len(prefix) + length):
                continue
            with suppress(OSError):
                file = os.open(entry.path, os.O_RDWR | getattr(os, "O_NOFOLLOW", 0))
                try:
                    if lock_alone(file):
                        os.unlink(entry.path)
                finally:
                    os.close(file)


def lock_alone(file: int) -> bool:
    """Lock a file; whether that could be done: some file systems, and Windows, have no such locks."""
    if fcntl is None:
        return False
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


def write_file(path: str | Path, content: bytes | str) -> Path:
    """Write a file under a temporary name and rename it; an existing file survives until then. Not collective.

    Args:
        path: destination; a symbolic link is followed.
        content: bytes, or text that is written as UTF-8 with the line ends that it has.

    Raises:
        ExportError: the destination cannot be written.
    """
    data = content.encode() if isinstance(content, str) else content
    try:
        replace_file(Path(os.path.realpath(path)), data)
    except OSError as error:
        raise ExportError(
            f"cannot write {path}: {error.strerror or error}; nothing was changed there. {len(data)} bytes are "
            "needed: choose a folder that exists, that you may write to and that has the space"
        ) from error
    return Path(path)


def read_file(path: str | Path, *, largest: int = LARGEST) -> bytes:
    """The bytes of a file. Not collective.

    Raises:
        ExportError: it cannot be read, is not a regular file, or has more than ``largest`` bytes.
    """
    try:
        if Path(path).exists() and not Path(path).is_file():  # opening a pipe would wait for its writer
            raise ExportError(f"cannot read {path}: it is not a regular file")
        with open(path, "rb") as file:
            size = os.fstat(file.fileno()).st_size
            if size > largest:
                raise ExportError(f"cannot read {path}: it has {size} bytes, and {largest} are the most")
            return file.read(min(largest, size))
    except OSError as error:
        raise ExportError(f"cannot read {path}: {error.strerror or error}") from error


def read_text(path: str | Path, *, largest: int = LARGEST) -> str:
    """The text of a file; bytes that are not UTF-8 become replacement characters, as comments may hold them.

    Raises:
        ExportError: as `read_file`.
    """
    return read_file(path, largest=largest).decode("utf-8", errors="replace")


def finite(array: NDArray[np.float64], *, path: str | Path, what: str) -> NDArray[np.float64]:
    """The array, when all its numbers are finite.

    Raises:
        ExportError: they are not.
    """
    if not np.isfinite(array).all():
        raise ExportError(f"{path}: {what} holds values that are not finite")
    return array
