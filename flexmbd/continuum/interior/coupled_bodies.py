"""Bodies with history that touch each other in implicit steps: all their nodes are solved for together.

Each of them answers the machine for its own frames alone, whose wrenches hang on the frames of all.  So the others'
frames, with those of the shapes that they touch, follow a body's own; the first that is asked computes for all.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.history.body_memory import BodyMemory
from flexmbd.continuum.history.nonlinear_model import NonlinearModel
from flexmbd.continuum.history.tangent_solver import Preconditioner
from flexmbd.continuum.interior.condensed_newton import Condensed, CondensedNewton
from flexmbd.continuum.interior.condensed_part import BodyTrial
from flexmbd.continuum.interior.facet_search import check_facets, check_same_ranks
from flexmbd.continuum.interior.facing_contacts import FacingContacts
from flexmbd.continuum.interior.facing_touch import FacingTouch
from flexmbd.continuum.interior.nodal_solution import NodalSolution
from flexmbd.continuum.interior.step_equations import BodyAxes, StepEquations
from flexmbd.errors import ConvergenceError, SceneError
from flexmbd.multibody.bodies.continuum_body import FrameMotion, Interior, InteriorIteration, Scheme
from flexmbd.multibody.interiors.touching_interior import FacingSurface
from flexmbd.round_off import STALLED

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# Of bodies by themselves, with their frames given: corrections with which they are solved, and iterations at most.
_SOLVED, _MOST = 1e-11, 40


class CoupledBody:
    """A body among those that are solved for together.

    Attributes:
        interior: to the machine.
        body: the body.
        nodes: their solution.
        frame_count: how many frames it has, with those of shapes that it touches.
        equations: of a step's end, from its time, its length, the scheme, and the frames' motion. Collective.
        held_energy: J, the sizes of all that it holds. Collective.
        take: keeps what its `commit` makes the state, a trial with an increment (local dofs,) m.
        coupled: all of them.
    """

    def __init__(
        self, interior: Interior, body: NonlinearModel, nodes: NodalSolution, frame_count: Callable[[], int],
        equations: Callable[[float, float, Scheme, FrameMotion], StepEquations], held_energy: Callable[[], float],
        take: Callable[[BodyTrial, FloatArray], None],
    ) -> None:
        """Alone. Collective."""
        self.interior, self.body, self.nodes, self.frame_count = interior, body, nodes, frame_count
        self.equations, self.held_energy, self.take = equations, held_energy, take
        self.leave()

    def leave(self) -> None:
        """Be alone. Collective."""
        self.coupled = CoupledBodies([self])

    def touch(self, facing: FacingSurface, other: CoupledBody) -> None:
        """Let its nodes touch another one's facets, with all that it is among. Collective.

        Raises:
            SceneError: as `touch_between`.
        """
        touch = touch_between(facing, self.nodes, other.nodes)
        coupled = self.coupled.joined(touch, self, other)
        for one in coupled.members:
            one.coupled = coupled

    def others(self) -> tuple[CoupledBody, ...]:
        """All but this one."""
        return tuple(one for one in self.coupled.members if one is not self)

    @property
    def row(self) -> int:
        """Its place among them."""
        return next(k for k, one in enumerate(self.coupled.members) if one is self)

    @property
    def is_touched(self) -> bool:
        """Whether it is not alone."""
        return bool(self.coupled.facing.contacts)

    @property
    def names(self) -> list[str]:
        """Of the contacts of all."""
        return self.coupled.facing.names

    def widened(self, wrenches: FloatArray) -> FloatArray:
        """Wrenches (k, 6) on its own frames, and none on the others'."""
        return np.vstack([wrenches, np.zeros((sum(one.frame_count() for one in self.others()), 6))])

    def begin(self, x: FloatArray, axes: BodyAxes) -> None:
        """See `CoupledBodies.begin`. Collective."""
        self.coupled.begin(self, x, axes)

    def iterate(
        self, t_end: float, h: float, scheme: Scheme, motion: FrameMotion, *, tolerance: float, renew: bool
    ) -> InteriorIteration:
        """See `IteratedInterior.iterate`. Collective."""
        return self.coupled.iterate(self, t_end, h, scheme, motion, tolerance=tolerance, renew=renew)

    def trial(self, t_end: float, h: float, scheme: Scheme, motion: FrameMotion) -> tuple[FloatArray, FloatArray]:
        """See `CoupledBodies.trial`. Collective."""
        return self.coupled.trial(self, t_end, h, scheme, motion)

    def accept(self) -> None:
        """See `CoupledBodies.accept`. Collective."""
        self.coupled.accept()

    def forget(self) -> None:
        """See `CoupledBodies.forget`."""
        self.coupled.forget()

    def stiffness(self) -> float:
        """See `FacingContacts.stiffness`."""
        return self.coupled.facing.stiffness(self.row)

    def nodal(self) -> FloatArray:
        """See `FacingContacts.nodal`."""
        return self.coupled.facing.nodal(self.row)

    def pushed(self) -> list[tuple[IntArray, FloatArray]]:
        """See `FacingContacts.pushed`."""
        return self.coupled.facing.pushed(self.row)

    def resultants(self) -> dict[str, FloatArray]:
        """See `FacingContacts.resultants`."""
        return self.coupled.facing.resultants(self.row)

    def works(self) -> FloatArray | None:
        """See `FacingContacts.works`."""
        return self.coupled.facing.works(self.row)

    def snapshot(self, memory: BodyMemory) -> dict[str, FloatArray]:
        """See `FacingContacts.snapshot`. Collective."""
        return self.coupled.facing.snapshot(self.row, memory)

    def restore(self, memory: BodyMemory, kept: Mapping[str, FloatArray]) -> None:
        """See `FacingContacts.restore`."""
        self.coupled.facing.restore(self.row, memory, kept)


