"""The bare record as numpy arrays in one .npz, for whoever has numpy and not HDF5.

The members are the datasets of docs/record.md, their paths with "/"; texts are unicode arrays.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from flexmbd.errors import ExportError, RecordError
from flexmbd.export.loss import Capabilities, check_body, checked_writer
from flexmbd.files.archive import read_archive, write_archive
from flexmbd.files.tree_file import Tree
from flexmbd.given import checked
from flexmbd.record.reduced_body import ReducedBody

CAPABILITIES = Capabilities(
    nodal_interfaces=True, gyroscopic=True, ports=True, stiffening=True, nodes=True, stress=True, unknowns=True,
    nonlinear=True, loads=True, heat=True, contact=True,
)  # fmt: skip


@checked_writer
def npz(body: ReducedBody, path: str | Path, *, lossy: bool = False) -> tuple[str, ...]:
    """Write the whole record as an archive of arrays (.npz), without pickles. Not collective.

    Args:
        body: any reduced body.
        path: destination.
        lossy: as of all formats; this one loses nothing.

    Returns:
        The parts that are not in the file: none.

    Raises:
        ExportError: the destination cannot be written.
    """
    check_body(body)
    write_archive(path, dict(_flat(body.tree(), "")))
    return ()


@checked(error=ExportError)
def read_npz(path: str | Path) -> ReducedBody:
    """Read a file of `npz`, bit for bit. Not collective.

    Raises:
        ExportError: the file is missing, damaged, or holds something else.
    """
    arrays = read_archive(path)
    tree: Tree = {}
    try:
        for name, array in arrays.items():
            *folders, last = name.split("/")
            place = tree
            for folder in folders:
                place = place.setdefault(folder, {})
            place[last] = _value(array)
        tree.setdefault("provenance", {})  # an empty folder leaves no trace in an archive
        return ReducedBody.from_tree(tree)
    except (KeyError, TypeError, ValueError, AttributeError, RecordError) as error:
        raise ExportError(f"{path} does not hold the arrays of a reduced body: {error}") from error


def _flat(tree: Tree, where: str) -> list[tuple[str, Any]]:
    items: list[tuple[str, Any]] = []
    for key, value in tree.items():
        if isinstance(value, dict):
            items += _flat(value, f"{where}{key}/")
        else:
            items.append((f"{where}{key}", value if isinstance(value, np.ndarray) else np.array(value, dtype=str)))
    return items


def _value(array: Any) -> Any:
    if array.dtype.kind != "U":
        return array
    return array.item() if array.ndim == 0 else tuple(array.tolist())
