"""Whether dofs that are held keep a body from moving as a rigid one, by its geometry alone.

A connected elastic body whose rigid motions all move some held dof has a regular stiffness. That is known before
anything is factorised; what round-off leaves of a singular factor tells nothing.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.finite_elements.linear_model import LinearModel
from flexmbd.continuum.grid.pieces import pieces
from flexmbd.continuum.matrices.blocks import FloatArray, total

#: Relative size below which a rigid motion leaves dofs at rest; found from squares, whose rounding is that of 1e-8.
AT_REST = 1e-6


def is_held(model: LinearModel, boundary: NDArray[np.bool_]) -> bool:
    """Whether every piece of a body, cells that hang together by facets, is held. Collective.

    Args:
        model: the body.
        boundary: (owned dofs,) whether a dof of this rank is held.
    """
    found = pieces(model.mesh.mesh)
    return all(_holds(model, mask, boundary & mask) for mask in _dofs(model, found.of_cells, found.count))


def _dofs(model: LinearModel, of_cells: NDArray[np.int64], count: int) -> list[NDArray[np.bool_]]:
    """(owned dofs,) for each piece: the kinematic dofs on its cells."""
    dofmap = model.space.dofmap
    kinematic = model.layout.kinematic[: model.n_owned]
    masks = []
    for piece in range(count):
        blocks = np.unique(dofmap.list[: len(of_cells)][of_cells == piece])
        dofs = (dofmap.index_map_bs * blocks[:, None] + np.arange(dofmap.index_map_bs)).reshape(-1)
        mask = np.zeros(model.n_owned, dtype=bool)
        mask[dofs[dofs < model.n_owned]] = True
        masks.append(mask & kinematic)
    return masks


def _holds(model: LinearModel, piece: NDArray[np.bool_], held: NDArray[np.bool_]) -> bool:
    """Collective."""
    x = model.node_x[: model.n_owned_nodes][piece[model.displacement_dofs[: model.n_owned_nodes, 0]]]
    count = model.comm.allreduce(len(x))
    motions = model.rigid_motions(total(model.comm, x.sum(axis=0)) / count, np.eye(3))
    sizes = np.sqrt(np.diag(_gram(model, motions[piece])) / count)
    gram = _gram(model, motions[held]) / np.outer(sizes, sizes)
    return bool(np.linalg.eigvalsh(gram)[0] > AT_REST**2)


def _gram(model: LinearModel, rows: FloatArray) -> FloatArray:
    return total(model.comm, rows.T @ rows)
