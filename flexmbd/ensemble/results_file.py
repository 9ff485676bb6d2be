"""The HDF5 file of an ensemble, which a killed process leaves so that another one can go on with it.

All datasets have their final size from the beginning, and are laid out without chunks, so that rows that come in change
no structure of the file: whenever the process dies, what it wrote can be read.  A row counts once its state says so,
which is written after it and its checksum.  All else has a checksum of its own (`files.row_file`).
"""

from __future__ import annotations

import contextlib
import itertools
import os
import shutil
import time
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from math import prod
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import DamageWarning, RecordError, warn
from flexmbd.files.row_file import Places, check_rows, head_size, places_of, seal_rows
from flexmbd.files.sound_hdf5 import open_hdf5
from flexmbd.files.tree_file import FileKind
from flexmbd.files.whole_file import first_line, part_file, refuse_no_room

if TYPE_CHECKING:  # h5py loads where a file is asked for
    import h5py

FloatArray = NDArray[np.float64]

#: States of a variant: not run yet, done, failed.
WAITING, DONE, FAILED = range(3)

ENSEMBLE = FileKind("flexmbd ensemble", 2, "ensemble(..., file=)")
_unnamed = itertools.count()
_TEXT = 400  # bytes of a failure's message
_HEADERS = 1 << 16  # bytes of all else in the file
_EVERY = 0.2  # s after which what came is written: what a killed process loses
_CHECKED_AT_ONCE = 1 << 24  # bytes


