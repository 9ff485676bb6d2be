"""What ./run promises to the command that it runs. Inside its environment, where it only passes the command on."""

import os
import shutil
import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from machine import Machine

REPOSITORY = Path(__file__).resolve().parents[2]
RUN = REPOSITORY / "run"
# the project, then a package that is installed without what it asks for
FILL = ["pip", "pip", "compile"]

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


def test_more_tools_are_asked_for_before_the_command() -> None:
    """Within the environment nothing changes any more: the command runs as it is."""
    done = run("--tools", "python", "-c", "import sys; print(sys.argv[1:])", "--tools")
    assert done.stdout == "['--tools']\n"
    assert "--tools stands before a command" in run("--tools").stderr


def test_unknown_command() -> None:
    done = run("no-such-command")
    assert done.returncode == 127
    assert "no-such-command" in done.stderr


def test_base_packages_are_not_shadowed() -> None:
    """DOLFINx was compiled with the base's numpy: another one in the environment above it would be a risk."""
    if Path(os.environ["FLEXMBD_ENV"], "flexmbd.stamp").read_text().split("\n")[1] == "wheel":
        pytest.skip("all come from PyPI")
    names = ("numpy", "scipy", "h5py", "numba", "dolfinx")
    script = f"import importlib.util as u; print(*(u.find_spec(name).origin for name in {names}), sep='\\n')"
    done = run("python", "-c", script)
    modules = done.stdout.splitlines()
    assert len(modules) == len(names)
    for module in modules:
        assert module.endswith("__init__.py")
        assert not module.startswith(os.environ["FLEXMBD_ENV"])


def test_one_thread_a_process_unless_said_otherwise(tmp_path: Path) -> None:
    show = ("python", "-c", "import os; print(os.environ['OMP_NUM_THREADS'])")
    assert run(*show).stdout == os.environ["OMP_NUM_THREADS"] + "\n"
    assert run("OMP_NUM_THREADS=2", *show).stdout == "2\n"


def test_an_error_on_one_rank_ends_all(tmp_path: Path) -> None:
    """Where the others wait for it in a collective call, and would for ever."""
    script = tmp_path / "wrong.py"
    script.write_text(
        "from mpi4py import MPI\n"
        "if MPI.COMM_WORLD.rank == 1:\n"
        "    raise ValueError('rank 1 alone')\n"
        "MPI.COMM_WORLD.barrier()\n"
    )
    done = run("mpirun", "-n", "2", "python", str(script), "argument", timeout=50)
    assert done.returncode != 0
    assert "ValueError: rank 1 alone" in done.stderr


def test_mpirun_gets_its_arguments_as_they_are(tmp_path: Path) -> None:
    """But for the runner that aborts, before a script of python; what has a runner of its own keeps it."""
    fake = tmp_path / "mpirun"
    fake.write_text("#!/bin/sh\nprintf '%s|' \"$@\"\n")
    fake.chmod(0o755)
    around = {**os.environ, "PATH": f"{tmp_path}:{os.environ['PATH']}"}

    def given(*words: str) -> list[str]:
        return run("mpirun", *words, env=around).stdout.rstrip("|").split("|")

    ranks = ["-n", "2"]
    assert given(*ranks, "python", "a b.py", "-x") == [*ranks, "python", "-m", "mpi4py", "a b.py", "-x"]
    assert given(*ranks, "python3", "-c", "pass") == [*ranks, "python3", "-m", "mpi4py", "-c", "pass"]
    for words in (["python", "-m", "pytest", "x.py"], ["python", "-u", "x.py"], ["flexmbd", "reduce", "x.step"], []):
        assert given(*ranks, *words) == [*ranks, *words]


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
        assert done.stderr == "run: FLEXMBD_WAY is 'wheels': it may be host, wheel, apt or tree\n"

    def test_no_pyproject(self, script: Path) -> None:
        (script.parent / "pyproject.toml").unlink()
        done = self.set_up(script)
        assert done.returncode == 1
        assert "pyproject.toml" in done.stderr.splitlines()[-1]


def until(condition: Callable[[], bool]) -> None:
    """Waits for it, for half a minute at the most."""
    deadline = time.monotonic() + 30
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.02)


