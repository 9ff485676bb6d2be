"""The nodes of a body between frames, solved for with the frames as they move, and all else condensed.

The matrices and Newton iterations of one body, whatever is to be balanced: a step's end, the start, or rest.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.history.displacement_newton import Convergence, Newton, Solution
from flexmbd.continuum.history.fresh_body import as_fresh
from flexmbd.continuum.history.locking_bodies import tell_locking_body
from flexmbd.continuum.history.nonlinear_model import NonlinearModel
from flexmbd.continuum.history.tangent_solver import LinearSolver
from flexmbd.continuum.interior.bonded_nodes import BondedNodes
from flexmbd.continuum.interior.condensed_part import CondensedPart
from flexmbd.continuum.interior.face_averages import FaceAverages
from flexmbd.continuum.interior.frame_columns import BalancedNodes
from flexmbd.continuum.interior.frame_response import Condensation, FrameResponse
from flexmbd.continuum.interior.further_unknowns import owned_further_dofs, with_unit_rows_of_further_unknowns
from flexmbd.continuum.interior.nodal_turns import TurningNodes, TurnState, refuse_turned_already, turn_inertia
from flexmbd.continuum.interior.step_equations import BodyAxes, NodalState, RestEquations, StepEquations
from flexmbd.continuum.interior.touched_nodes import TouchedNodes
from flexmbd.continuum.interior.turn_law import TurnLaw, find_turn_law
from flexmbd.errors import ConvergenceError
from flexmbd.multibody.bodies.body import RigidBody
from flexmbd.multibody.bodies.continuum_body import FrameMotion
from flexmbd.round_off import EPSILON, STALLED

FloatArray = NDArray[np.float64]

#: Far below the tolerance of a machine's own iteration.
_CONVERGENCE = Convergence(tolerance=1e-11, round_off=STALLED)


class NodalSolution:
    """Matrices and Newton iterations of one body. Constructing one is collective.

    Attributes:
        body: the body.
        bonds: its nodes on frames.
        bonded: (n,) local nodes that rigid frames hold.
        frames: condensation to them.
        law: of unknowns that turn with the body; None: there are none.
        turning: nodes whose rotations have inertia; None: there are none.
        fixed: owned dofs that are given where frames are fixed.
        newton: of displacements where those of bonded nodes are given.
        part: in iterations with the machine's own.
        solver: of the linear systems.
        diagonal: (owned nodes * 3,) N/m, of the undeformed body's tangent.
        round_off: N, 2-norm of what rounding leaves of forces.
        mass_size: kg, the same of the mass matrix.
    """

    def __init__(
        self, body: NonlinearModel, *, rigid_parts: Mapping[str, RigidBody] | None, solver: LinearSolver
    ) -> None:
        """Assemble the mass.

        Raises:
            InterfaceError: on all ranks: as `BondedNodes`.
            FormulationError: on all ranks: as `turn_inertia`.
        """
        tell_locking_body(body)
        self.body, self._M = body, body.mass()
        # in so short a time (s) nothing flows; in none a form whose viscosity is zero would divide 0 by 0
        with as_fresh(body):
            diagonal = body.tangent(np.zeros(body.layout.n_local), dt=EPSILON).getDiagonal().array_r.copy()
        inertia = turn_inertia(body, self._M)
        self.law: TurnLaw | None = find_turn_law(body, diagonal) if body.turns else None
        refuse_turned_already(body, self.law)
        self.bonds = bonds = BondedNodes(
            body, rigid_parts=rigid_parts, may_average=True, law=self.law,
            rotary=None if inertia is None else inertia.nodal,
        )
        self.turning: TurningNodes | None = None
        if inertia is not None and self.law is not None:
            self.turning = TurningNodes(inertia, self.law, bonds.rotary, bonds.nodes, bonds.frame_of)
        self._averages = FaceAverages(body, bonds)
        bonds.take_lent_mass(self._M)
        self.bonded = bonds.nodes[~bonds.averaged]
        dofs = body.displacement_dofs[bonds.nodes[bonds.own & ~bonds.averaged]]
        turning = bonds.turns.dofs[bonds.turns.own]
        self._prescribed = np.sort(np.concatenate([dofs.reshape(-1), turning])).astype(np.int32)
        self.newton = Newton(body, self._prescribed, solver=solver, convergence=_CONVERGENCE)
        # what has no mass has no acceleration
        still = np.union1d(self._prescribed, owned_further_dofs(body)).astype(np.int32)
        self._accelerated = Newton(body, still, solver=solver) if body.layout.has_further else self.newton
        self.frames = Condensation(body, bonds, self._averages, self.newton, self._M, self.turning)
        places = body.layout.displacements(diagonal)
        self.round_off = EPSILON * body.norm(places.ravel()) * self.extent_of(body.layout.node_x)
        self.mass_size = EPSILON * self._M.getDiagonal().norm()
        self.diagonal: FloatArray = places.reshape(-1).copy()
        self.fixed = np.union1d(self._prescribed, body.held_dofs).astype(np.int32)
        self.part, self.solver = CondensedPart(body, self.frames, self.fixed), solver

    @property
    def felt(self) -> FloatArray:
        """(owned nodes,) N/m, the stiffness that a node feels with its neighbours held."""
        return np.asarray(self.diagonal.reshape(-1, 3).mean(axis=1))

    def extent_of(self, x: FloatArray) -> float:
        """m, the largest coordinate of the body's nodes on all ranks, x (local nodes, 3) on this one. Collective."""
        return float(max(self.body.comm.allgather(abs(x).max(initial=0.0))))

    def round_off_of_step(self, x: FloatArray, per_x: float, touch: float) -> float:
        """N, 2-norm of what rounding leaves of a step's residual. Collective.

        Args:
            x: (local nodes, 3) m.
            per_x: s^2, of `Scheme.slopes`.
            touch: N/m, 2-norm of the stiffness of contacts.
        """
        extent = self.extent_of(x)
        # accelerations are differences of places over the square of the step
        return float(max(self.round_off, self.mass_size * extent / per_x, EPSILON * touch * extent))

    def axes(self, motion: FrameMotion) -> BodyAxes:
        """The body's axes with the frames as ``motion`` says."""
        return BodyAxes(self.body, *self.bonds.pose(motion))

    def inertia(self, a: FloatArray) -> FloatArray:
        """(owned nodes, 3) N, M a of (local nodes, 3) m/s^2, in inertial axes. Collective."""
        return self.frames.product(a)

    def discard_factors(self) -> None:
        """Forget factors of matrices."""
        self.newton.discard_factor()

    def solve(
        self, guess: FloatArray, motion: FrameMotion, axes: BodyAxes, equations: StepEquations | RestEquations
    ) -> Solution:
        """Newton's solution with the frames as ``motion`` says. Collective."""
        bonds = self.bonds
        # the first step moves the bonded nodes, and the others with them
        layout, moved = self.body.layout, guess.copy()
        steps = axes.increment(bonds.positions(motion), bonds.nodes)
        gap = steps - layout.displacements(moved)[bonds.nodes]
        moved[layout.displacement_dofs[self.bonded]] = steps[~bonds.averaged]
        guess = guess.copy()
        guess[self.body.held_dofs] = 0.0
        self.body.complete(guess)
        constraints = self._averages.constraints(motion, axes.R, displacement=gap)
        if bonds.turns.any:
            moved[bonds.turns.dofs] = bonds.turns.increments(motion.R, axes.R, self.body.displacement)
        target = moved[self._prescribed]
        return self.newton.solve(guess, target, equations.balance, equations.tangent, constraints)

    def solve_or_anew(
        self, guess: FloatArray, motion: FrameMotion, axes: BodyAxes, equations: StepEquations
    ) -> Solution:
        """As `solve`; where that fails, from the body as it was accepted last. Collective."""
        try:
            return self.solve(guess, motion, axes, equations)
        except ConvergenceError:
            # a guess by accelerations of vibrations shorter than the step is far off: begin from the deformed body
            if not guess.any():
                raise
            self.newton.discard_factor()
            return self.solve(np.zeros_like(guess), motion, axes, equations)

    def response(
        self, solution: Solution, equations: StepEquations | RestEquations, motion: FrameMotion, *, x: FloatArray,
        apparent: FloatArray, slopes: tuple[float, float], touched: TouchedNodes | None = None,
    ) -> FrameResponse:
        """Wrenches and slopes at a solution. Collective.

        Args:
            solution: of the equations.
            equations: that were solved.
            motion: of the frames.
            x: (local nodes, 3) m, inertial.
            apparent: (local nodes, 3) m/s^2, accelerations less gravity.
            slopes: of the scheme.
            touched: contact there.
        """
        axes, residual = self.axes(motion), solution.balance.residual
        at = BalancedNodes(
            motion, axes.to_inertial(residual), x, apparent, dead_load=axes.to_inertial(equations.loads.dead),
            slopes=slopes, couples=self.bonds.turns.wrenches(residual, motion.R, axes.R), touched=touched,
        )  # fmt: skip
        return self.frames.condense(lambda: equations.tangent(solution.increment), at)

    def accelerations(self, motion: FrameMotion, force: FloatArray, *, R: FloatArray) -> FloatArray:
        """(local nodes, 3) m/s^2 that forces (owned nodes, 3) N cause with the frames as ``motion`` says. Collective.

        ``R``: from the axes in which dofs are held to inertial ones, those of the forces.
        """
        bonds, body, a = self.bonds, self.body, np.zeros((len(self.body.layout.node_x), 3))
        carried = bonds.accelerations(motion)
        a[self.bonded] = carried[~bonds.averaged]
        constraints = self._averages.constraints(motion, R, displacement=carried @ R)
        matrix = with_unit_rows_of_further_unknowns(body, self._M)
        forces = body.layout.at_dofs((force - self.inertia(a)) @ R, owned=True).reshape(-1, 1)
        found = self._accelerated.solve_columns(matrix, forces, constraints)[:, 0]
        self._accelerated.discard_factor()
        matrix.destroy()
        vector = body.vector()
        vector.array[: body.n_owned] = found
        vector.scatter_forward()
        return body.complete_nodes(a + body.layout.displacements(vector.array) @ R.T)

    def begun(
        self, now: NodalState, motion: FrameMotion, *, weight: FloatArray, gravity: FloatArray, internal: FloatArray,
        unknowns: FloatArray, R: FloatArray,
    ) -> tuple[NodalState, FloatArray]:
        """The state with the accelerations that internal forces cause. Collective.

        Args:
            now: its accelerations are not read.
            motion: of the frames.
            weight: (owned nodes, 3) N, of gravity, in inertial axes.
            gravity: (3,) m/s^2.
            internal: (owned nodes, 3) N, less what acts, in inertial axes.
            unknowns: (owned dofs,) forces of unknowns beside the displacement, in the body's axes.
            R: as of `accelerations`.

        Returns:
            The state, and (k, 6) wrenches on the body's frames.
        """
        bonds = self.bonds
        a = self.accelerations(motion, weight - internal, R=R)
        state = replace(now, a=a, auxiliary=a.copy())
        nodal_forces = self.frames.nodal_forces(internal + self.inertia(a - gravity), a[self.bonded] - gravity)
        wrenches = bonds.wrenches(nodal_forces, bonds.arms(motion))
        if self.turning is not None and state.turns is not None:
            turns, forces = self.turning.started(state.turns, motion, unknowns)
            state, unknowns = replace(state, turns=turns), unknowns.copy()
            unknowns[self.turning.inertia.own] += forces
        couples = bonds.turns.wrenches(unknowns, motion.R, self.axes(motion).R)
        return state, wrenches + couples + self.frames.frame_couples(motion)

    def kinetic_energy(self, v: FloatArray, turns: TurnState | None) -> float:
        """J, less that of the frames' masses, at velocities (local nodes, 3) m/s, and spins of nodes. Collective."""
        momentum = self.inertia(v)
        nodes, mass = self._held()
        energy = 0.5 * (momentum * v[: len(momentum)]).sum() - 0.5 * (mass[:, None] * v[nodes] ** 2).sum()
        if self.turning is not None and turns is not None:
            energy += self.turning.inertia.energy(turns, nodes)
        return float(self.bonds.total(np.array(energy)))

    def weight_energy(self, weight: FloatArray, gravity: FloatArray, x: FloatArray) -> float:
        """J, of the weight (owned nodes, 3) N by gravity (3,) m/s^2, less that of frames, nodes at x m. Collective."""
        nodes, mass = self._held()
        energy = (mass[:, None] * x[nodes] @ gravity).sum() - (weight * x[: len(weight)]).sum()
        return float(self.bonds.total(np.array(energy)))

    def _held(self) -> tuple[NDArray[np.integer], FloatArray]:
        """This rank's nodes that rigid frames hold, and what of their mass the frames have, kg."""
        bonds = self.bonds
        mine = bonds.own & ~bonds.averaged
        return bonds.nodes[mine], bonds.mass[mine]
