"""What benchmarks/reduction.py has measured: a file for each mesh, code and number of ranks, and what they say."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import results

#: Measurements that are kept, of several runs.
KEPT = results.RESULTS / "reduction"
OURS = "flexmbd"
# without a factor: slow, so that it is run only with all cores, on some meshes
ITERATIVE = "flexmbd, iterative"
# what each peer needs, and whether its modes are converged
CODES = {"exudyn, scipy": ("exudyn", "ngsolve"), "exudyn, NGSolve": ("exudyn", "ngsolve"), "NGSolve": ("ngsolve",)}
CONVERGED = ("exudyn, scipy", "NGSolve")
AGREEMENT = 1e-6
# dofs from which on growth is told; below them what is fixed has a share
LARGE = 15e3
# columns of the table, and what they are called by us and by the peers' processes
STAGES = {
    "K, M": ("assembly",), "factor": ("factor",), "static": ("static shapes", "static"),
    "loads": ("responses to loads",), "modes": ("modes",),
}  # fmt: skip

Row = dict[str, Any]


def path_of(row: Row, folder: Path) -> Path:
    """Where a measurement is kept."""
    code = row["code"].replace(", ", "_")
    return folder / f"{row['mesher']}_{row['size']}_{code}_{row['ranks']}.json"


def keep(row: Row, folder: Path) -> None:
    """Write a measurement, in the place of an earlier one."""
    folder.mkdir(parents=True, exist_ok=True)
    path_of(row, folder).write_text(json.dumps(row, indent=1) + "\n", encoding="utf-8")


def kept(folder: Path) -> list[Row]:
    """All measurements of a folder, by mesher, dofs, code and ranks."""
    rows = [json.loads(path.read_text(encoding="utf-8")) for path in sorted(folder.glob("*.json"))]
    return sorted(rows, key=lambda row: (row["mesher"], row["dofs"], row["code"], row["ranks"]))


HEAD = ("mesh", "dofs", "code", "ranks", *STAGES, "rest", "total", "geometric", "MB", "+ geometric")


def line(row: Row) -> str:
    """A row of the table: seconds by stage, what geometric stiffness adds, megabytes."""
    seconds, memory = row["seconds"], row["memory"]
    found = [_stage(row, column) for column in STAGES]
    rest = seconds["total"] - sum(s for s in found if s is not None)
    times = [*found, rest, seconds["total"], seconds.get("geometric")]
    cells = [row["mesher"], str(row["dofs"]), row["code"], str(row["ranks"])]
    cells += ["" if s is None else f"{s:.2f}" for s in times]
    cells += ["" if b is None else f"{b / 1e6:.0f}" for b in (memory["peak"], memory.get("geometric"))]
    return f"| {' | '.join(cells)} |"


def machines(rows: Iterable[Row]) -> str:
    """On which days and machines the rows were measured, and how loaded these were when each began."""
    loads: dict[str, list[float]] = {}
    for row in rows:
        where, load = row["machine"].split(", load ")
        loads.setdefault(where, []).append(float(load))
    return "; ".join(f"{where}, load {min(found)} to {max(found)}" for where, found in sorted(loads.items()))


def _stage(row: Row, column: str) -> float | None:
    found = [row["seconds"][name] for name in STAGES[column] if name in row["seconds"]]
    return sum(found) if found else None


def claims(rows: Sequence[Row]) -> Iterator[str]:
    """What the figures say, in ratios; whole seconds and megabytes are the machine's affair."""
    for row, mine in beside(rows):
        time = row["seconds"]["total"] / mine["seconds"]["total"]
        memory = mine["memory"]["peak"] / row["memory"]["peak"]
        where = f"{row['mesher']}'s mesh of {row['dofs']} dofs"
        yield f"{where}: {row['code']} takes {time:.1f} times as long; flexmbd's memory is {memory:.0%}"
    ours = {_mesh(row): row for row in rows if row["code"] == OURS and row["ranks"] == 1}
    both = {_mesh(row): row for row in rows if row["code"] == OURS and row["ranks"] == 2}
    for row in rows:
        where = f"{row['mesher']}'s mesh of {row['dofs']} dofs"
        if row["code"] == ITERATIVE and _mesh(row) in both:
            mine = both[_mesh(row)]
            time = row["seconds"]["total"] / mine["seconds"]["total"]
            memory = row["memory"]["peak"] / mine["memory"]["peak"]
            yield f"{where}: without a factor {time:.1f} times the time, {memory:.0%} of the memory"
    for mesh, row in ours.items():
        if mesh in both:
            speedup = row["seconds"]["total"] / both[mesh]["seconds"]["total"]
            yield f"{mesh[0]}'s mesh of {row['dofs']} dofs: two ranks are {speedup:.2f} times as fast as one"
        if "geometric" in row["seconds"]:
            share = row["seconds"]["geometric"] / row["seconds"]["total"]
            yield f"{mesh[0]}'s mesh of {row['dofs']} dofs: geometric stiffness takes {share:.0%} of the rest"


def beside(rows: Sequence[Row]) -> Iterator[tuple[Row, Row]]:
    """Each row of another program, and ours on one rank of the same mesh."""
    ours = {_mesh(row): row for row in rows if row["code"] == OURS and row["ranks"] == 1}
    return ((row, ours[_mesh(row)]) for row in rows if row["code"] in CODES and _mesh(row) in ours)


def growth(rows: Sequence[Row]) -> Iterator[str]:
    """Powers p of a fit c n^p to the large meshes."""
    for mesher, code, ranks in sorted({(row["mesher"], row["code"], row["ranks"]) for row in rows}):
        mine = [row for row in rows if (row["mesher"], row["code"], row["ranks"]) == (mesher, code, ranks)]
        mine = [row for row in mine if row["dofs"] > LARGE]
        if len(mine) < 2:
            continue
        values = {"time": [row["seconds"]["total"] for row in mine], "memory": [row["memory"]["peak"] for row in mine]}
        for column in STAGES:
            found = [_stage(row, column) for row in mine]
            values[column] = [one for one in found if one]
        dofs = [row["dofs"] for row in mine]
        powers = [f"{name} {power(dofs, y):.2f}" for name, y in values.items() if len(y) == len(mine)]
        whose = f"{mesher}'s meshes, {code}, {ranks} rank{'s' * (ranks > 1)}, {dofs[0]} to {dofs[-1]} dofs"
        yield f"{whose}, grow with the powers: {', '.join(powers)}"


def power(x: Iterable[float], y: Iterable[float]) -> float:
    """The slope of a straight line through the logarithms, by least squares."""
    return float(np.polyfit(np.log(list(x)), np.log(list(y)), 1)[0])


def disagreements(rows: Sequence[Row]) -> Iterator[str]:
    """Rows whose frequencies are not those of flexmbd on one rank, or on two where that was not run."""
    first: dict[tuple[str, str], Row] = {}
    for row in sorted(rows, key=lambda row: (row["code"] != OURS, row["ranks"])):
        ours = first.setdefault(_mesh(row), row)
        error = float(np.max(np.abs(np.divide(row["frequencies"], ours["frequencies"]) - 1.0)))
        text = f"{row['mesher']}'s mesh of {row['dofs']} dofs, {row['code']}, {row['ranks']} ranks: "
        text += f"frequencies differ by {error:.1e}"
        if row["code"] not in (OURS, ITERATIVE, *CONVERGED):
            print(f"{text}; its eigensolver stops before they are converged")
        elif not error <= AGREEMENT:
            yield text


def _mesh(row: Row) -> tuple[str, str]:
    return row["mesher"], row["size"]
