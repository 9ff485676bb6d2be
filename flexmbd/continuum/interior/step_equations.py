"""The balance of a body's nodes at a step's end, by the machine's scheme of integration.

Nodes have absolute positions, velocities and accelerations in inertial axes, so that the mass matrix is constant and
there are no gyroscopic terms (Ambrosio & Nikravesh 1992, eq. 43-46); internal forces are those of the body's
axes, which the first interface frame carries.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

from petsc4py import PETSc

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.history.applied_loads import TrialLoads
from flexmbd.continuum.history.body_memory import BodyMemory
from flexmbd.continuum.history.displacement_newton import Balance
from flexmbd.continuum.history.nonlinear_model import NonlinearModel
from flexmbd.continuum.interior.frame_response import Condensation
from flexmbd.continuum.interior.implicit_contacts import ImplicitContacts
from flexmbd.continuum.interior.implicit_touch import TouchedState
from flexmbd.continuum.interior.nodal_turns import TurnState, recalled, remembered
from flexmbd.continuum.interior.touched_nodes import TouchedNodes
from flexmbd.multibody.bodies.continuum_body import FrameMotion, Scheme
from flexmbd.round_off import STALLED

FloatArray = NDArray[np.float64]

# Arrays of a state over the nodes.
_NODAL = ("x", "v", "a", "auxiliary")



@dataclass(frozen=True, eq=False)
class NodalState:
    """Nodes at an instant: (local nodes including ghosts, 3) each, in inertial axes.

    Attributes:
        t: s.
        x, v, a: m, m/s, m/s^2.
        auxiliary: m/s^2, of the scheme.
        h: s, of the step before; zero at the start.
        turns: of nodes whose rotations have inertia; None: there are none.
    """

    t: float
    x: FloatArray
    v: FloatArray
    a: FloatArray
    auxiliary: FloatArray
    h: float
    turns: TurnState | None = None

    def carried(self, h: float, scheme: Scheme) -> NodalState:
        """With auxiliary accelerations for a step of the length h, s."""
        if self.h == 0.0:
            return self
        turns = self.turns
        if turns is not None:
            turns = replace(turns, auxiliary=scheme.carry(turns.auxiliary, h, self.h, turns.a))
        return replace(self, auxiliary=scheme.carry(self.auxiliary, h, self.h, self.a), turns=turns)

    def remembered(self, memory: BodyMemory) -> dict[str, FloatArray]:
        """It as arrays over the whole body, for checkpoints. Collective."""
        arrays = {name: memory.gather_nodes(getattr(self, name)) for name in _NODAL}
        turns = {} if self.turns is None else remembered(self.turns, memory)
        return {**arrays, **turns, "times": np.array([self.t, self.h])}

    @classmethod
    def recalled(cls, arrays: Mapping[str, FloatArray], memory: BodyMemory, *, turns: bool) -> NodalState:
        """This rank's part of `remembered`, on any number of ranks; turns: whether nodes turn. Collective."""
        nodal = {name: memory.scatter_nodes(arrays[name]) for name in _NODAL}
        t, h = (float(value) for value in arrays["times"])
        return cls(t=t, h=h, turns=recalled(arrays, memory) if turns else None, **nodal)


@dataclass(frozen=True, eq=False)
class StepEnd:
    """A step's end that was solved for, or the state at rest.

    Attributes:
        state: of the nodes there.
        increment: (local dofs,) m, displacement since the last accepted step.
        load: (owned nodes, 3) N, in inertial axes, that acts there.
        touched: what shapes do there.
        dt: s, the time that passes for the material, none on the way to rest.
        frames: (k, 3, 3) axes of the machine's frames there.
    """

    state: NodalState
    increment: FloatArray
    load: FloatArray
    touched: tuple[TouchedState, ...]
    dt: float
    frames: FloatArray


