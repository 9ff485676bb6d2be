"""How much memory there is left."""

from __future__ import annotations

import os
from pathlib import Path


def available_memory() -> int | None:
    """Bytes of memory that this computer, or the container on it, has left; None where it does not say."""
    found = [_free_pages(), _cgroup_rest()]
    return min((one for one in found if one is not None), default=None)


def _free_pages() -> int | None:
    try:
        # what is taken by the cache of files can be had as well
        lines = Path("/proc/meminfo").read_text().splitlines()
        return next(1024 * int(line.split()[1]) for line in lines if line.startswith("MemAvailable:"))
    except (OSError, StopIteration, ValueError, IndexError):
        pass
    try:
        return os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (ValueError, OSError):
        return None


def _cgroup_rest() -> int | None:
    folder = Path("/sys/fs/cgroup")
    try:
        most, now = (int((folder / name).read_text()) for name in ("memory.max", "memory.current"))
    except (OSError, ValueError):
        return None
    return max(most - now, 0)
