"""Files from anywhere: written whole or not at all, read within bounds.

A reader here takes a file from anywhere: sizes are checked before anything is allocated, numbers before
they are used, and whatever is wrong ends in one `ExportError` that names the file.
"""

from __future__ import annotations

import errno
import os
import secrets
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import ExportError

#: No file of a reduced body is larger (bytes); what claims more is refused before it is read.
LARGEST = 2**31


def replace_file(path: Path, *parts: bytes) -> None:
    """Put the parts into a new file and rename it to `path`.

    Raises:
        OSError: it cannot be written; what was there is there still.
    """
    if path.exists() and not path.is_file():
        # the rename would put a file in the place of a device
        raise OSError(errno.EINVAL, "it is not a regular file")
    # another name for each writer, so that two at once do not meet
    temporary = path.with_name(f".{secrets.token_hex(8)}.part")
    try:
        with open(temporary, "xb") as file:
            for part in parts:
                file.write(part)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
    except OSError:
        temporary.unlink(missing_ok=True)
        raise
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        # the rename itself must survive a power cut; some network file systems cannot promise it
        os.fsync(folder)
    except OSError:
        pass
    finally:
        os.close(folder)


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
            return file.read(largest)
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
