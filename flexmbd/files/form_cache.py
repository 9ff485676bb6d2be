"""FFCx's cache of compiled forms, mended: remains of killed compilations are removed and compiled again.

FFCx makes a form's .c first, and says by a .c.cached that its library is whole.  Of a compilation that was killed the
.c stays alone, and whoever needs the form waits for the other file until its time is out, for ever again.  A library
that was cut short, as by a full disk, ends the process that loads it.
"""

from __future__ import annotations

import os
import struct
import time
from contextlib import suppress
from pathlib import Path

from flexmbd.files.whole_file import lock_alone

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

# Other processes that compile hold the first; the second is as old as the last look.
_LOCK, _LOOKED = ".flexmbd.lock", ".flexmbd.looked"
# Seconds that a compilation may take beside which other processes of flexmbd run.
_COMPILATION = 600.0
# Of an ELF header of 64 bits: where the table of sections is, size and number of its entries. It stands last.
_SECTIONS, _ENTRIES, _ELF = 0x28, 0x3A, b"\x7fELF\x02\x01"

_held: list[int] = []


def mend_form_cache(folder: Path) -> tuple[str, ...]:
    """Remove remains of killed compilations; returns the names of the forms concerned. Not collective.

    The cache is not touched where it cannot be written to.
    """
    if not folder.is_dir():
        with suppress(OSError):
            folder.mkdir(parents=True)
    try:
        file = os.open(folder / _LOCK, os.O_RDWR | os.O_CREAT | getattr(os, "O_CLOEXEC", 0), 0o666)
    except OSError:
        return ()
    alone = lock_alone(file)  # no other process of flexmbd compiles forms
    removed = [name for name in _broken(folder, 0.0 if alone else _COMPILATION) if _remove(folder, name)]
    with suppress(OSError):
        (folder / _LOOKED).touch()
    _stay(file)
    return tuple(removed)


def _stay(file: int) -> None:
    """Show others that this process may compile, to its end."""
    if fcntl is not None:
        with suppress(OSError):
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    _held.append(file)


def _broken(folder: Path, age: float) -> list[str]:
    """Names of forms whose compilation was not ended for so long (s), or whose library is cut short."""
    try:
        with os.scandir(folder) as entries:
            found = {entry.name: entry for entry in entries}
        looked = (folder / _LOOKED).stat().st_mtime if _LOOKED in found else 0.0
        broken = []
        for name, entry in found.items():
            form = name.partition(".")[0]
            if name.endswith(".c") and f"{name}.cached" not in found:
                parts = (found[one] for one in (name, f"{form}.o") if one in found)
                if time.time() - max(part.stat().st_mtime for part in parts) >= age:
                    broken.append(form)
            # each is looked at once after it was written
            elif name.endswith(".so") and entry.stat().st_mtime >= looked - 2.0 and f"{form}.c.cached" in found:
                if is_cut_short(Path(entry.path)):
                    broken.append(form)
        return broken
    except OSError:
        return []


def is_cut_short(library: Path) -> bool:
    """Whether a shared library (ELF, 64 bits) has fewer bytes than its header says; of other kinds, none at all."""
    try:
        with open(library, "rb") as file:
            head, size = file.read(64), os.fstat(file.fileno()).st_size
    except OSError:
        return False
    if len(head) < 64 or not head.strip(b"\0"):
        return True
    if not head.startswith(_ELF):
        return False
    (table,) = struct.unpack_from("<Q", head, _SECTIONS)
    each, count = struct.unpack_from("<HH", head, _ENTRIES)
    return bool(table + each * count > size)


def _remove(folder: Path, form: str) -> bool:
    """Remove all files of a form; the mark of a whole one first."""
    try:
        for path in sorted(folder.glob(f"{form}.*"), key=lambda one: not one.name.endswith(".cached")):
            path.unlink(missing_ok=True)
    except OSError:
        return False
    return True