class TestTrees:
    """Trees and environments are made once, whole or not at all, and do not disturb each other."""

    @pytest.fixture
    def machine(self, tmp_path: Path) -> Machine:
        return Machine(tmp_path)

    def test_made_once(self, machine: Machine) -> None:
        code, said = machine.run()
        assert code == 0, said
        assert said.endswith("run: the environment is ready\n")
        assert machine.calls() == ["mmdebstrap trixie", "venv", *FILL]
        assert machine.run("sh", "-c", "exit 7") == (7, "")
        assert machine.calls() == []

    def test_the_machine_s_path_stands_behind_the_tree_s(self, machine: Machine, tmp_path: Path) -> None:
        """So that a program in a folder that FLEXMBD_BIND shows is found, and none of the tree's is hidden."""
        code, said = machine.run("sh", "-c", f"printf %s $PATH >{tmp_path}/path")
        assert code == 0, said
        (environment,) = machine.cache.glob("venv/*/")
        own = f"{environment}/bin:/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"
        assert (tmp_path / "path").read_text() == f"{own}:{machine.environment['PATH']}"

    def test_kernels_that_do_not_compile_fail_no_set_up(self, machine: Machine) -> None:
        (machine.stubs / "compile.fails").touch()
        code, said = machine.run()
        assert code == 0, said
        assert said.endswith("run: the environment is ready\n")

    @pytest.mark.parametrize("stage", ["mmdebstrap", "pip"])
    def test_failure_is_repaired_by_the_next_call(self, machine: Machine, stage: str) -> None:
        trouble = machine.stubs / f"{stage}.fails"
        trouble.touch()
        for _ in range(2):
            code, said = machine.run()
            assert code == 1
            cause, _, log = said.splitlines()[-1].rpartition(" (all of it: ")
            assert cause.endswith(f" s: E: no network for {stage}")
            assert f"E: no network for {stage}\n" in Path(log.rstrip(")")).read_text()
        machine.calls()
        trouble.unlink()
        assert machine.run()[0] == 0
        assert machine.calls() == ["mmdebstrap trixie"] * (stage == "mmdebstrap") + ["venv", *FILL]
        assert machine.trees() == ["trixie"]

    @pytest.mark.parametrize("stage", ["mmdebstrap", "pip"])
    def test_killed_set_up_is_repaired_by_the_next_call(self, machine: Machine, stage: str) -> None:
        delay = machine.stubs / f"{stage}.waits"
        delay.write_text("60")
        process = machine.start(start_new_session=True)
        until(lambda: machine.waiting(stage))
        machine.calls()
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        assert machine.trees() == ["trixie?" if stage == "mmdebstrap" else "trixie"]
        delay.unlink()
        assert machine.run()[0] == 0
        assert machine.calls() == ["mmdebstrap trixie"] * (stage == "mmdebstrap") + ["venv", *FILL]
        assert machine.trees() == ["trixie"]

    def test_from_wheels_alone(self, machine: Machine) -> None:
        """Nothing of the python below is seen, and pip is asked for DOLFINx."""
        machine.environment["FLEXMBD_WAY"] = "wheel"
        code, said = machine.run()
        assert code == 0, said
        assert machine.calls() == ["venv", *FILL]
        assert machine.trees() == []
        (environment,) = machine.cache.glob("venv/*/")
        assert machine.arguments("venv") == [f"-m venv {environment.parent}/{environment.name}"]
        assert machine.arguments("pip")[0].split()[-3].endswith("/checkout[test,fem]")
        assert machine.run() == (0, "")

    def test_a_python_that_takes_no_wheel(self, machine: Machine) -> None:
        machine.environment["FLEXMBD_WAY"] = "wheel"
        machine.script.write_text(machine.script.read_text().replace("(3, 12) <= sys", "(3, 98) <= sys"))
        code, said = machine.run()
        assert code == 1
        assert said.startswith("run: the wheel of DOLFINx needs Python 3.12 to 3.14, and ")
        assert machine.calls() == []

    def test_two_calls_at_once(self, machine: Machine) -> None:
        (machine.stubs / "mmdebstrap.waits").write_text("0.5")
        calls = [machine.start(), machine.start()]
        said = [call.communicate(timeout=60)[1] for call in calls]
        assert [call.returncode for call in calls] == [0, 0]
        assert machine.calls() == ["mmdebstrap trixie", "venv", *FILL]
        assert sorted("waiting for it" in text for text in said) == [False, True]

    def test_suites_beside_each_other(self, machine: Machine) -> None:
        for suite in ("trixie", "unstable"):
            assert machine.run(suite=suite)[0] == 0
            assert machine.calls() == [f"mmdebstrap {suite}", "venv", *FILL]
        for suite in ("trixie", "unstable"):
            assert machine.run(suite=suite) == (0, "")
        # a change of the project renews each environment when it is called, and removes nothing of the other
        machine.project.write_text(machine.project.read_text() + "# changed\n")
        for suite in ("trixie", "unstable"):
            assert machine.run(suite=suite)[0] == 0
            assert machine.calls() == FILL
            assert machine.trees() == ["trixie", "unstable"]

    def test_removed_tree_is_made_anew_with_its_environment(self, machine: Machine) -> None:
        """The new one may have another python, for which the old environment has no packages."""
        for suite in ("trixie", "unstable"):
            machine.run(suite=suite)
        machine.calls()
        (tree,) = machine.cache.glob("tree/unstable-*/")
        shutil.rmtree(tree)
        assert machine.run() == (0, "")
        assert machine.run(suite="unstable")[0] == 0
        assert machine.calls() == ["mmdebstrap unstable", "venv", *FILL]

    def test_dolfinx_that_flexmbd_does_not_know(self, machine: Machine) -> None:
        machine.run()
        machine.calls()
        machine.install_dolfinx("0.12.0")
        for made in (["mmdebstrap unstable"], []):
            code, said = machine.run(suite="unstable")
            assert code == 1
            (tree,) = machine.cache.glob("tree/unstable-*/")
            assert said.splitlines()[-1] == (
                f"run: error: flexmbd runs with DOLFINx 0.9 to 0.11, and this is 0.12.0: remove {tree} and "
                f"make that of an earlier day (see FLEXMBD_MIRROR in {machine.script})"
            )
            assert machine.calls() == made
        assert machine.run() == (0, "")

    def test_broken_off_compilations_are_forgotten(self, machine: Machine) -> None:
        """DOLFINx waits for a form that another process compiles, and so for one that nobody compiles any more."""
        machine.run()
        forms = machine.cache / "home" / ".cache" / "fenics"
        forms.mkdir(parents=True)
        for name in ("whole.c", "whole.c.cached", "broken.c"):
            (forms / name).touch()
        other = machine.start(
            "sh", "-c", f"touch {machine.stubs}/entered; sleep 60", start_new_session=True
        )
        until(lambda: (machine.stubs / "entered").exists())
        (forms / "broken.c").touch()
        machine.run()
        assert (forms / "broken.c").exists()  # the other command may be compiling it
        os.killpg(other.pid, signal.SIGTERM)
        other.communicate()
        assert machine.run() == (0, "")
        assert sorted(file.name for file in forms.iterdir()) == ["whole.c", "whole.c.cached"]