@dataclass(frozen=True, eq=False)
class BodyAxes:
    """The body's axes, which the first interface frame carries; displacements are since the last accepted step.

    Attributes:
        body: the body.
        p: (3,) m, where they stand.
        R: (3, 3) rotation from them to inertial ones.
    """

    body: NonlinearModel
    p: FloatArray
    R: FloatArray

    def positions(self, increment: FloatArray, nodes: NDArray[np.integer] | slice = slice(None)) -> FloatArray:
        """(n, 3) m, of nodes in inertial axes at a displacement (local dofs,) m."""
        moved = self.body.layout.displacements(self.body.displacement + increment)[nodes]
        return np.asarray(self.p + (self.body.layout.node_x[nodes] + moved) @ self.R.T)

    def increment(self, x: FloatArray, nodes: NDArray[np.integer] | slice = slice(None)) -> FloatArray:
        """(n, 3) m, displacement of nodes at inertial positions x (n, 3)."""
        layout = self.body.layout
        before = layout.node_x[nodes] + layout.displacements(self.body.displacement)[nodes]
        return np.ascontiguousarray((x - self.p) @ self.R - before)

    def to_inertial(self, forces: FloatArray) -> FloatArray:
        """(owned nodes, 3) N in inertial axes, of forces (owned dofs,) N in the body's."""
        return np.asarray(self.body.layout.displacements(forces) @ self.R.T)

    def to_body(self, forces: FloatArray) -> FloatArray:
        """(owned dofs,) N in the body's axes, of forces (owned nodes, 3) N in inertial ones."""
        return self.body.layout.at_dofs(forces @ self.R, owned=True)


@dataclass(frozen=True, eq=False)
class TriedStep:
    """A trial step: the parts of its equations that do not depend on the frames' motion.

    Attributes:
        t_end, h: s.
        scheme: of integration.
        before: the last accepted state, its auxiliary accelerations carried to this step.
        factors: of the loads at its end.
        gravity: (3,) m/s^2.
        round_off: N, 2-norm of what rounding leaves of the residual.
    """

    t_end: float
    h: float
    scheme: Scheme
    before: NodalState
    factors: FloatArray
    gravity: FloatArray
    round_off: float

    @property
    def per_x(self) -> float:
        """s^2, position at the step's end per unit of the acceleration there."""
        return self.scheme.slopes(self.h)[0]

    @cached_property
    def predicted(self) -> FloatArray:
        """(local nodes, 3) m, inertial positions at the step's end without accelerations there."""
        return self._moved(np.zeros_like(self.before.a))

    def coasted(self) -> FloatArray:
        """(local nodes, 3) m, inertial positions at the step's end with unchanged accelerations."""
        return self._moved(self.before.a)

    def _moved(self, a: FloatArray) -> FloatArray:
        before = self.before
        return np.asarray(before.x + self.scheme.end(self.h, before.v, before.a, before.auxiliary, a)[0])


