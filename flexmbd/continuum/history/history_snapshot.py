"""Copies of the state of a body with history."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.history.held_fields import PortStates

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class HistorySnapshot:
    """The state of a body after an accepted step: this rank's part.

    Attributes:
        displacement: (local dofs including ghosts,) m, from the undeformed mesh.
        history: of each group, flat.
        viscous_work: J, dissipated by the formulations' dissipation in the whole body.
        temperature: (local nodes including ghosts,) K, its rise; empty where the body is not heated.
        ports: their efforts and flows.
    """

    displacement: FloatArray
    history: tuple[FloatArray, ...]
    viscous_work: float = 0.0
    temperature: FloatArray = field(default_factory=lambda: np.zeros(0))
    ports: PortStates = field(default_factory=lambda: PortStates.at_rest(0))
