"""Watches when bodies with nonlinear stiffness leave the states at which they were compared with their full models."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import RangeWarning, warn
from flexmbd.multibody.bodies.body import Body
from flexmbd.multibody.kernels.physics.elasticity import strain_energies
from flexmbd.multibody.kernels.reading.tree import flexible_row
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.results.stretch_watch import StoredRows

FloatArray = NDArray[np.float64]


class RangeWatch:
    """Looks through the rows of a simulation as they come, and warns once of each body."""

    def __init__(self, scene: CompiledScene, bodies: Iterable[Body]) -> None:
        self._scene = scene
        records = ((body, scene.index.now(body).reduced()) for body in bodies)
        self._inside = {
            body: float(record.nonlinear.energy[0])
            for body, record in records
            if record is not None and record.nonlinear is not None
        }
        self._rows = 0

    def look(self, stored: StoredRows) -> None:
        """Look at the rows that came since; each begins with its time (s) and its configuration.

        Warns:
            RangeWarning: a body has left its range, once a body.
        """
        if not self._inside:
            return
        t, x, *_ = stored.since(self._rows)
        self._rows += len(t)
        self.judge(t, x)

    def judge(self, t: FloatArray, x: FloatArray) -> None:
        """The same of states that are no run's, as equilibria: times or load factors (k,), configurations (k, nx)."""
        for body, most in tuple(self._inside.items()):
            energy = np.zeros(len(t))
            flex = flexible_row(self._scene.plan, self._scene.index.bodies[body])
            place = self._scene.index.modes[body].x
            strain_energies(self._scene.plan, flex, np.ascontiguousarray(x), place.start, energy)
            beyond = np.flatnonzero(energy > most)
            if len(beyond):
                del self._inside[body]
                warn(
                    f"flexible body {body.name!r} stores {energy[beyond[0]]:.4g} J at t = {t[beyond[0]]:.6g} s, more "
                    f"than the {most:.4g} J up to which it was compared with its full model: from there on nothing is "
                    "known of its error; reduce it for a larger range of loads, or cut it in several pieces",
                    RangeWarning,
                )
