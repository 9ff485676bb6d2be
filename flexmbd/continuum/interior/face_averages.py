"""Averaged frames of a body that turns and strains finitely: constraints on the displacement of a face's nodes.

The frame of an averaged interface moves so that the displacement of the face, as it is seen from the frame, has no
mean: with C the average of the interface (its mean translation and small rotation),

    C (R^T (x - p) - (X - P)) = 0

for nodes at x, at X in the undeformed mesh, and a frame at p, P, turned by R. It is the rigid motion nearest to the
face's in the L2 norm, whatever its size, and turns with the body. Given the frame, the condition is linear in x. The
forces that keep it are R C^T times a force and a moment; the frame has their resultant against it.
"""

from __future__ import annotations

from mpi4py import MPI

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.finite_elements.interface import AveragedInterface
from flexmbd.continuum.history.displacement_newton import LinearConstraints
from flexmbd.continuum.history.nonlinear_model import NonlinearModel
from flexmbd.continuum.interior.bonded_nodes import BondedNodes
from flexmbd.multibody.bodies.continuum_body import FrameMotion

FloatArray = NDArray[np.float64]


class FaceAverages:
    """The constraints of all averaged interfaces of a body. Constructing one is collective."""

    def __init__(self, body: NonlinearModel, bonds: BondedNodes) -> None:
        """Collect the averages.

        Args:
            body: the body.
            bonds: its nodes on interfaces.
        """
        self._comm, self._layout, self._n_owned, self._bonds = body.comm, body.layout, body.n_owned, bonds
        self._faces: list[tuple[int, FloatArray, NDArray[np.int32], FloatArray]] = []
        for k, found in enumerate(body.interfaces):
            if not isinstance(found, AveragedInterface):
                continue
            nodes = found.nodes[found.nodes < body.layout.n_owned_nodes]
            dofs = body.displacement_dofs[nodes]
            order = np.argsort(found.dofs)
            average = found.average[order[np.searchsorted(found.dofs[order], dofs)]]
            gram = self._comm.allreduce(np.einsum("nai,naj->ij", average, average), op=MPI.SUM)
            # any combination of the six will do: orthonormal ones serve as a basis
            basis = average @ np.linalg.inv(np.linalg.cholesky(gram)).T
            self._faces.append((k, found.R, dofs, basis))

    def __bool__(self) -> bool:
        return bool(self._faces)

    def constraints(
        self, motion: FrameMotion, R: FloatArray, *, displacement: FloatArray | None = None
    ) -> LinearConstraints | None:
        """The constraints on a displacement (owned dofs,). Collective.

        Args:
            motion: of the frames.
            R: (3, 3), from the axes of the displacement to inertial ones.
            displacement: (interface nodes, 3) m, one in these axes that meets them, as for
                `BondedNodes.nodes`; zero by default.

        Returns:
            None where no interface is averaged.
        """
        if not self._faces:
            return None
        columns = np.zeros((self._n_owned, 6 * len(self._faces)))
        for i, (k, axes, dofs, basis) in enumerate(self._faces):
            turn = R.T @ motion.R[k] @ axes.T
            columns[dofs.ravel(), 6 * i : 6 * i + 6] = np.einsum("ab,nbi->nai", turn, basis).reshape(-1, 6)
        gap: FloatArray = np.zeros(columns.shape[1])
        if displacement is not None:
            bonds, field = self._bonds, np.zeros((self._layout.n_owned_nodes, 3))
            mine = bonds.own & bonds.averaged
            field[bonds.nodes[mine]] = displacement[mine]
            gap = bonds.total(np.asarray(columns.T @ self._layout.at_dofs(field, owned=True)))
        return LinearConstraints(columns, gap)
