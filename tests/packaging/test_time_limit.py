"""Compilation has a time of its own; what hangs is ended."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

HELPERS = Path(__file__).resolve().parents[1] / "helpers"

WAITS = """
import time
from numba.core import event

def test_that_waits_for_its_kernels():
    with event.trigger_event("numba:compiler_lock"):
        with event.trigger_event("numba:compiler_lock"):
            time.sleep(1.5)
        time.sleep(0.5)

def test_after_it():
    pass
"""

HANGS = """
import time
from numba.core import event

def test_that_hangs():
    with event.trigger_event("numba:compiler_lock"):
        time.sleep(0.5)
    time.sleep(60.0)
"""

NEVER_COMPILED = """
import time
import time_limit
from numba.core import event

time_limit.COMPILATION = 1.0

def test_whose_kernels_never_come():
    with event.trigger_event("numba:compiler_lock"):
        time.sleep(60.0)
"""


DIES = """
import os

def test_that_dies():
    os.kill(os.getpid(), 9)

def test_after_it():
    pass
"""


WAITS_FOR_A_FORM = """
import sys
import time
import types

jit = types.ModuleType("jit")
jit.compile_forms = jit.compile_expressions = lambda seconds: time.sleep(seconds)
sys.modules["ffcx.codegeneration.jit"] = jit

def test_that_waits_for_a_form():
    jit.compile_forms(1.5)
    jit.compile_expressions(seconds=0.5)

def test_after_it():
    jit.compile_forms(1.5)
"""


def run(folder, text, *options):
    """A run of pytest on these tests, with a limit of a second."""
    (folder / "test_some.py").write_text(text)
    command = [sys.executable, "-m", "pytest", "-p", "time_limit", "-p", "sharing", "-c", os.devnull]
    command += ["--rootdir", str(folder), "--timeout=1", "--timeout-method=thread", *options, str(folder)]
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("OMPI_", "PMI"))}
    environment["PYTHONPATH"] = str(HELPERS)
    return subprocess.run(command, capture_output=True, text=True, timeout=50, env=environment, check=False)


@pytest.mark.parametrize("text", [WAITS, WAITS_FOR_A_FORM], ids=["kernels", "forms"])
def test_compilation_does_not_count(tmp_path, text):
    done = run(tmp_path, text)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "2 passed" in done.stdout


@pytest.mark.parametrize("text", [HANGS, NEVER_COMPILED], ids=["hangs", "never compiled"])
def test_what_hangs_is_ended(tmp_path, text):
    done = run(tmp_path, text)
    assert done.returncode != 0
    assert "Timeout" in done.stdout + done.stderr


@pytest.mark.parametrize(("text", "name"), [(HANGS, "test_that_hangs"), (DIES, "test_that_dies")])
def test_a_worker_that_ends_names_its_test_once_and_the_next_one_goes_on(tmp_path, text, name):
    others = "\n\ndef test_the_last():\n    pass\n"
    (tmp_path / "test_others.py").write_text(others)
    done = run(tmp_path, text + others, "-ra", "--numprocesses=2", "--dist=loadfile", "--no-loadscope-reorder")
    said = done.stdout + done.stderr
    assert done.returncode == 1, said
    # The summary's line of the test repeats this message whole where the variable CI is set: it is not counted.
    told = [line for line in said.splitlines() if line.startswith("worker ")]
    assert [line.split("crashed while running ")[1] for line in told] == [f"'test_some.py::{name}'"], said
    passed = 2 if text is HANGS else 3
    assert f"1 failed, {passed} passed" in said, said
    assert text is DIES or "in test_that_hangs" in said, said
