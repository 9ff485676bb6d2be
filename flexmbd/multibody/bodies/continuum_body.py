"""Bodies with history: interiors between rigid interface frames, and the body that the machine sees.

To the machine each interface frame is a rigid body (the rigid part and the lumped mass of the nodes bonded to it:
Ambrosio & Nikravesh 1992, eq. 47-53), which joints and forces take hold of as of any other.  What lies between the
frames, the interior, is a force element with memory: wrenches on the frames for their given motion.  Whoever
builds one fulfils ``ExplicitInterior``, ``ImplicitInterior`` or both; nothing here knows how.

All vectors are in inertial axes unless said otherwise, all units SI.  With several processes every call is collective
over the team and must leave all ranks with the same numbers or the same error.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import InterfaceError, SceneError
from flexmbd.given import checked
from flexmbd.multibody.bodies.body import Frame, RigidBody, refuse_change
from flexmbd.rotation import check_rotation

FloatArray = NDArray[np.float64]

#: The state of an interior, as arrays: it goes into checkpoints and their files.
Memory = Mapping[str, NDArray[np.generic]]


@dataclass(frozen=True, eq=False)
class InteriorFrame:
    """An interface frame I of the body B as it begins, and the constant mass that moves with it.

    Attributes:
        name: unique in the body.
        p_BI_B: (3,) m.
        R_BI: (3, 3) rotation from I's axes to B's.
        mass: kg, of the rigid part and the lumped mass of the nodes bonded to the frame; positive.
        com: (3,) m, centre of that mass from I's origin, in I's axes.
        inertia: (3, 3) kg m^2 of it about ``com``, in I's axes.
    """

    name: str
    p_BI_B: FloatArray
    R_BI: FloatArray
    mass: float
    com: FloatArray
    inertia: FloatArray


class FrameMotion(NamedTuple):
    """Motion of a body's k interface frames at an instant, in the order of ``Interior.frames``.

    p: (k, 3) m, origins.  R: (k, 3, 3) rotations from the frames' axes to inertial ones.
    v, w: (k, 3) m/s, rad/s, of the origins and of the frames.
    a, alpha: (k, 3) m/s^2, rad/s^2, of the origins and of the frames.
    """

    p: FloatArray
    R: FloatArray
    v: FloatArray
    w: FloatArray
    a: FloatArray
    alpha: FloatArray


class Push(NamedTuple):
    """Wrenches of an interior on its frames: (k, 6) force (N) and moment (N m) about each frame's origin.

    end: at the step's end.  mean: over the step, by the trapezoidal rule over the interior's own steps, so that h
    times it is the impulse; of a single step it is the mean of both ends.
    """

    end: FloatArray
    mean: FloatArray


@dataclass(frozen=True)
class Scheme:
    """Generalized-alpha as the machine takes it, for the interior's own unknowns alike (Arnold & Bruels 2007).

    Forces balance M a = f at the step's end, with true accelerations a.  Positions and velocities go by auxiliary
    ones A, which are the true ones at the start:

        (1 - alpha_m) A' + alpha_m A = (1 - alpha_f) a' + alpha_f a
        x' = x + h v + h^2 ((1/2 - beta) A + beta A'),    v' = v + h ((1 - gamma) A + gamma A')

    A belongs to an instant d = alpha_m - alpha_f steps later than a.  Where a step begins anew, of which nothing before
    it tells, that instant lies on the straight line between the true accelerations at both its ends, and what comes of
    A = a + d (a' - a), A' = a' + d (a' - a) is Newmark's method with gamma = 1/2, beta = (1 + d^2) / 4.

    Attributes:
        alpha_m, alpha_f, beta, gamma: of the method.
        anew: whether the step begins anew.
    """

    alpha_m: float
    alpha_f: float
    beta: float
    gamma: float
    anew: bool = False

    @property
    def delay(self) -> float:
        """d: how many steps later than the true acceleration the auxiliary one belongs."""
        return self.alpha_m - self.alpha_f

    def begun_anew(self) -> Scheme:
        """The scheme of a step that begins anew."""
        return replace(self, anew=True)

    def newmark(self) -> tuple[float, float]:
        """beta and gamma of a step that begins anew."""
        return 0.25 * (1.0 + self.delay**2), 0.5

    def slopes(self, h: float) -> tuple[float, float]:
        """Position (s^2) and velocity (s) at the end of a step h per unit of the true acceleration there."""
        if self.anew:
            beta, gamma = self.newmark()
            return beta * h * h, gamma * h
        share = (1.0 - self.alpha_f) / (1.0 - self.alpha_m)
        return self.beta * share * h * h, self.gamma * share * h

    def end(
        self, h: float, v: FloatArray, a: FloatArray, auxiliary: FloatArray, a_end: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Displacement within the step, velocity and auxiliary acceleration at its end."""
        if self.anew:
            beta, gamma = self.newmark()
            moved: FloatArray = h * v + h * h * ((0.5 - beta) * a + beta * a_end)
            return moved, v + h * ((1.0 - gamma) * a + gamma * a_end), a_end + self.delay * (a_end - a)
        mean: FloatArray = (1.0 - self.alpha_f) * a_end + self.alpha_f * a
        last: FloatArray = mean / (1.0 - self.alpha_m) - self.alpha_m / (1.0 - self.alpha_m) * auxiliary
        move: FloatArray = h * v + h * h * ((0.5 - self.beta) * auxiliary + self.beta * last)
        return move, v + h * ((1.0 - self.gamma) * auxiliary + self.gamma * last), last

    def carry(self, auxiliary: FloatArray, h: float, h_before: float, a: FloatArray) -> FloatArray:
        """The auxiliary acceleration for a step h after one of ``h_before`` (s) that led to ``a``.

        It lies a share of the step beside the true one; a step that begins anew has none of before.
        """
        if h == h_before or self.anew:
            return auxiliary
        return np.asarray(a + h / h_before * (auxiliary - a), dtype=np.float64)


