"""How workers share the tests: as many as there are cores, whole files each, so that a module's fixtures are made once.

The longest files come first, by `durations.txt`: seconds of one core with cold caches. `./run pytest --write-durations`
writes that table anew.
"""

from __future__ import annotations

import os
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from xdist.scheduler import LoadFileScheduling  # type: ignore[import-untyped]
from xdist.workermanage import WorkerController  # type: ignore[import-untyped]

TESTS = Path(__file__).resolve().parents[1]
TABLE = Path(__file__).with_name("durations.txt")

# Seconds: of a file that the table does not have; of the shortest one it has; of so much work as is worth two workers.
UNKNOWN, SHORTEST, ENOUGH = 1.0, 3.0, 45.0
# Markers of tests that run only where they are asked for.
ASKED_FOR = ("thousand", "whole")
# Each wants a gigabyte of memory.
MOST_WORKERS = 8


def number_of_workers(config: pytest.Config, *, cores: int) -> int:
    """None where the tests are few, or where what they print is to be seen as it comes."""
    if config.getoption("capture") == "no" or config.getoption("collectonly"):
        return 0
    known = read_table()
    files = {file for given in config.args for file in _files(Path(given.partition("::")[0]))}
    if len(files) < 2 or sum(known.get(file, UNKNOWN) for file in files) < ENOUGH:
        return 0
    return min(cores, MOST_WORKERS)


@pytest.hookimpl(trylast=True)
def choose_and_order(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out what is asked for by its marker alone. Of a worker: the longest files first, each in its own order."""
    asked = str(config.getoption("markexpr"))
    names = [name for name in ASKED_FOR if name not in asked]
    left = {item for item in items if any(item.get_closest_marker(name) for name in names)}
    if left:
        config.hook.pytest_deselected(items=list(left))
        items[:] = [item for item in items if item not in left]
    if is_worker():
        known = read_table()
        items.sort(key=lambda item: -known.get(_name(item.path), UNKNOWN))


class WholeFiles(LoadFileScheduling):
    """A file's tests by one worker. A test at which a worker died is not tried again by the next one."""

    def remove_node(self, node: WorkerController) -> str | None:
        """The test that ran as this worker died; what it leaves goes to the others."""
        files = self.assigned_work.pop(node)
        left = [(file, test) for file, tests in files.items() for test, done in tests.items() if not done]
        if not left:
            return None
        (file, ran), *others = left
        files[file][ran] = True
        for file in reversed(dict(others)):
            self.workqueue[file] = files[file]
            self.workqueue.move_to_end(file, last=False)
        for other in self.assigned_work:
            self._reschedule(other)
        return ran


def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> WholeFiles | None:
    """For whole files; another `--dist` has its own."""
    return WholeFiles(config, log) if config.getoption("dist") == "loadfile" else None


class Durations:
    """Adds up what the files of this run take, and writes the table at its end."""

    def __init__(self) -> None:
        self._seconds: dict[str, float] = defaultdict(float)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self._seconds[report.nodeid.partition("::")[0].removeprefix("tests/")] += report.duration

    def pytest_sessionfinish(self) -> None:
        write_table({**read_table(), **self._seconds})


def read_table() -> dict[str, float]:
    """Seconds by a file's path below tests/."""
    lines = (line.split() for line in TABLE.read_text().splitlines())
    return {file: float(seconds) for seconds, file in lines}


def write_table(seconds: dict[str, float]) -> None:
    """Those files that are there and take long enough, the longest first."""
    long = ((took, file) for file, took in seconds.items() if took >= SHORTEST and (TESTS / file).is_file())
    TABLE.write_text("".join(f"{took:.0f} {file}\n" for took, file in sorted(long, reverse=True)))


def _files(given: Path) -> list[str]:
    found: Sequence[Path] = [*given.rglob("test_*.py")] if given.is_dir() else [given]
    return [_name(path) for path in found]


def _name(path: Path) -> str:
    return os.path.relpath(path, TESTS)


def is_worker() -> bool:
    """Whether this process runs tests for another one, which reports."""
    return "PYTEST_XDIST_WORKER" in os.environ
