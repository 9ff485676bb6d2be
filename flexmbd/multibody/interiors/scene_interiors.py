"""The interiors of a compiled scene: their frames in the plan, their wrenches on them, and their records."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import SceneError, described
from flexmbd.multibody.bodies.body import Frame, Ground
from flexmbd.multibody.bodies.continuum_body import ContinuumBody, FrameMotion, Memory, PlacedInterior
from flexmbd.multibody.force.protocol import ElementTable, OffJoints
from flexmbd.multibody.interiors.observed import ObservedInterior
from flexmbd.multibody.interiors.ported import PortedInterior
from flexmbd.multibody.interiors.time_factor import LoadedInterior
from flexmbd.multibody.interiors.touching_interior import Obstacle, ReducedFacets
from flexmbd.multibody.kernels.base.arrays import Plan, Work
from flexmbd.multibody.kernels.elements.interior_wrench import INTERIOR_WRENCH
from flexmbd.multibody.kernels.sampling.interface_frames import (
    M_A,
    M_ALPHA,
    M_P,
    M_R,
    M_V,
    M_W,
    N_MOTION,
    frame_motions,
    frame_twists,
)
from flexmbd.multibody.team import Team

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class InteriorForce(OffJoints):
    """The wrenches of an interior on its frames: forces and moments in inertial axes, changed at each step.

    Attributes:
        body: with the interior.
        obstacles: rigid shapes that its surfaces touch, on whose frames it exerts wrenches as well.
        reduced: surfaces of reduced bodies that they touch, likewise.
        pairs: names of its contacts with other bodies with history.
        beside: frames of bodies that are solved for with it (`CoupledInterior`), on which it exerts none.
    """

    body: ContinuumBody
    obstacles: tuple[Obstacle, ...] = ()
    reduced: tuple[ReducedFacets, ...] = ()
    pairs: tuple[str, ...] = ()
    beside: tuple[Frame, ...] = ()

    @property
    def frames(self) -> tuple[Frame, ...]:
        """The interface frames, those of the obstacles, those of reduced bodies, and those of bodies beside it."""
        own = (self.body.frame(frame.name) for frame in self.body.interior.frames)
        touched = (*(one.frame for one in self.obstacles), *(frame for one in self.reduced for frame in one.frames))
        return (*own, *touched, *self.beside)

    def check(self) -> None:
        """Nothing to check: the body was when it was made."""

    def assemble(self, table: ElementTable) -> None:
        """One row a frame; on the ground, which nothing moves, none is needed."""
        rows = tuple(table.frame(frame) for frame in self.frames)
        giving = [one.name for one in self.obstacles if one.mass is not None]
        giving += [one.name for one in self.reduced]
        placed = PlacedInterior(self.body, rows, (*giving, *self.pairs), is_paired=bool(self.pairs))
        first = table.add_interior(placed)
        for k, (frame, row) in enumerate(zip(self.frames, rows, strict=True)):
            what = f"interior of {self.body.name} on {frame.label}"
            if not isinstance(frame.body, Ground):
                table.element(INTERIOR_WRENCH, what, f=table.ground(), g=row, count=first + k)
        if isinstance(self.body.interior, LoadedInterior):
            for factor in self.body.interior.load_factors:  # no element reads them, but steps end on their breaks
                table.time(factor.function, f"{factor.what} of {self.body.name}")


@dataclass(frozen=True)
class InteriorRecord:
    """The interiors' part of a row of the trajectory.

    Attributes:
        wrenches: (k, 6) on the frames.
        energies: J, by name, of each body.
        outer_forces: (3,) N, by name, of planes and loads on each body; none of one that does not show them.
        ports: (2,) effort and flow by name, of each body.
    """

    wrenches: FloatArray
    energies: tuple[Mapping[str, float], ...]
    outer_forces: tuple[Mapping[str, FloatArray], ...]
    ports: tuple[Mapping[str, FloatArray], ...]


@dataclass(frozen=True, eq=False)
class Interiors:
    """All interiors of a scene, with k frames, body by body.

    Attributes:
        placed: one a body.
        team: the processes that run the scene; rank 0's wrenches count.
        failure: why stepping stopped, if it did.
        buffer: one record for each row of the integrator's record.
        watchers: are called after each accepted step, when the machine's state is that at its end.
    """

    placed: tuple[PlacedInterior, ...]
    team: Team
    failure: list[SceneError] = field(default_factory=list)
    buffer: list[InteriorRecord] = field(default_factory=list)
    watchers: list[Callable[[], None]] = field(default_factory=list)

    @property
    def bodies(self) -> tuple[ContinuumBody, ...]:
        """The bodies."""
        return tuple(one.body for one in self.placed)

    @cached_property
    def rows(self) -> NDArray[np.int64]:
        """(k,) rows of ``Plan.frames``."""
        return np.array([row for one in self.placed for row in one.rows], np.int64)

    def motions(
        self, plan: Plan, work: Work, x: FloatArray, v: FloatArray, a: FloatArray
    ) -> tuple[FrameMotion, ...]:
        """Motion of each body's frames at a state of the machine."""
        out = np.zeros((len(self.rows), N_MOTION))
        frame_motions(plan, work, self.rows, x, v, a, out)
        return self.split_motions(out)

    def split_motions(self, out: FloatArray) -> tuple[FrameMotion, ...]:
        """Each body's part of motions (k, N_MOTION), as copies."""
        found, first = [], 0
        for one in self.placed:
            part = out[first : first + len(one.rows)]
            first += len(one.rows)
            linear = (part[:, o : o + 3].copy() for o in (M_V, M_W, M_A, M_ALPHA))
            found.append(FrameMotion(part[:, M_P : M_P + 3].copy(), part[:, M_R:M_V].reshape(-1, 3, 3).copy(), *linear))
        return tuple(found)

    def twists(self, plan: Plan, work: Work, x: FloatArray) -> FloatArray:
        """(6 k, nv) velocity and angular velocity of the frames per unit of each generalised velocity."""
        nv = len(plan.free) + len(plan.driven)
        out = np.zeros((6 * len(self.rows), nv))
        frame_twists(plan, work, self.rows, x, np.zeros(nv), np.zeros(nv), out)
        return out

    def evaluate(
        self, function: Callable[[int, ContinuumBody], Sequence[FloatArray]], *, doing: str
    ) -> list[list[FloatArray]]:
        """Results of a function for each body's interior: finite arrays, rank 0's on all ranks.

        Raises:
            SceneError: an interior failed; the message names its body, and the cause is its own error.
        """
        answers = []
        for k, body in enumerate(self.bodies):
            error: Exception | None = None
            answer: list[FloatArray] = []
            try:
                answer = [np.asarray(part, dtype=np.float64) for part in function(k, body)]
                if not all(np.isfinite(part).all() for part in answer):
                    raise SceneError("it gave numbers that are not finite")
            except Exception as reason:  # noqa: BLE001  (whatever a user's body raises ends in the step's failure)
                error = reason
            try:
                self.team.fail(error)
            except Exception as reason:
                raise SceneError(f"body {body.name!r} failed {doing}: {described(reason)}") from (error or reason)
            answers.append([self.team.agree(part) for part in answer])
        return answers

    def apply_wrenches(self, plan: Plan, wrenches: FloatArray) -> None:
        """Write wrenches (k, 6) into the plan."""
        plan.wrenches[:] = wrenches

    def applied_wrenches(self, plan: Plan) -> FloatArray:
        """Return a copy (k, 6) of the wrenches in the plan."""
        return plan.wrenches.copy()

    def row(self, plan: Plan) -> InteriorRecord:
        """The record at the machine's present state, of which the watchers are told.  Collective."""
        energies = tuple(dict(body.interior.energies()) for body in self.bodies)
        forces = tuple({} if one is None else dict(one.outer_forces()) for one in self.observed)
        for watch in self.watchers:
            watch()
        interiors = (body.interior for body in self.bodies)
        ports = tuple(dict(one.port_states()) if isinstance(one, PortedInterior) else {} for one in interiors)
        return InteriorRecord(self.applied_wrenches(plan), energies, forces, ports)

    @cached_property
    def observed(self) -> tuple[ObservedInterior | None, ...]:
        """The bodies' interiors, None for those that do not show themselves."""
        found = (body.interior for body in self.bodies)
        return tuple(one if isinstance(one, ObservedInterior) else None for one in found)

    def snapshot(self, plan: Plan) -> InteriorSnapshot:
        """Copies of the interiors' states and wrenches."""
        memories = tuple(dict(body.interior.snapshot()) for body in self.bodies)
        return InteriorSnapshot(self.applied_wrenches(plan), memories)

    def restore(self, plan: Plan, kept: InteriorSnapshot) -> None:
        """Go back to a snapshot."""
        self.apply_wrenches(plan, kept.wrenches)
        for body, memory in zip(self.bodies, kept.memories, strict=True):
            body.interior.restore(memory)


@dataclass(frozen=True, eq=False)
class InteriorSnapshot:
    """A snapshot of interiors: the wrenches (k, 6) that act, and each one's state."""

    wrenches: FloatArray
    memories: tuple[Memory, ...]


#: The snapshot of a scene that has no interiors.
NO_INTERIORS = InteriorSnapshot(np.zeros((0, 6)), ())