@dataclass(frozen=True, eq=False)
class StepEquations:
    """Internal, inertia and outer forces at the end of a step, in body axes, as they depend on the displacement.

    Attributes:
        body: the body.
        step: that is tried.
        axes: at its end.
        frames: with the mass matrix.
        loads: that act there.
        held: nodes that rigid frames hold.
        held_accelerations: (n, 3) m/s^2, of them.
        contacts: with shapes and reduced bodies.
        frame_motion: of the frames.
    """

    body: NonlinearModel
    step: TriedStep
    axes: BodyAxes
    frames: Condensation
    loads: TrialLoads
    held: NDArray[np.integer]
    held_accelerations: FloatArray
    contacts: ImplicitContacts
    frame_motion: FrameMotion

    def motion(self, increment: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(local nodes, 3) m, m/s^2, positions and accelerations in inertial axes at a displacement (local dofs,)."""
        x = self.body.complete_nodes(self.axes.positions(increment))
        a: FloatArray = (1.0 / self.step.per_x) * (x - self.step.predicted)
        a[self.held] = self.held_accelerations
        return x, a

    def forces(self, increment: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Internal, inertia and outer forces (owned dofs,) N at a displacement (local dofs,) m. Collective.

        Raises:
            ConvergenceError: as `NonlinearModel.force`.
        """
        self.loads.set_given_fields()
        internal = self.body.force(increment, dt=self.step.h)
        x, a = self.motion(increment)
        inertia = self.axes.to_body(self.frames.product(a - self.step.gravity))
        turning, before, end = self.frames.turning, self.step.before.turns, self.turned(increment)
        if turning is not None and before is not None and end is not None:
            inertia[turning.inertia.own] += turning.forces(before, end, increment)
        outer = self.loads.force(increment)
        if self.contacts.touches:
            touched = self.touched(x)
            on_nodes = touched.at_nodes(touched.force, self.body.layout.n_owned_nodes)
            outer = outer + self.axes.to_body(self.body.condense_nodes(on_nodes))
        return internal, inertia, outer

    def turned(self, increment: FloatArray) -> TurnState | None:
        """The nodes' rotations at a displacement (local dofs,) m. Not collective."""
        turning, step = self.frames.turning, self.step
        if turning is None or step.before.turns is None:
            return None
        return turning.ended(step.before.turns, increment, self.axes.R, self.frame_motion, step.h, step.scheme)

    def touched(self, x: FloatArray) -> TouchedNodes:
        """Contact forces with nodes at x (local nodes, 3) m. Not collective."""
        return self.contacts.evaluate(x, self.frame_motion)[0]

    def residual(self, increment: FloatArray) -> FloatArray:
        """(owned dofs,) N, the residual at a displacement (local dofs,) m. Collective.

        Raises:
            ConvergenceError: as `NonlinearModel.force`.
        """
        internal, inertia, outer = self.forces(increment)
        return internal + inertia - outer

    def balance(self, increment: FloatArray) -> Balance:
        """As `residual`, with the size of the forces. Collective.

        Raises:
            ConvergenceError: as `NonlinearModel.force`.
        """
        internal, inertia, outer = self.forces(increment)
        size = max(self.step.round_off / STALLED, *(self.body.norm(part) for part in (internal, inertia, outer)))
        return Balance(internal + inertia - outer, size)

    def tangent(self, increment: FloatArray) -> PETSc.Mat:
        """Derivative of the residual; the body's own matrix. Collective.

        Raises:
            ConvergenceError: as `NonlinearModel.tangent`.
        """
        self.loads.set_given_fields()
        matrix = self.loads.subtract_slopes(self.body.tangent(increment, dt=self.step.h), increment)
        matrix.axpy(1.0 / self.step.per_x, self.frames.mass, PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
        if self.contacts.touches:
            touched = self.touched(self.motion(increment)[0])
            matrix = self.body.with_slopes(
                matrix, lambda alone: touched.add_slopes(alone, self.axes.R, self.body.layout)
            )
        return matrix

    def end(self, increment: FloatArray, held_velocities: FloatArray) -> NodalState:
        """The nodes at the step's end."""
        step, before, (x, a) = self.step, self.step.before, self.motion(increment)
        _, v, last = step.scheme.end(step.h, before.v, before.a, before.auxiliary, a)
        v[self.held] = held_velocities
        v, a, last = (self.body.complete_nodes(rates) for rates in (v, a, last))
        return NodalState(step.t_end, x, v, a, last, step.h, self.turned(increment))


@dataclass(frozen=True, eq=False)
class RestEquations:
    """Internal and outer forces at rest, in body axes, as they depend on the displacement.

    Attributes:
        body: the body.
        weight: (owned dofs,) N, minus what gravity does, in body axes.
        loads: that act.
        round_off: N, 2-norm of what rounding leaves of the residual.
    """

    body: NonlinearModel
    weight: FloatArray
    loads: TrialLoads
    round_off: float

    def balance(self, increment: FloatArray) -> Balance:
        """The forces at a displacement (local dofs,) m. Collective.

        Raises:
            ConvergenceError: as `NonlinearModel.force`.
        """
        self.loads.set_given_fields()
        internal = self.body.force(increment, dt=0.0)
        if self.body.is_updated:
            self.body.check_cells()
        outer = self.weight - self.loads.force(increment)
        size = max(self.body.norm(internal), self.body.norm(outer), self.round_off / STALLED)
        return Balance(internal + outer, size)

    def tangent(self, increment: FloatArray) -> PETSc.Mat:
        """Derivative of the residual; the body's own matrix. Collective.

        Raises:
            ConvergenceError: as `NonlinearModel.tangent`.
        """
        self.loads.set_given_fields()
        return self.loads.subtract_slopes(self.body.tangent(increment, dt=0.0), increment)
