"""Paths of equilibria of a machine: what is found."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuation.crossing import CriticalKind
from flexmbd.continuation.found_path import FoundPath, told
from flexmbd.multibody.bodies.body import Body, Frame
from flexmbd.multibody.joint.connection import Connection
from flexmbd.multibody.linear.working_point import WorkingPoint

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class CriticalPoint(WorkingPoint):
    """An equilibrium at which a path turns, branches, or begins to flutter; ``t`` is its load factor.

    ``System.equilibrium(about=critical, path=...)`` follows the other path from a bifurcation.

    Attributes:
        kind: which of these it is.
        mode: (nv,) changes of the machine's coordinates in which it gives way there; the largest is 1 rad or the
            machine's extent.
        tangent: (nv + 1,) of the path that it was found on: changes of the coordinates, last that of the factor.
        typical: rad, or of the machine's extent: what counted as much on that path as its range of factors.
    """

    kind: CriticalKind = CriticalKind.LIMIT
    mode: FloatArray = field(default_factory=lambda: np.zeros(0))
    tangent: FloatArray = field(default_factory=lambda: np.zeros(0))
    typical: float = 1.0

    def __repr__(self) -> str:
        """Its kind and factor."""
        return told(self)


@dataclass(frozen=True, eq=False, repr=False)
class EquilibriumPath(FoundPath[WorkingPoint, CriticalPoint]):
    """Equilibria of a machine one after the other, as its loads grow and fall.

    Attributes:
        points: the equilibria; ``t`` of each is its load factor.  Each is good for ``linearize(about=...)``.
        critical: limit points, bifurcations and onsets of flutter among them, in their order; located to 1e-7 of the
            step in which they lie.
        end: why the path ends.
    """

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
