"""The retained dofs of nodal interfaces: each moved by one unit with all others fixed (Guyan 1965)."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum import parallel
from flexmbd.continuum.finite_elements.linear_model import LinearModel
from flexmbd.continuum.finite_elements.nodal_interface import RetainedNodes, retained_dofs, retained_nodes
from flexmbd.continuum.matrices.blocks import FloatArray
from flexmbd.errors import ReductionError
from flexmbd.record.carrying_dofs import carrying_dofs


@dataclass(frozen=True, eq=False)
class NodalDofs:
    """The dofs of nodal interfaces that are coordinates.

    Attributes:
        nodes: of all nodal interfaces.
        names: (s,) of the coordinates, as "weld.17.x" of node 17.
        owner: (s,) the nodal interface that each is of, in the model's order.
        dofs: (s,) which of the nodes' dofs each is, 3 node + axis.
        carriers: (6,) those that carry the rigid motions, or (0,) where a frame does.
        unit_motions: (owned dofs, s) each dof moved by 1 m along one of B's axes.
    """

    nodes: RetainedNodes
    names: tuple[str, ...]
    owner: NDArray[np.int64]
    dofs: NDArray[np.int64]
    carriers: NDArray[np.int64]
    unit_motions: FloatArray


def check_retained(model: LinearModel) -> None:
    """Refuse nodal interfaces with which nothing is reduced. Collective.

    Raises:
        ReductionError: on all ranks: the reduced stiffness, which is full, has more numbers than that of the mesh.
    """
    kept = model.comm.allreduce(int(retained_dofs(model).sum()))
    entries = int(model.K.getInfo(model.K.InfoType.GLOBAL_SUM)["nz_used"])
    if kept**2 > entries:
        names = ", ".join(repr(group.name) for group in model.nodal)
        raise ReductionError(
            f"nodal interfaces {names} keep {kept} dofs: the reduced stiffness, which is full, would have "
            f"{kept**2:.2g} numbers, and that of the mesh has {entries:.2g}, so nothing is reduced; take a smaller "
            "group, a coarser mesh there, or a frame (Interface)"
        )


def nodal_dofs(
    model: LinearModel, *, axes: FloatArray, framed: bool, carrying: Collection[str] = ()
) -> NodalDofs:
    """The dofs of a model's nodal interfaces. Collective.

    Args:
        model: with nodal interfaces.
        axes: (3, 3) rotation from B's axes to the mesh's.
        framed: whether an interface with a frame carries the rigid motions; else six dofs far apart do, and the others
            are coordinates relative to these.
        carrying: names of nodal interfaces whose nodes shall be these, where they do not lie in one line.

    Raises:
        ReductionError: on all ranks: the nodes lie in one line, and cannot carry the rigid motions.
    """
    nodes = retained_nodes(model)
    count = len(nodes.node)
    carriers: NDArray[np.int64] = np.zeros(0, dtype=np.int64)
    if not framed:
        first = np.flatnonzero([model.nodal[i].name in carrying for i in nodes.interface])
        carriers = parallel.on_root(model.comm, lambda: _carriers(nodes.x @ axes, first))
    kept = np.setdiff1d(np.arange(3 * count), carriers)
    motions = np.zeros((model.n_owned, 3 * count), order="F")
    here = np.flatnonzero(nodes.local >= 0)
    dofs = model.displacement_dofs[nodes.local[here]]
    for axis in range(3):
        motions[dofs, 3 * here[:, None] + axis] = axes[:, axis]
    names = [
        f"{model.nodal[interface].name}.{node}.{axis}"
        for node, interface in zip(nodes.node, nodes.interface, strict=True)
        for axis in "xyz"
    ]
    return NodalDofs(
        nodes,
        tuple(names[i] for i in kept),
        owner=nodes.interface[kept // 3],
        dofs=kept,
        carriers=carriers,
        unit_motions=np.asfortranarray(motions[:, kept]),
    )


def _carriers(x: FloatArray, first: NDArray[np.intp]) -> NDArray[np.int64]:
    own = carrying_dofs(x[first]) if len(first) else None
    if own is not None:
        return 3 * first[own // 3] + own % 3
    found = carrying_dofs(x)
    if found is None:
        raise ReductionError(
            "the nodal interfaces' nodes lie in one line and cannot tell how the part turns about it; take larger "
            "groups, or a frame beside them (Interface)"
        )
    return found
