"""What a report is made of: text, tables and pictures, in sections."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: A number (NaN: there is none) or a text.
Cell: TypeAlias = float | int | str

# In text of LaTeX these mean something else.
_LATEX = {
    "\\": r"\textbackslash{}", "&": r"\&", "%": r"\%", "$": r"\$", "#": r"\#", "_": r"\_", "{": r"\{", "}": r"\}",
    "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "<": r"\textless{}", ">": r"\textgreater{}",
}  # fmt: skip
_NAME = re.compile(r"[a-z0-9_]+")
_DIGITS = 4  # of numbers on the page and in a paper; files of numbers have them all
_PLAIN = 1e6  # numbers below have no exponent
_PAGE = 40  # rows of a table that fit on a page of paper
_WIDE = 40  # letters of a cell that is broken into lines


@dataclass(frozen=True)
class ReportTable:
    """Rows under headings: on the page, as .csv with all digits and as .tex for a paper.

    Attributes:
        name: of its files, of small letters, digits and underscores.
        caption: a sentence without its full stop.
        headings: of the columns, units in brackets: "error [m]".
        rows: as many cells each.

    Raises:
        ValueError: the name is none for a file, or a row has another number of cells.
    """

    name: str
    caption: str
    headings: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]

    def __post_init__(self) -> None:
        _refuse_name(self.name)
        if any(len(row) != len(self.headings) for row in self.rows):
            raise ValueError(f"table {self.name}: a row has another number of cells than there are headings")

    def csv(self) -> str:
        """The table as text with commas; numbers with all their digits, empty where there is none."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(self.headings)
        writer.writerows([_exact(cell) for cell in row] for row in self.rows)
        return text.getvalue()

    def latex(self) -> str:
        """The table for a paper, by the rules of the package booktabs."""
        columns = "".join(map(self._latex_column, range(len(self.headings))))
        head = " & ".join(map(latex_text, self.headings)) + r" \\"
        body = [" & ".join(_latex_cell(cell) for cell in row) + r" \\" for row in self.rows]
        named = rf"\caption{{{latex_text(self.caption)}.}}", rf"\label{{tab:{self.name}}}"
        if len(self.rows) > _PAGE:
            lines = [
                r"% \usepackage{booktabs, longtable}", rf"\begin{{longtable}}{{{columns}}}", "".join(named) + r" \\",
                r"\toprule", head, r"\midrule", r"\endfirsthead", r"\toprule", head, r"\midrule", r"\endhead",
                *body, r"\bottomrule", r"\end{longtable}", "",
            ]  # fmt: skip
        else:
            lines = [
                r"% \usepackage{booktabs}", r"\begin{table}", r"\centering", *named, rf"\begin{{tabular}}{{{columns}}}",
                r"\toprule", head, r"\midrule", *body, r"\bottomrule", r"\end{tabular}", r"\end{table}", "",
            ]  # fmt: skip
        return "\n".join(lines)

    def _latex_column(self, k: int) -> str:
        """How a column is set: numbers to the right, text to the left, long text in lines."""
        words = [row[k] for row in self.rows if isinstance(row[k], str)]
        if max((len(str(one)) for one in words), default=0) > _WIDE:
            return r"p{0.5\linewidth}"
        return "l" if words else "r"


@dataclass(frozen=True)
class ReportPicture:
    """A diagram: on the page, as .svg and as .pdf for a paper.

    Attributes:
        name: of its files, of small letters, digits and underscores.
        caption: a sentence without its full stop.
        draw: fills an empty figure of matplotlib.
        size: inches.
    """

    name: str
    caption: str
    draw: Callable[[Figure], None]
    size: tuple[float, float] = (8.0, 4.5)

    def __post_init__(self) -> None:
        _refuse_name(self.name)


@dataclass(frozen=True)
class Paragraph:
    """Sentences."""

    text: str


@dataclass(frozen=True)
class Listing:
    """Lines as a terminal shows them."""

    text: str


Content: TypeAlias = ReportTable | ReportPicture | Paragraph | Listing


@dataclass(frozen=True)
class ReportSection:
    """A heading and what stands under it."""

    title: str
    contents: Sequence[Content]


@dataclass(frozen=True)
class Report:
    """A page and its files.

    Attributes:
        title: of the page.
        verdict: in a word or two, as "PASS"; empty where nothing is judged.
        summary: what a reader is to know first.
        sections: in their order.
        sources: sha256 of what was looked at, by its name, as a form file.
    """

    title: str
    verdict: str
    summary: str
    sections: Sequence[ReportSection]
    sources: Mapping[str, str]

    @property
    def tables(self) -> list[ReportTable]:
        """All of them, in the order of the page."""
        return [one for section in self.sections for one in section.contents if isinstance(one, ReportTable)]

    @property
    def pictures(self) -> list[ReportPicture]:
        """All of them, in the order of the page."""
        return [one for section in self.sections for one in section.contents if isinstance(one, ReportPicture)]


def number_text(value: float) -> str:
    """A number with some digits, for people; a dash where there is none.  Up to a million it has no exponent."""
    if math.isnan(value):
        return "-"
    text = f"{value:.{_DIGITS}g}"
    return f"{float(text):.0f}" if "e+" in text and abs(value) < _PLAIN else text


def latex_text(text: str) -> str:
    """Text with the letters that LaTeX takes for commands written out."""
    return "".join(_LATEX.get(letter, letter) for letter in text)


def _latex_cell(cell: Cell) -> str:
    if isinstance(cell, str):
        return latex_text(cell)
    if isinstance(cell, float) and math.isinf(cell):
        return r"$\infty$" if cell > 0 else r"$-\infty$"
    text = number_text(cell)
    mantissa, e, exponent = text.partition("e")
    if e:
        return rf"${mantissa} \times 10^{{{int(exponent)}}}$"
    return f"${text}$" if text.startswith("-") and len(text) > 1 else text


def _exact(cell: Cell) -> str:
    if isinstance(cell, str):
        return cell
    if isinstance(cell, int):
        return str(cell)
    return "" if math.isnan(cell) else repr(float(cell))


def _refuse_name(name: str) -> None:
    if not _NAME.fullmatch(name):
        raise ValueError(f"{name!r} is no name for files: small letters, digits and underscores")
