"""`flexmbd sweep scene.toml --vary KEY=VALUES`: a scene from a file, many times with other values."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from flexmbd.command.body_file import check_free, make_folder
from flexmbd.command.interrupts import INTERRUPTED, exits_at_once, interrupts_once
from flexmbd.command.launch import usable_cores
from flexmbd.command.simulate import add_settings, settings_of, shows_bar
from flexmbd.command.terminal import add_json, print_json, print_line, print_warning
from flexmbd.command.workers import worker_processes
from flexmbd.errors import SceneError
from flexmbd.files.result_table import ResultTable, write_table
from flexmbd.run.interrupts import interrupts_wait
from flexmbd.scene_file import SceneSweep
from flexmbd.scene_file.scene_sweep import TAKES, sweep_results
from flexmbd.scene_file.sweep_values import Variation, numeric_columns, read_variation, unit_of, variants

_FAILED = 1
_MOST_FAILURES = 5  # told one by one
_TAKEN = ("last", "min", "max")
_EXAMPLES = """\
values: START:STOP:COUNT, equal steps; START:STOP:COUNT:log, equal ratios; A,B,C, a list; uniform(LEAST,MOST) and
normal(MEAN,DEVIATION), random. Several --vary make all combinations; of what is random --samples draws each.

examples:
  flexmbd sweep pendulum.toml --vary bodies.bob.mass=1:3:5 --vary simulate.rtol=1e-6,1e-8
  flexmbd sweep pendulum.toml --vary 'bodies.bob.com[2]=normal(-1,0.01)' --samples 100 --seed 1
  flexmbd sweep pendulum.toml --vary force[0].stiffness=1:1e3:7:log --column 'hinge.*' --take max
  flexmbd plot pendulum_sweep/sweep.csv

The table has a row for each variant; what failed is told and left out, and makes the exit code 1. After Ctrl-C (130)
it has what was done, and the same command goes on from there, by sweep.h5 (docs/command_line.md).
"""


def describe(parser: argparse.ArgumentParser) -> None:
    """Give the subcommand's parser its arguments."""
    parser.description = "Simulate the machine of a TOML file many times, with other values, on several processes."
    parser.epilog = _EXAMPLES
    parser.add_argument("scene", type=Path, help="a scene file, as pendulum.toml")
    parser.add_argument(
        "--vary", action="append", required=True, metavar="KEY=VALUES", help="as body.bob.mass=1:3:5; repeat it"
    )
    add_settings(parser)
    parser.add_argument("--samples", type=int, metavar="N", help="draws of what is random")
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="of the draws (default: 0)")
    parser.add_argument(
        "--column", action="append", default=[], metavar="NAME", help="of these results; * stands for any letters"
    )
    parser.add_argument(
        "--take", action="append", default=[], choices=list(TAKES), help=f"this (default: {', '.join(_TAKEN)})"
    )
    parser.add_argument("-o", "--output", type=Path, metavar="DIR", help="folder of results (default: SCENE_sweep)")
    parser.add_argument("--jobs", type=int, default=usable_cores(), help="processes (one a core)")
    parser.add_argument("--force", action="store_true", help="begin anew where results are there")
    bar = parser.add_mutually_exclusive_group()
    bar.add_argument("--progress", action="store_true", help="a progress bar on stderr, even if it is not a terminal")
    bar.add_argument("--quiet", action="store_true", help="no progress bar, no report")
    add_json(parser)
    parser.set_defaults(run=sweep)


def sweep(arguments: argparse.Namespace) -> int:
    """Run the variants, write the table. Not collective.

    Raises:
        SceneError: a key or a value is none of the scene's; the scene cannot be built; all variants failed.
        RecordError, ExportError: results cannot be written, or are of another sweep.
    """
    if arguments.jobs < 1:
        raise SceneError(f"--jobs must be 1 or more, got {arguments.jobs}")
    if arguments.seed < 0:
        raise SceneError(f"--seed must be 0 or more, got {arguments.seed}")
    with exits_at_once():
        variations = [read_variation(word) for word in arguments.vary]
        rows = variants(variations, samples=arguments.samples, seed=arguments.seed)
        fixed = settings_of(arguments.settings)
        scenes = SceneSweep(arguments.scene, fixed, tuple(arguments.column), tuple(arguments.take) or _TAKEN)
        possible = scenes.first_possible(rows)
        quantities = scenes.quantities(possible)
        formats = scenes.scene(possible).output.formats
    folder: Path = arguments.output or Path(f"{arguments.scene.stem}_sweep")
    make_folder(folder)
    store = folder / "sweep.h5"
    tables = [folder / f"sweep.{kind}" for kind in formats]
    for path in tables:
        check_free(path, force=arguments.force or store.exists())
    if arguments.force:
        store.unlink(missing_ok=True)
    is_interrupted = _run(scenes, rows, store, arguments)
    with interrupts_wait() as late:
        samples = _samples(variations, rows)
        found = sweep_results(store, samples, quantities)
        done = np.isfinite(found.values).all(axis=1)
        table = ResultTable(
            (*samples.names, *(name for name, _ in quantities)),
            (*samples.units, *(unit for _, unit in quantities)),
            np.hstack([samples.values, found.values])[done],
        )
        if len(table.values):  # a table without rows is none
            for path in tables:
                write_table(table, path)
    if is_interrupted or late.seen:
        done_so_far = f"the {len(table.values)} variants that were done are in {tables[0]}"
        print_warning(f"stopped by Ctrl-C; {done_so_far if len(table.values) else 'no variant was done'}")
        return INTERRUPTED
    _report(arguments, table, [store, *tables], found.failures)
    return _FAILED if found.failures else 0


def _run(scenes: SceneSweep, rows: Sequence[dict[str, Any]], store: Path, arguments: argparse.Namespace) -> bool:
    """Whether Ctrl-C broke it off, with something done."""
    try:
        with interrupts_once(), worker_processes(min(arguments.jobs, len(rows))) as pool:
            done = scenes.run(rows, executor=pool, workers=arguments.jobs, file=store, progress=shows_bar(arguments))
            done.close()
    except KeyboardInterrupt:
        if not store.exists():
            raise
        return True
    return False


def _samples(variations: Sequence[Variation], rows: Sequence[dict[str, Any]]) -> ResultTable:
    """A row for each variant: its number from 0, and its values."""
    given = numeric_columns(variations, rows)
    units = ("1", *(unit_of(one.key) if one.is_numeric else "choice" for one in variations))
    return ResultTable(("variant", *given), units, np.column_stack([np.arange(float(len(rows))), *given.values()]))


def _report(
    arguments: argparse.Namespace, table: ResultTable, files: Sequence[Path], failures: Sequence[tuple[int, str]]
) -> None:
    """Say what was done, for people or for scripts."""
    for k, message in failures[:_MOST_FAILURES]:
        print_warning(f"variant {k} failed: {message}")
    if len(failures) > _MOST_FAILURES:
        print_warning(f"and {len(failures) - _MOST_FAILURES} more failed; {files[0]} has their messages")
    if arguments.json:
        print_json(
            {
                "files": files,
                "done": len(table.values),
                "failed": [{"variant": k, "error": message} for k, message in failures],
                "columns": dict(zip(table.names, table.units, strict=True)),
            }
        )
    elif not arguments.quiet:
        failed = f", {len(failures)} failed" if failures else ""
        print_line(f"{len(table.values)} variants done{failed}")
        for path in files:
            print_line(str(path))