@dataclass(frozen=True, eq=False)
class _Answered:
    """What was computed for all, and who has not asked for it yet, by rows."""

    what: tuple[object, ...]
    trials: list[BodyTrial]
    found: Condensed
    waiting: set[int]

    def is_for(self, what: tuple[object, ...], motions: Sequence[FrameMotion]) -> bool:
        """Whether it answers this question."""
        pairs = zip(self.trials, motions, strict=True)
        same = (np.array_equal(*parts) for one, motion in pairs for parts in zip(one.motion, motion, strict=True))
        return what == self.what and all(same)


class CoupledBodies:
    """Bodies that are solved for together, one alone included.

    Attributes:
        members: the bodies.
        facing: their contacts with each other.
        newton: of all.
    """

    def __init__(
        self, members: Sequence[CoupledBody], touches: Sequence[tuple[FacingTouch, CoupledBody, CoupledBody]] = ()
    ) -> None:
        """Nothing touches yet; touches: each with the bodies of its nodes and facets. Collective."""
        self.members, self._touches = tuple(members), tuple(touches)
        rows = {id(one): k for k, one in enumerate(self.members)}
        between = [(touch, rows[id(one)], rows[id(other)]) for touch, one, other in touches]
        self.facing = FacingContacts([one.body for one in self.members], between)
        first = self.members[0].nodes
        self.newton = CondensedNewton([one.nodes.part for one in self.members], first.solver, self.facing)
        self._begun: dict[int, tuple[FloatArray, BodyAxes]] = {}
        self._asked: _Answered | None = None
        self._tried: Condensed | None = None

    def joined(self, touch: FacingTouch, one: CoupledBody, other: CoupledBody) -> CoupledBodies:
        """These and those that another body is among, with one contact more. Collective."""
        more = () if other.coupled is self else other.coupled.members
        touches = self._touches + (() if other.coupled is self else other.coupled._touches)
        return CoupledBodies((*self.members, *more), (*touches, (touch, one, other)))

    def begin(self, member: CoupledBody, x: FloatArray, axes: BodyAxes) -> None:
        """A body begins anew with its nodes at x (local nodes, 3) m. Collective.

        Raises:
            SceneError: on all ranks: it begins in what it touches.
        """
        self.forget()
        row = member.row
        if row in self._begun:  # of a start that was refused
            self._begun = {}
        self._begun[row] = x, axes
        sizes = {k: one.nodes.extent_of(one.body.layout.node_x) for k, one in enumerate(self.members)}
        self.facing.begin(row, self._begun, sizes)
        if len(self._begun) == len(self.members):
            self._begun = {}

    def iterate(
        self, member: CoupledBody, t_end: float, h: float, scheme: Scheme, motion: FrameMotion, *, tolerance: float,
        renew: bool,
    ) -> InteriorIteration:
        """See `IteratedInterior.iterate`. Collective."""
        told = tolerance, renew
        motions = self._split(member, motion)

        def compute() -> tuple[list[BodyTrial], Condensed]:
            trials = self._trials(t_end, h, scheme, motions)
            found = self.newton.iterate(trials, energy=self._energy(), tolerance=tolerance, renew=renew)
            if found.correction <= tolerance:
                self._check(found)
            return trials, found

        return self._answer(member, self._ask(member, (t_end, h, scheme, told), motions, compute))

    def trial(
        self, member: CoupledBody, t_end: float, h: float, scheme: Scheme, motion: FrameMotion
    ) -> tuple[FloatArray, FloatArray]:
        """See `ImplicitInterior.trial`, of several bodies. Collective.

        Raises:
            ConvergenceError: on all ranks: no solution.
        """
        motions = self._split(member, motion)

        def compute() -> tuple[list[BodyTrial], Condensed]:
            trials = self._trials(t_end, h, scheme, motions)
            before, energy = np.inf, self._energy()
            for _ in range(_MOST):
                found = self.newton.iterate(trials, energy=energy, tolerance=_SOLVED, renew=True)
                stalled = found.correction <= STALLED and found.correction > 0.5 * before
                if found.correction <= _SOLVED or stalled:
                    self._check(found)
                    return trials, found
                before = found.correction
            names = ", ".join(map(repr, self.facing.names))
            raise ConvergenceError(
                f"bodies that touch each other ({names}) were not solved for in {_MOST} iterations; the last "
                f"correction is {found.correction:.1e} of what they hold; take a smaller step"
            )

        found = self._answer(member, self._ask(member, (t_end, h, scheme, ()), motions, compute))
        return found.wrenches, found.slopes

    def accept(self) -> None:
        """Make the tried step's end the accepted one, once for all. Collective."""
        self._asked = None
        self.newton.end_step()
        if self._tried is not None:
            self.facing.accept(self._tried.facing)
        self._tried = None

    def forget(self) -> None:
        """Forget the step that was tried, and factors."""
        self._asked = self._tried = None
        self.facing.revert()
        self.newton.discard()

    def _ask(
        self, member: CoupledBody, what: tuple[object, ...], motions: list[FrameMotion],
        compute: Callable[[], tuple[list[BodyTrial], Condensed]],
    ) -> _Answered:
        """What was computed, for this body now. Collective."""
        row, asked = member.row, self._asked
        if asked is None or row not in asked.waiting or not asked.is_for(what, motions):
            trials, found = compute()
            self._tried = found
            for one, trial, increment in zip(self.members, trials, found.increments, strict=True):
                one.take(trial, increment)
            self._asked = asked = _Answered(what, trials, found, set(range(len(self.members))))
        asked.waiting.discard(row)
        return asked

    def _answer(self, member: CoupledBody, asked: _Answered) -> InteriorIteration:
        """A body's part of it: wrenches on its own frames, and their slopes by all."""
        row, found = member.row, asked.found
        order = self._order(row)
        wrenches = member.widened(found.wrenches[row])
        slopes, count = np.zeros_like(found.slopes), found.wrenches[row].size
        slopes[:count] = found.slopes[np.ix_(order[:count], order)]
        rounding = np.zeros_like(wrenches)
        round_off, reach = asked.trials[row].equations.step.round_off, member.nodes.bonds.reach
        rounding[: len(found.wrenches[row])] = round_off * np.repeat([1.0, reach], 3)
        return InteriorIteration(wrenches, slopes, found.correction, rounding)

    def _order(self, row: int) -> IntArray:
        """(c,) columns of all frames, a body's own first."""
        ends = 6 * np.cumsum([0, *(one.frame_count() for one in self.members)])
        return np.r_[ends[row] : ends[row + 1], 0 : ends[row], ends[row + 1] : ends[-1]]

    def _split(self, member: CoupledBody, motion: FrameMotion) -> list[FrameMotion]:
        """Each body's part of a motion in which one body's frames come first."""
        found, first = {}, 0
        for one in (member, *member.others()):
            mine = slice(first, first + one.frame_count())
            found[id(one)] = FrameMotion(*(part[mine] for part in motion))
            first = mine.stop
        return [found[id(one)] for one in self.members]

    def _trials(self, t_end: float, h: float, scheme: Scheme, motions: list[FrameMotion]) -> list[BodyTrial]:
        pairs = zip(self.members, motions, strict=True)
        return [BodyTrial(one.equations(t_end, h, scheme, motion), motion) for one, motion in pairs]

    def _energy(self) -> float:
        return sum(one.held_energy() for one in self.members)

    def _check(self, found: Condensed) -> None:
        for one, increment in zip(self.members, found.increments, strict=True):
            one.body.check_increment(increment)


def touch_between(facing: FacingSurface, nodes: NodalSolution, facets: NodalSolution) -> FacingTouch:
    """The contact of one body's nodes with another one's facets. Collective.

    Raises:
        SceneError: on all ranks: the bodies are on other ranks, have welds, or are solved by multigrid; facets have
            nodes beside their corners, or are the edges of a plane body.
    """
    what = f"contact {facing.name!r}"
    check_facets(facets.body, facing.facets, what=what)
    check_same_ranks(nodes.body, facets.body, what=what)
    if any(one.body.ties is not None for one in (nodes, facets)):
        raise SceneError(
            f"{what}: bodies with welds touch each other in explicit steps alone; take ExplicitContinuum for both, or "
            "mesh what is welded in one"
        )
    if any(one.solver.preconditioner is not Preconditioner.FACTOR for one in (nodes, facets)):
        raise SceneError(
            f"{what}: bodies that touch each other in implicit steps have one factor, which multigrid does not make; "
            "take LinearSolver(preconditioner=Preconditioner.FACTOR) for both"
        )
    felt = nodes.felt, facets.felt
    return FacingTouch(facing, nodes.body, facets.body, felt, size=nodes.extent_of(nodes.body.layout.node_x))
