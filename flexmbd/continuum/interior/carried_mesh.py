"""The mesh of a body with history under nodes that move in inertial axes.

Nodes have absolute positions and accelerations (Ambrosio & Nikravesh 1992, eq. 43-46), and the mesh lives in body
axes.  Formulations of the updated configuration are objective step by step, so the axes in which the body began will
do for ever.  Those of the initial configuration take small strains only, and the axes must turn with the body: they
do so with the rotation R of

    A = sum of m (x - x_c) (X - X_c)^T = R S,   S symmetric                                (polar decomposition)

over the nodes.  What the energy U(R^T (x - x_c) - (X - X_c)) says of the forces on the nodes is more than R f, for R
depends on x: the moment of f about x_c, carried by the masses, is taken off, and so no momentum is made.
"""

from __future__ import annotations

import numpy as np
from dolfinx import fem
from numpy.typing import NDArray

from flexmbd.continuum.history.fresh_body import is_fresh
from flexmbd.continuum.history.nonlinear_model import NonlinearModel
from flexmbd.continuum.interior.bonded_turns import BondedTurns
from flexmbd.continuum.interior.bulk_viscosity import BulkForces
from flexmbd.continuum.interior.staggered_fields import StaggeredFields

FloatArray = NDArray[np.float64]


class CarriedMesh:
    """The body's nodes, and the internal forces that their places call for.

    Attributes:
        body: with its history.
        begins_fresh: whether it begins undeformed, with the first history.
        X: (owned nodes, 3) m, undeformed places in body axes.
        masses: (owned nodes,) kg.
        p, R: origin (m) and rotation of the body axes in inertial ones.
        bulk: the forces of bulk viscosity, if any.
        fields: unknowns besides the displacement, if any.
        couples: (k, 6) wrenches on frames, inertial, of unknowns that turn with them, at the last `pull`.
        viscous: (owned nodes, 3) N, these at the last `pull`, a part of what that returned.
    """

    def __init__(
        self,
        body: NonlinearModel,
        masses: FloatArray,
        *,
        bulk: BulkForces | None = None,
        turns: BondedTurns | None = None,
    ) -> None:
        """Collective.

        Args:
            body: at rest; what it is deformed by it is deformed by whenever it begins.
            masses: (owned nodes,) kg, lumped.
            bulk: the forces of bulk viscosity, if any.
            turns: unknowns that turn with frames, if any.

        Raises:
            FormulationError: as `StaggeredFields`.
        """
        self.body, self.masses = body, masses
        self._turns = turns if turns is not None and turns.any else None
        given = None if self._turns is None else self._turns.dofs[self._turns.own]
        self.fields = StaggeredFields(body, given) if body.layout.has_further else None
        self.couples: FloatArray = np.zeros((0, 6))
        self.bulk = bulk
        self.viscous: FloatArray = np.zeros((len(masses), 3))
        self.X: FloatArray = body.layout.node_x[: len(masses)].copy()
        self.p: FloatArray = np.zeros(3)
        self.R: FloatArray = np.eye(3)
        self._rest, self.begins_fresh = body.snapshot(), is_fresh(body)
        self._increment = fem.Function(body.space).x
        self._mass = float(self.sum(masses.sum()))
        self._centre = self.sum(masses @ self.X) / self._mass
        self._arms = self.X - self._centre

    def begin(self, p: FloatArray, R: FloatArray) -> FloatArray:
        """As the body was at first, with its axes at p (m), turned by R. Not collective.

        Returns:
            (owned nodes, 3) m, places of the nodes in inertial axes.
        """
        self.body.restore(self._rest)
        if self.fields is not None:
            self.fields.forget()
            self.fields.lost = 0.0
        self.p, self.R = np.array(p, dtype=float), np.array(R, dtype=float)
        self.couples = np.zeros_like(self.couples)
        return np.asarray(self.p + self.body.node_x[: len(self.X)] @ self.R.T)

    def pull(self, x: FloatArray, *, dt: float, frames: FloatArray | None = None) -> FloatArray:
        """Move to the nodes' places and accept what that does. Collective.

        Args:
            x: (owned nodes, 3) m, in inertial axes.
            dt: s, that the way there has taken.
            frames: (k, 3, 3) axes of the frames, where unknowns turn with them.

        Returns:
            (owned nodes, 3) N: what the deformed body exerts on its nodes, in inertial axes.

        Raises:
            ConvergenceError: on all ranks: a cell is turned inside out, or the material has no answer.
        """
        if self.body.is_updated:
            return -self._step((x - self.p) @ self.R - self.X, dt) @ self.R.T
        centre = np.asarray(self.sum(self.masses @ x) / self._mass, dtype=float)
        left, s, right = np.linalg.svd(self.sum((self.masses[:, None] * (x - centre)).T @ self._arms))
        proper = np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
        self.R = left @ proper @ right
        self.p = centre - self.R @ self._centre
        y = (x - centre) @ self.R
        force = self._step(y - self._arms, dt, frames)
        stretch = right.T @ (proper * s) @ right
        moment = self.sum(np.cross(y, force).sum(axis=0))
        if self._turns is not None:
            moment = moment - self.couples[:, 3:].sum(axis=0) @ self.R
        turn = np.linalg.solve(np.trace(stretch) * np.eye(3) - stretch, moment)
        return -(force - self.masses[:, None] * np.cross(turn, self._arms)) @ self.R.T

    def place(self, p: FloatArray, R: FloatArray) -> None:
        """Set the body axes as they were at a snapshot. Not collective."""
        self.p, self.R = np.array(p, dtype=float), np.array(R, dtype=float)

    def sum(self, part: FloatArray) -> FloatArray:
        """Sum over the ranks, in their order, so that it is the same on all. Collective."""
        return np.asarray(sum(self.body.comm.allgather(np.asarray(part, dtype=float))))

    def _step(self, u: FloatArray, dt: float, frames: FloatArray | None = None) -> FloatArray:
        """Forces (owned nodes, 3) in body axes that hold the body at the whole displacement u."""
        owned, layout = self.body.n_owned, self.body.layout
        change = u - layout.displacements(self.body.displacement[:owned])
        self._increment.array[:owned] = layout.at_dofs(change, owned=True)
        if self._turns is not None and frames is not None:
            own = self._turns.own
            dofs = self._turns.dofs[own]
            self._increment.array[dofs] = self._turns.increments(frames, self.R, self.body.displacement)[own]
        self._increment.scatter_forward()
        if self.fields is not None:
            whole = self.fields.step(self._increment.array, dt=dt)
            if self._turns is not None and frames is not None:
                self.couples = self._turns.wrenches(whole, frames, self.R)
            return layout.displacements(whole)
        force = self.body.step(self._increment.array, dt=dt).reshape(-1, 3)
        if self.bulk is None:
            return force
        viscous = self.bulk.step(self._increment.array, dt=dt).reshape(-1, 3)
        self.viscous = -viscous @ self.R.T
        return force + viscous
