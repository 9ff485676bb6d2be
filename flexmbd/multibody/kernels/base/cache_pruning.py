"""The cache of kernels is kept small: what was not used for long, or is too much, is removed.

Processes that run meanwhile lose nothing: they have read what they use, and what is not there is compiled anew.
"""

from __future__ import annotations

import os
import time
from contextlib import suppress
from pathlib import Path

# Seconds after which an entry that nobody used is removed, between two looks at the whole, and between two notes of an
# entry's use; bytes of all entries, above which those that were not used for longest go.
_UNUSED, _LOOK, _NOTE = 30 * 86400.0, 86400.0, 86400.0
_MOST = 5 * 2**30
_LOOKED = ".looked"


def note_use(path: str) -> None:
    """Let an entry be as young as today."""
    with suppress(OSError):
        if time.time() - os.stat(path).st_mtime > _NOTE:
            os.utime(path)


def prune(folder: Path) -> int:
    """Remove old entries of a folder and of those in it, at most once a day; how many."""
    mark = folder / _LOOKED
    now = time.time()
    with suppress(OSError):
        if now - mark.stat().st_mtime < _LOOK:
            return 0
    entries: list[tuple[float, int, str]] = []
    try:
        mark.touch()  # others look no more today
        for where, _, names in os.walk(folder):
            for name in names:
                with suppress(OSError):  # another process removed it
                    found = os.stat(path := os.path.join(where, name))
                    entries.append((found.st_mtime, found.st_size, path))
    except OSError:
        return 0
    entries.sort(reverse=True)
    removed, size = 0, 0
    for used, bytes_, path in entries:
        size += bytes_
        if (size > _MOST or now - used > _UNUSED) and path != str(mark):
            with suppress(OSError):
                os.unlink(path)
                removed += 1
    return removed
