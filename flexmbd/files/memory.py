"""How much memory there is left."""

from __future__ import annotations

import os
import sys
from pathlib import Path


def available_memory() -> int | None:
    """Bytes of memory left to this computer, to the container on it and to this process (ulimit -v); None: unknown."""
    found = [_free_pages(), _cgroup_rest(), _process_rest()]
    return min((one for one in found if one is not None), default=None)


def _free_pages() -> int | None:
    try:
        # what is taken by the cache of files can be had as well
        lines = Path("/proc/meminfo").read_text().splitlines()
        return next(1024 * int(line.split()[1]) for line in lines if line.startswith("MemAvailable:"))
    except (OSError, StopIteration, ValueError, IndexError):
        pass
    if sys.platform == "win32":
        return None
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


def _process_rest() -> int | None:
    try:
        import resource  # Unix alone

        most = resource.getrlimit(resource.RLIMIT_AS)[0]
        pages = int(Path("/proc/self/statm").read_text().split()[0])
    except (ImportError, OSError, ValueError, IndexError):
        return None
    return None if most == resource.RLIM_INFINITY else max(most - pages * os.sysconf("SC_PAGE_SIZE"), 0)
