"""Files that are written whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Callable, Collection
from pathlib import Path
from typing import TYPE_CHECKING

from flexmbd.errors import PictureError
from flexmbd.multibody.team import Team

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def checked_path(path: str | Path, suffixes: Collection[str]) -> Path:
    """Return ``path`` as a Path.

    Raises:
        PictureError: its suffix is none of ``suffixes``, or its folder is not there or not to be written to.
    """
    if not isinstance(path, (str, Path)):
        raise PictureError(f"the path of a picture is a text or a Path, got {path!r:.100}")
    target = Path(path)
    if target.suffix.lower() not in suffixes:
        raise PictureError(
            f"{target}: the suffix {target.suffix!r} is not known; use {' or '.join(sorted(suffixes))}"
        )
    folder = target.parent
    if not (folder.is_dir() and os.access(folder, os.W_OK)):
        raise PictureError(f"cannot write {target}: {folder} is no folder that may be written to")
    return target


def save(figure: Figure, target: Path, team: Team) -> None:
    """Let the team's root write a figure of matplotlib; the other ranks go on. Not collective.

    Raises:
        PictureError: on the root: the file cannot be written.
    """
    if team.is_root:
        write(target, lambda temporary: figure.savefig(temporary, dpi=150))


def write(target: Path, fill: Callable[[Path], None]) -> Path:
    """Let ``fill`` write a temporary file beside ``target``, then rename it; return ``target``.

    An existing file survives a failure.

    Raises:
        PictureError: the folder or the file cannot be written.
    """
    temporary = target.with_name(f".{target.stem}.{os.getpid()}{target.suffix}")
    try:
        temporary.touch()  # tells at once, before minutes of drawing
        fill(temporary)
        os.replace(temporary, target)
    except OSError as reason:
        why = reason.strerror or str(reason).partition("\n")[0]  # ffmpeg's report has many lines
        raise PictureError(f"cannot write {target}: {why}") from reason
    finally:
        temporary.unlink(missing_ok=True)
    return target
