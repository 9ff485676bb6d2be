"""Craig-Bampton reduction of a beam of solids: time and memory against exudyn and NGSolve.

    ./run python benchmarks/reduction.py                       # 5 000 to 300 000 dofs, some 25 minutes on two cores
    ./run python benchmarks/reduction.py --sizes 600k 1M --codes flexmbd --ranks 2     # larger ones, one by one
    ./run python benchmarks/reduction.py --show                # table, growth and picture of all that is kept
    ./run python benchmarks/reduction.py --quick               # the smallest mesh, nothing is kept
    ./run pip install -e .[benchmark]                          # exudyn and NGSolve, else their rows are left out

A box of 1 x 0.05 x 0.05 m in ten-node tetrahedra, both ends rigid, body frame on one of them: 19 modes,
6 static and 13 fixed-interface ones. All codes get the same tetrahedra, of gmsh and of NETGEN, in memory before the
clock starts. Each measurement is a process of its own with one thread a rank; compiled forms are in the cache. Time is
from the mesh to the reduced basis, of flexmbd to the record, its modes counted. Memory is the peak of the process, of
all ranks together, its libraries and the mesh included. The frequencies of the reduced bodies must agree to 1e-6.

"flexmbd, iterative" takes conjugate gradients with multigrid in the factor's place, which saves memory alone; its
column "factor" is the making of the multigrid levels.

Each measurement is kept as a file in benchmarks/results/reduction, in the place of an earlier one of its kind;
`./run python -m benchmarks reduction` measures what this state has not yet, and writes the page of all.
"""

from __future__ import annotations

import argparse
import importlib.util
import itertools
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import reduction_case as case
import reduction_picture
import reduction_rows as kept_rows
import results
from benchmark import Report
from reduction_rows import CODES, ITERATIVE, KEPT, OURS, Row

HERE = Path(__file__).resolve().parent
PATIENCE = 3600.0
MINUTES = 25.0
PEERS: tuple[str, ...] = ("exudyn", "ngsolve")


@dataclass(frozen=True)
class Case:
    """A measurement: which mesh, by what, on how many ranks."""

    mesher: str
    size: str
    code: str
    ranks: int

    @property
    def repeats(self) -> int:
        """Of which the quickest counts."""
        return {"5k": 3, "19k": 3, "63k": 2}.get(self.size, 1)


def main() -> int:
    arguments = _arguments()
    arguments.output.mkdir(parents=True, exist_ok=True)
    report = Report(arguments.output)
    if arguments.quick:
        quick(report)
        return 0
    if not arguments.show:
        wanted = list(
            _cases(arguments.sizes, meshers=arguments.meshers, codes=arguments.codes, ranks=arguments.ranks)
        )
        for row in _measured(wanted, arguments.output):
            kept_rows.keep(row, KEPT)
    _tell(kept_rows.kept(KEPT), report)
    return 0


def quick(report: Report) -> None:
    """The smallest mesh of gmsh, flexmbd on one rank and on two and NGSolve, each once."""
    wanted = [Case("gmsh", "5k", OURS, 1), Case("gmsh", "5k", OURS, 2)]
    wanted += [Case("gmsh", "5k", "NGSolve", 1) for _ in range("NGSolve" in _peers())]
    _tell(list(_measured(wanted, report.folder, repeats=1)), report)


def full(report: Report) -> None:
    """What this state of the checkout has not measured yet; told of all that is kept."""
    commit = results.setting(()).commit
    there = {
        kept_rows.path_of(row, KEPT)
        for row in kept_rows.kept(KEPT)
        if row["commit"] == commit and not commit.endswith("+")
    }
    every = _cases(case.FULL, meshers=case.MESHERS, codes=None, ranks=(1, 2))
    wanted = [one for one in every if kept_rows.path_of(vars(one), KEPT) not in there]
    for row in _measured(wanted, report.folder):
        kept_rows.keep(row, KEPT)
    _tell(kept_rows.kept(KEPT), report)


def _tell(rows: list[Row], report: Report) -> None:
    """Table, ratios, picture; ends where converged frequencies disagree."""
    if not rows:
        raise SystemExit("nothing was measured")
    for commit, same in itertools.groupby(sorted(rows, key=lambda row: row["commit"]), lambda row: row["commit"]):
        report.say(f"State {commit}: {kept_rows.machines(same)}")
    report.say()
    report.table(*kept_rows.HEAD)
    for row in rows:
        report.say(kept_rows.line(row))
    report.say()
    for claim in (*kept_rows.claims(rows), *kept_rows.growth(rows)):
        report.say(f"- {claim}")
    for row, mine in kept_rows.beside(rows):
        name = f"beam of {row['dofs']} dofs, {row['mesher']}"
        theirs, ours = (one["seconds"]["total"] for one in (row, mine))
        report.beside(name, task="Craig-Bampton reduction, 20 modes", peer=row["code"], theirs=theirs, ours=ours)
    report.picture("reduction_benchmark.png", partial(reduction_picture.draw, rows))
    faults = list(kept_rows.disagreements(rows))
    if faults:
        raise SystemExit("; ".join(faults))
    report.say(f"All converged frequencies agree to {kept_rows.AGREEMENT:.0e}.")


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="the smallest mesh only, each once; nothing is kept")
    parser.add_argument("--sizes", nargs="+", choices=tuple(case.CELL_SIZE), default=case.FULL, help="about the dofs")
    parser.add_argument("--meshers", nargs="+", choices=case.MESHERS, default=case.MESHERS)
    parser.add_argument("--codes", nargs="+", choices=(OURS, ITERATIVE, *CODES), help="default: each where it can")
    parser.add_argument("--ranks", nargs="+", type=int, default=(1, 2), help="of flexmbd")
    parser.add_argument("--output", type=Path, default=Path("out_reduction"), metavar="FOLDER", help="meshes, picture")
    parser.add_argument("--show", action="store_true", help="nothing is measured")
    return parser.parse_args()


