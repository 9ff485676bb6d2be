"""One Newton iteration of the nodes of a body, or of several that touch, within each of the machine's.

With the nodes y and the frames' motion X the residual r(y, X) of the nodes and the wrenches w(y, X) are linearised
together, and the nodes eliminated,

    dy = -A^-1 (r + r_X dX),    w + (w_X - w_y A^-1 r_X) dX - w_y A^-1 r,    A = r_y,

so that what is out of balance in the body goes into the wrenches that the machine sees, and both converge as one.
Bodies that touch each other have one A: their own ones, and what their contacts add.

The factor of A and what was condensed with it are kept in body axes, for the next iterations and the next steps, as
long as the corrections fall: a step in which nothing changes but a linear response costs no new tangent.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from petsc4py import PETSc

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from flexmbd.continuation.line_search import ShareTrial, by_work, searched
from flexmbd.continuum.history.displacement_newton import NO_FORCES, TRIALS, WORK_RATIO, LinearConstraints
from flexmbd.continuum.history.tangent_solver import LinearSolver
from flexmbd.continuum.interior.condensed_part import BodyTrial, CondensedPart, CorrectedBody
from flexmbd.continuum.interior.facing_contacts import FacingContacts, FacingForces
from flexmbd.continuum.interior.frame_columns import FrameColumns
from flexmbd.continuum.interior.joined_unknowns import CoupledFactor, JoinedFactor, JoinedUnknowns, OwnFactor
from flexmbd.continuum.matrices.blocks import inner, multiply
from flexmbd.multibody.bodies.continuum_body import FrameMotion

FloatArray = NDArray[np.float64]

#: A correction that is not smaller than this part of the one before asks for a tangent of its own, which costs about
#: ten evaluations of the forces.
_SLOW = 0.25

#: The size of a correction whose forces are not evaluated yet.
_UNKNOWN = 1.0


@dataclass(frozen=True, eq=False)
class _KeptTangent:
    """What was computed with a tangent, in body axes.

    Attributes:
        per_x: s^2, of the step that it was made for.
        slopes: (c, c) of the wrenches by the frames' motions.
        fields: (c, owned dofs) m, displacement of the nodes, and further unknowns, by a unit motion of each frame.
    """

    per_x: float
    slopes: FloatArray
    fields: FloatArray


@dataclass(frozen=True, eq=False)
class _TriedPlace:
    """A place that is tried.

    Attributes:
        increments: (local dofs,) m, of each body.
        constraints: of all bodies there.
        balance: (owned dofs,) N, the residual.
        left: what of it is out of balance.
        facing: contacts of the bodies with each other there.
    """

    increments: list[FloatArray]
    constraints: LinearConstraints | None
    balance: FloatArray
    left: FloatArray
    facing: FacingForces


@dataclass(frozen=True, eq=False)
class _Iterate:
    """Nodes after an iteration.

    Attributes:
        increments: (local dofs,) m, of each body: displacement since the last accepted step, at which the forces were
            evaluated.
        change: (owned dofs,) m, their correction.
        work: J, of what was out of balance on the correction.
        motions: of each body's frames that it was corrected for.
        correction: J^(1/2), the energy norm of the correction; infinite before the first.
        first: J^(1/2), of the first iteration of the step.
    """

    increments: list[FloatArray]
    change: FloatArray
    work: float
    motions: list[FrameMotion]
    correction: float
    first: float


@dataclass(frozen=True, eq=False)
class Condensed:
    """The frames' wrenches as the linearised bodies have them.

    Attributes:
        wrenches: of each body (k, 6) on its frames and those of shapes that it touches.
        slopes: (c, c) the derivative of all of them, as `ImplicitInterior.trial` has it.
        correction: how far the nodes are from balance: the energy norm of Newton's correction over what bodies hold.
        increments: (local dofs,) m, of each body, at which the forces were evaluated.
        facing: contacts of the bodies with each other there.
    """

    wrenches: list[FloatArray]
    slopes: FloatArray
    correction: float
    increments: list[FloatArray]
    facing: FacingForces


class CondensedNewton:
    """Newton's iteration of bodies' nodes, step after step."""

    def __init__(self, parts: Sequence[CondensedPart], solver: LinearSolver, facing: FacingContacts) -> None:
        """Nothing is computed yet.

        Args:
            parts: the bodies.
            solver: of the linear systems of one body; those of several have a factor of their own.
            facing: contacts of several with each other.
        """
        self._parts, self._facing, self._comm = tuple(parts), facing, parts[0].body.comm
        self._unknowns = unknowns = JoinedUnknowns(parts)
        alone = len(parts) == 1
        self._linear: JoinedFactor = OwnFactor(parts[0], solver) if alone else CoupledFactor(parts, unknowns)
        self._responses: FloatArray = np.zeros((unknowns.size, 0))  # displacement by unit forces along constraints
        self._coupling: PETSc.Mat | None = None  # of the last tangent
        self._kept: _KeptTangent | None = None
        self._last: _Iterate | None = None

    def end_step(self) -> None:
        """Forget the step's iterations; factors are kept."""
        self._last = None

    def discard(self) -> None:
        """Forget everything, as at a checkpoint."""
        self._last = self._kept = None
        self._linear.discard()

    def iterate(self, trials: Sequence[BodyTrial], *, energy: float, tolerance: float, renew: bool) -> Condensed:
        """Go to a motion of the frames, linearise there. Collective.

        Args:
            trials: of the bodies: the equations of the step's end, with their frames.
            energy: J, what the bodies hold, the measure of corrections; where it is none the step's first is.
            tolerance: a correction that is smaller needs no tangent of its own.
            renew: whether the tangent shall be made anew.

        Raises:
            ConvergenceError: on all ranks: the forces cannot be had there.
        """
        last = self._last
        if last is None:
            return self._predict(trials, renew=renew)
        found, per_x = self._search(trials, last), trials[0].equations.step.per_x
        fresh = renew or self._kept is None or self._kept.per_x != per_x
        if fresh:
            self._factor(trials, found)
        change, forces, norm = self._correction(found)
        size = _relative(norm, energy, last.first)
        if not fresh and size > tolerance and norm > _SLOW * last.correction:
            fresh = True
            self._factor(trials, found)
            change, forces, norm = self._correction(found)
            size = _relative(norm, energy, last.first)
        if size > tolerance:
            sizes = zip(self._parts, self._unknowns.split(found.left), strict=True)
            most = float(np.linalg.norm([one.equations.step.round_off for one in trials]))
            if float(np.linalg.norm([part.body.norm(left) for part, left in sizes])) <= most:
                size = 0.0
        wrenches, slopes = self._response(trials, found, change, found.balance + forces, fresh=fresh)
        work = self._total(float(change @ found.left))
        motions = [one.motion for one in trials]
        self._last = _Iterate(found.increments, change, work, motions, norm, last.first)
        return Condensed(wrenches, slopes, size, found.increments, found.facing)

    def _predict(self, trials: Sequence[BodyTrial], *, renew: bool) -> Condensed:
        """The first iteration: linear from the last accepted state. Collective."""
        kept, parts, per_x = self._kept, self._parts, trials[0].equations.step.per_x
        begun = [part.begun(one) for part, one in zip(parts, trials, strict=True)]
        increments: list[FloatArray] = [np.zeros(part.body.layout.n_local) for part in parts]
        balance, facing = self._residual(trials, increments)
        constraints = self._unknowns.constraints([found for *_, found in begun])
        found = _TriedPlace(increments, constraints, balance, balance, facing)
        fresh = renew or kept is None or kept.per_x != per_x
        if fresh and kept is not None:
            self._factor(trials, found, [part.begun_tangent(per_x, kept.per_x) for part in parts])
        elif fresh:
            self._factor(trials, found)
        jumped, inertia = (np.concatenate(several) for several in list(zip(*begun, strict=True))[:2])
        residual = balance + self._product(jumped) - inertia
        left = self._without_constraint_forces(residual, [found for *_, found in begun])
        found = _TriedPlace(increments, constraints, residual, left, facing)
        change, forces, norm = self._correction(found)
        change, residual = change + jumped, residual + forces
        wrenches, slopes = self._response(trials, found, change, residual, fresh=fresh)
        self._last = _Iterate(increments, change, 0.0, [one.motion for one in trials], norm, norm)
        return Condensed(wrenches, slopes, _UNKNOWN, increments, facing)

    def _residual(self, trials: Sequence[BodyTrial], increments: list[FloatArray]) -> tuple[FloatArray, FacingForces]:
        """(owned dofs,) N at increments (local dofs,) m of each body, and the contacts there. Collective."""
        residuals = [one.equations.residual(y) for one, y in zip(trials, increments, strict=True)]
        axes = [one.equations.axes for one in trials]
        facing = self._facing.evaluate([one.positions(y) for one, y in zip(axes, increments, strict=True)], axes)
        acting = zip(residuals, axes, facing.on_bodies, strict=True)
        return np.concatenate([part - one.to_body(force) for part, one, force in acting]), facing

    def _search(self, trials: Sequence[BodyTrial], last: _Iterate) -> _TriedPlace:
        """Go along the last correction until what is out of balance does less work on it. Collective."""

        def trial(share: float) -> ShareTrial[_TriedPlace]:
            increments, constraints = self._placed(trials, last, share)
            balance, facing = self._residual(trials, increments)
            left = self._without_constraint_forces(balance, constraints)
            found = _TriedPlace(increments, self._unknowns.constraints(constraints), balance, left, facing)
            if not last.work:  # nothing to compare: the step is taken
                return ShareTrial(found, share, 0.0)
            work = self._total(float(last.change @ left))
            return by_work(found, share, work=work, before=last.work, ratio=WORK_RATIO)

        return searched(trial, most=TRIALS if last.work else 1, fails=NO_FORCES).place

    def _placed(
        self, trials: Sequence[BodyTrial], last: _Iterate, share: float
    ) -> tuple[list[FloatArray], list[LinearConstraints | None]]:
        """A share of the last correction, and nodes as they go with the frames: held ones exactly, others linearly."""
        change = share * last.change
        if self._kept is not None:
            moved = zip(self._parts, last.motions, trials, strict=True)
            moves = np.concatenate([part.small_motions(before, one) for part, before, one in moved])
            change = change + moves @ self._kept.fields
        changes = zip(self._parts, trials, last.increments, self._unknowns.split(change), strict=True)
        found = [part.placed(one, increment, own) for part, one, increment, own in changes]
        return [increment for increment, _ in found], [constraints for _, constraints in found]

    def _factor(
        self, trials: Sequence[BodyTrial], found: _TriedPlace, tangents: Sequence[PETSc.Mat] | None = None
    ) -> None:
        """Factor the tangent at a place, or those that are given and change. Collective."""
        if tangents is None:
            tangents = [one.equations.tangent(y) for one, y in zip(trials, found.increments, strict=True)]
        self._kept = None
        for part, matrix in zip(self._parts, tangents, strict=True):
            part.keep(matrix)
        if self._coupling is not None:
            self._coupling.destroy()
        axes = [one.equations.axes for one in trials]
        self._coupling = self._facing.slopes(found.facing, axes)
        self._linear.take(tangents, self._coupling)
        if found.constraints is not None:
            self._responses = self._linear.solve_block(found.constraints.columns)

    def _correction(self, found: _TriedPlace) -> tuple[FloatArray, FloatArray, float]:
        """Newton's correction (owned dofs,) m, its forces (owned dofs,) N, and its energy norm, J^(1/2). Collective."""
        change = self._linear.solve_factored(-found.left)
        if found.constraints is not None:
            change = self._constrained(change[:, None], found.constraints)[:, 0]
        forces = self._product(change)
        # each kind of unknown by itself: in one sum a pressure's energy may take away the displacement's
        energies = [
            np.vdot(own[kind], force[kind])
            for part, own, force in zip(self._parts, *map(self._unknowns.split, (change, forces)), strict=True)
            for kind in part.kinds
        ]
        return change, forces, float(np.sqrt(abs(self._parts[0].bonds.total(np.array(energies))).sum()))

    def _constrained(self, solution: FloatArray, constraints: LinearConstraints) -> FloatArray:
        """Solutions (owned dofs, k) with the forces that keep the constraints. Collective."""
        m, responses = len(constraints.gap), self._responses
        products = inner(self._comm, constraints.columns, np.hstack([responses, solution]))
        shares = np.linalg.solve(products[:, :m], products[:, m:] - constraints.gap[:, None])
        return np.asarray(solution - responses @ shares)

    def _response(
        self, trials: Sequence[BodyTrial], found: _TriedPlace, change: FloatArray, residual: FloatArray, *, fresh: bool
    ) -> tuple[list[FloatArray], FloatArray]:
        """Wrenches of each body and slopes (c, c) where the linearised nodes are in balance. Collective."""
        corrected = self._corrected(trials, found, change, residual)
        turn = scipy.linalg.block_diag(
            *(np.kron(np.eye(2 * len(one.motion.p)), one.equations.axes.R) for one in trials)
        )
        if not fresh and self._kept is not None:
            return [one.wrenches() for one in corrected], turn @ self._kept.slopes @ turn.T
        axes = [one.equations.axes for one in trials]
        acting = self._facing.moved(found.facing, self._unknowns.split(self._coupled(change)), axes)
        columns = [one.columns(force) for one, force in zip(corrected, acting, strict=True)]
        ends = np.cumsum([0, *(len(one.carried) for one in columns)])
        spans = [slice(int(first), int(last)) for first, last in pairwise(ends)]
        left, kept, ways = np.zeros((3, self._unknowns.size, int(ends[-1])))
        for part, one, mine, span in zip(self._parts, columns, self._unknowns.slices, spans, strict=True):
            left[mine, span], kept[mine, span] = one.left, one.kept
            ways[mine, span] = part.frames.columns((one.carried + one.relative) @ one.R)
        left += self._coupled(ways)
        for mine, turned in zip(self._unknowns.slices, self._facing.turned(found.facing, spans, axes), strict=True):
            left[mine] += turned
        followed = self._linear.solve_block(-left - kept)
        if found.constraints is not None:
            met = LinearConstraints(found.constraints.columns, np.zeros_like(found.constraints.gap))
            followed = self._constrained(followed, met)
        own = zip(self._parts, self._unknowns.split(followed), strict=True)
        changes = left + np.concatenate([multiply(part.tangent, rows) for part, rows in own]) + self._coupled(followed)
        return self._answers(corrected, columns, spans, followed, changes, turn)

    def _answers(
        self, corrected: list[CorrectedBody], columns: list[FrameColumns], spans: list[slice], followed: FloatArray,
        changes: FloatArray, turn: FloatArray,
    ) -> tuple[list[FloatArray], FloatArray]:
        """Wrenches of each body and slopes (c, c), of which all is kept that the next iterations need. Collective."""
        count = followed.shape[1]
        slopes, fields, wrenches = np.zeros((count, count)), np.zeros((count, self._unknowns.size)), []
        for one, own, mine, span in zip(corrected, columns, self._unknowns.slices, spans, strict=True):
            order = np.r_[span, 0 : span.start, span.stop : count]  # a body's own first
            wide = own.and_others(count - (span.stop - span.start))
            response = one.part.frames.answer(wide, followed[mine][:, order], changes[mine][:, order])
            slopes[span, order] = response.slopes
            fields[order, mine] = response.relative.T
            wrenches.append(response.wrenches)
        per_x = corrected[0].trial.equations.step.per_x
        self._kept = _KeptTangent(per_x, turn.T @ slopes @ turn, turn.T @ fields)
        return wrenches, slopes

    def _corrected(
        self, trials: Sequence[BodyTrial], found: _TriedPlace, change: FloatArray, residual: FloatArray
    ) -> list[CorrectedBody]:
        """Each body where the linearised nodes are in balance. Collective."""
        split = self._unknowns.split
        each = zip(self._parts, trials, found.increments, split(change), split(residual), strict=True)
        return [CorrectedBody.of(*one) for one in each]

    def _product(self, change: FloatArray) -> FloatArray:
        """The last tangent, with its rows of nodes on frames, times a displacement (owned dofs,). Collective."""
        own = zip(self._parts, self._unknowns.split(change), strict=True)
        return np.concatenate([part.product(rows) for part, rows in own]) + self._coupled(change)

    def _coupled(self, block: FloatArray) -> FloatArray:
        """What contacts of the bodies add to the last tangent, times (owned dofs,) or (owned dofs, k). Collective."""
        if self._coupling is None:
            return np.zeros_like(block)
        return multiply(self._coupling, block.reshape(len(block), -1)).reshape(block.shape)

    def _without_constraint_forces(
        self, residual: FloatArray, constraints: Sequence[LinearConstraints | None]
    ) -> FloatArray:
        """The residual on the nodes that no frame holds, less the forces that keep the constraints. Collective."""
        own = zip(self._parts, self._unknowns.split(residual), constraints, strict=True)
        return np.concatenate([part.without_constraint_forces(rows, kept) for part, rows, kept in own])

    def _total(self, part: float) -> float:
        return float(self._parts[0].bonds.total(np.array(part)))


def _relative(norm: float, energy: float, first: float) -> float:
    """The size of a correction: its energy norm over that of what bodies hold, or of the step's first one."""
    if norm == 0.0:
        return 0.0
    return norm / np.sqrt(2.0 * energy) if energy > 0.0 else norm / (first or norm)
