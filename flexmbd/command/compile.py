"""`flexmbd compile`: the kernels of the integrators, compiled before a simulation waits for them."""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Any

from flexmbd.command.launch import usable_cores
from flexmbd.command.terminal import add_json, print_json, print_line, print_warning, wants_bar
from flexmbd.errors import SceneError
from flexmbd.multibody.kernels.base.kernel_store import cache_folder, is_cache_writable
from flexmbd.scene_file.entry_kinds import INTEGRATORS

#: The integrators that are chosen automatically; those that take longest to compile stand first.
AUTOMATIC = ("radau_iia", "generalized_alpha", "explicit_runge_kutta", "central_difference")
_PAUSE = 0.05  # s, between looks at what runs
_EXAMPLES = """\
examples:
  flexmbd compile
  flexmbd compile --all
  flexmbd compile radau_iia

Kernels that are there already are looked through: what is damaged is compiled anew. Bodies with history and laws of
your own have kernels besides, which are compiled when they are first used.
"""


def describe(parser: argparse.ArgumentParser) -> None:
    """Give the subcommand's parser its arguments."""
    parser.description = (
        "Compile the kernels of integrators, on all cores, so that no simulation waits for them; without names those "
        "of the integrators that are chosen automatically."
    )
    parser.epilog = _EXAMPLES
    names = ", ".join(INTEGRATORS)
    parser.add_argument("integrators", nargs="*", metavar="INTEGRATOR", help=f"any of {names}")
    parser.add_argument("--all", action="store_true", help="all integrators")
    parser.add_argument("--jobs", type=int, default=usable_cores(), help="processes (one a core)")
    add_json(parser)
    parser.set_defaults(run=compile_kernels)


def compile_kernels(arguments: argparse.Namespace) -> int:
    """Compile the kernels, and print which, how long that took and where the cache is.

    Raises:
        SceneError: an unknown integrator, no process, or one that failed.
    """
    unknown = [name for name in arguments.integrators if name not in INTEGRATORS]
    if unknown:
        raise SceneError(f"there is no integrator {unknown[0]!r}; there are {', '.join(INTEGRATORS)}")
    if arguments.jobs < 1:
        raise SceneError(f"--jobs must be 1 or more, got {arguments.jobs}")
    chosen = set(INTEGRATORS if arguments.all else arguments.integrators or AUTOMATIC)
    order = [*(name for name in AUTOMATIC if name in chosen), *sorted(chosen - set(AUTOMATIC))]
    folder = cache_folder()
    if not is_cache_writable():
        print_warning(f"{folder} cannot be written to: kernels are kept where numba finds a place, else not at all")
    began = time.perf_counter()
    written: dict[str, int] = {}
    with _bar(len(order)) as bar:
        for name, entries in _run(order, arguments.jobs):
            written[name] = entries
            if bar is not None:
                bar.set_description(f"compiled {name}")
                bar.update()
    seconds = time.perf_counter() - began
    if arguments.json:
        print_json({"folder": str(folder), "seconds": seconds, "written": written})
    else:
        print_line(_summary(written, seconds, folder))
    return 0


def _summary(written: dict[str, int], seconds: float, folder: Path) -> str:
    names = ", ".join(written)
    if not any(written.values()):
        return f"all kernels of {names} are there: {folder}"
    return f"{sum(written.values())} kernels compiled in {seconds:.0f} s, for {names}: {folder}"


def _bar(total: int) -> AbstractContextManager[Any]:
    """A progress bar where a person looks on and tqdm is there."""
    if not wants_bar():
        return nullcontext()
    from tqdm import tqdm

    return tqdm(total=total, unit="integrator", leave=False)  # type: ignore[no-any-return]


def _run(names: list[str], jobs: int) -> Iterator[tuple[str, int]]:
    """Compile for each integrator in a process of its own, some at a time: the name and the number of kernels written.

    However it ends no process is left behind.

    Raises:
        SceneError: a process failed.
    """
    waiting = list(names)
    running: dict[str, subprocess.Popen[str]] = {}
    try:
        while waiting or running:
            while waiting and len(running) < jobs:
                name = waiting.pop(0)
                words = [sys.executable, "-m", "flexmbd.command.sample_machines", name]
                # a group of its own: Ctrl-C ends it from here, without a word
                running[name] = subprocess.Popen(
                    words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, process_group=0
                )
            for name in [one for one, process in running.items() if process.poll() is not None]:
                done = running.pop(name)
                out, err = done.communicate()
                if done.returncode != 0:
                    cause = err.strip().splitlines()[-1:] or [f"exit code {done.returncode}"]
                    raise SceneError(f"compiling the kernels of {name} failed: {cause[0]}")
                yield name, int(json.loads(out)["written"])
            time.sleep(_PAUSE)
    finally:
        for process in running.values():
            process.terminate()
            process.wait()
