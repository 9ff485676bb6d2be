"""Full matrices as CalculiX stores them: *FREQUENCY, SOLVER=MATRIXSTORAGE writes job.sti, job.mas and job.dof."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.errors import ExportError
from flexmbd.export.superelements.full_matrices import Sparse, node_table
from flexmbd.files.whole_file import read_text
from flexmbd.given import checked

_DOF = re.compile(r"(\d{1,18})\.([123])", re.ASCII)


@checked(error=ExportError)
def read_matrix_storage(path: str | Path, nodes: ArrayLike) -> Sparse:
    """A full matrix that CalculiX stored, its rows as a node table has them, for `reduce_matrices`. Not collective.

    The file has a line ``row column value`` for each entry of the upper triangle; which displacement a row is stands
    in the file of the same name that ends in .dof, ``node.component`` a line. What is held in CalculiX has no rows:
    store the matrices of the free part.

    Args:
        path: job.sti, the stiffness, or job.mas, the mass; job.dof lies beside it.
        nodes: (k, 4) table: number, x, y, z.

    Returns:
        (3 k, 3 k) sparse.

    Raises:
        ExportError: a file is missing or damaged; or their displacements are not all those of the table's nodes.
    """
    import scipy.sparse

    path = Path(path)
    numbers, _ = node_table(nodes)
    dofs = path.with_suffix(".dof")
    places = _places(read_text(dofs), numbers, dofs)
    try:
        rows, columns, values = _entries(read_text(path), len(places))
    except (ValueError, OverflowError) as error:
        raise ExportError(f"{path}: {error}") from error
    i, j = places[rows], places[columns]
    off = i != j
    entries = np.append(values, values[off]), (np.append(i, j[off]), np.append(j, i[off]))
    return scipy.sparse.csr_array(entries, shape=(len(places), len(places)))


def _places(text: str, numbers: NDArray[np.int64], path: Path) -> NDArray[np.int64]:
    """The row of the node table for each row of the matrices."""
    first = {int(number): 3 * place for place, number in enumerate(numbers)}
    found: list[int] = []
    for line in text.split():
        dof = _DOF.fullmatch(line)
        if dof is None or int(dof[1]) not in first:
            raise ExportError(f"{path}: {line[:40]!r} is not the displacement of a node of the table, node.component")
        found.append(first[int(dof[1])] + int(dof[2]) - 1)
    missing = set(range(3 * len(numbers))) - set(found)
    if missing:
        place = min(missing)
        raise ExportError(
            f"{path} has no row for component {place % 3 + 1} of node {numbers[place // 3]}: what is held in CalculiX "
            "is left out; store the matrices without supports and constraints, and leave nodes of no element out of "
            "the table"
        )
    if len(found) != 3 * len(numbers):
        raise ExportError(f"{path}: {len(found)} rows for {3 * len(numbers)} displacements; one is there twice")
    return np.array(found, dtype=np.int64)


def _entries(text: str, size: int) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    """Rows and columns, from 0, and values of the upper triangle."""
    words = text.split()
    if len(words) % 3:
        raise ValueError("its lines are not `row column value`")
    table = np.array(words, dtype=np.float64).reshape(-1, 3)
    places, values = table[:, :2], table[:, 2]
    if not np.isfinite(table).all() or (places != places.round()).any():
        raise ValueError("its lines are not `row column value`, of finite numbers")
    if len(places) == 0 or places.min() < 1 or places.max() > size or (places[:, 0] > places[:, 1]).any():
        raise ValueError(f"it has entries outside the upper triangle of {size} rows, which its .dof file has")
    rows, columns = places.astype(np.int64).T - 1
    if len(np.unique(rows * size + columns)) < len(rows):
        raise ValueError("an entry is there twice")
    if np.count_nonzero(rows == columns) < size:
        raise ValueError("diagonal entries are missing: the file is cut short")
    return rows, columns, values
