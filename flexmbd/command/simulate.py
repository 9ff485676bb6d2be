"""`flexmbd simulate scene.toml`: a scene from a file, simulated into tables and a film."""

from __future__ import annotations

import argparse
import signal
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeAlias

from flexmbd.command.body_file import check_free, make_folder
from flexmbd.command.interrupts import INTERRUPTED, exits_at_once
from flexmbd.command.terminal import add_json, print_json, print_line, print_warning, wants_bar
from flexmbd.errors import SceneError
from flexmbd.files.result_table import ResultTable, write_table
from flexmbd.run.interrupts import interrupts_handled, interrupts_wait
from flexmbd.run.stopped import SimulationError, SimulationInterrupted
from flexmbd.run.trajectory import Trajectory
from flexmbd.scene_file import Built, SceneFile, build, plan_columns, read_scene, tabulate
from flexmbd.scene_file.scene_sweep import integrator_of, simulated
from flexmbd.toml_file import toml_value

Broken: TypeAlias = SimulationError | SimulationInterrupted

_STOPPED = 1
_STREAM = "run.h5"
_MOST_EVENTS = 20  # told one by one
_EXAMPLES = """\
examples:
  flexmbd simulate pendulum.toml                     the tables go to the folder pendulum_results
  flexmbd simulate pendulum.toml -o run1 --force --quiet
  flexmbd simulate pendulum.toml --set bodies.bob.mass=2.3 --set simulate.t_end=5
  flexmbd simulate pendulum.toml --stream            the trajectory too, in pendulum_results/run.h5, as it comes
  flexmbd simulate pendulum.toml --from pendulum_results/run.h5 -o so_far       tables of what is there, also after kill
  flexmbd simulate pendulum.toml --explain           what would be computed, and by which integrator
  flexmbd plot pendulum_results/results.csv

exit code 1: the simulation stopped early; what it computed until then is in the tables, as after Ctrl-C (130)
docs/command_line.md has a whole scene file and all its keys
"""


def describe(parser: argparse.ArgumentParser) -> None:
    """Give the subcommand's parser its arguments."""
    parser.description = "Simulate the machine that a TOML file describes, and write what it asks for."
    parser.epilog = _EXAMPLES
    parser.add_argument("scene", type=Path, help="a scene file, as pendulum.toml")
    parser.add_argument("-o", "--output", type=Path, metavar="DIR", help="folder of results (default: SCENE_results)")
    parser.add_argument("--force", action="store_true", help="replace results that are there")
    add_settings(parser)
    kept = parser.add_mutually_exclusive_group()
    kept.add_argument(
        "--stream", action="store_true", help=f"the trajectory too, in DIR/{_STREAM}, written while the machine runs"
    )
    kept.add_argument(
        "--from",
        type=Path,
        metavar="FILE",
        dest="kept",
        help="do not simulate: make the tables and the film of this trajectory of the scene, of a --stream or run.save",
    )
    parser.add_argument("--explain", action="store_true", help="say what would be computed, and stop")
    bar = parser.add_mutually_exclusive_group()
    bar.add_argument("--progress", action="store_true", help="a progress bar on stderr, even if it is not a terminal")
    bar.add_argument("--quiet", action="store_true", help="no progress bar, no report")
    add_json(parser)
    parser.set_defaults(run=simulate)


def add_settings(parser: argparse.ArgumentParser) -> None:
    """Give a parser the argument `--set`."""
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        dest="settings",
        help="another value than the file's, as body.crank.mass=2.3 or simulate.rtol=1e-8; repeat it",
    )


def settings_of(words: Sequence[str], *, option: str = "--set") -> dict[str, Any]:
    """Values by their keys, of KEY=VALUE each.

    Raises:
        SceneError: one has no key or no value, or two have one key.
    """
    found: dict[str, Any] = {}
    for word in words:
        key, equals, value = (part.strip() for part in word.partition("="))
        if not (key and equals and value):
            raise SceneError(f"{option} takes KEY=VALUE, as body.crank.mass=2.3, got {word!r}")
        if key in found:
            raise SceneError(f"{option} {key} is given twice")
        found[key] = toml_value(value)
    return found


