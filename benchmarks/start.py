"""Processor time until a rigid pendulum moves: with an empty cache of kernels, method by method, and with a warm one.

Each row is a process of its own on one core. The first finds no kernel in its cache; each further method finds what
those before it left there. `other` is another checkout, whose own `run` is called:

    python3 benchmarks/start.py
    python3 benchmarks/start.py ../other
"""

from __future__ import annotations

import argparse
import os
import subprocess
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parents[1]
METHODS = ("automatic", "GeneralizedAlpha", "RadauIIA", "EnergyMomentum", "CentralDifference", "automatic, warm")

PENDULUM = """
import sys, time
import flexmbd as fm
loaded = time.process_time()
scene = fm.System(gravity=(0.0, 0.0, -9.81))
rod = scene.add(fm.RigidBody(mass=1.0, inertia=(0.1, 0.1, 0.1), com=(0.5, 0.0, 0.0)))
hinge = scene.connect(fm.joint.Revolute(axis="y"), scene.ground.frame(), rod.frame())
hinge.position = 0.3
method = sys.argv[1].partition(",")[0]
how = {} if method == "automatic" else {"integrator": getattr(fm, method)()}
scene.simulate(1.0, rtol=1e-5, **how)
print("seconds", loaded, time.process_time() - loaded)
"""


def seconds(checkout: Path, method: str, cache: str) -> tuple[float, float]:
    """Processor time (s) of the import and of the first simulation."""
    done = subprocess.run(
        ["taskset", "-c", "0", str(checkout / "run"), "python", "-c", PENDULUM, method],
        cwd=checkout,
        env={**os.environ, "NUMBA_CACHE_DIR": cache},
        capture_output=True,
        text=True,
        check=True,
    )
    answer = next(line.split() for line in done.stdout.splitlines() if line.startswith("seconds"))
    return float(answer[1]), float(answer[2])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("other", nargs="?", type=Path, help="another checkout, with its own `run`")
    other = parser.parse_args().other
    checkouts = [HERE] if other is None else [HERE, other.resolve()]
    caches = [tempfile.TemporaryDirectory() for _ in checkouts]
    print("| method | " + " | ".join(f"import (s) | first run of {one.name} (s)" for one in checkouts) + " |")
    print("|---|" + "---|" * 2 * len(checkouts))
    for method in METHODS:
        row = [seconds(one, method, cache.name) for one, cache in zip(checkouts, caches, strict=True)]
        print(f"| {method} | " + " | ".join(f"{load:.2f} | {first:.2f}" for load, first in row) + " |", flush=True)
    for cache in caches:
        cache.cleanup()


if __name__ == "__main__":
    main()
