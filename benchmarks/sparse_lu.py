"""LU factors of sparse matrices of blocks beside SciPy's SuperLU and, where kvxopt is installed, KLU: in turns.

Lattices of masses with two unknowns, chains of blocks of nine, and ladders: two such chains with rungs, and a body that
all blocks are coupled with. Times are processor times, the least of several turns: the pattern (once for a machine), a
factorisation with a known pattern (SuperLU orders anew each time; KLU refactors) and a solution.

    ./run python benchmarks/sparse_lu.py
"""

from __future__ import annotations

import importlib
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import scipy.sparse
import scipy.sparse.linalg
from benchmark import Report

from flexmbd.multibody.kernels.sparse.block_lu import clear, factor_sparse, new_block_matrix, solve_sparse
from flexmbd.multibody.kernels.sparse.block_pattern import BlockPattern, new_block_pattern

MINUTES = 1.0
PEERS = ("kvxopt",)
TURNS = 5


def lattice(nx: int, ny: int) -> tuple[np.ndarray, np.ndarray]:
    """Sizes and pairs of blocks, each coupled with its four neighbours."""
    node = np.arange(nx * ny).reshape(nx, ny)
    along = np.stack((node[:-1].ravel(), node[1:].ravel()), axis=1)
    across = np.stack((node[:, :-1].ravel(), node[:, 1:].ravel()), axis=1)
    return np.full(nx * ny, 2), np.concatenate((along, across))


def chain(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Blocks of nine, one after the other."""
    return np.full(count, 9), np.stack((np.arange(count - 1), np.arange(1, count)), axis=1)


def ladder(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Two chains of blocks of six with rungs, and one block more that all are coupled with."""
    sizes, pairs = lattice(count, 2)
    border = np.stack((np.arange(2 * count), np.full(2 * count, 2 * count)), axis=1)
    return np.full(len(sizes) + 1, 6), np.concatenate((pairs, border))


def random_matrix(pattern: BlockPattern) -> tuple[scipy.sparse.csc_matrix, np.ndarray, np.ndarray]:
    """A regular matrix of a pattern; its values and where they stand."""
    random = np.random.default_rng(0)
    size = np.diff(pattern.first)
    block = np.repeat(np.arange(len(size)), np.diff(pattern.entry_at))
    rows, columns, places = [], [], []
    for q, (i, j) in enumerate(zip(block, pattern.column, strict=True)):
        r, c = np.indices((size[i], size[j]))
        rows.append((pattern.first[i] + r).ravel())
        columns.append((pattern.first[j] + c).ravel())
        places.append((pattern.offset[q] + r * pattern.stride[q] + c).ravel())
    row, column = np.concatenate(rows), np.concatenate(columns)
    values = random.standard_normal(len(row))
    values[row == column] += 8.0
    shape = (pattern.unknowns, pattern.unknowns)
    return scipy.sparse.csc_matrix((values, (row, column)), shape=shape), values, np.concatenate(places)


def turns(*tasks: Callable[[], object]) -> list[float]:
    """The least processor time (s) of each task."""
    least = [np.inf] * len(tasks)
    for _ in range(TURNS):
        for k, task in enumerate(tasks):
            begin = time.process_time()
            task()
            least[k] = min(least[k], time.process_time() - begin)
    return least


def klu_tasks(matrix: scipy.sparse.csc_matrix, right: np.ndarray) -> list[Callable[[], object]]:
    """KLU's factorisation and solution; none without it."""
    try:
        kvxopt, klu = importlib.import_module("kvxopt"), importlib.import_module("kvxopt.klu")
    except ImportError:
        return []
    entries = matrix.tocoo()
    sparse = kvxopt.spmatrix(entries.data, entries.row.astype(int), entries.col.astype(int), matrix.shape)
    symbolic = klu.symbolic(sparse)
    numeric = klu.numeric(sparse, symbolic)
    column = kvxopt.matrix(right)
    return [
        lambda: klu.numeric(sparse, symbolic),
        lambda: klu.solve(sparse, symbolic, numeric, column),
    ]


def measure(report: Report, name: str, sizes: np.ndarray, pairs: np.ndarray) -> None:
    """Say a row of the table."""
    begin = time.process_time()
    pattern = new_block_pattern(sizes, pairs)
    ordering = time.process_time() - begin
    sparse, values, places = random_matrix(pattern)
    matrix, right = new_block_matrix(pattern), np.ones((1, pattern.unknowns))

    def assemble() -> None:
        clear(matrix)
        matrix.values[places] = values

    def factor_super() -> scipy.sparse.linalg.SuperLU:
        return scipy.sparse.linalg.splu(
            sparse, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.01, options={"SymmetricMode": True}
        )

    other = factor_super()
    peers = klu_tasks(sparse, np.ones(pattern.unknowns))
    _, own, of_super, *of_klu = turns(assemble, lambda: factor_sparse(pattern, matrix), factor_super, *peers[:1])
    solution, of_super_solution, *of_klu_solution = turns(
        lambda: solve_sparse(pattern, matrix, right.copy()), lambda: other.solve(right[0]), *peers[1:]
    )
    found = right.copy()
    solve_sparse(pattern, matrix, found)
    if abs(sparse @ found[0] - 1.0).max() > 1e-10:
        raise RuntimeError(f"{name}: the solution is wrong")
    times = [own, of_super, *of_klu, solution, of_super_solution, *of_klu_solution]
    cells = [f"{1e3 * one:.3g}" for one in times]
    report.say(
        f"| {name} | {pattern.unknowns} | {1e3 * ordering:.3g} | {pattern.operations:.3g} | {pattern.fill} | "
        + " | ".join(cells)
        + " |"
    )


def run(report: Report, cases: dict[str, tuple[np.ndarray, np.ndarray]]) -> None:
    """Measure cases by their names."""
    peers = ["ours", "SuperLU", *(["KLU"] if klu_tasks(scipy.sparse.eye(2, format="csc"), np.ones(2)) else [])]
    heads = [f"{what} (ms), {peer}" for what in ("factor", "solve") for peer in peers]
    report.table("matrix", "unknowns", "pattern (ms)", "operations", "entries", *heads)
    for name, (sizes, pairs) in cases.items():
        measure(report, name, sizes, pairs)


def quick(report: Report) -> None:
    run(report, {"lattice 72 x 6": lattice(72, 6), "chain of 30": chain(30), "ladder of 10": ladder(10)})


def full(report: Report) -> None:
    lattices = {f"lattice {nx} x {ny}": lattice(nx, ny) for nx, ny in ((72, 6), (72, 24), (300, 100))}
    chains = {f"chain of {n}": chain(n) for n in (30, 300, 3000)}
    ladders = {f"ladder of {n}": ladder(n) for n in (10, 100, 1000)}
    run(report, {**lattices, **chains, **ladders})


if __name__ == "__main__":
    full(Report(Path(".")))
