"""Paths of equilibria of a machine: what a user asks for, and what is found."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import SceneError
from flexmbd.given import is_number, is_truth
from flexmbd.multibody.bodies.body import Body, Frame
from flexmbd.multibody.joint.connection import Connection
from flexmbd.multibody.linear.path.critical import CriticalKind
from flexmbd.multibody.linear.path.follow import PathEnd
from flexmbd.multibody.linear.working_point import WorkingPoint

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Continuation:
    """How a path of equilibria is followed; for ``System.equilibrium(path=...)``.

    Functions of time scale the loads: the time is the load factor.  ``FrameForce(frame, (0, lambda t: -t, 0))`` grows
    with it, or falls as a path turns; constant forces and gravity stay.  Prescribed motions lead a machine in the same
    way, without rates.

    Attributes:
        to: the factor at which the path ends.
        back_to: a factor on the other side of the start at which it ends as well; by default as far behind the start
            as ``to`` is before it.
        side: 1 or -1: which way the path leaves a bifurcation, along its mode or against it, or a limit point, on or
            back again; of no matter elsewhere.
        longest_step: rad of a joint, of the machine's extent, and of the range of factors.
        most_points: after which the path is broken off.

    Raises:
        SceneError: numbers that are none or have no sense.
    """

    to: float
    back_to: float | None = None
    side: int = 1
    longest_step: float = 0.1
    most_points: int = 500

    def __post_init__(self) -> None:
        for name in ("to", "back_to"):
            value = getattr(self, name)
            if not is_number(value) and (name == "to" or value is not None):
                raise SceneError(f"Continuation: {name} must be a load factor, a number, got {value!r}")
            if value is not None:  # integers as well: kernels know doubles
                object.__setattr__(self, name, float(value))
        if is_truth(self.side) or self.side not in (1, -1):
            raise SceneError(f"Continuation: side must be 1 or -1, got {self.side!r}")
        if not is_number(self.longest_step) or not 0.0 < self.longest_step <= 1.0:
            raise SceneError(f"Continuation: longest_step must be above 0 and at most 1, got {self.longest_step!r}")
        if is_truth(self.most_points) or not isinstance(self.most_points, int) or self.most_points < 2:
            raise SceneError(f"Continuation: most_points must be 2 or more, got {self.most_points!r}")


@dataclass(frozen=True, eq=False)
class CriticalPoint(WorkingPoint):
    """An equilibrium at which a path turns, branches, or begins to flutter; ``t`` is its load factor.

    ``System.equilibrium(about=critical, path=...)`` follows the other path from a bifurcation.

    Attributes:
        kind: which of these it is.
        mode: (nv,) changes of the machine's coordinates in which it gives way there; the largest is 1 rad or the
            machine's extent.
        tangent: (nv + 1,) of the path that it was found on: changes of the coordinates, last that of the factor.
    """

    kind: CriticalKind = CriticalKind.LIMIT
    mode: FloatArray = field(default_factory=lambda: np.zeros(0))
    tangent: FloatArray = field(default_factory=lambda: np.zeros(0))

    def __repr__(self) -> str:
        """Its kind and factor."""
        return f"<CriticalPoint: {self.kind.value} at the factor {self.t:.9g}>"


@dataclass(frozen=True, eq=False)
class EquilibriumPath:
    """Equilibria of a machine one after the other, as its loads grow and fall.

    Attributes:
        points: the equilibria; ``t`` of each is its load factor.  Each is good for ``linearize(about=...)``.
        critical: limit points, bifurcations and onsets of flutter among them, in their order; located to 1e-7 of the
            step in which they lie.
        end: why the path ends.
    """

    points: tuple[WorkingPoint, ...]
    critical: tuple[CriticalPoint, ...]
    end: PathEnd

    def __repr__(self) -> str:
        """How far it goes and what lies on it."""
        met = ", ".join(f"{one.kind.value} at {one.t:.6g}" for one in self.critical) or "no critical point"
        return (
            f"<EquilibriumPath: {len(self.points)} points, factors {self.factors[0]:.6g} to {self.factors[-1]:.6g} "
            f"({self.end.value}); {met}>"
        )

    @property
    def factors(self) -> FloatArray:
        """(k,) load factors."""
        return np.array([one.t for one in self.points])

    @property
    def unstable(self) -> NDArray[np.int64]:
        """(k,) how many independent motions grow from each; 0 where it is stable."""
        return np.array([one.unstable for one in self.points])

    def position(self, frame: Frame) -> FloatArray:
        """(k, 3) m, of a frame's origin in inertial axes.

        Raises:
            SceneError: it is of another scene; so of all that are asked for here.
        """
        return np.array([one.position(frame) for one in self.points])

    def rotation(self, frame: Frame) -> FloatArray:
        """(k, 3, 3) rotation from a frame's axes to inertial ones."""
        return np.array([one.rotation(frame) for one in self.points])

    def beta(self, connection: Connection) -> FloatArray:
        """(k,) or (k, n): coordinates of a joint, rad or m."""
        return np.array([one.beta(connection) for one in self.points])

    def q(self, body: Body) -> FloatArray:
        """(k, n) modal coordinates of a body."""
        return np.array([one.q(body) for one in self.points])

    def reaction(self, connection: Connection) -> FloatArray:
        """(k, 6) force (N) and moment (N m) of a joint, as ``WorkingPoint.reaction``."""
        return np.array([one.reaction(connection) for one in self.points])