class ResultsFile:
    """An open file of results; in memory where it has no path.

    Outcomes are kept until a fraction of a second is over, and then written together: to write a row costs as much as
    to run a short variant.

    Attributes:
        file: the open file.
        state: (n,) of each variant.
        names: of the outputs.
        shapes: of one variant's outputs, by their names.
    """

    def __init__(self, file: h5py.File) -> None:
        self.file = file
        self.state: NDArray[np.int8] = file["state"][()]
        self.names: tuple[str, ...] = tuple(file["outputs"])
        self.shapes: dict[str, tuple[int, ...]] = {name: file["outputs"][name].shape[1:] for name in self.names}
        self._outputs: dict[int, Mapping[str, FloatArray]] = {}
        self._messages: dict[int, str] = {}
        self._written = time.monotonic()

    def keep(self, k: int, outputs: Mapping[str, FloatArray]) -> None:
        """Take the outputs of variant k; raises as ``write``."""
        self._outputs[k] = outputs
        self._write_in_time()

    def fail(self, k: int, message: str) -> None:
        """Take why variant k failed; raises as ``write``."""
        self._messages[k] = message
        self._write_in_time()

    def _write_in_time(self) -> None:
        if time.monotonic() > self._written + _EVERY:
            self.write()

    def write(self) -> None:
        """Write the rows taken.

        Raises:
            RecordError: the file cannot be written, as on a full disk.
        """
        outputs, messages = self._outputs, self._messages
        self._outputs, self._messages = {}, {}
        rows = sorted((*outputs, *messages))
        if not rows:
            return
        try:
            for stretch in _stretches(sorted(outputs)):
                for name in self.names:
                    found = np.array([outputs[k][name] for k in stretch])
                    self.file["outputs"][name][stretch.start : stretch.stop] = found
            for k, message in messages.items():
                self.file["message"][k] = message.encode()[:_TEXT]
            for stretch in _stretches(rows):
                self.state[stretch.start : stretch.stop] = [FAILED if k in messages else DONE for k in stretch]
                self.file["check"][stretch.start : stretch.stop] = self._checksums(stretch)
            self.file.flush()  # before their states say that they count
            for stretch in _stretches(rows):
                self.file["state"][stretch.start : stretch.stop] = self.state[stretch.start : stretch.stop]
            self.file.flush()
        except (OSError, RuntimeError) as reason:
            raise RecordError(f"the ensemble cannot be written to {self.file.filename}: {reason}") from reason
        self._written = time.monotonic()

    def drop_damaged(self) -> None:
        """Mark rows whose checksum is wrong as not run, and warn of them."""
        damaged: list[int] = []
        size = sum(8 * prod(shape) for shape in self.shapes.values()) + _TEXT
        at_once = max(1, _CHECKED_AT_ONCE // size)
        for first in range(0, len(self.state), at_once):
            stretch = range(first, min(first + at_once, len(self.state)))
            found, kept = self._checksums(stretch), self.file["check"][stretch.start : stretch.stop]
            wrong = (self.state[stretch.start : stretch.stop] != WAITING) & (found != kept)
            damaged += [first + int(k) for k in np.flatnonzero(wrong)]
        if not damaged:
            return
        self.state[damaged] = WAITING
        for k in damaged:
            self.file["state"][k], self.file["message"][k] = WAITING, b""
            for name in self.names:
                self.file["outputs"][name][k] = np.nan
        self.file.flush()
        some = ", ".join(map(str, damaged[:8])) + (", ..." if len(damaged) > 8 else "")
        warn(
            f"{self.file.filename}: of the variants {some} ({len(damaged)} of {len(self.state)}) other numbers are in "
            "the file than were written: they are run again. Is the disk sound?",
            DamageWarning,
        )

    def _checksums(self, stretch: range) -> NDArray[np.uint32]:
        """Of what rows hold, their numbers and states included."""
        rows = slice(stretch.start, stretch.stop)
        parts = [self.file["outputs"][name][rows] for name in self.names] + [self.file["message"][rows]]
        found = np.zeros(len(stretch), np.uint32)
        for i, k in enumerate(stretch):
            check = zlib.crc32(f"{k} {self.state[k]}".encode())
            for part in parts:
                check = zlib.crc32(part[i].tobytes(), check)
            found[i] = check
        return found

    def message(self, k: int) -> str:
        """Why variant k failed."""
        return bytes(self.file["message"][k]).decode(errors="replace")

    def close(self) -> None:
        """Let go of the file, which is to be whole already."""
        with contextlib.suppress(OSError, RuntimeError):
            self.file.close()


def _stretches(rows: Sequence[int]) -> Iterator[range]:
    """Rising numbers as ranges without gaps."""
    first = 0
    for k in range(1, len(rows) + 1):
        if k == len(rows) or rows[k] != rows[k - 1] + 1:
            yield range(rows[first], rows[k - 1] + 1)
            first = k


def new_file(
    path: Path | None, count: int, shapes: Mapping[str, tuple[int, ...]], samples: Mapping[str, FloatArray], digest: str
) -> ResultsFile:
    """Make a file of results, whole under its name at any instant.

    Raises:
        RecordError: it cannot be written.
    """
    import h5py

    if path is None:
        # no two open files of a process can have one name
        file = h5py.File(f"ensemble {next(_unnamed)}", "w", driver="core", backing_store=False)
        _lay_out(file, count, shapes, samples, digest)
        return ResultsFile(file)
    head = head_size(len(shapes) + len(_OF_EACH))
    numbers = sum(count * prod(shape) for shape in shapes.values()) + sum(values.size for values in samples.values())
    try:
        with part_file(Path(os.path.realpath(path))) as (part, room):
            refuse_no_room(room, 8 * numbers + (5 + _TEXT) * count + _HEADERS + head)
            with h5py.File(part, "w", locking=False, userblock_size=head) as file:
                _lay_out(file, count, shapes, samples, digest)
                places = _places(file)
            seal_rows(room, ENSEMBLE, head=head, places=places)
        return ResultsFile(_reopened(path))
    except OSError as reason:
        raise RecordError(f"the ensemble cannot be written to {path}: {first_line(reason)}") from reason


def opened_file(path: Path, count: int, digest: str) -> ResultsFile:
    """Open a file of results that an ensemble of so many variants left; damaged rows are to be run again.

    Raises:
        RecordError: it is no such file, another process writes to it, it is of another ensemble, or damaged beside its
            rows.
    """
    try:
        check_rows(path, kind=ENSEMBLE)
        file = _reopened(path)
    except (RecordError, OSError) as reason:
        raise RecordError(f"{path} cannot be continued: {first_line(reason)}") from reason
    if file.attrs.get("digest") != digest:
        file.close()
        raise RecordError(
            f"{path} is of another ensemble, of other samples, outputs, machine or options, or of another flexmbd; "
            "choose another name, or remove it"
        )
    if not _is_laid_out(file, count):
        file.close()
        raise RecordError(f"{path} is not a valid {ENSEMBLE.format}; remove it")
    found = ResultsFile(file)
    found.drop_damaged()
    return found


def _is_laid_out(file: h5py.File, count: int) -> bool:
    """Whether all that `_lay_out` makes of so many variants is there."""
    try:
        outputs = list(file["outputs"].values())
        sound = all(one.dtype == np.float64 and one.shape[:1] == (count,) for one in outputs)
        kinds = {name: ((count,), kind) for name, kind in _OF_EACH.items()}
        return sound and all((file[name].shape, file[name].dtype) == kind for name, kind in kinds.items())
    except (KeyError, AttributeError, TypeError):  # an item is missing, or is a group
        return False


def add_to_file(path: Path, write: Callable[[h5py.File], None]) -> None:
    """Let ``write`` add to a file of results that nobody runs variants into; whole under its name at any instant.

    Raises:
        RecordError: it cannot be written.
    """
    path = Path(os.path.realpath(path))
    try:
        with part_file(path) as (part, room):
            refuse_no_room(room, path.stat().st_size + _HEADERS)
            shutil.copyfile(path, part)
            with _reopened(part, locking=False) as file:
                write(file)
                head, places = file.userblock_size, _places(file)
            seal_rows(room, ENSEMBLE, head=head, places=places)
    except OSError as reason:
        raise RecordError(f"the ensemble cannot be written to {path}: {first_line(reason)}") from reason


def results(path: Path) -> h5py.File:
    """A file of results open for reading.

    Raises:
        RecordError: it cannot be read, or is no such file.
    """
    try:
        return open_hdf5(path, size=path.stat().st_size)
    except (RecordError, OSError) as reason:
        raise RecordError(f"{path} cannot be read: {first_line(reason)}") from reason


def _reopened(path: Path, *, locking: bool | None = None) -> h5py.File:
    return open_hdf5(path, "r+", size=path.stat().st_size, locking=locking)


def _places(file: h5py.File) -> Places:
    return places_of([*file["outputs"].values(), *(file[name] for name in _OF_EACH)])


def _lay_out(
    file: h5py.File,
    count: int,
    shapes: Mapping[str, tuple[int, ...]],
    samples: Mapping[str, FloatArray],
    digest: str,
) -> None:
    file.attrs.update({"format": ENSEMBLE.format, "version": ENSEMBLE.version, "digest": digest})
    for name, values in samples.items():
        file.create_dataset(f"samples/{name}", data=values, track_times=False)
    file.create_group("outputs")
    for name, shape in shapes.items():
        _allocate(file["outputs"], name, (count, *shape), np.dtype(np.float64), np.nan)
    for name, kind in _OF_EACH.items():
        _allocate(file, name, (count,), kind, b"" if kind.kind == "S" else 0)
    file["message"][...] = b""  # what HDF5 fills texts with is what was in memory


# Of each variant, beside the outputs; a state of 0 is WAITING.
_OF_EACH = {"state": np.dtype(np.int8), "message": np.dtype(f"S{_TEXT}"), "check": np.dtype(np.uint32)}


def _allocate(group: Any, name: str, shape: Sequence[int], dtype: np.dtype[Any], fill: Any) -> None:
    """A dataset whose place in the file is taken now."""
    import h5py

    plan = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    plan.set_alloc_time(h5py.h5d.ALLOC_TIME_EARLY)
    plan.set_fill_value(np.array(fill, dtype))
    plan.set_obj_track_times(False)
    space = h5py.h5s.create_simple(tuple(shape))
    h5py.h5d.create(group.id, name.encode(), h5py.h5t.py_create(dtype, logical=True), space, plan)
