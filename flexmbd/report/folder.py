"""The folder of a report: written whole or not at all, with a digest of what was looked at and of what was found.

One process writes it; ranks of MPI are the caller's affair.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import secrets
import shutil
from collections.abc import Mapping
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from platform import python_version

from flexmbd.errors import ExportError
from flexmbd.report.contents import Report, ReportPicture
from flexmbd.report.page import page
from flexmbd.visual.library import load, require
from flexmbd.visual.panels import empty_figure

#: The page in a report's folder.
PAGE = "index.html"

_LIBRARIES = (
    "flexmbd", "numpy", "scipy", "numba", "llvmlite", "h5py", "matplotlib", "fenics-dolfinx", "fenics-ufl",
    "fenics-basix", "fenics-ffcx", "petsc4py", "slepc4py", "mpi4py", "gmsh",
)  # fmt: skip


def refuse_folder(folder: Path) -> None:
    """Refuse a folder that a report cannot be written into, before anything is computed.

    Raises:
        ExportError: it is a file, or not empty; or the folder that it is in is not there, or not to be written to.
        PictureError: matplotlib is not installed.
    """
    require("matplotlib")
    if folder.suffix in (".html", ".htm", ".pdf"):
        raise ExportError(
            f"{folder}: a report is a folder, in which {PAGE} and its tables and figures are; give "
            f"{folder.with_suffix('')}"
        )
    os.rmdir(_new_folder(folder))


def write_report(report: Report, folder: Path) -> Path:
    """Write a report's page, and its tables and pictures as files; return the page.

    Two reports of the same contents are the same to the byte.

    Args:
        report: what is told.
        folder: that is not there, or empty: index.html, digest.json, tables/NAME.csv and .tex, figures/NAME.svg and
            .pdf.

    Raises:
        ExportError: as ``refuse_folder``; or it cannot be written, and then nothing is left of it.
        PictureError: matplotlib is not installed.
    """
    part = _new_folder(folder)
    try:
        _fill(report, part)
        _take_place(part, folder)
    except OSError as error:
        why = error.strerror or error
        raise ExportError(f"cannot write the report {folder}: {why}; nothing was changed there") from error
    finally:
        with suppress(OSError):
            shutil.rmtree(part)
    return folder / PAGE


def file_digest(path: Path) -> str:
    """sha256 of a file.

    Raises:
        ExportError: it cannot be read.
    """
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise ExportError(f"cannot read {path}: {error.strerror or error}") from error


def _new_folder(folder: Path) -> Path:
    """A new folder where a report's is to be, or in it where it is there."""
    target = Path(os.path.realpath(folder))
    try:
        if folder.exists() and not folder.is_dir():
            raise ExportError(f"{folder} is a file; give a folder for the report that is not there, or empty")
        if folder.is_dir() and any(folder.iterdir()):
            raise ExportError(f"{folder} is not empty; give a folder for the report that is not there, or empty")
        part = (target if target.is_dir() else target.parent) / f".report.{secrets.token_hex(8)}.part"
        part.mkdir()
    except OSError as error:
        raise ExportError(
            f"cannot write the report {folder}: {error.strerror or error}; give a folder in one that is there and that "
            "you may write to"
        ) from error
    return part


def _take_place(part: Path, folder: Path) -> None:
    """Let a complete part be the report's folder; of one that is there, which someone may stand in, its contents."""
    if part.parent != Path(os.path.realpath(folder)):
        os.replace(part, folder)
        return
    for one in sorted(part.iterdir(), key=lambda path: path.name == PAGE):  # the page last
        os.replace(one, folder / one.name)


def _fill(report: Report, part: Path) -> None:
    texts = {f"tables/{one.name}.csv": one.csv() for one in report.tables}
    results = hashlib.sha256("".join(f"{name}\n{text}" for name, text in sorted(texts.items())).encode()).hexdigest()
    texts.update({f"tables/{one.name}.tex": one.latex() for one in report.tables})
    drawn = {one.name: _drawn(one) for one in report.pictures}
    digest: dict[str, Mapping[str, str]] = {
        "versions": versions(),
        "sha256 of what was looked at": dict(report.sources),
        "sha256 of what was found": {"tables/*.csv": results},
    }
    vectors = {name: kinds["svg"] for name, kinds in drawn.items()}
    texts[PAGE] = page(report, pictures=vectors, digest=digest)
    texts["digest.json"] = json.dumps(digest, indent=2, ensure_ascii=False) + "\n"
    for name, text in texts.items():
        _write(part / name, text.encode())
    for name, kinds in drawn.items():
        for kind, data in kinds.items():
            _write(part / "figures" / f"{name}.{kind}", data)


def _write(path: Path, data: bytes) -> None:
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(data)


def _drawn(picture: ReportPicture) -> dict[str, bytes]:
    """The picture by kinds of files; without dates, and with the same names inside each time."""
    matplotlib = load("matplotlib")
    figure = empty_figure(picture.size, shown=False)
    kinds: dict[str, bytes] = {}
    with matplotlib.rc_context({"svg.hashsalt": picture.name}):
        picture.draw(figure)
        for kind, date in (("svg", "Date"), ("pdf", "CreationDate")):
            file = io.BytesIO()
            figure.savefig(file, format=kind, metadata={date: None})
            kinds[kind] = file.getvalue()
    return kinds


def versions() -> dict[str, str]:
    """Of Python and of the libraries that are installed."""
    found = {"Python": python_version()}
    for name in _LIBRARIES:
        with suppress(PackageNotFoundError):
            found[name] = version(name)
    return found
