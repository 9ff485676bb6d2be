"""A run's rows as they come: in memory, and beyond a share of it in files that no name leads to."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import IO

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import RecordError
from flexmbd.files.memory import available_memory
from flexmbd.integrate import state as st
from flexmbd.multibody.kernels.base.arrays import Work
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.team import Team

FloatArray = NDArray[np.float64]
#: Arrays (k, ...) of doubles with the same number of rows.
RowArrays = tuple[FloatArray, ...]

# Of the memory that is available: rows take twice as much for a moment where they are put together.
_SHARE = 0.25
_SMALL = 2**26  # bytes, below which nobody asks
_UNKNOWN = 2**31  # bytes, where nothing says how much memory there is


def is_affordable(size: int, team: Team) -> bool:
    """Whether so many bytes of rows, the same on all ranks, may stay in memory.  Collective over the team."""
    if size < _SMALL:
        return True
    available = available_memory()
    most = _UNKNOWN if available is None else _SHARE * available / team.size
    return size <= float(team.agree(np.array([most]))[0])


class RowStore:
    """Rows of several series, appended block by block.

    Attributes:
        count: how many rows there are.
        bytes: of those that are in memory.
    """

    def __init__(self) -> None:
        """Without any rows."""
        self.count = self.bytes = self._on_disk = 0
        self._blocks: list[RowArrays] = []
        self._files: list[IO[bytes]] = []
        self._shapes: list[tuple[int, ...]] = []

    def append(self, block: RowArrays) -> None:
        """Take another block of rows; an empty one is passed over."""
        if len(block[0]) or not self._blocks:
            self._blocks.append(block)
            self.bytes += sum(part.nbytes for part in block)
            self.count += len(block[0])

    @property
    def last(self) -> RowArrays:
        """The last block; whoever changes it changes what is kept."""
        return self._blocks[-1]

    def since(self, row: int) -> RowArrays:
        """The rows from ``row`` on, to be read: what stands in one block is not copied."""
        first, parts = self.count, list[RowArrays]()
        for block in reversed(self._blocks):
            if first <= row:
                break
            first -= len(block[0])
            parts.append(block)
        if first > row:
            parts.append(self._spilled())
            first = 0
        parts.reverse()
        joined = parts[0] if len(parts) == 1 else self._joined(parts)
        return tuple(part[row - first :] for part in joined)

    def keep(self, count: int) -> None:
        """Keep the first rows alone."""
        taken: list[RowArrays] = []
        while self._blocks and self.count > count:
            taken.append(self._drop_last())
        if self.count < count and taken:
            self.append(tuple(part[: count - self.count] for part in taken[-1]))
        elif self.count > count:
            self._cut_files(count)
            self.count = count

    def _drop_last(self) -> RowArrays:
        block = self._blocks.pop()
        self.bytes -= sum(part.nbytes for part in block)
        self.count -= len(block[0])
        return block

    def spill(self) -> None:
        """Move all but the last block to files.

        Raises:
            RecordError: the disk is full; the rows are where they were.
        """
        *blocks, last = self._blocks
        try:
            if not self._files:
                self._shapes = [part.shape[1:] for part in last]
                self._files = [tempfile.TemporaryFile(dir=_folder(), buffering=0) for _ in last]
            for block in blocks:
                for file, part in zip(self._files, block, strict=True):
                    _write(file, part)
        except OSError as reason:
            self._cut_files(self._on_disk)
            raise RecordError(
                f"the run's rows have no room in memory, nor on the disk in {_folder()}: {reason.strerror or reason}; "
                "let TMPDIR name a folder that has, or limit the run (max_rows=, max_steps=)"
            ) from reason
        self._on_disk += sum(len(block[0]) for block in blocks)
        self._blocks, self.bytes = [last], sum(part.nbytes for part in last)

    def series(self) -> RowArrays:
        """All rows; those from files are mapped into memory, and need none."""
        if not self._on_disk:
            return self._joined(self._blocks)
        try:
            if self._blocks:
                self._blocks.append(tuple(part[:0] for part in self._blocks[-1]))
                self.spill()
            return self._spilled()
        except RecordError:
            return self._joined([self._spilled(), *self._blocks])

    def _spilled(self) -> RowArrays:
        """The rows on the disk, mapped into memory."""
        pairs = zip(self._files, self._shapes, strict=True)
        return tuple(_mapped(file, (self._on_disk, *shape)) for file, shape in pairs)

    def _cut_files(self, rows: int) -> None:
        self._on_disk = rows
        for file, shape in zip(self._files, self._shapes, strict=False):
            file.seek(rows * _row_bytes(shape))
            file.truncate()

    def _joined(self, blocks: Sequence[RowArrays]) -> RowArrays:
        if not blocks:
            return tuple(part[:0] for part in self._blocks[-1])
        return tuple(np.concatenate(parts) for parts in zip(*blocks, strict=True))


def _write(file: IO[bytes], part: FloatArray) -> None:
    left = memoryview(np.ascontiguousarray(part)).cast("B") if part.size else memoryview(b"")
    while left:  # a disk that is nearly full takes a part
        left = left[file.write(left) :]


def _row_bytes(shape: tuple[int, ...]) -> int:
    return 8 * int(np.prod(shape))


def _mapped(file: IO[bytes], shape: tuple[int, ...]) -> FloatArray:
    """A file's doubles as an array; what is written to it stays in memory."""
    if not np.prod(shape):
        return np.zeros(shape)
    return np.memmap(file, np.float64, "c", shape=shape).view(np.ndarray)


def _folder() -> Path:
    """Where temporary files lie on a disk: often /tmp is memory."""
    named = next((os.environ[name] for name in ("TMPDIR", "TEMP", "TMP") if os.environ.get(name)), None)
    lasting = Path("/var/tmp")
    if named is None and os.access(lasting, os.W_OK):
        return lasting
    return Path(tempfile.gettempdir())


def new_record(scene: CompiledScene, work: Work, rows: int) -> st.Record:
    """A buffer with room for so many rows."""
    sizes = (scene.nx, scene.nv, scene.nv, len(scene.plan.rows))
    x, v, a, multipliers = (np.empty((rows, size)) for size in sizes)
    record = st.Record(np.empty(rows), x, v, a, multipliers, work)
    record.lay_out()
    return record