class Interior(Protocol):
    """The body between the frames: its own masses, elasticity, history, and their state at an instant."""

    @property
    def frames(self) -> tuple[InteriorFrame, ...]:
        """The k interface frames, at least one."""

    @property
    def mass(self) -> float:
        """Mass (kg) of the interior, without that of the frames."""

    def begin(self, t: float, motion: FrameMotion, gravity: FloatArray) -> FloatArray:
        """Start anew at time t (s): undeformed and unspoilt, moving with the frames.

        The machine calls it several times for one start, with other accelerations of the frames.  Velocities of the
        frames may differ from those of a rigid motion, as where one is pulled from the start.

        Args:
            t: s.
            motion: of the frames, which stand to each other as in the undeformed body.
            gravity: (3,) m/s^2; the interior's weight is the interior's affair, that of the frames the machine's.

        Returns:
            (k, 6) wrenches on the frames at this instant, with the frames' accelerations given.
        """

    def snapshot(self) -> Memory:
        """Copies of its whole state, from which it goes on to the bit."""

    def restore(self, memory: Memory) -> None:
        """Go back to a snapshot, perhaps of another process's interior of the same data.

        All that is remembered beside it, as factors and first guesses, is dropped: at a checkpoint the machine
        restores the run that goes on as well, so that a restart is the same to the bit.
        """

    def energies(self) -> Mapping[str, float]:
        """Energies (J) by name at the present state: kinetic, elastic, plastic (work done), damping, contact, ...

        Asked after each step, so it had better be cheap.  Always the same names.  ``gravitational`` is that of the
        interior's weight; what is dissipated counts as positive, so that the sum is constant where no force from
        outside works.
        """


@runtime_checkable
class ExplicitInterior(Interior, Protocol):
    """An interior that steps by central differences (velocity Verlet), in step with ``CentralDifference``."""

    def stable_step(self) -> float:
        """The longest stable step (s) at the present state, with no reserve."""

    def advance(self, h: float, start: FrameMotion, end: FrameMotion) -> Push:
        """Step by h (s) between two motions of the frames; there is no way back but ``restore``.

        A step of its own goes x' = x + h v + h^2/2 a, a' = a(x'), v' = v + h/2 (a + a').  Where h is longer than the
        stable step it takes several, its frames' motion between them interpolated (constant accelerations).

        Args:
            h: s.
            start: with the present velocities, to which those predicted in the last ``end`` were approximations.
            end: positions and rotations at the step's end; velocities are predicted by the accelerations at the
                start, which ``end`` repeats.

        Raises:
            ConvergenceError: it cannot, as where an element is inverted; the message says what happened.
        """


@runtime_checkable
class ImplicitInterior(Interior, Protocol):
    """An interior that solves for its own unknowns at the step's end, for ``GeneralizedAlpha``."""

    def trial(
        self, t_end: float, h: float, scheme: Scheme, motion: FrameMotion
    ) -> tuple[FloatArray, FloatArray]:
        """Solve for the step's end, from the last state committed, for the frames' trial motion there.

        Several trials of one step follow each other; none builds on another's history (a last trial may be the first
        guess of the next), so that the answer depends on the last state committed and the arguments alone, to the
        solver's tolerance, which is to be far below the machine's (1e-10 of the forces, say).

        Args:
            t_end: time (s) of the step's end.
            h: the step (s).
            scheme: how its own unknowns go.
            motion: of the frames at the step's end, accelerations included.

        Returns:
            (k, 6) wrenches on the frames at the step's end, those of the interior's inertia included; and their
            derivative (6 k, 6 k), row-major as the wrenches, by small displacements (m) of the frames' origins and
            small rotations (rad) of the frames (R becomes exp(theta) R), frame by frame, at the step's end: the
            interior's unknowns follow, and the frames' velocities and accelerations do by the scheme, that is
            per_v / per_x and 1 / per_x of the displacement, with (per_x, per_v) = ``scheme.slopes(h)``.

        Raises:
            ConvergenceError: no solution; the machine takes a shorter step, or stops with the message.
        """

    def commit(self) -> None:
        """Make the last trial the state."""

    def revert(self) -> None:
        """Forget all trials since the last state committed; nothing of them may be seen in what follows."""


