"""The record's stress modes: stress at the nodes per unit of each modal coordinate."""

from __future__ import annotations

from collections.abc import Sequence

from mpi4py import MPI

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.finite_elements.linear_model import LinearModel
from flexmbd.continuum.finite_elements.nodes import node_numbers
from flexmbd.continuum.finite_elements.stress import StressRecovery
from flexmbd.continuum.grid.row_exchange import share_of
from flexmbd.continuum.matrices.blocks import FloatArray
from flexmbd.errors import FormulationError
from flexmbd.record.reduced_body import StressModes
from flexmbd.reduction.spread_groups import SpreadGroup, SpreadRows

# Rows and columns of the components xx yy zz xy xz yz.
_ROWS, _COLUMNS = [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]


def stress_group(
    model: LinearModel, modes: FloatArray, *, frames: Sequence[str], p: FloatArray, R: FloatArray
) -> SpreadGroup[StressModes]:
    """The group (`StressModes`), as `LinearModel.stress_field` averages each mode. Collective.

    Args:
        model: the body.
        modes: (local dofs including ghosts, n), in the mesh's axes.
        frames: names of the interfaces that the record has, in its order.
        p: (3,) m, the body frame's origin in the mesh's axes.
        R: (3, 3) rotation from the body frame's axes to the mesh's.

    Raises:
        FormulationError: on all ranks: the body is under load; small displacements make no stress.
    """
    comm, recovery = model.comm, StressRecovery(model)
    if comm.allreduce(bool(model.displacement.any()), op=MPI.LOR):
        raise FormulationError(
            f"{model.form_name}: the body is under load, and stress modes lack the stress that it has at rest; keep "
            "the modes (Keep(modes=True)) and take stresses from the model"
        )
    # all ranks have a mode's stress at all nodes, and keep that of some nodes
    own = share_of(comm.rank, comm.size, len(recovery.node))
    sigma = np.empty((own.stop - own.start, 6, modes.shape[1]))
    for i, mode in enumerate(modes.T):
        sigma[:, :, i] = _components(recovery.nodal(mode)[own], R)
    place = np.arange(own.start, own.stop)
    rows = SpreadRows(comm, len(recovery.node), place, sigma.shape[1:], lambda which: sigma[which])
    return SpreadGroup(
        StressModes,
        {
            "node": recovery.node,
            "x": (recovery.x - p) @ R,
            "interface": _interface_of(model, recovery.node, frames),
            "sigma": rows,
        },
    )


def _interface_of(model: LinearModel, node: NDArray[np.int64], frames: Sequence[str]) -> NDArray[np.int64]:
    """The interface that each node is of, the first where several share it; -1 for none. Collective."""
    owner = np.full(len(node), -1, dtype=np.int64)
    numbers = node_numbers(model)
    known = [one for name in frames for one in model.interfaces if one.name == name]
    others = [one for one in model.interfaces if one.name not in frames]
    for i, interface in reversed(list(enumerate([*known, *others]))):
        held = model.comm.allgather(numbers[interface.nodes])
        owner[np.isin(node, np.concatenate(held))] = i
    return owner


def _components(sigma: FloatArray, R: FloatArray) -> FloatArray:
    """(k, 6) in B's axes of tensors (k, 3, 3) in the mesh's."""
    turned = R.T @ sigma @ R
    six: FloatArray = turned[:, _ROWS, _COLUMNS]
    return six
