"""`flexmbd plot results.csv`: columns of a simulation over time, or the frequencies of a record, as a picture."""

from __future__ import annotations

import argparse
import fnmatch
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from flexmbd.command.body_file import check_free, read_body
from flexmbd.command.terminal import add_json, print_json, print_line
from flexmbd.errors import ExportError, PictureError
from flexmbd.files.result_table import SUFFIXES, NoTableError, ResultTable, read_table
from flexmbd.visual.destination import write
from flexmbd.visual.panels import empty_figure, legend_beside, remove_frame
from flexmbd.visual.series_plot import plot_table

if TYPE_CHECKING:
    from flexmbd.record.reduced_body import ReducedBody

_KINDS = (".png", ".pdf", ".svg")
_MOST_CURVES = 200
_EXAMPLES = """\
examples:
  flexmbd plot pendulum_results/results.csv                          all columns, those of one unit in one diagram
  flexmbd plot results.npz --column 'hinge.*' --column energy.total -o hinge.png
  flexmbd plot results.csv --list                                    the names of the columns
  flexmbd plot rod.h5 -o rod.png                                     frequencies and damping ratios of a record
"""


def describe(parser: argparse.ArgumentParser) -> None:
    """Give the subcommand's parser its arguments."""
    parser.description = "Draw columns of a simulation's results over time, or the frequencies of a reduced body."
    parser.epilog = _EXAMPLES
    parser.add_argument("result", type=Path, help="results of `flexmbd simulate` (.csv, .npz), or a record (.h5)")
    parser.add_argument(
        "--column",
        action="append",
        default=[],
        metavar="NAME",
        help="draw these; * stands for any letters; repeat it (default: all but the time)",
    )
    parser.add_argument("--list", action="store_true", help="list the columns, and stop")
    parser.add_argument(
        "-o", "--output", type=Path, metavar="FILE", help=f"{', '.join(_KINDS)} (default: beside the results, .png)"
    )
    parser.add_argument("--force", action="store_true", help="replace a picture that exists")
    add_json(parser)
    parser.set_defaults(run=plot)


def plot(arguments: argparse.Namespace) -> int:
    """Read, draw, write the picture. Not collective.

    Raises:
        ExportError, RecordError: the file cannot be read, or has no such column; the picture exists already.
        PictureError: matplotlib is missing, or the picture cannot be written.
    """
    source: Path = arguments.result
    table = _table(source)
    if arguments.list:
        columns = _columns(table)
        if arguments.json:
            print_json({"file": source, "columns": columns})
        else:
            print_line("\n".join(f"{name} [{unit}]" for name, unit in columns.items()))
        return 0
    output: Path = arguments.output or source.with_suffix(".png")
    if output.suffix.lower() not in _KINDS:
        raise PictureError(f"{output}: a picture's name ends in {', '.join(_KINDS)}")
    check_free(output, force=arguments.force, source=source)
    if table is None:
        body = read_body(source)
        drawn = ["frequency", "damping"]
        _draw_frequencies(body, source.stem, output)
    else:
        drawn = _chosen(table, arguments.column)
        plot_table(table, drawn, path=output, title=source.stem)
    if arguments.json:
        print_json({"file": output, "columns": drawn})
    else:
        print_line(f"{output}: {len(drawn)} column{'s' if len(drawn) > 1 else ''}")
    return 0


def _table(path: Path) -> ResultTable | None:
    """The table in a file, or None where it is another kind: a body's, by its suffix or because no table is in it."""
    if path.suffix.lower() not in SUFFIXES:
        return None
    try:
        return read_table(path)
    except NoTableError:
        return None


def _columns(table: ResultTable | None) -> dict[str, str]:
    if table is None:
        return {"frequency": "Hz", "damping": "1"}
    return dict(zip(table.names, table.units, strict=True))


def _chosen(table: ResultTable, patterns: Sequence[str]) -> list[str]:
    """Names of the columns that fit the patterns, in the table's order."""
    names = table.names[1:]
    chosen = set(names) if not patterns else set()
    for pattern in patterns:
        found = [name for name in table.names if name == pattern] or fnmatch.filter(names, pattern)
        if not found:
            raise ExportError(f"no column fits {pattern!r}; there are {', '.join(table.names)}")
        chosen.update(found)
    if len(chosen) > _MOST_CURVES:
        raise ExportError(f"{len(chosen)} columns are too many for one picture; choose by --column")
    return [name for name in table.names if name in chosen]


def _draw_frequencies(body: ReducedBody, title: str, path: Path) -> None:
    """The free body's frequencies, and the damping ratios of its modes, by number."""
    if body.n_modes == 0:
        raise PictureError("the body is rigid: it has no frequencies to draw")
    figure = empty_figure((8.0, 6.2), shown=False)
    figure.suptitle(title)
    above, below = figure.subplots(2, 1, sharex=True)
    number = np.arange(1, body.n_modes + 1)
    above.semilogy(number, body.frequencies(), "o", label="free")
    if body.frame is not None:
        above.semilogy(number, np.sqrt(body.stiffness) / (2.0 * np.pi), "x", label=f"{body.frame} held")
    above.set_ylabel("frequency [Hz]")
    legend_beside(above)
    below.plot(number, 100.0 * np.diag(body.damping) / (2.0 * np.sqrt(body.stiffness)), "s")
    below.set_ylabel("damping ratio [%]")
    below.set_xlabel("mode")
    for diagram in (above, below):
        remove_frame(diagram)
    write(path, lambda temporary: figure.savefig(temporary, dpi=150))
