"""The interface of a compiled scene for kinematics, reactions and Kane's equations."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.multibody.bodies.body import Frame
from flexmbd.multibody.kernels.base.arrays import Plan, Work
from flexmbd.multibody.scene_index import SceneIndex
from flexmbd.multibody.topology import Topology

FloatArray = NDArray[np.float64]

#: A force (3,) N at a frame's origin and a torque (3,) N m, both in inertial axes.
Contribution = tuple[Frame, ArrayLike, ArrayLike]


class WrenchSource(Protocol):
    """A source of wrenches on frames that enter the equations as generalised forces alone."""

    def wrenches(self, t: float, x: FloatArray, v: FloatArray) -> Iterable[Contribution]:
        """Force and torque on each frame that it acts on, at a time (s) and state x (nx,), v (nv,)."""


@runtime_checkable
class Machine(Protocol):
    """A compiled scene, as far as its motion and forces are concerned."""

    @property
    def plan(self) -> Plan:
        """The flat arrays."""

    @property
    def index(self) -> SceneIndex:
        """Where bodies, joints and forces stand in the arrays."""

    @property
    def extent(self) -> float:
        """The machine's size (m)."""
        ...

    @property
    def start(self) -> FloatArray:
        """(nx,) configuration with every joint at its own zero."""

    @property
    def nv(self) -> int:
        """Number of generalised speeds."""

    @property
    def topology(self) -> Topology:
        """Tree and closures."""

    @property
    def wrench_sources(self) -> Sequence[WrenchSource]:
        """Forces on frames that the plan knows as generalised forces alone."""

    @property
    def redundant(self) -> Sequence[str]:
        """Names of constraint rows left out as redundant."""

    def forget_failure(self) -> None:
        """Forget what a user's function did wrong before."""

    def refuse_failed(self, work: Work) -> None:
        """Raise the error of a user's function that failed in an evaluation, if one did."""
