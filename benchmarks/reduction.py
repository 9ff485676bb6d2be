"""Craig-Bampton reduction of a beam of solids: time and memory against exudyn and NGSolve.

    ./run python benchmarks/reduction.py              # all sizes, 12 to 15 minutes on two cores
    ./run python benchmarks/reduction.py --quick      # two small meshes, about a minute
    ./run pip install -e .[benchmark]                 # exudyn and NGSolve, without which their rows are left out

A box of 1 x 0.05 x 0.05 m in ten-node tetrahedra, both ends rigid, body frame on one of them: 20 modes,
6 static and 14 fixed-interface ones. All codes get the same tetrahedra (gmsh's, or those of files of
vertices and ten-node cells, `--meshes`), in memory before the clock starts. Each measurement is a
process of its own with one thread a rank; compiled forms are in the cache. Time is from the mesh to the
reduced basis, of flexmbd to the record. Memory is the peak of the process, of all ranks together, its
libraries and the mesh included. The frequencies of the reduced bodies must agree to 1e-6.

"flexmbd, iterative" takes conjugate gradients with multigrid in the factor's place, which saves memory alone; its
column "factor" is the making of the multigrid levels.

Writes out_reduction/results.json, docs/pictures/reduction_benchmark.png (not with --quick), and a table.
"""

from __future__ import annotations

import argparse
import datetime as dt
import importlib.metadata
import importlib.util
import itertools
import json
import os
import platform
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import reduction_case as case
import reduction_picture
from benchmark import Report

HERE = Path(__file__).resolve().parent
OURS = "flexmbd"
# without a factor: slow, so that it is run only with all cores, on some meshes
ITERATIVE = "flexmbd, iterative"
# what each peer needs, and whether its modes are converged
CODES = {"exudyn, scipy": ("exudyn", "ngsolve"), "exudyn, NGSolve": ("exudyn", "ngsolve"), "NGSolve": ("ngsolve",)}
CONVERGED = ("exudyn, scipy", "NGSolve")
AGREEMENT = 1e-6
PATIENCE = 900.0
MINUTES = 15.0
PEERS: tuple[str, ...] = ("exudyn", "ngsolve")
# dofs of a mesh that is no small one
MANY = 30e3

STAGES = ("assembly", "factor", "static", "modes")


@dataclass(frozen=True)
class Mesh:
    """A mesh file; whether the peers reduce it too; whether it is reduced without a factor as well."""

    path: Path
    dofs: int
    compared: bool
    iterated: bool = False


def main() -> int:
    arguments = _arguments()
    arguments.output.mkdir(parents=True, exist_ok=True)
    file = arguments.output / "results.json"
    if not arguments.redraw:
        measured: dict[str, Any] = {"machine": _machine(), "rows": []}
        for row in _measure(arguments):
            measured["rows"].append(row)
            # after each, so that --redraw shows what a run that is stopped has measured
            file.write_text(json.dumps(measured, indent=1))
    results = json.loads(file.read_text())
    results["rows"].sort(key=lambda row: row["dofs"])
    print(f"\n{results['machine']}\n")
    _tell(results["rows"], Report(arguments.output))
    return 0


def quick(report: Report) -> None:
    """The smallest mesh, flexmbd on one rank and on two and NGSolve, each once."""
    mesh = min(_meshes(argparse.Namespace(quick=True, meshes=None, output=report.folder)), key=lambda mesh: mesh.dofs)
    wanted = [(OURS, 1), (OURS, 2), *(("NGSolve", 1) for _ in range("NGSolve" in _peers()))]
    rows = (_least(code, mesh, repeats=1, ranks=ranks) for code, ranks in wanted)
    _tell([row for row in rows if row is not None], report)


def full(report: Report) -> None:
    """All meshes."""
    rows = list(_measure(argparse.Namespace(quick=False, meshes=None, output=report.folder)))
    _tell(sorted(rows, key=lambda row: row["dofs"]), report)


def _tell(rows: list[dict[str, Any]], report: Report) -> None:
    """Table, ratios, picture; ends where converged frequencies disagree."""
    report.say(_table(rows))
    report.say()
    for claim in _claims(rows):
        report.say(f"- {claim}")
    report.picture("reduction_benchmark.png", partial(reduction_picture.draw, rows))
    faults = list(_disagreements(rows))
    if faults:
        raise SystemExit("; ".join(faults))
    report.say(f"All converged frequencies agree to {AGREEMENT:.0e}.")


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="the two smallest meshes only, each once")
    parser.add_argument("--meshes", type=Path, metavar="FOLDER", help="compare on the .npz files in a folder instead")
    parser.add_argument("--output", type=Path, default=Path("out_reduction"), metavar="FOLDER", help="of the results")
    parser.add_argument("--redraw", action="store_true", help="table and picture of the last results, nothing measured")
    return parser.parse_args()


