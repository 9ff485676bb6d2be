"""The protocol of a machine's motion that pictures need; a `Trajectory` is one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.multibody.bodies.body import Body, Frame
from flexmbd.multibody.joint.connection import Connection
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.results.energy import Energy
from flexmbd.multibody.team import Team

FloatArray = NDArray[np.float64]


class Marked(Protocol):
    """An instant that a picture marks, as that of an event."""

    @property
    def name(self) -> str:
        """The name of the event."""

    @property
    def t(self) -> float:
        """When (s)."""


@runtime_checkable
class RecordedMotion(Protocol):
    """A machine on its way; times ``t`` are (k,) s, and nt instants where none are given."""

    @property
    def t(self) -> FloatArray:
        """(nt,) s."""

    @property
    def bodies(self) -> Mapping[str, Body]:
        """Name to body."""

    @property
    def team(self) -> Team:
        """Who writes files."""

    @property
    def events(self) -> Sequence[Marked]:
        """The events that took place, in order."""

    @property
    def scene(self) -> CompiledScene:
        """The machine: its joints and gravity."""

    def position(self, frame: Frame, *, t: ArrayLike | None = None) -> FloatArray:
        """(k, 3) m, position of the frame's origin in the inertial frame."""

    def rotation(self, frame: Frame, *, t: ArrayLike | None = None) -> FloatArray:
        """(k, 3, 3) rotations from the frame's axes to inertial ones."""

    def body_motion(self, *, t: ArrayLike | None = None) -> FloatArray:
        """(k, links, 21) of all bodies' axes: position (3) m, rotation (9), then velocities and accelerations."""

    def beta(self, connection: Connection, *, t: ArrayLike | None = None) -> FloatArray:
        """Joint coordinates, (k,) or (k, several)."""

    def q(self, body: Body, *, t: ArrayLike | None = None) -> FloatArray:
        """(k, n) modal coordinates."""

    def energy(self, *, t: ArrayLike | None = None) -> Energy:
        """Energies (J), each (k,)."""
