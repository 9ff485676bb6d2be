"""Selective mass scaling of thin walls: the vibrations through their thickness out of the stable step.

The two nodes of an edge through the wall get a further mass s that resists their difference alone,

    M = diag(m_1, m_2) + s [[1, -1], [-1, 1]],    s = ((L / h)^2 - 1) m_1 m_2 / (m_1 + m_2),

with the length h of the edge and the least size L of its cells in the wall, or a part of it (Olovsson, Simonsson &
Unosson 2005, doi:10.1002/nme.1293; Confalonieri, Ghisi & Perego 2015).  What stretches and shears through the thickness
is slower by h / L, as fast as a cell of size L.  Masses, momentum and gravity stay what they were; the rotary inertia
of the wall grows to that of a length L, which lowers frequencies of bending at wave numbers k by the order (k L)^2, as
much as the mesh does.
"""

from __future__ import annotations

import numpy as np
from dolfinx import fem, la
from numpy.typing import NDArray

from flexmbd.continuum import parallel
from flexmbd.continuum.contract.entries import is_layered
from flexmbd.continuum.finite_elements.lumping import lumped_mass
from flexmbd.continuum.history.nonlinear_model import NonlinearModel
from flexmbd.errors import FormulationError, SceneError
from flexmbd.round_off import SAME_PLACE

FloatArray = NDArray[np.float64]

# Corners of a brick that edges in the wall join; corners i and i + 4 are joined by one through it.
_IN_WALL = np.array([(0, 1), (2, 3), (0, 2), (1, 3), (4, 5), (6, 7), (4, 6), (5, 7)])


def thickness_mass(body: NonlinearModel, scale: float) -> ThicknessMass | None:
    """The further mass of a body; None for a scale of zero. Collective.

    Raises:
        SceneError: on all ranks: the scale is below 0 or above 1, or another one on some.
        FormulationError: as `ThicknessMass`; welds.
    """
    parallel.check_same(body.comm, SceneError, scaled_thickness=scale)
    if not 0.0 <= scale <= 1.0:
        raise SceneError(f"scaled_thickness must be from 0 (none) to 1 (the cells' size in the wall), got {scale!r}")
    if scale > 0.0 and body.ties is not None:
        raise FormulationError(
            "scaled_thickness= goes by edges through the wall, and welds tie some of their ends alone; leave it out, "
            "or mesh the walls in one"
        )
    return ThicknessMass(body, scale) if scale > 0.0 else None


