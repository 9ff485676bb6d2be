"""`flexmbd compile`: kernels compiled before anything waits for them."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

from flexmbd.multibody.kernels.base.kernel_store import cache_folder

COMMAND = [sys.executable, "-m", "flexmbd", "compile"]


def run(*words: str, **variables: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([*COMMAND, *words], capture_output=True, text=True, env={**os.environ, **variables})


def test_the_second_call_finds_all() -> None:
    """In the folder that kernels are kept in, which the first call fills where it lacks some."""
    assert run("central_difference").returncode == 0
    done = run("central_difference")
    assert done.returncode == 0
    assert done.stdout == f"all kernels of central_difference are there: {cache_folder()}\n"
    told = json.loads(run("central_difference", "--json").stdout)
    assert told["written"] == {"central_difference": 0}
    assert told["folder"] == str(cache_folder())


def test_names_and_numbers_that_are_none_are_refused() -> None:
    done = run("runge")
    assert done.returncode == 2
    assert "there is no integrator 'runge'; there are generalized_alpha" in done.stderr
    done = run("--jobs", "0")
    assert done.returncode == 2
    assert "--jobs must be 1 or more, got 0" in done.stderr


def test_ctrl_c_is_one_line(tmp_path: Path) -> None:
    """With an empty folder, so that there is something to compile; no process is left."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    process = subprocess.Popen(
        [*COMMAND, "radau_iia"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment,
        restore_signals=True, process_group=0,
    )  # fmt: skip
    until = time.monotonic() + 60.0
    while not any(tmp_path.rglob("*.nbi")) and time.monotonic() < until:
        time.sleep(0.1)
    (child,) = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60.0)
    assert process.returncode == 130
    assert (out, err) == ("", "flexmbd: stopped by Ctrl-C\n")
    assert not Path("/proc", child).exists()
