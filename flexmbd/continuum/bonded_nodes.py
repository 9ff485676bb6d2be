"""Nodes bonded to the rigid interface frames of a body with history: where they are, and what they pass on.

Ambrosio & Nikravesh 1992, eq. 47-53: the nodes on the boundary of a rigid part move with it, their lumped
mass is part of it, and the forces that they are held with act on it.
"""

from __future__ import annotations

from collections.abc import Mapping

from mpi4py import MPI

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum import parallel
from flexmbd.continuum.interface import RigidInterface
from flexmbd.continuum.updated_lagrangian import UpdatedLagrangian
from flexmbd.errors import InterfaceError
from flexmbd.multibody.body import RigidBody
from flexmbd.multibody.continuum_body import FrameMotion, InterfaceFrame

FloatArray = NDArray[np.float64]


class BondedNodes:
    """The bonded nodes of all interfaces of a body. Constructing one is collective.

    Attributes:
        frames: one for each interface, in the order of `UpdatedLagrangian.interfaces`.
        nodes: (n,) local nodes, ghosts included.
        frame_of: (n,) the number of each node's frame.
        own: (n,) whether this rank owns the node.
        mass: (n,) kg, lumped.
    """

    def __init__(
        self, body: UpdatedLagrangian, mass: FloatArray, *, rigid_parts: Mapping[str, RigidBody] | None = None
    ) -> None:
        """Collect nodes and inertia.

        Args:
            body: with one rigid interface at least.
            mass: (local nodes including ghosts,) kg, lumped.
            rigid_parts: by interface the rigid part there: mass, inertia, and centre of mass from the
                interface's origin, in the interface's axes.

        Raises:
            InterfaceError: on all ranks: no interface, an averaged one, a rigid part of another name, or
                nodes whose inertia about an axis is zero where no rigid part helps.
        """
        parts, names = dict(rigid_parts or {}), [found.name for found in body.interfaces]
        averaged = [found.name for found in body.interfaces if not isinstance(found, RigidInterface)]
        if not names or averaged or not set(parts) <= set(names):
            raise InterfaceError(
                f"interfaces {names}, of which {averaged} are averaged, with rigid parts {sorted(parts)}: a body with "
                "history in a machine needs rigid interfaces, and a rigid part the name of one"
            )
        self._comm = body.comm
        self.nodes = np.concatenate([found.nodes for found in body.interfaces])
        self.frame_of = np.repeat(np.arange(len(names)), [len(found.nodes) for found in body.interfaces])
        self.own = self.nodes < body.layout.n_owned_nodes
        self.mass = mass[self.nodes]
        self._origins = np.array([found.p for found in body.interfaces])
        self._axes = np.array([found.R for found in body.interfaces])
        offsets = body.layout.node_x[self.nodes] - self._origins[self.frame_of]
        self._arms = np.einsum("nba,nb->na", self._axes[self.frame_of], offsets)
        self.frames = tuple(self._frame(k, name, parts.get(name)) for k, name in enumerate(names))

    def arms(self, motion: FrameMotion) -> FloatArray:
        """(n, 3) m, from the frames' origins to their nodes, in inertial axes."""
        return np.einsum("nab,nb->na", motion.R[self.frame_of], self._arms)

    def positions(self, motion: FrameMotion) -> FloatArray:
        """(n, 3) m, of the nodes, in inertial axes."""
        return np.asarray(motion.p[self.frame_of] + self.arms(motion))

    def velocities(self, motion: FrameMotion) -> FloatArray:
        """(n, 3) m/s, of the nodes."""
        k = self.frame_of
        return np.asarray(motion.v[k] + np.cross(motion.w[k], self.arms(motion)))

    def accelerations(self, motion: FrameMotion) -> FloatArray:
        """(n, 3) m/s^2, of the nodes."""
        k, arms = self.frame_of, self.arms(motion)
        turning = np.cross(motion.w[k], np.cross(motion.w[k], arms))
        return np.asarray(motion.a[k] + np.cross(motion.alpha[k], arms) + turning)

    def wrenches(self, forces: FloatArray, motion: FrameMotion) -> FloatArray:
        """Forces (n, 3) N on the nodes as (k, 6) forces and moments about the frames' origins. Collective."""
        own, frame = self.own, self.frame_of
        wrenches = np.zeros((len(self.frames), 6))
        np.add.at(wrenches[:, :3], frame[own], forces[own])
        np.add.at(wrenches[:, 3:], frame[own], np.cross(self.arms(motion)[own], forces[own]))
        return self.total(wrenches)

    def total(self, values: FloatArray) -> FloatArray:
        """The sum over the ranks, made by one of them so that it is the same on all. Collective."""
        if self._comm.size == 1:
            return values
        summed = self._comm.reduce(values, op=MPI.SUM, root=0)
        return np.asarray(self._comm.bcast(summed, root=0))

    def pose(self, motion: FrameMotion) -> tuple[FloatArray, FloatArray]:
        """Position (3,) and axes (3, 3) of the body frame that the first interface carries, in inertial axes."""
        R = motion.R[0] @ self._axes[0].T
        return motion.p[0] - R @ self._origins[0], R

    def _frame(self, k: int, name: str, part: RigidBody | None) -> InterfaceFrame:
        mine = self.own & (self.frame_of == k)
        arms, mass = self._arms[mine], self.mass[mine]
        sums: FloatArray = np.zeros((4, 4))
        sums[0, 0], sums[0, 1:], sums[1:, 1:] = mass.sum(), mass @ arms, (mass[:, None] * arms).T @ arms
        if part is not None and self._comm.rank == 0:
            first, second = part.moments()
            sums[0, 0] += part.mass
            sums[0, 1:] += first
            sums[1:, 1:] += second
        sums = self.total(sums)
        whole, com = float(sums[0, 0]), sums[0, 1:] / sums[0, 0]
        second = sums[1:, 1:] - whole * np.outer(com, com)
        inertia = np.trace(second) * np.eye(3) - second
        error = None
        if np.linalg.eigvalsh(inertia)[0] <= 1e-9 * np.trace(inertia):
            error = InterfaceError(
                f"interface {name!r}: its nodes lie on a line and have no inertia about it; give it a rigid part, or "
                "more nodes"
            )
        parallel.raise_collectively(self._comm, error)
        return InterfaceFrame(name, self._origins[k], self._axes[k], whole, com, (inertia + inertia.T) / 2)
