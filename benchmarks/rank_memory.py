"""Memory of each rank that reduces a large part, over the ranks and the degrees of freedom.

    ./run python benchmarks/rank_memory.py [--sizes 50000 150000 300000] [--ranks 1 2 4]

The gear case of demos/large_part.py, reduced by a factor of its stiffness: of each rank the peak of its process,
libraries, mesh and machine included. Ranks need not have processors of their own, for no times are told.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import tempfile
from pathlib import Path

from benchmark import Report

MINUTES = 10.0
TIMED = False
PEERS: tuple[str, ...] = ()
DEMO = Path(__file__).resolve().parents[1] / "demos" / "large_part.py"
SIZES, RANKS = (50_000, 150_000, 300_000), (1, 2, 4)


def peaks(asked: int, ranks: int, folder: Path) -> tuple[int, list[float]]:
    """Degrees of freedom that there are, and the peak of each rank, GB."""
    command = [sys.executable, str(DEMO), str(asked)]
    command = ["mpirun", "--oversubscribe", "-n", str(ranks), *command] if ranks > 1 else command
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=True)
    dofs = re.search(r"(\d+) degrees of freedom", done.stdout)
    told = re.search(r"at the most, of each rank ([\d., ]+) GB", done.stdout)
    if dofs is None or told is None:
        raise RuntimeError(f"{DEMO} told no memory:\n{done.stdout}")
    return int(dofs[1]), [float(one) for one in told[1].split(", ")]


def measure(report: Report, sizes: tuple[int, ...], ranks: tuple[int, ...]) -> None:
    """All of them, a table and a picture."""
    report.table("dofs", "ranks", "largest of a rank, GB", "least of a rank, GB", "all, GB")
    found: dict[int, list[tuple[int, float]]] = {}
    with tempfile.TemporaryDirectory() as folder:
        for asked in sizes:
            for count in ranks:
                dofs, each = peaks(asked, count, Path(folder))
                report.say(f"| {dofs} | {count} | {max(each):.2f} | {min(each):.2f} | {sum(each):.2f} |")
                found.setdefault(count, []).append((dofs, max(each)))
    report.picture("rank_memory.png", lambda path: draw(found, path))


def draw(found: dict[int, list[tuple[int, float]]], path: Path) -> None:
    """The largest peak of a rank over the degrees of freedom, a line for each number of ranks."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.0, 3.6), layout="constrained")
    axes = figure.subplots()
    for (ranks, rows), marker in zip(found.items(), "os^Dv", strict=False):
        dofs, memory = zip(*rows, strict=True)
        label = "one rank" if ranks == 1 else f"{ranks} ranks"
        axes.plot([one / 1e3 for one in dofs], memory, marker=marker, label=label)
    axes.set(xlabel="thousand degrees of freedom", ylabel="largest memory of a rank, GB", ylim=(0.0, None))
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    axes.legend(frameon=False)
    figure.savefig(path, dpi=150)


def quick(report: Report) -> None:
    """A coarse case."""
    measure(report, (15_000,), (1, 2))


def full(report: Report) -> None:
    """Up to 300 000 degrees of freedom."""
    measure(report, SIZES, RANKS)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sizes", type=int, nargs="+", default=SIZES)
    parser.add_argument("--ranks", type=int, nargs="+", default=RANKS)
    parser.add_argument("--folder", type=Path, default=Path("out_rank_memory"), help="of the picture")
    given = parser.parse_args()
    given.folder.mkdir(exist_ok=True)
    measure(Report(given.folder), tuple(given.sizes), tuple(given.ranks))


if __name__ == "__main__":
    main()
