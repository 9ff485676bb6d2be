"""Interiors with ports: pairs of effort and flow, as the voltage and the charge of an electrode."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.bodies.continuum_body import Interior

FloatArray = NDArray[np.float64]


@runtime_checkable
class PortedInterior(Interior, Protocol):
    """An interior with ports, whose efforts are among its loads."""

    def port_states(self) -> Mapping[str, FloatArray]:
        """(2,) effort and flow by name, in the last accepted state; always the same names.  Asked after each step."""
