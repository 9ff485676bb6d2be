"""What a run was asked and how it is repeated, as its trajectory and its report know it.

Light: every machine loads it with its runs.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.integrate.protocol import Integrator
from flexmbd.multibody.bodies.body import Body, Frame
from flexmbd.multibody.bodies.continuum_body import ContinuumBody
from flexmbd.multibody.contact.touch import AnyContact
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.results.energy import Energy
from flexmbd.multibody.results.surface_series import AnySeries
from flexmbd.run.stats import Stats

FloatArray = NDArray[np.float64]


class Run(Protocol):
    """What is read of a trajectory, as there."""

    @property
    def scene(self) -> CompiledScene:
        """The compiled scene."""

    @property
    def t(self) -> FloatArray:
        """(nt,) s."""

    @property
    def stats(self) -> Stats:
        """Cost and residuals."""

    @property
    def bodies(self) -> Mapping[str, Body]:
        """By name."""

    def body_motion(self, *, t: ArrayLike | None = None) -> FloatArray:
        """(k, links, 21) of all bodies' axes."""

    def q(self, body: Body, *, t: ArrayLike | None = None) -> FloatArray:
        """(k, n) modal coordinates."""

    def position(self, frame: Frame, *, t: ArrayLike | None = None) -> FloatArray:
        """(k, 3) m."""

    def energy(self, *, t: ArrayLike | None = None) -> Energy:
        """Over time."""

    def energies(self, body: ContinuumBody) -> dict[str, FloatArray]:
        """Of the interior of a body with history, over time."""

    def contacts(self, touching: Sequence[AnyContact], /) -> tuple[AnySeries, ...]:
        """What contacts do over time."""


@dataclass(frozen=True)
class Rung:
    """One run of a ladder.

    Attributes:
        method: that it goes by.
        rtol: error tolerated.
        h: fixed step (s), or None.
        times: (k,) s, at which steps are to end.
    """

    method: Integrator
    rtol: float
    h: float | None
    times: tuple[float, ...]


@dataclass(frozen=True)
class Asked:
    """What a run was asked, as far as it can be repeated.

    Attributes:
        rtol, h, method: of the run.
        explained: what is computed and what is skipped, as ``System.explain`` has it.
        repeat: runs the machine from its own start again.
        obstacle: why it cannot be repeated, and then has no method; empty where it can.
    """

    rtol: float
    h: float | None
    method: Integrator | None
    explained: str
    repeat: Callable[[Rung], Run] | None
    obstacle: str = ""


class Repeatable(Protocol):
    """What a trajectory keeps of what it was asked."""

    def asked(self, trajectory: Any, /) -> Asked:
        """In terms of the machine as it ran."""
