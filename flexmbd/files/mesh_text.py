"""Text files of other programs, whatever system wrote them: lines with their ends, marks and encodings removed.

Not only UTF-8 with line feeds: a byte order mark, carriage returns and Latin-1 are met as often.
"""

from __future__ import annotations

import codecs
from pathlib import Path

from flexmbd.errors import ExportError
from flexmbd.files.memory import available_memory
from flexmbd.files.whole_file import read_file

#: What one byte of a text takes until its numbers are arrays: lines, fields and their lists.
_MEMORY_PER_BYTE = 12


def read_lines(path: Path) -> list[str]:
    """The lines of a text file, without their ends; not collective.

    Bytes that are not UTF-8 are Latin-1. A form feed or another control character ends no line.

    Raises:
        ExportError: it cannot be read, is not a regular file, or is larger than memory can take.
    """
    free = available_memory()
    if free is not None and path.is_file() and path.stat().st_size * _MEMORY_PER_BYTE > free:
        raise ExportError(
            f"cannot read {path}: its {path.stat().st_size / 1e9:.3g} GB of text take more than the memory that is "
            f"free ({free / 1e9:.3g} GB)"
        )
    data = read_file(path)
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        text = data.decode("utf-16", errors="replace")
    else:
        try:
            text = data.decode("utf-8-sig")
        except UnicodeDecodeError:
            text = data.decode("latin-1")
    if "\r" in text:
        text = text.replace("\r\n", "\n").replace("\r", "\n")
    return text.split("\n")
