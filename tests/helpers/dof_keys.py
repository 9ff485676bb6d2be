"""Names for all dofs of a model that no partition changes, and its matrices in their order."""

from __future__ import annotations

from typing import Any

import numpy as np
from full_model import gather

FloatArray = np.ndarray


def keys(model: Any) -> FloatArray:
    """(local dofs, 5): the first of its field's components, its place, its component in the field."""
    found = np.empty((model.layout.n_local, 5))
    for field in model.layout.fields:
        x = field.space.tabulate_dof_coordinates()
        size = field.space.dofmap.index_map_bs
        found[field.dofs, 0] = field.components.start
        found[field.dofs, 1:4] = np.repeat(x, size, axis=0)
        found[field.dofs, 4] = np.tile(np.arange(size), len(x))
    return found


def everywhere(model: Any, rows: FloatArray) -> FloatArray:
    """Rows (owned dofs, ...) of all ranks, in an order that no partition changes. Collective."""
    return np.concatenate(model.comm.allgather(rows[: model.n_owned]))[_order(model)]


def matrix(model: Any, which: Any) -> FloatArray:
    """A PETSc matrix of the model, dense, in that order, on every rank. Collective."""
    order = _order(model)
    return gather(which).toarray()[np.ix_(order, order)]


def _order(model: Any) -> np.ndarray:
    every = np.concatenate(model.comm.allgather(keys(model)[: model.n_owned]))
    return np.lexsort(np.round(every, 9).T[::-1])
