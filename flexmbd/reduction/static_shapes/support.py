"""Dofs whose support keeps a body from rigid motions: whether given ones do, and a smallest set that does.

A connected elastic body whose rigid motions all move some held dof has a regular stiffness. That is known before
anything is factorised; what round-off leaves of a singular factor tells nothing.
"""

from __future__ import annotations

from collections.abc import Sequence

from mpi4py import MPI

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum import parallel
from flexmbd.continuum.finite_elements.interface import FoundInterface
from flexmbd.continuum.finite_elements.linear_model import LinearModel
from flexmbd.continuum.grid.pieces import pieces
from flexmbd.continuum.matrices.blocks import FloatArray, total
from flexmbd.errors import ReductionError
from flexmbd.record.carrying_dofs import AT_REST, independent_rows
from flexmbd.reduction.static_shapes.interface_motions import rigidly_bound
from flexmbd.reduction.static_shapes.rigid_modes import RigidModes


def needs_support(model: LinearModel, interfaces: Sequence[FoundInterface]) -> bool:
    """Whether no interface is rigid or nodal and no support there, so that six dofs are to hold the body."""
    return not (rigidly_bound(interfaces) or model.supports or model.nodal)


def is_held(model: LinearModel, boundary: NDArray[np.bool_]) -> bool:
    """Whether every piece of a body, cells connected by facets, is held. Collective.

    Args:
        model: the body.
        boundary: (owned dofs,) whether a dof of this rank is held.
    """
    found = pieces(model.mesh.mesh)
    if model.ties is not None:  # which join the pieces; what follows holds nothing
        held, every = boundary & ~model.tied_dofs, np.zeros_like(found.of_cells)
        return all(_holds(model, mask, held & mask) for mask in _dofs(model, every, 1))
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


def minimal_support(model: LinearModel, rigid: RigidModes) -> NDArray[np.bool_]:
    """(owned dofs,) six dofs on all ranks that together keep the body from moving. Collective.

    They are far apart: the pivots of a QR factorisation of the rigid motions.
    """
    reach = np.linalg.norm(model.node_x - rigid.com, axis=1).max(initial=0.0)
    reach = model.comm.allreduce(reach, op=MPI.MAX)
    rows = rigid.motions / np.repeat([1.0, reach], 3)
    rows[model.tied_dofs] = 0.0
    mine, _ = independent_rows(rows)
    gathered = model.comm.gather((mine, rows[mine]), root=0) or []

    def choose() -> list[tuple[int, int]]:
        found = [(rank, dof) for rank, (dofs, _) in enumerate(gathered) for dof in dofs.tolist()]
        together = np.vstack([rows for _, rows in gathered])
        chosen, _ = independent_rows(together)
        sizes = np.linalg.svd(together[chosen])[1]
        if len(sizes) < 6 or not sizes[-1] > AT_REST * sizes[0]:
            raise ReductionError(
                "the nodes of the body lie in one line and carry no rotation, so that nothing can keep "
                "it from turning about that line; take a formulation with rotations or a solid mesh"
            )
        return [found[i] for i in chosen]

    support = np.zeros(model.n_owned, dtype=bool)
    for rank, dof in parallel.on_root(model.comm, choose):
        if rank == model.comm.rank:
            support[dof] = True
    return support