def _cases(
    sizes: Iterable[str], *, meshers: Sequence[str], codes: Sequence[str] | None, ranks: Sequence[int]
) -> Iterator[Case]:
    """What can be measured here, small meshes first; codes that are named also on meshes that are large for them."""
    peers = _peers()
    for size, mesher in itertools.product(sorted(sizes, key=list(case.CELL_SIZE).index), meshers):
        for code in (OURS, ITERATIVE, *peers):
            if codes is not None and code not in codes:
                continue
            if code == OURS:
                yield from (Case(mesher, size, code, number) for number in ranks)
            elif code == ITERATIVE:
                if codes is not None or size in case.ITERATED:
                    yield Case(mesher, size, code, max(ranks))
            elif codes is not None or size in case.COMPARED:
                yield Case(mesher, size, code, 1)


def _peers() -> list[str]:
    found = []
    for peer, needed in CODES.items():
        missing = [name for name in needed if importlib.util.find_spec(name) is None]
        if missing:
            print(f"{peer} is left out: no {', '.join(missing)} here; ./run pip install -e .[benchmark] brings it")
        else:
            found.append(peer)
    return found


def _measured(cases: Sequence[Case], folder: Path, *, repeats: int | None = None) -> Iterator[Row]:
    """The rows, printed as they come."""
    print(f"| {' | '.join(kept_rows.HEAD)} |", flush=True)
    warm = False
    for one in cases:
        mesh = _mesh_file(one, folder)
        if mesh is None:
            continue
        if not warm:
            _run(OURS, mesh, "geometric")  # once for nothing, so that every form is compiled
            warm = True
        row = _least(one, mesh, repeats=one.repeats if repeats is None else repeats)
        if row is not None:
            print(kept_rows.line(row), flush=True)
            yield row


def _mesh_file(one: Case, folder: Path) -> Path | None:
    """The mesh, made where it is not there; None where its mesher is not here."""
    path = folder / f"{one.mesher}_{one.size}.npz"
    if path.exists():
        return path
    if one.mesher == "netgen" and importlib.util.find_spec("netgen") is None:
        print(f"NETGEN's mesh of {one.size} is left out: ./run pip install -e .[benchmark] brings NETGEN", flush=True)
        return None
    try:
        case.make_mesh(one.mesher, case.CELL_SIZE[one.size], path)
    except subprocess.CalledProcessError as error:
        print(f"{one.mesher}'s mesh of {one.size} is left out: {error.stderr[-300:]}", flush=True)
        return None
    return path


def _least(one: Case, mesh: Path, *, repeats: int) -> Row | None:
    """The quickest of several measurements; of ours with the cost of geometric stiffness beside it."""
    more = ["iterative"] if one.code == ITERATIVE else []
    setting = results.setting(())
    row = _quickest(one, mesh, *more, repeats=repeats)
    if row is None:
        return None
    row.update(vars(one), commit=setting.commit, machine=f"{setting.date}, {setting.machine}, load {setting.load:.1f}")
    if one.code == OURS:
        whole = _quickest(one, mesh, "geometric", repeats=repeats)
        if whole is not None:
            row["seconds"]["geometric"] = max(whole["seconds"]["total"] - row["seconds"]["total"], 0.0)
            row["memory"]["geometric"] = whole["memory"]["peak"]
    return row


def _quickest(one: Case, mesh: Path, *more: str, repeats: int) -> Row | None:
    runs = [_run(one.code, mesh, *more, ranks=one.ranks) for _ in range(repeats)]
    there = [run for run in runs if run is not None]
    return min(there, key=lambda run: run["seconds"]["total"]) if len(there) == repeats else None


def _run(code: str, mesh: Path, *more: str, ranks: int = 1) -> Row | None:
    """One measurement in processes of its own; None where it fails, which is said."""
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.json"
        own = code in (OURS, ITERATIVE)
        worker = [sys.executable, str(HERE / ("reduction_flexmbd.py" if own else "reduction_peers.py"))]
        command = [*worker, *([] if own else [code]), str(mesh), str(report), *more]
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
            print(f"{code} on {mesh.stem} and {ranks} ranks failed: {failure or 'no report'}", flush=True)
            return None
        result: Row = json.loads(report.read_text())
        return result


if __name__ == "__main__":
    sys.exit(main())
