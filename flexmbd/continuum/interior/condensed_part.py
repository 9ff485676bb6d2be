"""One body's part in Newton's iteration of nodes within the machine's: where its nodes go with the frames.

And, once the linearised nodes are in balance, the frames' wrenches, and what their motions do.
"""

from __future__ import annotations

from dataclasses import dataclass

from petsc4py import PETSc

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from flexmbd.continuum.history.displacement_newton import LinearConstraints
from flexmbd.continuum.history.nonlinear_model import NonlinearModel
from flexmbd.continuum.interior.frame_columns import BalancedNodes, FrameColumns
from flexmbd.continuum.interior.frame_response import Condensation
from flexmbd.continuum.interior.further_unknowns import kinds_of_unknowns
from flexmbd.continuum.interior.step_equations import StepEquations
from flexmbd.continuum.interior.touched_nodes import TouchedNodes
from flexmbd.continuum.matrices.blocks import multiply
from flexmbd.multibody.bodies.continuum_body import FrameMotion

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class BodyTrial:
    """Equations of a body at a step's end, with the frames' motion there, and those of what it touches."""

    equations: StepEquations
    motion: FrameMotion


class CondensedPart:
    """The nodes of a body, and its tangent.

    Attributes:
        body: the body.
        frames: condensation to its frames.
        bonds: its nodes on these.
        prescribed: owned dofs that move with rigid frames, or never.
        kinds: owned dofs of each kind of unknown.
    """

    def __init__(self, body: NonlinearModel, frames: Condensation, prescribed: NDArray[np.int32]) -> None:
        """Nothing is computed yet."""
        self.body, self.frames, self.prescribed, self.bonds = body, frames, prescribed, frames.bonds
        self.kinds = kinds_of_unknowns(body)
        self._held = self.bonds.nodes[~self.bonds.averaged]
        self._vector = body.vector()
        self.tangent: PETSc.Mat = PETSc.Mat()  # with its rows of nodes on frames; no handle before the first

    def begun(self, trial: BodyTrial) -> tuple[FloatArray, FloatArray, LinearConstraints | None]:
        """Where a step begins: from the last accepted state, in which no material is led astray. Collective.

        Returns:
            (owned dofs,) m, how nodes on frames jump; (owned dofs,) N, the inertia that a tangent makes of it and that
            they have not, as they have their frames' accelerations; and the constraints of averaged frames.
        """
        body, equations, motion = self.body, trial.equations, trial.motion
        places = equations.axes.increment(self.bonds.positions(motion), self.bonds.nodes)
        constraints = self.frames.averages.constraints(motion, equations.axes.R, displacement=places)
        jump = np.zeros_like(body.layout.node_x)
        jump[self._held] = places[~self.bonds.averaged]
        jumped = body.layout.at_dofs(jump[: body.layout.n_owned_nodes], owned=True)
        own = self.bonds.turns.own
        jumped[self.bonds.turns.dofs[own]] = self._turned(trial)[own]
        inertia = (1.0 / equations.step.per_x) * multiply(self.frames.mass, jumped[:, None])[:, 0]
        return jumped, inertia, constraints

    def placed(
        self, trial: BodyTrial, increment: FloatArray, change: FloatArray
    ) -> tuple[FloatArray, LinearConstraints | None]:
        """An increment (local dofs,) m and its change (owned dofs,), with held nodes exactly on frames. Collective.

        Returns:
            (local dofs,) m; and the constraints of averaged frames, which are met but for second order.
        """
        axes, bonds, motion = trial.equations.axes, self.bonds, trial.motion
        increment = self.with_ghosts(increment, change)
        layout = self.body.layout
        places = axes.increment(bonds.positions(motion), bonds.nodes)
        gap = places - layout.displacements(increment)[bonds.nodes]
        increment[layout.displacement_dofs[self._held]] = places[~bonds.averaged]
        increment[bonds.turns.dofs] = self._turned(trial)
        self.body.complete(increment)
        return increment, self.frames.averages.constraints(motion, axes.R, displacement=gap)

    def _turned(self, trial: BodyTrial) -> FloatArray:
        """(m,) how far unknowns that turn with frames have turned since the last accepted step."""
        return self.bonds.turns.increments(trial.motion.R, trial.equations.axes.R, self.body.displacement)

    def keep(self, matrix: PETSc.Mat) -> None:
        """Keep a copy of the tangent. Collective."""
        if not self.tangent.handle:
            self.tangent = matrix.copy()
            self._products = self.tangent.createVecs()
        else:
            matrix.copy(self.tangent, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)

    def begun_tangent(self, per_x: float, kept_per_x: float) -> PETSc.Mat:
        """The kept tangent for a step of another length: the stiffness as it was. Collective."""
        matrix = self.tangent.copy()
        matrix.axpy(1.0 / per_x - 1.0 / kept_per_x, self.frames.mass, PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
        return matrix

    def product(self, change: FloatArray) -> FloatArray:
        """The kept tangent, with its rows of nodes on frames, times a displacement (owned dofs,). Collective."""
        right, left = self._products
        right.array[:] = change
        self.tangent.mult(right, left)
        return np.asarray(left.array_r.copy())

    def with_ghosts(self, increment: FloatArray, change: FloatArray) -> FloatArray:
        """(local dofs,) an increment and a change of the owned dofs. Collective."""
        vector = self._vector
        vector.array[: self.body.n_owned] = increment[: self.body.n_owned] + change
        vector.scatter_forward()
        return self.body.complete(vector.array.copy())

    def without_constraint_forces(self, residual: FloatArray, constraints: LinearConstraints | None) -> FloatArray:
        """The residual on the nodes that no frame holds, less the forces that keep the constraints. Collective."""
        free = residual.copy()
        if constraints is not None:
            along = self.bonds.total(np.asarray(constraints.columns.T @ residual))
            free -= constraints.columns @ along
        free[self.prescribed] = 0.0
        return free

    def small_motions(self, start: FrameMotion, trial: BodyTrial) -> FloatArray:
        """(6 k,) displacement of the frames' origins and their rotation vectors since ``start``, in the body's axes."""
        end, R = trial.motion, trial.equations.axes.R
        vectors = Rotation.from_matrix(end.R @ start.R.transpose(0, 2, 1)).as_rotvec()
        return np.hstack([(end.p - start.p) @ R, vectors @ R]).reshape(-1)


@dataclass(frozen=True, eq=False)
class CorrectedBody:
    """A body where its linearised nodes are in balance.

    Attributes:
        part, trial: of the body.
        increment: (local dofs,) m.
        residual: (owned nodes, 3) N, in inertial axes, of internal and inertia forces less loads and contact.
        couples: (k, 6) as of `BalancedNodes`.
        touched: contact with shapes there, where it may touch some.
    """

    part: CondensedPart
    trial: BodyTrial
    increment: FloatArray
    residual: FloatArray
    couples: FloatArray
    touched: TouchedNodes | None

    @classmethod
    def of(
        cls, part: CondensedPart, trial: BodyTrial, increment: FloatArray, change: FloatArray, residual: FloatArray
    ) -> CorrectedBody:
        """From increments (local dofs,) m, with a change and a residual (owned dofs,). Collective."""
        equations, touched = trial.equations, None
        if equations.contacts.touches:
            touched = equations.touched(equations.motion(increment)[0])
            touched = touched.moved(part.body.complete_nodes(equations.axes.to_inertial(change.copy())))
        couples = part.bonds.turns.wrenches(residual, trial.motion.R, equations.axes.R)
        inertial = equations.axes.to_inertial(residual)
        return cls(part, trial, part.with_ghosts(increment, change), inertial, couples, touched)

    def wrenches(self) -> FloatArray:
        """(k, 6) on the frames. Collective."""
        equations, bonds, frames = self.trial.equations, self.part.bonds, self.part.frames
        arms = equations.axes.positions(self.increment, bonds.nodes) - self.trial.motion.p[bonds.frame_of]
        forces = frames.nodal_forces(self.residual, equations.held_accelerations - equations.step.gravity)
        couples = self.couples + frames.frame_couples(self.trial.motion)
        return frames.with_shapes(bonds.wrenches(forces, arms) + couples, self.touched)

    def columns(self, facing: FloatArray) -> FrameColumns:
        """What the frames' unit motions do; facing: (owned nodes, 3) N, by other bodies of its kind. Collective."""
        equations = self.trial.equations
        x, a = equations.motion(self.increment)
        at = BalancedNodes(
            self.trial.motion, self.residual, x, a - equations.step.gravity,
            dead_load=equations.axes.to_inertial(equations.loads.dead) + facing,
            slopes=equations.step.scheme.slopes(equations.step.h), couples=self.couples, touched=self.touched,
        )  # fmt: skip
        return self.part.frames.columns_of(self.part.tangent, at)
