"""The record's optional groups: nodal modes, and the surface for pictures."""

from __future__ import annotations

import numpy as np

from flexmbd.continuum import parallel
from flexmbd.continuum.blocks import FloatArray
from flexmbd.continuum.model import ContinuumModel
from flexmbd.continuum.nodes import boundary_triangles, node_numbers, sorted_triangles
from flexmbd.reduced import NodalModes, Surface


def nodal_group(
    model: ContinuumModel, modes: FloatArray, *, p: FloatArray, R: FloatArray
) -> NodalModes:
    """The modes at all displacement nodes, by `node_numbers`, ascending. Collective.

    Args:
        model: the body.
        modes: (local dofs including ghosts, n), in the mesh's axes.
        p: (3,) m, the body frame's origin in the mesh's axes.
        R: (3, 3) rotation from the body frame's axes to the mesh's.

    Returns:
        The group, the same on every rank.
    """
    owned = model.n_owned // 3
    numbers = parallel.gather_rows(model.comm, node_numbers(model)[:owned])
    x = parallel.gather_rows(model.comm, model.space.tabulate_dof_coordinates()[:owned])
    phi = parallel.gather_rows(model.comm, modes[: 3 * owned].reshape(owned, 3, -1))

    def make() -> NodalModes:
        assert numbers is not None and x is not None and phi is not None  # noqa: S101, PT018
        order = np.argsort(numbers)
        return NodalModes(
            numbers[order], (x[order] - p) @ R, np.einsum("ba,kbn->kan", R, phi[order])
        )

    return parallel.on_root(model.comm, make)


def surface_group(
    model: ContinuumModel, modes: FloatArray, *, p: FloatArray, R: FloatArray
) -> Surface:
    """The boundary's triangles with their modes; arguments as in `nodal_group`. Collective."""
    numbers = node_numbers(model)
    triangles = parallel.gather_rows(model.comm, numbers[boundary_triangles(model)])
    every = nodal_group(model, modes, p=p, R=R)

    def make() -> Surface:
        assert triangles is not None  # noqa: S101  (rank 0)
        used = np.unique(triangles)
        place = np.searchsorted(every.node, used)
        rows = np.searchsorted(used, sorted_triangles(triangles))
        return Surface(every.x[place], rows, every.phi[place])

    return parallel.on_root(model.comm, make)
