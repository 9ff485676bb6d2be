"""What all tests share: pictures without a screen, and order among the ranks under mpirun.

With `./run mpirun -n 2 python -m pytest -m mpi` every rank runs the same tests. Rank 0 reports; the other ranks only
say what failed on them. After each test the ranks meet and tell each other whether it passed. If one of them failed
and another does not come, because it waits in the test for the failed one, the whole run is aborted rather than hung.
"""

import os
import sys
import time
from collections.abc import Generator
from pathlib import Path

import pytest
import sharing
from _pytest._io import TerminalWriter
from sharing import pytest_xdist_make_scheduler as pytest_xdist_make_scheduler  # hooks
from time_limit import pytest_timeout_set_timer as pytest_timeout_set_timer

from flexmbd.libraries import load_before_wheel

os.environ.setdefault("MPLBACKEND", "Agg")
os.environ.setdefault("PYVISTA_OFF_SCREEN", "true")

load_before_wheel()  # tests may import DOLFINx themselves, before flexmbd


def _of_mpirun(*names: str) -> int:
    """The first of these environment variables, by which mpirun tells a process its place; 0 without mpirun."""
    return next((int(os.environ[name]) for name in names if name in os.environ), 0)


# Without mpi4py, which only tests of the continuum side may load.
RANK = _of_mpirun("OMPI_COMM_WORLD_RANK", "PMI_RANK")
PARALLEL = _of_mpirun("OMPI_COMM_WORLD_SIZE", "PMI_SIZE") > 1

# How long a rank waits for the others after a test, in seconds: if it failed itself, and if not.
PATIENCE_AFTER_FAILURE = 20.0
PATIENCE = 400.0


# What tells a user of an error: a right scene, as those of the documents, hears nothing of it.
TOLD = ("Locking", "Pulse", "Range", "Start", "Steps", "Table", "Unit")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Let warnings of a user's errors be errors where the documents' examples run; then see ``sharing``."""
    for item in items:
        if item.path.name.endswith("docs.py"):
            for kind in TOLD:
                item.add_marker(pytest.mark.filterwarnings(f"error::flexmbd.errors.{kind}Warning"))
    sharing.choose_and_order(config, items)


@pytest.fixture
def shared_path(tmp_path: Path) -> Path:
    """An empty folder that is the same on all ranks, where `tmp_path` is another one on each. Collective."""
    if not PARALLEL:
        return tmp_path
    from mpi4py import MPI

    return MPI.COMM_WORLD.bcast(tmp_path, root=0)


class Ranks:
    """Keeps the ranks of a parallel run together; registered only there."""

    def __init__(self, config: pytest.Config) -> None:
        from mpi4py import MPI

        self._mpi = MPI
        self._comm = MPI.COMM_WORLD.Dup()
        self._config = config
        self._failed = False

    def _any_failed(self, *, failed: bool, after: str) -> bool:
        """Whether any rank failed; aborts the run if not all of them come to tell."""
        began = time.monotonic()
        patience = PATIENCE_AFTER_FAILURE if failed else PATIENCE
        mine, anywhere = bytearray([failed]), bytearray(1)
        request = self._comm.Iallreduce([mine, self._mpi.UINT8_T], [anywhere, self._mpi.UINT8_T], op=self._mpi.MAX)
        while not request.Test():
            if time.monotonic() - began > patience:
                self._say(f"waited {patience:.0f} s after {after} for the other ranks: aborting the run")
                self._comm.Abort(1)
            time.sleep(5e-4)
        return bool(anywhere[0])

    def _say(self, text: str) -> None:
        print(f"\n[rank {RANK}] {text}", file=sys.__stderr__, flush=True)

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        if report.failed and RANK > 0:
            self._say(f"ERROR collecting {report.nodeid}\n{report.longreprtext}")

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed:
            self._failed = True
            if RANK > 0:
                self._say(f"FAILED {report.nodeid} ({report.when})\n{report.longreprtext}")

    def pytest_collection_finish(self, session: pytest.Session) -> None:
        names = [item.nodeid for item in session.items]
        if any(others != (names, 0) for others in self._comm.allgather((names, session.testsfailed))):
            pytest.exit("the ranks collected different tests, or one of them failed to", returncode=1)

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        self._failed = False

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_teardown(self, item: pytest.Item) -> Generator[None]:
        yield
        if hasattr(item, "cancel_timeout"):  # or the limit would end this rank, which only waits for the others
            item.cancel_timeout()

    @pytest.hookimpl(trylast=True)
    def pytest_runtest_logfinish(self, nodeid: str) -> None:
        failed = self._failed
        if self._any_failed(failed=failed, after=nodeid) and not failed:
            self._say(f"{nodeid} passed here and failed on another rank")
            if self._config.getoption("maxfail") == 1:
                pytest.exit("a test failed on another rank", returncode=1)

    @pytest.hookimpl(tryfirst=True)
    def pytest_sessionfinish(self, session: pytest.Session, exitstatus: int) -> None:
        failed = exitstatus not in (pytest.ExitCode.OK, pytest.ExitCode.NO_TESTS_COLLECTED)
        if self._any_failed(failed=failed, after="the last test") and not failed:
            session.exitstatus = pytest.ExitCode.TESTS_FAILED

    @pytest.hookimpl(trylast=True)
    def pytest_unconfigure(self) -> None:
        self._any_failed(failed=False, after="the report")  # mpirun ends all as soon as one rank exits with an error
        self._comm.Free()


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--write-durations", action="store_true", help="write tests/helpers/durations.txt by this run")


def pytest_xdist_auto_num_workers(config: pytest.Config) -> int:
    """As many as cores where there is enough to do; none under mpirun, whose ranks run the same tests."""
    return 0 if PARALLEL else sharing.number_of_workers(config, cores=len(os.sched_getaffinity(0)))


@pytest.hookimpl(trylast=True)
def pytest_configure(config: pytest.Config) -> None:
    """Under mpirun: one report, and ranks that wait for each other."""
    if config.getoption("write_durations") and not sharing.is_worker():
        config.pluginmanager.register(sharing.Durations(), "flexmbd-durations")
    if not PARALLEL:
        return
    config.pluginmanager.register(Ranks(config), "flexmbd-ranks")
    reporter = config.pluginmanager.getplugin("terminalreporter")
    if RANK > 0 and reporter is not None:
        # The report goes nowhere; what others write by the configuration's writer, as a timeout, is still to be seen.
        visible = reporter._tw
        reporter._tw = TerminalWriter(open(os.devnull, "w"))
        config.get_terminal_writer = lambda: visible  # type: ignore[method-assign]
