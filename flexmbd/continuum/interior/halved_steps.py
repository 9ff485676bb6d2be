"""A body's history updated twice in each step, beside its own: how far its updates are off where rates matter.

A form that takes the length of the step updates its history by implicit Euler's method, as a rule, whose error is of
first order in the step: along the same motion half the steps leave half of it, and what the forces differ by is the
other half (Richardson).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.history.nonlinear_model import NonlinearModel
from flexmbd.errors import ConvergenceError

FloatArray = NDArray[np.float64]


class HalvedSteps:
    """The second history. Its displacements are the body's."""

    def __init__(self, body: NonlinearModel) -> None:
        """Begin with the body's history."""
        self._body = body
        self._largest_force = self._largest_error = 0.0
        self.begin_anew()

    def begin_anew(self) -> None:
        """Take the body's history."""
        self._beside = self._body.snapshot()

    @property
    def error(self) -> float:
        """Largest error of the body's internal forces so far, over their largest; 2-norms of nodal forces."""
        return self._largest_error / self._largest_force if self._largest_force > 0.0 else 0.0

    def follow(self, increment: FloatArray, dt: float) -> None:
        """After the body has accepted a step, (local dofs,) m in dt s, take it in two halves. Collective."""
        body, own, still = self._body, self._body.snapshot(), np.zeros_like(increment)
        force = body.force(still, dt=0.0)
        try:
            body.restore(replace(self._beside, temperature=own.temperature))
            for _ in range(2):
                body.commit(0.5 * increment, dt=0.5 * dt)
            difference = body.force(still, dt=0.0) - force
            self._beside = body.snapshot()
        except ConvergenceError:  # of points that the halves lead elsewhere
            difference, self._beside = np.zeros_like(force), own
        finally:
            body.restore(own)
        self._largest_force = max(self._largest_force, body.norm(force))
        self._largest_error = max(self._largest_error, 2.0 * body.norm(difference))
