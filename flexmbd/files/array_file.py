"""Files of arrays (.npz) that are whole at any instant, without pickles."""

from __future__ import annotations

import os
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import RecordError


def write_arrays(path: str | Path, arrays: Mapping[str, Any]) -> Path:
    """Write under a temporary name first, so that a process killed meanwhile leaves the file that was there.

    Raises:
        RecordError: it cannot be written.
    """
    target = Path(path)
    temporary = target.with_name(f"{target.name}.{os.getpid()}.part")
    try:
        with temporary.open("wb") as file:
            np.savez(file, allow_pickle=False, **arrays)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(target)
    except OSError as reason:
        temporary.unlink(missing_ok=True)
        raise RecordError(f"the checkpoint cannot be written to {target}: {reason}") from reason
    return target


def read_arrays(path: str | Path, *, version: int) -> dict[str, NDArray[Any]]:
    """The arrays of a file by name.

    Raises:
        RecordError: no such file, none that `write_arrays` wrote, or its ``version`` is another.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file}
            found = int(arrays["version"])
    except (OSError, EOFError, KeyError, ValueError, zipfile.BadZipFile) as reason:
        raise RecordError(f"{path} is not a checkpoint that can be read: {reason}") from reason
    if found != version:
        raise RecordError(f"{path}: a checkpoint of version {found}, not {version}")
    return arrays
