"""The HDF5 file of an ensemble, which a killed process leaves so that another one can go on with it.

All datasets have their final size from the beginning, and are laid out without chunks, so that rows that come in change
no structure of the file: whenever the process dies, what it wrote can be read.  A row counts once its state says so,
which is written after it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import RecordError

if TYPE_CHECKING:  # h5py loads where a file is asked for
    import h5py

FloatArray = NDArray[np.float64]

#: States of a variant: not run yet, done, failed.
WAITING, DONE, FAILED = range(3)

_VERSION = 1
_TEXT = 400  # bytes of a failure's message


class ResultsFile:
    """An open file of results; in memory where it has no path."""

    def __init__(self, file: h5py.File) -> None:
        self.file = file
        self.state: NDArray[np.int8] = file["state"][()]
        self.names: tuple[str, ...] = tuple(file["outputs"])

    def write(self, outputs: Mapping[int, Mapping[str, FloatArray]], failures: Mapping[int, str]) -> None:
        """Write the outputs of some variants, and why others failed, by their numbers."""
        for k, values in outputs.items():
            for name, value in values.items():
                self.file["outputs"][name][k] = value
        for k, message in failures.items():
            self.file["message"][k] = message.encode()[:_TEXT]
        self.file.flush()  # before their states say that they count
        for k in (*outputs, *failures):
            self.file["state"][k] = self.state[k] = FAILED if k in failures else DONE
        self.file.flush()

    def message(self, k: int) -> str:
        """Why variant k failed."""
        return bytes(self.file["message"][k]).decode(errors="replace")

    def shape(self, name: str) -> tuple[int, ...]:
        """Of one variant's output."""
        shape: tuple[int, ...] = self.file["outputs"][name].shape[1:]
        return shape


def new_file(
    path: Path | None, count: int, shapes: Mapping[str, tuple[int, ...]], samples: Mapping[str, FloatArray], digest: str
) -> ResultsFile:
    """Make a file of results, whole under its name at any instant.

    Raises:
        RecordError: it cannot be written.
    """
    import h5py

    if path is None:
        file = h5py.File("ensemble", "w", driver="core", backing_store=False)
        _lay_out(file, count, shapes, samples, digest)
        return ResultsFile(file)
    part = path.with_name(f"{path.name}.part")
    try:
        with h5py.File(part, "w") as file:
            _lay_out(file, count, shapes, samples, digest)
        part.replace(path)
        return ResultsFile(h5py.File(path, "r+"))
    except OSError as reason:
        raise RecordError(f"the ensemble cannot be written to {path}: {reason}") from reason


def opened_file(path: Path, digest: str) -> ResultsFile:
    """Open a file of results that an ensemble with this digest left.

    Raises:
        RecordError: it is no such file, another process writes to it, or it is of another ensemble.
    """
    import h5py

    try:
        file = h5py.File(path, "r+")
    except OSError as reason:
        raise RecordError(f"{path} cannot be gone on with: {reason}") from reason
    if file.attrs.get("format") != "flexmbd ensemble" or file.attrs.get("version") != _VERSION:
        file.close()
        raise RecordError(f"{path} is no file of an ensemble; choose another name")
    if file.attrs["digest"] != digest:
        file.close()
        raise RecordError(
            f"{path} is of another ensemble, of other samples, outputs, machine or options; choose another name, or "
            "remove it"
        )
    return ResultsFile(file)


def _lay_out(
    file: h5py.File,
    count: int,
    shapes: Mapping[str, tuple[int, ...]],
    samples: Mapping[str, FloatArray],
    digest: str,
) -> None:
    file.attrs.update({"format": "flexmbd ensemble", "version": _VERSION, "digest": digest})
    for name, values in samples.items():
        file.create_dataset(f"samples/{name}", data=values, track_times=False)
    file.create_group("outputs")
    for name, shape in shapes.items():
        _allocate(file["outputs"], name, (count, *shape), np.dtype(np.float64), np.nan)
    _allocate(file, "state", (count,), np.dtype(np.int8), WAITING)
    _allocate(file, "message", (count,), np.dtype(f"S{_TEXT}"), b"")


def _allocate(group: Any, name: str, shape: Sequence[int], dtype: np.dtype[Any], fill: Any) -> None:
    """A dataset whose place in the file is taken now."""
    import h5py

    plan = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    plan.set_alloc_time(h5py.h5d.ALLOC_TIME_EARLY)
    plan.set_fill_value(np.array(fill, dtype))
    plan.set_obj_track_times(False)
    space = h5py.h5s.create_simple(tuple(shape))
    h5py.h5d.create(group.id, name.encode(), h5py.h5t.py_create(dtype, logical=True), space, plan)
