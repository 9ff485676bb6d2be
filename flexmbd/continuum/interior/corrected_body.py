"""One body where its linearised nodes are in balance: its frames' wrenches, and what their motions do."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.interior.condensed_part import BodyTrial, CondensedPart
from flexmbd.continuum.interior.frame_response import FrameColumns
from flexmbd.continuum.interior.touched_nodes import TouchedNodes

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class CorrectedBody:
    """A body where its linearised nodes are in balance.

    Attributes:
        part, trial: of the body.
        increment: (local dofs,) m.
        residual: (owned nodes, 3) N, in inertial axes, of internal and inertia forces less loads and contact.
        couples: (k, 6) as of `Condensation.condense`.
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
        return self.part.frames.columns_of(
            self.part.tangent, self.residual, self.trial.motion, x=x, apparent_acceleration=a - equations.step.gravity,
            dead_load=equations.axes.to_inertial(equations.loads.dead) + facing,
            slopes=equations.step.scheme.slopes(equations.step.h), touched=self.touched,
        )  # fmt: skip