class InteriorIteration(NamedTuple):
    """The result of one of Newton's iterations of an interior.

    Attributes:
        wrenches, slopes: as of ``ImplicitInterior.trial``, but of the interior's equations linearised: where its
            unknowns would go with these frames, and with frames a little beside.
        correction: the energy norm of its unknowns' correction over that of the body's state.
        rounding: N and N m, what round-off makes of the wrenches, (k, 6) or what is broadcast to that: the machine's
            equations are not solved more closely than these tell.
    """

    wrenches: FloatArray
    slopes: FloatArray
    correction: float
    rounding: FloatArray | float = 0.0


@runtime_checkable
class IteratedInterior(ImplicitInterior, Protocol):
    """An interior that takes one Newton iteration of its own in each of the machine's: both converge as one."""

    def iterate(
        self, t_end: float, h: float, scheme: Scheme, motion: FrameMotion, *, tolerance: float, renew: bool
    ) -> InteriorIteration:
        """Move with the frames, evaluate the forces, linearise: a trial that need not be in balance.

        The next iteration of the step begins with this one's correction, and with what the frames' further motion
        adds to it.  ``commit`` takes the unknowns at which the forces were evaluated last, ``revert`` forgets them.

        Args:
            t_end: s, as of ``ImplicitInterior.trial``.
            h: s, as there.
            scheme: as there.
            motion: of the frames, as there.
            tolerance: of the corrections with which the step ends.
            renew: whether older factors converge too slowly for the machine.

        Raises:
            ConvergenceError: the forces cannot be had there.
        """


@checked("name")
@dataclass(eq=False)
class ContinuumBody:
    """A body with history in a machine: rigid interface frames, and an interior between them.

    ``scene.add(body)`` puts a rigid body for each interface frame into the scene, called "name.frame".

    Attributes:
        interior: the body between the frames.
        name: given by ``System.add``.

    Raises:
        SceneError: the interior has no frames, two of one name, one whose mass or inertia no body can have, or it
            can be stepped neither way.
    """

    interior: Interior
    name: str = field(default="", kw_only=True)

    def __setattr__(self, name: str, value: object) -> None:
        refuse_change(self, name, ("interior",))
        super().__setattr__(name, value)

    def __post_init__(self) -> None:
        if not isinstance(self.interior, (ExplicitInterior, ImplicitInterior)) or isinstance(self.interior, type):
            raise SceneError(
                f"continuum body: its interior must be an ExplicitInterior or an ImplicitInterior, as an "
                f"ImplicitContinuum, got {self.interior!r:.100}"
            )
        frames = self.interior.frames
        names = [frame.name for frame in frames]
        if not frames or len(set(names)) < len(names):
            raise SceneError(f"continuum body: it needs interface frames, each with a name of its own, got {names}")
        parts = []
        for frame in frames:
            try:
                check_rotation(frame.R_BI, "R_BI")
                parts.append(RigidBody(frame.mass, frame.inertia, tuple(map(float, frame.com))))
            except SceneError as reason:
                raise SceneError(f"interface frame {frame.name!r} of a continuum body: {reason}") from reason
        self.parts: tuple[RigidBody, ...] = tuple(parts)

    @property
    def mass(self) -> float:
        """Mass (kg) of the frames and the interior."""
        return self.interior.mass + sum(part.mass for part in self.parts)

    def frame(self, name: str) -> Frame:
        """Return the interface frame ``name``.

        Raises:
            InterfaceError: no interface has that name; the message lists those there are.
        """
        for frame, part in zip(self.interior.frames, self.parts, strict=True):
            if frame.name == name:
                return Frame(part, np.zeros(3), np.eye(3), None, f"{self.name or 'continuum body'}.{name}")
        known = ", ".join(repr(frame.name) for frame in self.interior.frames)
        raise InterfaceError(f"continuum body {self.name!r} has no interface {name!r}; it has {known}")


@dataclass(frozen=True)
class PlacedInterior:
    """A body's frames in a plan, its own and those of shapes that its surface touches: rows of ``Plan.frames``.

    Attributes:
        body: the body.
        rows: of the frames.
        giving: names of the contacts with what gives way: shapes on bodies, and surfaces of other bodies.
        is_paired: whether it touches another body with history, with which it steps.
    """

    body: ContinuumBody
    rows: tuple[int, ...]
    giving: tuple[str, ...] = ()
    is_paired: bool = False