class ThicknessMass:
    """The further mass of the edges through the wall of one body. Constructing one is collective.

    Attributes:
        nodes: (k, 2) local nodes of the edges that reach this rank's own, ghosts among them.
        added: (k,) kg, s of each.
        arms: (k, 3) m, from the first node to the second, in body axes.
        mine: (k,) whether sums over the body have the edge on this rank.
        scale: as given.
        ratio: the largest L / h.
    """

    def __init__(self, body: NonlinearModel, scale: float = 1.0) -> None:
        """Find the edges.

        Args:
            body: at rest and undeformed.
            scale: L over the least size of an edge's cells in the wall.

        Raises:
            FormulationError: on all ranks: no cells are layered; several lie through the thickness; the mass cannot be
                lumped.
        """
        groups = [group for group in body.groups if is_layered(group.formulation)]
        if not groups or body.degree != 1:
            raise FormulationError(
                f"scaled_thickness is of walls of layered cells (LAYERED) of degree 1, as of forms.solid_shell, and "
                f"{body.form_name} of degree {body.degree} is none; leave it out"
            )
        self.scale = scale
        self._vectors, self._n = fem.Function(body.layout.node_space).x, body.layout.n_owned_nodes
        x = body.layout.node_x
        cells = np.concatenate([group.cells for group in groups])
        owned = cells < body.mesh.mesh.topology.index_map(3).size_local
        corners = body.layout.node_space.dofmap.list[cells][:, :8]
        pairs = np.concatenate([corners[:, [i, i + 4]] for i in range(4)])
        sums, partners = self._of_cells(x, corners[owned], scale)
        first, second = pairs.T
        apart = np.linalg.norm(partners[first] - sums[first, 2:] * x[second], axis=1)
        stacked = bool((apart > SAME_PLACE * sums[first, 2] * np.linalg.norm(x[second] - x[first], axis=1)).any())
        if any(body.comm.allgather(stacked)):
            raise FormulationError(
                f"scaled_thickness is of walls of one cell through the thickness, and of {body.form_name} several lie "
                "on each other, or walls meet in an edge of more than one thickness; leave it out"
            )
        number = body.layout.node_space.dofmap.index_map.local_to_global(np.arange(len(x), dtype=np.int32))
        swapped = number[first] > number[second]
        pairs[swapped] = pairs[swapped, ::-1]
        pairs = np.unique(pairs, axis=0)
        self.nodes: NDArray[np.int32] = pairs[(pairs < self._n).any(axis=1)]
        share = sums[self.nodes[:, 0], 0] / sums[self.nodes[:, 0], 1]
        lumped = body.vector()
        lumped.array[: body.n_owned] = lumped_mass(body)
        lumped.scatter_forward()
        self._m: FloatArray = body.layout.displacements(lumped.array)[:, 0]
        m = self._m[self.nodes]
        self._set(self.nodes, share * m[:, 0] * m[:, 1] / m.sum(axis=1), x[self.nodes[:, 1]] - x[self.nodes[:, 0]])
        self.ratio = float(np.sqrt(1.0 + max(body.comm.allgather(float(share.max(initial=0.0))))))

    def bond(self, frame_of: NDArray[np.int64]) -> None:
        """Leave out the edges with one node on a frame and the other free or on another frame; not collective.

        Args:
            frame_of: (local nodes,) the frame that each goes with, or -1.
        """
        same = frame_of[self.nodes[:, 0]] == frame_of[self.nodes[:, 1]]
        self._set(self.nodes[same], self.added[same], self.arms[same])

    def hold(self, moves: FloatArray) -> None:
        """Take along which axes nodes move, (owned nodes, 3) of 1 and 0. Collective."""
        self._answers = self._everywhere(moves)[self.nodes] / self._m[self.nodes][:, :, None]

    def accelerations(self, alone: FloatArray) -> FloatArray:
        """(owned nodes, 3) m/s^2, where they would be ``alone`` by the lumped masses. Collective."""
        each, of = self._everywhere(alone)[self.nodes], self._answers
        apart = self.added[:, None] * (each[:, 0] - each[:, 1]) / (1.0 + self.added[:, None] * of.sum(axis=1))
        return self._taken(alone, -of * apart[:, None, :] * [[[1.0], [-1.0]]])

    def times(self, vectors: FloatArray) -> FloatArray:
        """(owned nodes, 3) kg x, the further mass by vectors at the nodes. Collective."""
        return self._taken(np.zeros_like(vectors), self._apart(vectors)[:, None, :] * [[[1.0], [-1.0]]])

    def square(self, vectors: FloatArray) -> float:
        """Vectors (owned nodes, 3) by the further mass and themselves: this rank's part. Collective."""
        each = self._everywhere(vectors)[self.nodes[self.mine]]
        return float(self.added[self.mine] @ ((each[:, 0] - each[:, 1]) ** 2).sum(axis=1))

    def inverse_root(self, vectors: FloatArray) -> FloatArray:
        """(owned nodes * 3,) the inverse root of the mass over the lumped one's; symmetric. Collective."""
        q = [[1.0, -1.0]] / np.sqrt(self._m[self.nodes])
        square = (q**2).sum(axis=1)
        factor = (1.0 / np.sqrt(1.0 + self.added * square) - 1.0) / square
        each = self._everywhere(vectors.reshape(-1, 3))[self.nodes]
        along = factor[:, None] * (q[:, :, None] * each).sum(axis=1)
        return self._taken(vectors.reshape(-1, 3), q[:, :, None] * along[:, None, :]).reshape(-1)

    def _set(self, nodes: NDArray[np.int32], added: FloatArray, arms: FloatArray) -> None:
        self.nodes, self.added, self.arms = nodes, added, arms
        self.mine: NDArray[np.bool_] = nodes[:, 0] < self._n
        self._answers = np.ones((1, 1, 3)) / self._m[nodes][:, :, None]

    def _of_cells(self, x: FloatArray, corners: NDArray[np.int32], scale: float) -> tuple[FloatArray, FloatArray]:
        """Sums over the cells of each node, the same on all ranks that have it.

        Returns:
            (local nodes, 3): share times volume, volume (m^3), number of cells; places (m) of the edge's other node.
        """
        at = x[corners]
        length = np.linalg.norm(at[:, _IN_WALL[:, 0]] - at[:, _IN_WALL[:, 1]], axis=2).min(axis=1)
        volume = abs(np.linalg.det(at[:, [1, 2, 4]] - at[:, :1]))
        sums, partners = np.zeros((2, len(x), 3))
        for i in range(8):
            j = (i + 4) % 8
            height = np.linalg.norm(at[:, j] - at[:, i], axis=1)
            share = np.maximum((scale * length / height) ** 2 - 1.0, 0.0)
            np.add.at(sums, corners[:, i], np.column_stack([share * volume, volume, np.ones_like(volume)]))
            np.add.at(partners, corners[:, i], at[:, j])
        return self._summed(sums), self._summed(partners)

    def _summed(self, values: FloatArray) -> FloatArray:
        """(local nodes, 3) sums over the ranks. Collective."""
        self._vectors.array[:] = values.reshape(-1)
        self._vectors.scatter_reverse(la.InsertMode.add)
        self._vectors.scatter_forward()
        return np.asarray(self._vectors.array.reshape(-1, 3).copy())

    def _everywhere(self, values: FloatArray) -> FloatArray:
        """(local nodes, 3) of those at owned nodes. Collective."""
        self._vectors.array[: 3 * self._n] = values.reshape(-1)
        self._vectors.scatter_forward()
        return np.asarray(self._vectors.array.reshape(-1, 3).copy())

    def _apart(self, vectors: FloatArray) -> FloatArray:
        """(k, 3) s times the difference of an edge's nodes. Collective."""
        each = self._everywhere(vectors)[self.nodes]
        return np.asarray(self.added[:, None] * (each[:, 0] - each[:, 1]))

    def _taken(self, vectors: FloatArray, changes: FloatArray) -> FloatArray:
        """Vectors (owned nodes, 3) with changes (k, 2, 3) at the edges' nodes; a node is on one edge at most."""
        out, own = vectors.copy(), self.nodes < self._n
        out[self.nodes[own]] += changes[own]
        return out
