"""Files of arrays (.npz) that are whole at any instant, without pickles."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import ExportError, RecordError
from flexmbd.files.archive import read_archive
from flexmbd.files.whole_file import part_file


def write_arrays(path: str | Path, arrays: Mapping[str, Any]) -> Path:
    """Write arrays; a process that is killed meanwhile leaves the file that was there. Not collective.

    Args:
        path: destination; a symbolic link is followed.
        arrays: by name.

    Raises:
        RecordError: it cannot be written.
    """
    target = Path(os.path.realpath(path))
    try:
        with part_file(target) as (_, number), os.fdopen(number, "wb", closefd=False) as file:
            np.savez(file, allow_pickle=False, **arrays)
    except OSError as reason:
        raise RecordError(
            f"the checkpoint cannot be written to {path}: {reason.strerror or reason}; a file that was there is "
            "unchanged: choose a folder that exists, that you may write to and that has the space"
        ) from reason
    return Path(path)


def read_arrays(path: str | Path, *, version: int) -> dict[str, NDArray[Any]]:
    """The arrays of a file by name. Not collective.

    Raises:
        RecordError: no such file, none that `write_arrays` wrote, or its ``version`` is another.
    """
    try:
        arrays = read_archive(path, compressed=False)
        found = int(arrays["version"].item())
    except (ExportError, KeyError, ValueError, TypeError, AttributeError, OverflowError) as reason:
        raise RecordError(f"{path} is not a checkpoint that can be read: {reason}") from reason
    if found != version:
        raise RecordError(
            f"{path} was written by another version of flexmbd (format {found}, this one reads {version}): go on with "
            "that version, or start anew"
        )
    return arrays
