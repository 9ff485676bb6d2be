"""A mesh that is moved while something is assembled, and back again."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from dolfinx import fem
from numpy.typing import NDArray

from flexmbd.continuum import compat

FloatArray = NDArray[np.float64]


class MovedMesh:
    """The nodes of a mesh under displacements of an isoparametric element; of straight cells under those of any."""

    def __init__(self, space: fem.FunctionSpace) -> None:
        """Not collective.

        Args:
            space: of the displacement, of the degree of the mesh's geometry, or of any where that is straight.
        """
        self._geometry = space.mesh.geometry
        self._undeformed: FloatArray = self._geometry.x.copy()
        nodes = compat.cell_nodes(space.mesh)
        self._dofs = np.zeros((len(self._undeformed), 3), dtype=np.int32)
        blocks = space.dofmap.list[: len(nodes), : nodes.shape[1]]  # corners come first
        self._dofs[nodes.ravel()] = 3 * blocks.reshape(-1, 1) + np.arange(3)

    @contextmanager
    def at(self, displacement: FloatArray) -> Iterator[None]:
        """The mesh displaced by (local dofs including ghosts,) m within a `with` block."""
        x = self._geometry.x
        x[:] = self._undeformed + displacement[self._dofs]
        try:
            yield
        finally:
            x[:] = self._undeformed
