"""Files of reduced bodies by the suffixes of their names: records, and the formats of flexmbd.export."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from flexmbd.errors import ExportError, FlexmbdError, SceneError
from flexmbd.export import FORMATS, Format, format_named
from flexmbd.files.tree_file import check_destination
from flexmbd.record.reduced_body import ReducedBody

#: The name of flexmbd's own file format, beside those of `FORMATS`.
RECORD = "record"

_RECORD_SUFFIXES = (".h5", ".hdf5")


def read_body(path: Path, *, kind: str | None = None) -> ReducedBody:
    """The body in a file. Not collective.

    Args:
        path: of the file.
        kind: the name of its format; None: by what its name ends in. Where several formats have that suffix they are
            tried in turn.

    Raises:
        RecordError, ExportError: there is no such file, format or reader, or the file cannot be read.
    """
    if kind == RECORD or (kind is None and path.suffix.lower() in _RECORD_SUFFIXES):
        return ReducedBody.load(path)
    if kind is not None:
        chosen = format_named(kind)
        if chosen.read is None:
            raise ExportError(
                f"{path}: no body can be read from the format {kind}, which does not hold a whole one; "
                f"readable are {', '.join(_readable())}"
            )
        return chosen.read(path)
    fitting = [one for one in FORMATS if one.read is not None and _ends(path, one)]
    if not fitting:
        raise ExportError(
            f"{path}: no format of reduced bodies that can be read ends in {path.suffix or 'nothing'}; name it by "
            f"--from: {', '.join(_readable())}"
        )
    faults = []
    for one in fitting:
        if one.read is None:
            continue
        try:
            return one.read(path)
        except FlexmbdError as error:
            faults.append((one.name, str(error)))
    if len(faults) == 1 or not path.is_file():
        raise ExportError(faults[0][1])
    raise ExportError(f"{path} cannot be read: " + "; ".join(f"as {name}: {fault}" for name, fault in faults))


def write_body(
    body: ReducedBody, path: Path, *, kind: str, lossy: bool, options: Mapping[str, Any]
) -> tuple[str, ...]:
    """Write a body, whole or not at all, with options of the format's writer. Not collective.

    Returns:
        What the file leaves out, a phrase each.

    Raises:
        RecordError, ExportError: the destination cannot be written, or the format cannot carry the body.
    """
    if kind == RECORD:
        body.save(path)
        return ()
    return format_named(kind).write(body, path, lossy=lossy, **options)


def kind_of(path: Path) -> str:
    """The name of the format to write by a file's suffix; of several the one with that very name.

    Raises:
        ExportError: no format has that suffix, or several.
    """
    if path.suffix.lower() in _RECORD_SUFFIXES:
        return RECORD
    fitting = [one for one in FORMATS if _ends(path, one)]
    longest = max((len(one.suffix) for one in fitting), default=0)
    names = [one.name for one in fitting if len(one.suffix) == longest]
    named = [name for name in names if path.suffix.lower() == f".{name}"]
    if len(names) == 1 or named:
        return (named or names)[0]
    every = ", ".join([RECORD, *(one.name for one in FORMATS)])
    if not names:
        raise ExportError(f"{path}: no format ends in {path.suffix or 'nothing'}; name it by --to: {every}")
    raise ExportError(f"{path}: {' and '.join(names)} end in {path.suffix}; choose by --to")


def check_free(path: Path, *, force: bool, source: Path | None = None) -> None:
    """Refuse a destination that cannot be written, or that exists, before anything is computed. Not collective.

    Args:
        path: the destination.
        force: an existing file may be replaced.
        source: a file that must not be replaced by what is made of it.

    Raises:
        RecordError: it cannot be written.
        ExportError: it exists.
    """
    check_destination(path)
    if path.exists():
        if source is not None and source.exists() and path.samefile(source):
            raise ExportError(f"{path} is the file to read; give another name by -o")
        if not force:
            raise ExportError(f"{path} exists; give --force to replace it, or another name")


def make_folder(folder: Path) -> None:
    """Make a folder of results, if it is not there.

    Raises:
        SceneError: it cannot be made.
    """
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise SceneError(f"cannot make the folder {folder}: {error.strerror or error}; give another by -o") from error


def _ends(path: Path, one: Format) -> bool:
    return path.name.lower().endswith(one.suffix.lower())


def _readable() -> list[str]:
    return [RECORD, *(one.name for one in FORMATS if one.read is not None)]