def _measure(arguments: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """All rows, printed as they come."""
    peers = _peers()
    meshes = sorted(_meshes(arguments), key=lambda mesh: mesh.dofs)
    # once for nothing, so that every form is compiled
    _least(OURS, meshes[0], repeats=1, ranks=1)
    for mesh in meshes:
        repeats = 1 if arguments.quick or mesh.dofs > 100e3 else 3 if mesh.dofs < MANY else 2
        wanted = [(OURS, 1), (OURS, 2), *((peer, 1) for peer in peers if mesh.compared)]
        rows = (_least(code, mesh, repeats=repeats, ranks=ranks) for code, ranks in wanted)
        yield from (row for row in rows if row is not None)
    rows = (_least(ITERATIVE, mesh, repeats=1, ranks=2) for mesh in meshes if mesh.iterated)
    yield from (row for row in rows if row is not None)


def _peers() -> list[str]:
    found = []
    for peer, needed in CODES.items():
        missing = [name for name in needed if importlib.util.find_spec(name) is None]
        if missing:
            print(f"{peer} is left out: no {', '.join(missing)} here; ./run pip install -e .[benchmark] brings it")
        else:
            found.append(peer)
    return found


def _meshes(arguments: argparse.Namespace) -> Iterator[Mesh]:
    sizes = [size for size in case.CELL_SIZE if size in (case.QUICK if arguments.quick else case.FULL)]
    if arguments.meshes is not None:
        files = sorted(arguments.meshes.glob("*.npz"))
        if not files:
            raise SystemExit(f"{arguments.meshes}: no .npz file with `points` and `tet10`, or `tetrahedra`, is there")
        counts = [case.count_dofs(path) for path in files]
        given = [
            Mesh(path, dofs, True, iterated=dofs > MANY and not arguments.quick)
            for path, dofs in zip(files, counts, strict=True)
        ]
        yield from (mesh for mesh in given if not arguments.quick or mesh.dofs < MANY)
        sizes = [size for size in sizes if size not in case.COMPARED]
    for size in sizes:
        path = arguments.output / f"beam_{size}.npz"
        case.make_mesh(case.CELL_SIZE[size], path)
        iterated = case.QUICK[:1] if arguments.quick else case.ITERATED
        yield Mesh(path, case.count_dofs(path), size in case.COMPARED, size in iterated)


def _least(code: str, mesh: Mesh, *, repeats: int, ranks: int = 1) -> dict[str, Any] | None:
    """The quickest of several measurements; of ours with the cost of geometric stiffness beside it."""
    more = ["iterative"] if code == ITERATIVE else []
    runs = [_run(code, mesh, *more, ranks=ranks) for _ in range(repeats)]
    if None in runs:
        return None
    row = min((run for run in runs if run), key=lambda run: run["seconds"]["total"])
    row["code"] = code
    if code == OURS:
        whole = [_run(code, mesh, "geometric", ranks=ranks) for _ in range(repeats)]
        if None not in whole:
            row["seconds"]["geometric"] = min(run["seconds"]["geometric"] for run in whole if run)
            row["memory"]["geometric"] = max(run["memory"]["peak"] for run in whole if run)
    print(_line(row), flush=True)
    return row


def _run(code: str, mesh: Mesh, *more: str, ranks: int = 1) -> dict[str, Any] | None:
    """One measurement in processes of its own; None where it fails, which is said."""
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.json"
        own = code in (OURS, ITERATIVE)
        worker = [sys.executable, str(HERE / ("reduction_flexmbd.py" if own else "reduction_peers.py"))]
        command = [*worker, *([] if own else [code]), str(mesh.path), str(report), *more]
        if ranks > 1:
            command = ["mpirun", "-n", str(ranks), *command]
        one_thread = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
        try:
            done = subprocess.run(
                command, env={**os.environ, **one_thread}, capture_output=True, text=True, timeout=PATIENCE
            )
            failure = done.stderr[-2000:] if done.returncode else ""
        except subprocess.TimeoutExpired:
            failure = f"stopped after {PATIENCE:.0f} s"
        if failure or not report.exists():
            print(f"{code} on {mesh.dofs} dofs and {ranks} ranks failed: {failure or 'no report'}", flush=True)
            return None
        result: dict[str, Any] = json.loads(report.read_text())
        return result


HEAD = "| dofs | code | ranks | K, M | factor | static | modes | rest | total | geometric | memory | + geometric |"


def _table(rows: Sequence[dict[str, Any]]) -> str:
    """In markdown; seconds and MB."""
    rule = "|" + "---|" * (HEAD.count("|") - 1)
    return "\n".join([HEAD, rule, *map(_line, rows)])


def _line(row: dict[str, Any]) -> str:
    seconds, memory = row["seconds"], row["memory"]
    rest = seconds["total"] - sum(seconds.get(stage, 0.0) for stage in STAGES)
    times = [*(seconds.get(stage) for stage in STAGES), rest, seconds["total"], seconds.get("geometric")]
    cells = [str(row["dofs"]), row["code"], str(row["ranks"]), *("" if s is None else f"{s:.2f}" for s in times)]
    cells += ["" if b is None else f"{b / 1e6:.0f}" for b in (memory["peak"], memory.get("geometric"))]
    return f"| {' | '.join(cells)} |"


def _claims(rows: Sequence[dict[str, Any]]) -> Iterator[str]:
    """What the figures say, in ratios; whole seconds and megabytes are the machine's affair."""
    ours = {row["dofs"]: row for row in rows if row["code"] == OURS and row["ranks"] == 1}
    for row in rows:
        if row["code"] in CODES and row["dofs"] in ours:
            mine = ours[row["dofs"]]
            time = row["seconds"]["total"] / mine["seconds"]["total"]
            memory = mine["memory"]["peak"] / row["memory"]["peak"]
            yield f"{row['dofs']} dofs: {row['code']} takes {time:.1f} times as long; flexmbd's memory is {memory:.0%}"
    for dofs, row in ours.items():
        seconds = row["seconds"]
        if "geometric" in seconds:
            yield f"{dofs} dofs: geometric stiffness takes {seconds['geometric'] / seconds['total']:.0%} of the rest"
    both = {row["dofs"]: row for row in rows if row["code"] == OURS and row["ranks"] == 2}
    for row in rows:
        if row["code"] == ITERATIVE and row["dofs"] in both:
            mine = both[row["dofs"]]
            time = row["seconds"]["total"] / mine["seconds"]["total"]
            memory = row["memory"]["peak"] / mine["memory"]["peak"]
            yield f"{row['dofs']} dofs: without a factor {time:.0f} times the time, {memory:.0%} of the memory"
    for dofs in sorted(ours.keys() & both.keys()):
        speedup = ours[dofs]["seconds"]["total"] / both[dofs]["seconds"]["total"]
        yield f"{dofs} dofs: two ranks are {speedup:.2f} times as fast as one"
    sizes = sorted(ours)
    for low, high in itertools.pairwise(sizes):
        powers = [
            np.log(ours[high]["seconds"][stage] / ours[low]["seconds"][stage]) / np.log(high / low)
            for stage in ("total", "factor")
        ]
        yield f"from {low} to {high} dofs: the time grows with the power {powers[0]:.2f}, the factor's {powers[1]:.2f}"


def _disagreements(rows: Sequence[dict[str, Any]]) -> Iterator[str]:
    """Rows whose frequencies are not those of flexmbd on one rank; methods that stop early are only shown."""
    first = {row["dofs"]: row for row in rows if row["code"] == OURS and row["ranks"] == 1}
    for row in rows:
        if row["dofs"] not in first:
            yield f"{row['dofs']} dofs: flexmbd has no result"
            continue
        ours = first[row["dofs"]]
        error = float(np.max(np.abs(np.divide(row["frequencies"], ours["frequencies"]) - 1.0)))
        text = f"{row['dofs']} dofs, {row['code']}, {row['ranks']} ranks: frequencies differ by {error:.1e}"
        if row["code"] not in (OURS, ITERATIVE, *CONVERGED):
            print(f"{text}; its eigensolver stops before they are converged")
        elif not error <= AGREEMENT:
            yield text


def _machine() -> str:
    names = ("fenics-dolfinx", "exudyn", "ngsolve", "numpy", "scipy")
    versions = [f"{name} {importlib.metadata.version(name)}" for name in names if _has(name)]
    cpus = [line.partition(":")[2].strip() for line in _cpu_lines() if line.startswith("model name")]
    day = dt.date.today().isoformat()
    return f"{day}, {cpus[0] if cpus else platform.machine()}, {os.cpu_count()} cores; {', '.join(versions)}"


def _cpu_lines() -> list[str]:
    path = Path("/proc/cpuinfo")
    return path.read_text().splitlines() if path.exists() else []


def _has(name: str) -> bool:
    try:
        importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return False
    return True


if __name__ == "__main__":
    sys.exit(main())
