"""One Newton iteration of a body's nodes within each of the machine's, condensed to the frames.

With the nodes y and the frames' motion X the residual r(y, X) of the nodes and the wrenches w(y, X) are linearised
together, and the nodes eliminated,

    dy = -A^-1 (r + r_X dX),    w + (w_X - w_y A^-1 r_X) dX - w_y A^-1 r,    A = r_y,

so that what is out of balance in the body goes into the wrenches that the machine sees, and both converge as one.

The factor of A and what was condensed with it are kept in body axes, for the next iterations and the next steps, as
long as the corrections fall: a step in which nothing changes but a linear response costs no new tangent.
"""

from __future__ import annotations

from dataclasses import dataclass

from petsc4py import PETSc

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuation.line_search import ShareTrial, by_work, searched
from flexmbd.continuum.history.displacement_newton import NO_FORCES, TRIALS, WORK_RATIO, LinearConstraints
from flexmbd.continuum.history.nonlinear_model import NonlinearModel
from flexmbd.continuum.history.tangent_solver import LinearSolver, TangentSolver
from flexmbd.continuum.interior.frame_response import Condensation
from flexmbd.continuum.interior.further_unknowns import kinds_of_unknowns
from flexmbd.continuum.interior.step_equations import StepEquations
from flexmbd.continuum.matrices.blocks import inner, multiply
from flexmbd.multibody.bodies.continuum_body import FrameMotion

FloatArray = NDArray[np.float64]

#: A correction that is not smaller than this part of the one before asks for a tangent of its own, which costs about
#: ten evaluations of the forces.
_SLOW = 0.25

#: The size of a correction whose forces are not evaluated yet.
_UNKNOWN = 1.0

#: A trial displacement, (local dofs,) m; the constraints there; the forces; and what of them is out of balance.
_Found = tuple[FloatArray, LinearConstraints | None, FloatArray, FloatArray]


@dataclass(frozen=True, eq=False)
class _KeptTangent:
    """What was computed with a tangent, in body axes.

    Attributes:
        per_x: s^2, of the step that it was made for.
        slopes: (6 k, 6 k) of the wrenches by the frames' motions.
        fields: (6 k, owned dofs) m, displacement of the nodes, and further unknowns, by a unit motion of each frame.
    """

    per_x: float
    slopes: FloatArray
    fields: FloatArray


@dataclass(frozen=True, eq=False)
class _Iterate:
    """Nodes after an iteration.

    Attributes:
        increment: (local dofs,) m, displacement since the last accepted step, at which the forces were evaluated.
        change: (owned dofs,) m, its correction.
        work: J, of what was out of balance on the correction.
        motion: of the frames that it was corrected for.
        correction: J^(1/2), the energy norm of the correction; infinite before the first.
        first: J^(1/2), of the first iteration of the step.
    """

    increment: FloatArray
    change: FloatArray
    work: float
    motion: FrameMotion
    correction: float
    first: float


@dataclass(frozen=True, eq=False)
class Condensed:
    """The frames' wrenches as the linearised body has them.

    Attributes:
        wrenches: (k, 6) on them.
        slopes: (6 k, 6 k) their derivative, as `ImplicitInterior.trial` has it.
        correction: how far the nodes are from balance: the energy norm of Newton's correction over what the body holds.
        increment: (local dofs,) m, at which the forces were evaluated.
    """

    wrenches: FloatArray
    slopes: FloatArray
    correction: float
    increment: FloatArray


