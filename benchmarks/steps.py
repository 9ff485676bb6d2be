"""Processor time of a step, scene by scene and method by method, of this checkout and of another one in turns.

Small machines, where what surrounds the equations shows. Each checkout has a process of its own, both on one core,
and they run in turns, with kernels compiled before. What counts is the stepping alone, and of each turn the run that
took least. The ratio of a row is that of the least times; its range is that of the ratios turn by turn, which says how
far the machine can be trusted.

It calls each checkout's own `run`, so python3 calls it and not `run`:

    python3 benchmarks/steps.py                            # this checkout alone
    python3 benchmarks/steps.py ../other                   # and beside another
    python3 benchmarks/steps.py ../other --only four-bar --method Radau --turns 15 --core 1

Both run the scenes of this checkout. Ratios are of whole runs, this checkout's over the other's; steps (rejected ones
included) and Newton's iterations, or evaluations of forces, say where the two took different ones.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
from pathlib import Path
from typing import Any, NamedTuple

HERE = Path(__file__).resolve().parents[1]
ANSWER = "answer: "  # what a runner's answers begin with


class Row(NamedTuple):
    """The run of a method on a scene that took least: s, steps, iterations or evaluations of forces."""

    seconds: float
    steps: int
    iterations: int


class Runner:
    """A process in a checkout that runs what it is asked for."""

    def __init__(self, checkout: Path, core: int) -> None:
        script, folder = HERE / "benchmarks" / "steps_runner.py", HERE / "out_steps" / checkout.name
        self._process = subprocess.Popen(
            [str(checkout / "run"), "python", str(script), str(folder), str(core)],
            cwd=checkout,
            env={**os.environ, "FLEXMBD_BIND": str(HERE)},  # where `run` enters a tree
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def ask(self, what: tuple[str, str] | None) -> Any:
        """The answer to a line of the input."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(json.dumps(what) + "\n")
        self._process.stdin.flush()
        for line in self._process.stdout:
            if line.startswith(ANSWER):
                return json.loads(line.removeprefix(ANSWER))
        raise SystemExit("a checkout's process ended; what it said stands above")


def table_row(case: str, method: str, columns: list[list[Row]]) -> str:
    """Markdown; ``columns``: the turns of each checkout."""
    text = f"| {case} | {method} |"
    for rows in columns:
        best = min(rows)
        text += f" {best.steps} ({best.iterations}) | {best.seconds / best.steps * 1e6:.2f} |"
    if len(columns) == 2:
        here, there = columns
        ratios = [a.seconds / b.seconds for a, b in zip(here, there, strict=True)]
        text += f" {min(here).seconds / min(there).seconds:.2f} | {min(ratios):.2f} to {max(ratios):.2f} |"
    return text


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("other", nargs="?", type=Path, help="another checkout, with its own `run`")
    parser.add_argument("--turns", type=int, default=7)
    parser.add_argument("--only", default="", help="scenes whose names hold this")
    parser.add_argument("--method", default="", help="methods whose names hold this")
    parser.add_argument("--core", type=int, default=0)
    chosen = parser.parse_args()
    checkouts = [HERE, *([chosen.other.resolve()] if chosen.other else [])]
    runners = [Runner(checkout, chosen.core) for checkout in checkouts]
    heads = ["scene", "method", *["steps (iterations)", "us a step"] * len(runners)]
    heads += ["ratio", "turn by turn"] if len(runners) == 2 else []
    print(f"| {' | '.join(heads)} |\n|{'---|' * len(heads)}")
    for case, method in runners[0].ask(None):
        if chosen.only not in case or chosen.method not in method:
            continue
        if None in [runner.ask((case, method)) for runner in runners]:
            continue  # a method that stops has said so
        turns = [[Row(*runner.ask((case, method))) for runner in runners] for _ in range(chosen.turns)]
        print(table_row(case, method, [list(column) for column in zip(*turns, strict=True)]), flush=True)


if __name__ == "__main__":
    main()
