"""A file that grows by whole trees: each as `tree_file` writes it, with its size and SHA-256, one after the other.

Whoever is killed leaves the trees that were written and at most the beginning of one more, which readers pass over;
another process may read while the file grows.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Self

from flexmbd.errors import RecordError
from flexmbd.files.tree_file import HEAD, FileKind, Tree, check_image, image_size, tree_image, tree_of
from flexmbd.files.whole_file import is_locked_elsewhere, open_part, take_part


class TreeLog:
    """A log that is being written, by one process.

    Attributes:
        path: of the file.
    """

    def __init__(self, path: Path, kind: FileKind, file: int, *, size: int) -> None:
        """Made by `begin` and `resume`; ``size``: the bytes of whole trees in the file."""
        self.path, self._kind, self._file, self._size = path, kind, file, size

    @classmethod
    def begin(cls, path: Path, tree: Mapping[str, Any], *, kind: FileKind) -> Self:
        """Begin a log with a tree; an existing file survives until that is written.

        Args:
            path: of the file; a symbolic link is followed.
            tree: the first.
            kind: what the file is.

        Raises:
            RecordError: it cannot be written.
        """
        target = Path(os.path.realpath(path))
        image = tree_image(tree, kind=kind)
        try:
            temporary, file = open_part(target)
            try:
                _write(file, image)
                take_part(temporary, target, file=file)
            except BaseException:
                os.close(file)
                with suppress(OSError):
                    temporary.unlink(missing_ok=True)
                raise
        except OSError as error:
            raise _not_written(path, error) from error
        return cls(path, kind, file, size=len(image))

    @classmethod
    def resume(cls, path: Path, *, size: int, kind: FileKind) -> Self:
        """Go on with a log; what is beyond its first ``size`` bytes is dropped.

        Raises:
            RecordError: it cannot be written.
        """
        try:
            file = os.open(path, os.O_RDWR | getattr(os, "O_CLOEXEC", 0))
        except OSError as error:
            raise _not_written(path, error) from error
        if is_locked_elsewhere(file):
            os.close(file)
            raise RecordError(f"{path} is being written by another run; wait for its end, or choose another file")
        try:
            os.ftruncate(file, size)
            os.lseek(file, size, os.SEEK_SET)
        except OSError as error:
            raise _not_written(path, error) from error
        return cls(path, kind, file, size=size)

    def append(self, tree: Mapping[str, Any], *, lasting: bool = False) -> None:
        """Write another tree; what cannot be written whole is taken back.

        Args:
            tree: the tree.
            lasting: whether it shall have reached the disk when this returns, for it must survive a power cut.

        Raises:
            RecordError: it cannot be written.
        """
        image = tree_image(tree, kind=self._kind)
        try:
            _write(self._file, image)
            if lasting:
                os.fsync(self._file)
        except OSError as error:
            os.ftruncate(self._file, self._size)
            os.lseek(self._file, self._size, os.SEEK_SET)
            raise _not_written(self.path, error) from error
        self._size += len(image)

    def close(self) -> None:
        """Write no more."""
        os.close(self._file)


def read_log(path: Path, *, kind: FileKind) -> Iterator[tuple[Tree, int]]:
    """The trees of a log one by one, each with the bytes up to its end; a last one that is cut off is left out.

    Raises:
        RecordError: the file is missing, foreign, of another version, or a tree of it is damaged.
    """
    try:
        if path.exists() and not path.is_file():  # a pipe would be waited for
            raise RecordError(f"cannot read {path}: it is not a regular file")
        with open(path, "rb") as file:
            end = 0
            while head := file.read(HEAD):
                if end and len(head) < HEAD:
                    return
                size = image_size(path, head, kind=kind)
                if end and size > os.fstat(file.fileno()).st_size - end:
                    return
                image = head + file.read(size - HEAD)
                check_image(path, image, kind=kind)
                end += size
                yield tree_of(path, image, kind=kind), end
            if not end:
                raise RecordError(f"{path} is empty; pass a file that {kind.writer} wrote")
    except OSError as error:
        raise RecordError(f"cannot read {path}: {error.strerror or error}") from error


def _write(file: int, image: bytes) -> None:
    left = memoryview(image)
    while left:  # a disk that is nearly full takes a part
        left = left[os.write(file, left) :]


def _not_written(path: Path, error: OSError) -> RecordError:
    return RecordError(
        f"cannot write {path}: {error.strerror or error}; what it holds is whole: choose a folder that exists, that "
        "you may write to and that has the space"
    )