def simulate(arguments: argparse.Namespace) -> int:
    """Read the scene, simulate, write the tables. Not collective.

    Raises:
        SceneError, AssemblyError: the file is not a scene, or the machine cannot be assembled.
        ExportError: results exist already, or cannot be written.
        PictureError: the film cannot be made; the tables are there then.
        RecordError: the trajectory's file cannot be written, or read, or is of another machine.
    """
    with exits_at_once():
        scene = read_scene(arguments.scene, changes=settings_of(arguments.settings))
        built = build(scene)
    folder: Path = arguments.output or Path(f"{arguments.scene.stem}_results")
    files = [folder / f"results.{kind}" for kind in scene.output.formats]
    film = None if scene.output.film is None else folder / scene.output.film
    if arguments.explain:
        print_line(built.system.explain(rtol=scene.run.rtol, h=scene.run.h, integrator=integrator_of(scene)))
        return 0
    columns = plan_columns(built, scene.output)
    make_folder(folder)
    stream = folder / _STREAM if arguments.stream else None
    for path in (*files, film, stream):
        if path is not None:
            check_free(path, force=arguments.force)
    with interrupts_wait() as late:
        if arguments.kept is None:
            run, fault = _run(built, scene, progress=shows_bar(arguments), stream=stream)
        else:
            run, fault = Trajectory.load(arguments.kept, built.system), None
        table = tabulate(run, columns, every=scene.output.every)
        for path in files:
            write_table(table, path)
    is_interrupted = late.seen or isinstance(fault, KeyboardInterrupt)
    if film is not None and not is_interrupted:
        run.animate(film)
        files.append(film)
    if stream is not None:
        files.append(stream)
    _report(arguments, run, table, files, SimulationInterrupted("", run) if is_interrupted else fault)
    if is_interrupted:
        return INTERRUPTED
    return 0 if fault is None else _STOPPED


def shows_bar(arguments: argparse.Namespace) -> bool:
    """Whether a bar is asked for; by itself where a person looks on and tqdm is there."""
    if arguments.progress or arguments.quiet:
        return bool(arguments.progress)
    return wants_bar()


def _run(
    built: Built, scene: SceneFile, *, progress: bool, stream: Path | None
) -> tuple[Trajectory, Broken | None]:
    """The trajectory; of a simulation that stopped early the part that there is, and the error."""
    run: Trajectory | None = None
    try:
        with interrupts_handled(signal.default_int_handler):
            run = simulated(built, scene, progress=progress, stream=stream)
    except (SimulationError, SimulationInterrupted) as error:
        return error.trajectory, error
    except KeyboardInterrupt:
        if run is None:
            raise
        return run, SimulationInterrupted("interrupted at the end", run)
    return run, None


def _report(
    arguments: argparse.Namespace,
    run: Trajectory,
    table: ResultTable,
    files: list[Path],
    fault: Broken | None,
) -> None:
    """Say what was done, for people or for scripts."""
    stats = run.stats
    end = float(run.t[-1])
    written = f"what was computed until t = {end:.6g} s is in {', '.join(map(str, files))}"
    if isinstance(fault, KeyboardInterrupt):
        print_warning(f"stopped by Ctrl-C; {written}")
        return
    if fault is not None:
        print_warning(f"{fault}; {written}")
    if arguments.json:
        print_json(
            {
                "completed": fault is None,
                "error": None if fault is None else str(fault),
                "t_end": end,
                "files": files,
                "rows": len(table.values),
                "columns": dict(zip(table.names, table.units, strict=True)),
                "integrator": stats.integrator,
                "steps": stats.steps,
                "rejected": stats.rejected,
                "seconds": stats.seconds,
                "constraint_residual": stats.constraint_residual,
                "events": [{"name": one.name, "t": one.t} for one in run.events],
            }
        )
    elif not arguments.quiet:
        print_line(f"{end:.6g} s simulated in {stats.seconds:.3g} s: {stats.steps} steps, {stats.integrator}")
        for one in run.events[:_MOST_EVENTS]:
            print_line(f"event {one.name!r} at t = {one.t:.9g} s")
        if len(run.events) > _MOST_EVENTS:
            print_line(f"and {len(run.events) - _MOST_EVENTS} events more; --json has all")
        for path in files:
            what = f": {len(table.values)} rows, {len(table.names)} columns" if path.stem == "results" else ""
            print_line(f"{path}{what}")
