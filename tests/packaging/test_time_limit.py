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


def run(folder, text):
    """A run of pytest on these tests, with a limit of a second."""
    (folder / "test_some.py").write_text(text)
    command = [sys.executable, "-m", "pytest", "-p", "time_limit", "-c", os.devnull, "--rootdir", str(folder)]
    command += ["--timeout=1", "--timeout-method=thread", str(folder)]
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("OMPI_", "PMI"))}
    environment["PYTHONPATH"] = str(HELPERS)
    return subprocess.run(command, capture_output=True, text=True, timeout=50, env=environment, check=False)


def test_compilation_does_not_count(tmp_path):
    done = run(tmp_path, WAITS)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "2 passed" in done.stdout


@pytest.mark.parametrize("text", [HANGS, NEVER_COMPILED], ids=["hangs", "never compiled"])
def test_what_hangs_is_ended(tmp_path, text):
    done = run(tmp_path, text)
    assert done.returncode != 0
    assert "Timeout" in done.stdout + done.stderr
