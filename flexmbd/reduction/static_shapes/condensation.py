"""Static condensation to any set of nodes and components (Guyan 1965, doi:10.2514/3.2874)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from mpi4py import MPI

import numpy as np
from numpy.typing import NDArray

from flexmbd.brief import brief
from flexmbd.continuum import parallel
from flexmbd.continuum.finite_elements.linear_model import LinearModel
from flexmbd.continuum.finite_elements.nodes import node_numbers
from flexmbd.continuum.matrices.blocks import FloatArray, inner, multiply, symmetric
from flexmbd.errors import ReductionError
from flexmbd.given import checked
from flexmbd.reduction.static_shapes.interior_stiffness import continued, factorised
from flexmbd.reduction.static_shapes.support import is_held

_COMPONENTS = ("x", "y", "z")


@dataclass(frozen=True, eq=False)
class CondensedMatrices:
    """Stiffness and mass of a body condensed to some of its dofs.

    Attributes:
        K: (m, m) N/m.
        M: (m, m) kg.
        node: (m,) the node's number in the mesh's input, of each row.
        component: (m,) "x", "y" or "z" in the mesh's axes, of each row.
    """

    K: FloatArray
    M: FloatArray
    node: NDArray[np.int64]
    component: tuple[str, ...]

    __repr__ = brief


@checked(error=ReductionError, agree=parallel.told_to_all)
def static_condensation(
    model: LinearModel, retained: Iterable[tuple[int, str]]
) -> CondensedMatrices:
    """Condense a model to single dofs; the model's interfaces are not regarded. Collective.

    Args:
        model: the body.
        retained: (node, component) of each dof that is kept, in the order of the rows: the node's
            number in the mesh's input, counted from 0, and "x", "y" or "z". All components of
            some nodes are `itertools.product(nodes, "xyz")`.

    Returns:
        The condensed matrices, the same to the bit on every rank.

    Raises:
        ReductionError: on all ranks: an unknown node or component, one given twice, or dofs that
            leave the body free to move.
    """
    dofs = list(retained)
    numbers = _checked_numbers(model, dofs)
    unit = np.zeros((model.n_owned, len(dofs)), order="F")
    for column, (node, component) in enumerate(dofs):
        row = np.flatnonzero(numbers == node)
        unit[model.displacement_dofs[row, _COMPONENTS.index(component)], column] = 1.0
    boundary: NDArray[np.bool_] = np.any(unit != 0.0, axis=1)
    if not is_held(model, boundary):
        raise ReductionError(
            "the retained dofs leave the body free to move as a rigid one, so its interior stiffness is "
            "singular: retain enough of them, as all components of three nodes not in one line"
        )
    with factorised(model, boundary) as inside:
        shapes, forces = continued(model, inside, unit)
    stiffness = inner(model.comm, shapes, forces)
    mass = inner(model.comm, shapes, multiply(model.M, shapes))
    return CondensedMatrices(
        K=symmetric(stiffness),
        M=symmetric(mass),
        node=np.array([node for node, _ in dofs], dtype=np.int64),
        component=tuple(component for _, component in dofs),
    )


def _checked_numbers(model: LinearModel, dofs: list[tuple[int, str]]) -> NDArray[np.int64]:
    """The numbers of this rank's own nodes, once every dof is known to exist. Collective."""
    if not dofs:
        raise ReductionError("no dofs are retained; name at least those of three nodes")
    if len(set(dofs)) < len(dofs):
        twice = next(dof for dof in dofs if dofs.count(dof) > 1)
        raise ReductionError(f"dof {twice} is retained twice; name each once")
    for node, component in dofs:
        if component not in _COMPONENTS:
            raise ReductionError(f"node {node} has no component {component!r}; it has x, y and z")
    numbers = node_numbers(model)[: model.n_owned_nodes]
    nodes = np.unique([node for node, _ in dofs])
    there = np.isin(nodes, numbers)
    model.comm.Allreduce(MPI.IN_PLACE, there, op=MPI.LOR)
    if not there.all():
        last = max(model.comm.allgather(numbers.max(initial=-1)))
        raise ReductionError(
            f"the mesh has no node {nodes[~there][0]}; its nodes are numbered from 0 to {last} in the "
            "order of the input"
        )
    return numbers
