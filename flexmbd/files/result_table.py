"""Columns of numbers over time, in files that other programs read: text with commas (.csv) and numpy's .npz."""

from __future__ import annotations

import csv
import html
import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import ExportError
from flexmbd.files.archive import read_archive, write_archive
from flexmbd.files.whole_file import finite, read_text, write_file

if TYPE_CHECKING:
    import pandas as pd

FloatArray = NDArray[np.float64]

SUFFIXES = (".csv", ".npz")

# Of names in a file from anywhere.
_LONGEST = 1000

# What is printed of a table: columns, and rows from its top and its end.
_COLUMNS, _TOP, _END = 8, 7, 3


@dataclass(frozen=True, eq=False)
class ResultTable:
    """A table of numbers.

    Attributes:
        names: of the k columns; the first is the time.
        units: of the columns, as "m/s"; "1" for plain numbers.
        values: (nt, k).
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    values: FloatArray

    def __repr__(self) -> str:
        """How many rows and columns, and the first names."""
        size = f"{len(self.values)} rows, {len(self.names)} columns"
        return f"<ResultTable of {size}: {_list_of(self.names)}>"

    def __str__(self) -> str:
        """Its first and last rows under names and units; of many columns the first few."""
        columns = []
        for words in self._shown_columns():
            width = max(map(len, words))
            columns.append([word.rjust(width) for word in words])
        lines = ["  ".join(line) for line in zip(*columns, strict=True)]
        if self._rows_left_out:
            lines.insert(2 + _TOP, f"... {self._rows_left_out} more rows ...")
        return "\n".join([*lines, *self._more_columns()])

    def _repr_html_(self) -> str:
        """The same as a table of a notebook."""
        lines = []
        for k, line in enumerate(zip(*self._shown_columns(), strict=True)):
            cell = "th" if k < 2 else "td"
            if k == 2 + _TOP and self._rows_left_out:
                lines.append(f'<tr><td colspan="{len(line)}">... {self._rows_left_out} more rows ...</td></tr>')
            lines.append("<tr>" + "".join(f"<{cell}>{html.escape(word)}</{cell}>" for word in line) + "</tr>")
        more = "".join(f"<p>{html.escape(words)}</p>" for words in self._more_columns())
        return f"<div><table>{''.join(lines)}</table>{more}</div>"

    @property
    def _rows_left_out(self) -> int:
        return max(len(self.values) - _TOP - _END, 0)

    def _shown_columns(self) -> list[list[str]]:
        """Name, unit and the first and last values of the columns that are shown."""
        rows = len(self.values)
        shown = range(rows) if not self._rows_left_out else [*range(_TOP), *range(rows - _END, rows)]
        return [
            [self.names[k], f"[{self.units[k]}]", *(f"{self.values[row, k]:.6g}" for row in shown)]
            for k in range(min(len(self.names), _COLUMNS))
        ]

    def _more_columns(self) -> list[str]:
        left = self.names[_COLUMNS:]
        return [f"and {len(left)} more columns: {_list_of(left)}"] if left else []

    def save(self, path: str | Path) -> Path:
        """As ``write_table``. Not collective: under MPI, call it on one rank.

        Raises:
            ExportError: it cannot be written, or the path is none.
        """
        return write_table(self, _path(path))

    @staticmethod
    def load(path: str | Path) -> ResultTable:
        """As ``read_table``, with the same errors."""
        return read_table(_path(path))

    def to_pandas(self) -> pd.DataFrame:
        """A frame of pandas with the headings "name [unit]", the time its index.

        Raises:
            ExportError: pandas is not installed.
        """
        try:
            import pandas as pd  # only where it is asked for
        except ImportError as reason:
            raise ExportError("a table for pandas needs pandas: pip install pandas") from reason
        frame = pd.DataFrame(self.values, columns=self.headings)
        return frame.set_index(self.headings[0])

    @property
    def headings(self) -> list[str]:
        """Of each column, as "crank.x [m]"."""
        return [f"{name} [{unit}]" for name, unit in zip(self.names, self.units, strict=True)]

    def column(self, name: str) -> FloatArray:
        """The values (nt,) of a column.

        Raises:
            ExportError: there is no such column; the message lists those there are.
        """
        if name not in self.names:
            raise ExportError(f"there is no column {name!r}, but {', '.join(self.names)}")
        return self.values[:, self.names.index(name)]


def _list_of(names: Sequence[str]) -> str:
    """The first names."""
    return ", ".join(names[:6]) + (", ..." if len(names) > 6 else "")


def _path(given: str | Path) -> Path:
    if not isinstance(given, (str, Path)):
        raise ExportError(f"the path of a table is a text or a Path, got {given!r}")
    return Path(given)


def write_table(table: ResultTable, path: Path) -> Path:
    """Write a table, whole or not at all, as the path's suffix says.

    A .csv has one line of headings, "name [unit]", then the rows with all digits; a .npz the arrays names, units (text)
    and values.

    Raises:
        ExportError: the destination cannot be written, or has another suffix.
    """
    if path.suffix == ".npz":
        arrays = {"names": np.array(table.names), "units": np.array(table.units), "values": table.values}
        return write_archive(path, arrays)
    if path.suffix != ".csv":
        raise ExportError(f"{path}: a table is written as {' or '.join(SUFFIXES)}")
    text = io.StringIO()
    lines = csv.writer(text, lineterminator="\n")
    lines.writerow(table.headings)
    lines.writerows([repr(float(value)) for value in row] for row in table.values)
    return write_file(path, text.getvalue())


class NoTableError(ExportError):
    """A file of arrays that holds something else than a table."""


def read_table(path: Path) -> ResultTable:
    """Read a table that `write_table` wrote, or a .csv of numbers with one line of headings. Not collective.

    Raises:
        ExportError: the file is missing, damaged, of another kind (`NoTableError` for arrays that are not a table), or
            holds numbers that are not finite.
    """
    suffix = path.suffix.lower()
    if suffix == ".npz":
        return _from_archive(path)
    if suffix == ".csv":
        return _from_text(path)
    raise ExportError(f"{path} is not a table of results; they end in {' or '.join(SUFFIXES)}")


def _from_archive(path: Path) -> ResultTable:
    arrays = read_archive(path, requested=("names", "units", "values"))
    missing = [name for name in ("names", "units", "values") if name not in arrays]
    if missing:
        raise NoTableError(f"{path} is not a table of results: it has no array {', '.join(missing)}")
    names, units, values = arrays["names"], arrays["units"], arrays["values"]
    texts = all(one.ndim == 1 and one.dtype.kind == "U" for one in (names, units))
    if not texts or values.ndim != 2 or values.dtype.kind != "f" or len(names) != len(units):
        raise NoTableError(f"{path} is not a table of results: names, units and values do not fit together")
    known, kinds = [str(one) for one in names], [str(one) for one in units]
    return _checked(path, known, kinds, np.asarray(values, dtype=np.float64))


def _from_text(path: Path) -> ResultTable:
    rows = csv.reader(io.StringIO(read_text(path)))
    try:
        headings = next(rows, [])
        body = [row for row in rows if row]
    except csv.Error as error:
        raise ExportError(f"{path}, line {rows.line_num}: {error}") from error
    for number, row in enumerate(body, start=2):
        if len(row) != len(headings):
            raise ExportError(f"{path}, line {number}: {len(row)} values under {len(headings)} headings")
    try:
        values = np.array([[float(word) for word in row] for row in body], dtype=np.float64)
    except ValueError as error:
        raise ExportError(f"{path}: {error}") from error
    names, units = [], []
    for heading in headings:
        name, bracket, unit = heading.rpartition(" [")
        names.append(name if bracket else heading)
        units.append(unit.removesuffix("]") if bracket else "1")
    return _checked(path, names, units, values.reshape(len(body), len(headings)))


def _checked(path: Path, names: Sequence[str], units: Sequence[str], values: FloatArray) -> ResultTable:
    """A table whose parts fit together."""
    if not names or len(names) != values.shape[1] or len(values) == 0:
        raise ExportError(f"{path} is not a table of results: {len(names)} names for values of shape {values.shape}")
    if len(set(names)) != len(names) or max(map(len, [*names, *units])) > _LONGEST or "" in names:
        raise ExportError(f"{path}: each column must have a name of its own, of at most {_LONGEST} letters")
    return ResultTable(tuple(names), tuple(units), finite(values, path=path, what="the table"))