class CondensedNewton:
    """Newton's iteration of a body's nodes, step after step."""

    def __init__(
        self, body: NonlinearModel, frames: Condensation, prescribed: NDArray[np.int32], solver: LinearSolver
    ) -> None:
        """Nothing is computed yet.

        Args:
            body: the body.
            frames: with its bonds, averages and mass.
            prescribed: owned dofs that move with rigid frames, or never.
            solver: of the linear systems.
        """
        self._body, self._frames, self._prescribed = body, frames, prescribed
        self._bonds, self._averages = frames.bonds, frames.averages
        self._linear = TangentSolver(body, prescribed, solver)
        self._held = self._bonds.nodes[~self._bonds.averaged]
        self._parts = kinds_of_unknowns(body)
        self._tangent: PETSc.Mat = PETSc.Mat()  # with its rows of nodes on frames; no handle before the first
        self._vector = body.vector()
        self._responses: FloatArray = np.zeros((body.n_owned, 0))  # displacement by unit forces along the constraints
        self._kept: _KeptTangent | None = None
        self._last: _Iterate | None = None

    def end_step(self) -> None:
        """Forget the step's iterations; factors are kept."""
        self._last = None

    def discard(self) -> None:
        """Forget everything, as at a checkpoint."""
        self._last = self._kept = None
        self._linear.discard_preconditioner()

    def iterate(
        self, equations: StepEquations, motion: FrameMotion, *, energy: float, tolerance: float, renew: bool
    ) -> Condensed:
        """Go to a motion of the frames, linearise there. Collective.

        Args:
            equations: of the step's end, with these frames.
            motion: of the frames.
            energy: J, what the body holds, the measure of corrections; where it is none the step's first is.
            tolerance: a correction that is smaller needs no tangent of its own.
            renew: whether the tangent shall be made anew.

        Raises:
            ConvergenceError: on all ranks: the forces cannot be had there.
        """
        last = self._last
        if last is None:
            return self._predict(equations, motion, renew=renew)
        increment, constraints, balance, left = self._search(equations, motion, last)
        fresh = renew or self._kept is None or self._kept.per_x != equations.step.per_x
        if fresh:
            self._factor(equations.tangent(increment), constraints)
        change, forces, norm = self._correction(left, constraints)
        size = _relative(norm, energy, last.first)
        if not fresh and size > tolerance and norm > _SLOW * last.correction:
            fresh = True
            self._factor(equations.tangent(increment), constraints)
            change, forces, norm = self._correction(left, constraints)
            size = _relative(norm, energy, last.first)
        if size > tolerance and self._body.norm(left) <= equations.step.round_off:
            size = 0.0
        residual = balance + forces
        wrenches, slopes = self._response(equations, motion, increment, change, residual, fresh=fresh)
        work = float(self._bonds.total(np.array(change @ left)))
        self._last = _Iterate(increment, change, work, motion, norm, last.first)
        return Condensed(wrenches, slopes, size, increment)

    def _predict(self, equations: StepEquations, motion: FrameMotion, *, renew: bool) -> Condensed:
        """The first iteration: linear from the last accepted state, in which no material is led astray. Collective."""
        body, kept = self._body, self._kept
        increment = np.zeros(body.layout.n_local)
        places = equations.axes.increment(self._bonds.positions(motion), self._bonds.nodes)
        constraints = self._averages.constraints(motion, equations.axes.R, displacement=places)
        balance = equations.residual(increment)
        fresh = renew or kept is None or kept.per_x != equations.step.per_x
        if fresh:
            self._factor(self._begun_tangent(equations, increment), constraints)
        # held nodes go with their frames, whose accelerations they have
        jump = np.zeros_like(body.layout.node_x)
        jump[self._held] = places[~self._bonds.averaged]
        jumped = body.layout.at_dofs(jump[: body.layout.n_owned_nodes], owned=True)
        own = self._bonds.turns.own
        jumped[self._bonds.turns.dofs[own]] = self._turned(equations, motion)[own]
        inertia = multiply(self._frames.mass, jumped[:, None])[:, 0] / equations.step.per_x
        residual = balance + self._product(jumped) - inertia
        left = self._without_constraint_forces(residual, constraints)
        change, forces, norm = self._correction(left, constraints)
        change, residual = change + jumped, residual + forces
        wrenches, slopes = self._response(equations, motion, increment, change, residual, fresh=fresh)
        self._last = _Iterate(increment, change, 0.0, motion, norm, norm)
        return Condensed(wrenches, slopes, _UNKNOWN, increment)

    def _begun_tangent(self, equations: StepEquations, increment: FloatArray) -> PETSc.Mat:
        """The tangent to begin a step of another length with: the stiffness as it was. Collective."""
        if self._kept is None:
            return equations.tangent(increment)
        matrix = self._tangent.copy()
        change = 1.0 / equations.step.per_x - 1.0 / self._kept.per_x
        matrix.axpy(change, self._frames.mass, PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
        return matrix

    def _search(
        self, equations: StepEquations, motion: FrameMotion, last: _Iterate
    ) -> _Found:
        """Go along the last correction until what is out of balance does less work on it. Collective."""

        def trial(share: float) -> ShareTrial[_Found]:
            increment, constraints = self._placed(equations, motion, last, share)
            balance = equations.residual(increment)
            left = self._without_constraint_forces(balance, constraints)
            found = increment, constraints, balance, left
            if not last.work:  # nothing to compare: the step is taken
                return ShareTrial(found, share, 0.0)
            work = float(self._bonds.total(np.array(last.change @ left)))
            return by_work(found, share, work=work, before=last.work, ratio=WORK_RATIO)

        return searched(trial, most=TRIALS if last.work else 1, fails=NO_FORCES).place

    def _placed(
        self, equations: StepEquations, motion: FrameMotion, last: _Iterate, share: float
    ) -> tuple[FloatArray, LinearConstraints | None]:
        """A share of the last correction, and nodes as they go with the frames: held ones exactly, others linearly.

        Returns:
            (local dofs,) m; and the constraints of averaged frames, which are met but for second order.
        """
        axes, bonds = equations.axes, self._bonds
        change = share * last.change
        if self._kept is not None:
            moves = _small_motions(last.motion, motion, axes.R)
            change += moves @ self._kept.fields
        increment = self._with_ghosts(last.increment, change)
        layout = self._body.layout
        places = axes.increment(bonds.positions(motion), bonds.nodes)
        gap = places - layout.displacements(increment)[bonds.nodes]
        increment[layout.displacement_dofs[self._held]] = places[~bonds.averaged]
        increment[bonds.turns.dofs] = self._turned(equations, motion)
        self._body.complete(increment)
        return increment, self._averages.constraints(motion, axes.R, displacement=gap)

    def _turned(self, equations: StepEquations, motion: FrameMotion) -> FloatArray:
        """(m,) how far unknowns that turn with frames have turned since the last accepted step."""
        return self._bonds.turns.increments(motion.R, equations.axes.R, self._body.displacement)

    def _factor(self, matrix: PETSc.Mat, constraints: LinearConstraints | None) -> None:
        """Factor a tangent, which is changed. Collective."""
        self._kept = None
        if not self._tangent.handle:
            self._tangent = matrix.copy()
            self._products = self._tangent.createVecs()
        else:
            matrix.copy(self._tangent, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
        self._linear.constrain(matrix)
        self._linear.renew_preconditioner()
        self._linear.set_operator(matrix)
        if constraints is not None:
            self._responses = self._linear.solve_block(constraints.columns)

    def _correction(
        self, left: FloatArray, constraints: LinearConstraints | None
    ) -> tuple[FloatArray, FloatArray, float]:
        """Newton's correction (owned dofs,) m, its forces (owned dofs,) N, and its energy norm, J^(1/2). Collective."""
        change = self._linear.solve_factored(-left)
        if constraints is not None:
            change = self._constrained(change[:, None], constraints)[:, 0]
        forces = self._product(change)
        # each kind of unknown by itself: in one sum a pressure's energy may take away the displacement's
        energies = self._bonds.total(np.array([np.vdot(change[part], forces[part]) for part in self._parts]))
        return change, forces, float(np.sqrt(abs(energies).sum()))

    def _constrained(self, solution: FloatArray, constraints: LinearConstraints) -> FloatArray:
        """Solutions (owned dofs, k) with the forces that keep the constraints. Collective."""
        m, responses = len(constraints.gap), self._responses
        products = inner(self._body.comm, constraints.columns, np.hstack([responses, solution]))
        shares = np.linalg.solve(products[:, :m], products[:, m:] - constraints.gap[:, None])
        return np.asarray(solution - responses @ shares)

    def _response(
        self,
        equations: StepEquations,
        motion: FrameMotion,
        increment: FloatArray,
        change: FloatArray,
        residual: FloatArray,
        *,
        fresh: bool,
    ) -> tuple[FloatArray, FloatArray]:
        """Wrenches (k, 6) and slopes (6 k, 6 k) where the linearised nodes are in balance. Collective."""
        frames, bonds, R = self._frames, self._bonds, equations.axes.R
        couples = bonds.turns.wrenches(residual, motion.R, R)
        residual, corrected = equations.axes.to_inertial(residual), self._with_ghosts(increment, change)
        touched = None
        if equations.contacts.touches:
            touched = equations.touched(equations.motion(increment)[0])
            touched = touched.moved(self._body.complete_nodes(equations.axes.to_inertial(change.copy())))
        if not fresh and self._kept is not None:
            arms = equations.axes.positions(corrected, bonds.nodes) - motion.p[bonds.frame_of]
            forces = frames.nodal_forces(residual, equations.held_accelerations - equations.step.gravity)
            couples = couples + frames.frame_couples(motion)
            wrenches = frames.with_shapes(bonds.wrenches(forces, arms) + couples, touched)
            return wrenches, _turned(self._kept.slopes, R)
        x, a = equations.motion(corrected)
        a -= equations.step.gravity
        constraints = self._averages.constraints(motion, R)

        def inverse(block: FloatArray) -> FloatArray:
            solution = self._linear.solve_block(block)
            return solution if constraints is None else self._constrained(solution, constraints)

        response = frames.respond(
            self._tangent,
            inverse,
            residual,
            motion,
            x=x,
            apparent_acceleration=a,
            dead_load=equations.axes.to_inertial(equations.loads.dead),
            slopes=equations.step.scheme.slopes(equations.step.h),
            couples=couples,
            touched=touched,
        )
        n = len(response.slopes)
        turn = np.kron(np.eye(n // 3), R)
        fields = turn.T @ response.relative.T
        self._kept = _KeptTangent(equations.step.per_x, _turned(response.slopes, R.T), fields)
        return response.wrenches, response.slopes

    def _product(self, change: FloatArray) -> FloatArray:
        """The kept tangent, with its rows of nodes on frames, times a displacement (owned dofs,). Collective."""
        right, left = self._products
        right.array[:] = change
        self._tangent.mult(right, left)
        return np.asarray(left.array_r.copy())

    def _with_ghosts(self, increment: FloatArray, change: FloatArray) -> FloatArray:
        """(local dofs,) an increment and a change of the owned dofs. Collective."""
        vector = self._vector
        vector.array[: self._body.n_owned] = increment[: self._body.n_owned] + change
        vector.scatter_forward()
        return self._body.complete(vector.array.copy())

    def _without_constraint_forces(self, residual: FloatArray, constraints: LinearConstraints | None) -> FloatArray:
        """The residual on the nodes that no frame holds, less the forces that keep the constraints. Collective."""
        free = residual.copy()
        if constraints is not None:
            along = self._bonds.total(np.asarray(constraints.columns.T @ residual))
            free -= constraints.columns @ along
        free[self._prescribed] = 0.0
        return free


def _relative(norm: float, energy: float, first: float) -> float:
    """The size of a correction: its energy norm over that of what the body holds, or of the step's first one."""
    if norm == 0.0:
        return 0.0
    return norm / np.sqrt(2.0 * energy) if energy > 0.0 else norm / (first or norm)


def _small_motions(start: FrameMotion, end: FrameMotion, R: FloatArray) -> FloatArray:
    """(6 k,) displacement of the frames' origins and their rotation vectors, in axes that R turns to inertial ones."""
    turns = end.R @ start.R.transpose(0, 2, 1)
    sines: FloatArray = 0.5 * np.stack([turns[:, k, j] - turns[:, j, k] for j, k in ((1, 2), (2, 0), (0, 1))], axis=1)
    sine = np.sqrt((sines**2).sum(axis=1))
    angle = np.arctan2(sine, 0.5 * (turns[:, 0, 0] + turns[:, 1, 1] + turns[:, 2, 2] - 1.0))
    vectors = sines * (angle / np.where(sine > 0.0, sine, 1.0))[:, None]
    return np.hstack([(end.p - start.p) @ R, vectors @ R]).reshape(-1)


def _turned(matrix: FloatArray, R: FloatArray) -> FloatArray:
    """A matrix (n, n) of vectors in threes, in axes that R (3, 3) turns those of it to."""
    turn = np.kron(np.eye(len(matrix) // 3), R)
    return np.asarray(turn @ matrix @ turn.T)
