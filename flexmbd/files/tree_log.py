"""A file that grows by whole trees: each as `tree_file` writes it, with its size and SHA-256, one after the other.

Whoever is killed leaves the trees that were written and at most the beginning of one more, which readers pass over;
another process may read while the file grows.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Self, TypeVar

from flexmbd.errors import RecordError
from flexmbd.files import whole_file
from flexmbd.files.tree_file import HEAD, FileKind, Tree, check_image, image_size, tree_image, tree_of
from flexmbd.files.whole_file import AS_IT_IS, is_locked_elsewhere, open_part, take_part

T = TypeVar("T")


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
        if whole_file.WINDOWS:
            os.close(file)
            return cls.resume(path, size=len(image), kind=kind)
        return cls(path, kind, file, size=len(image))

    @classmethod
    def resume(cls, path: Path, *, size: int, kind: FileKind) -> Self:
        """Go on with a log; bytes beyond its first ``size`` are dropped.

        Raises:
            RecordError: it cannot be written.
        """
        try:
            file = os.open(path, os.O_RDWR | AS_IT_IS)
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
        """Write another tree; a part of one is taken back.

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
                size = _told(end, lambda head=head: image_size(path, head, kind=kind))  # type: ignore[misc]
                there = os.fstat(file.fileno()).st_size - end  # the head may claim any size
                image = head + file.read(max(min(size, there) - HEAD, 0))
                if end and len(image) < size and not _holds_head(image[HEAD:], kind):
                    return
                yield _checked_tree(path, image, begin=end, kind=kind), end + size
                end += size
            if not end:
                raise RecordError(f"{path} is empty; pass a file that {kind.writer} wrote")
    except OSError as error:
        raise RecordError(f"cannot read {path}: {error.strerror or error}") from error


def read_at(path: Path, begin: int, end: int, *, kind: FileKind) -> Tree:
    """The tree between two bytes of a log, as `read_log` told them.

    Raises:
        RecordError: the file cannot be read, or the tree is damaged by now.
    """
    try:
        with open(path, "rb") as file:
            file.seek(begin)
            image = file.read(end - begin)
    except OSError as error:
        raise RecordError(f"cannot read {path}: {error.strerror or error}") from error
    return _checked_tree(path, image, begin=begin, kind=kind)


def _checked_tree(path: Path, image: bytes, *, begin: int, kind: FileKind) -> Tree:
    """The tree of a block's bytes; raises RecordError, which says where it is, for what is damaged."""

    def tree() -> Tree:
        check_image(path, image, kind=kind)
        return tree_of(path, image, kind=kind)

    return _told(begin, tree)


def _told(begin: int, function: Callable[[], T]) -> T:
    """What a function gives; its error says at which byte the block begins that it is about."""
    try:
        return function()
    except RecordError as error:
        if not begin:
            raise
        raise RecordError(f"{error}; so is its block from byte {begin} on, and what is before that is whole") from error


def _holds_head(rest: bytes, kind: FileKind) -> bool:
    """Whether another tree begins in what seems to be the rest of a last one: then the size that this told is wrong."""
    return f"{kind.format}, version {kind.version}\n".encode() in rest


def _write(file: int, image: bytes) -> None:
    left = memoryview(image)
    while left:  # a disk that is nearly full takes a part
        left = left[os.write(file, left) :]


def _not_written(path: Path, error: OSError) -> RecordError:
    return RecordError(
        f"cannot write {path}: {error.strerror or error}; what it holds is whole: choose a folder that exists, that "
        "you may write to and that has the space"
    )
