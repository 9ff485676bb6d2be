"""What ./run promises to the command that it runs. Inside its environment, where it only passes the command on."""

import os
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

REPOSITORY = Path(__file__).resolve().parents[2]
RUN = REPOSITORY / "run"

pytestmark = pytest.mark.skipif("FLEXMBD_ENV" not in os.environ, reason="these tests are run by ./run pytest")


def run(*command: str, script: Path = RUN, **options: Any) -> subprocess.CompletedProcess[str]:
    return subprocess.run([str(script), *command], capture_output=True, text=True, **options)


def test_usage_without_a_command() -> None:
    done = run()
    assert done.returncode == 1
    assert done.stderr.startswith("usage: ./run CMD")
    assert run("--help").returncode == 0


def test_arguments_input_directory_and_exit_code_pass_through(tmp_path: Path) -> None:
    script = "import os, sys; print(sys.argv[1:], sys.stdin.read(), os.getcwd()); sys.exit(7)"
    done = run("python", "-c", script, "two words", "", "*", input="typed", cwd=tmp_path)
    assert done.returncode == 7
    assert done.stderr == ""
    assert done.stdout == f"{['two words', '', '*']} typed {tmp_path}\n"


def test_python_is_that_of_the_environment() -> None:
    for name in ("python", "python3"):
        done = run(name, "-c", "import sys; print(sys.prefix)")
        assert done.stdout.strip() == os.environ["FLEXMBD_ENV"]
    for name in ("pytest", "ruff", "mypy", "lint-imports"):
        assert Path(shutil.which(name) or "").parent == Path(os.environ["FLEXMBD_ENV"], "bin")


def test_unknown_command() -> None:
    done = run("no-such-command")
    assert done.returncode == 127
    assert "no-such-command" in done.stderr


def test_base_packages_are_not_shadowed() -> None:
    """DOLFINx was compiled with the base's numpy: another one in the environment above it would be a risk."""
    for name in ("numpy", "scipy", "h5py", "numba", "dolfinx"):
        module = run("python", "-c", f"import {name}; print({name}.__file__)").stdout
        assert not module.startswith(os.environ["FLEXMBD_ENV"])


def test_one_thread_a_process_unless_said_otherwise(tmp_path: Path) -> None:
    show = ("python", "-c", "import os; print(os.environ['OMP_NUM_THREADS'])")
    assert run(*show).stdout == os.environ["OMP_NUM_THREADS"] + "\n"
    assert run("OMP_NUM_THREADS=2", *show).stdout == "2\n"


def test_two_ranks_without_a_warning(tmp_path: Path) -> None:
    script = tmp_path / "sum.py"
    script.write_text(
        "import os, pathlib, sys\n"
        "from mpi4py import MPI\n"
        "total = MPI.COMM_WORLD.allreduce(MPI.COMM_WORLD.rank)\n"
        "unbound = len(os.sched_getaffinity(0)) == os.cpu_count() or os.sched_getaffinity(0)\n"
        "report = pathlib.Path(__file__).with_name(f'rank{MPI.COMM_WORLD.rank}')\n"
        "report.write_text(f'{total} {sys.prefix} {unbound}')\n"
    )
    outside = {name: value for name, value in os.environ.items() if not name.startswith(("OMPI_COMM", "PMIX_"))}
    done = run("mpirun", "-n", "3", "python", str(script), env=outside)
    assert done.returncode == 0
    assert done.stderr == ""
    # Each rank in a file of its own: mpirun may mix what the ranks print within a line.
    assert [file.read_text() for file in sorted(tmp_path.glob("rank*"))] == [f"3 {os.environ['FLEXMBD_ENV']} True"] * 3


class TestSetUp:
    """A copy of the script, away from the environment: it has to set up, and fails, and says why."""

    @pytest.fixture
    def script(self, tmp_path: Path) -> Path:
        script = tmp_path / "checkout" / "run"
        script.parent.mkdir()
        shutil.copy(RUN, script)
        shutil.copy(REPOSITORY / "pyproject.toml", script.parent)
        return script

    def set_up(self, script: Path, **variables: str) -> subprocess.CompletedProcess[str]:
        variables = {"FLEXMBD_CACHE": str(script.parents[1] / "cache"), **variables}
        outside = {name: value for name, value in os.environ.items() if not name.startswith("FLEXMBD_")}
        return run("true", script=script, env={**outside, **variables})

    def test_unknown_way(self, script: Path) -> None:
        done = self.set_up(script, FLEXMBD_WAY="wheels")
        assert done.returncode == 1
        assert done.stderr == "run: FLEXMBD_WAY is 'wheels': it may be host, apt or tree\n"

    def test_no_pyproject(self, script: Path) -> None:
        (script.parent / "pyproject.toml").unlink()
        done = self.set_up(script)
        assert done.returncode == 1
        assert "pyproject.toml" in done.stderr.splitlines()[-1]

    def test_failed_installation_names_the_cause_and_the_log(self, script: Path) -> None:
        (script.parent / "pyproject.toml").write_text("[project\n")
        done = self.set_up(script, FLEXMBD_WAY="host")
        assert done.returncode == 1
        *_, line = done.stderr.splitlines()
        assert "failed after" in line
        log = Path(line.rpartition(": ")[2].rstrip(")"))
        assert log.read_text()
        assert not list(script.parents[1].glob("cache/venv/*/flexmbd.stamp"))  # so the next call tries again
