"""Other programs that benchmarks run in processes and environments of their own (install_peers.sh)."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
# where install_peers.sh puts them, as seen from within ./run's tree and from outside
PLACES = (Path.home().parent / "peers", Path.home() / ".cache" / "flexmbd" / "peers")

Task = Callable[[], dict[str, Any]]


def peer_task(peer: str, script: str, arguments: list[str]) -> Task | None:
    """Another program in a process of its own; None, with a word, where it is not installed."""
    folder = next((root / peer for root in PLACES if (root / peer / "whole").exists()), None)
    if folder is None:
        print(f"{peer}: not installed, left out; see benchmarks/install_peers.sh")
        return None
    python = folder / "bin" / "python"
    called = [str(python if python.exists() else sys.executable), str(HERE / script), *arguments]
    environment = os.environ | {
        "OMP_NUM_THREADS": "1", "PATH": f"{folder}:{os.environ['PATH']}", "LD_LIBRARY_PATH": str(folder / "lib")
    }
    if peer == "calculix":  # its own loader brings its libraries
        del environment["LD_LIBRARY_PATH"]

    def run() -> dict[str, Any]:
        said = subprocess.run(called, capture_output=True, text=True, env=environment, cwd=HERE)
        lines = [line for line in said.stdout.splitlines() if line.startswith("{")]
        if said.returncode or not lines:
            raise SystemExit(f"{peer} failed: {said.stderr[-2000:]}")
        return dict(json.loads(lines[-1]))

    return run
