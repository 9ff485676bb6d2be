"""Watches when bodies with nonlinear stiffness leave the states at which they were compared with their full models.

They leave them by their strain energy; or in a direction in which they lock, which shows in the energy that further
shapes would relieve (`flexmbd.record.relief`).
"""

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
from flexmbd.record.relief import Relief

FloatArray = NDArray[np.float64]


class RangeWatch:
    """Looks through the rows of a simulation as they come, and warns once of each body."""

    def __init__(self, scene: CompiledScene, bodies: Iterable[Body]) -> None:
        self._scene = scene
        self._inside: dict[Body, float] = {}
        self._free: dict[Body, Relief] = {}
        for body in bodies:
            record = scene.index.now(body).reduced()
            if record is not None and record.nonlinear is not None:
                self._inside[body] = float(record.nonlinear.energy[0])
                self._free[body] = Relief(record.stiffness, record.nonlinear)
        self._rows = 0

    def look(self, stored: StoredRows) -> None:
        """Look at the rows that came since; each begins with its time (s) and its configuration.

        Warns:
            RangeWarning: a body has left its range, or locks; each once a body.
        """
        if not self._inside and not self._free:
            return
        t, x, *_ = stored.since(self._rows)
        self._rows += len(t)
        self.judge(t, x)

    def judge(self, t: FloatArray, x: FloatArray) -> None:
        """The same of states that are no run's, as equilibria: times or load factors (k,), configurations (k, nx)."""
        x = np.ascontiguousarray(x)
        for body in {**self._inside, **self._free}:
            energy = np.zeros(len(t))
            flex = flexible_row(self._scene.plan, self._scene.index.bodies[body])
            place = self._scene.index.modes[body].x
            strain_energies(self._scene.plan, flex, x, place.start, energy)
            if body in self._inside:
                self._judge_range(body, t, energy)
            if body in self._free:
                self._judge_locking(body, t, x[:, place], energy)

    def _judge_range(self, body: Body, t: FloatArray, energy: FloatArray) -> None:
        most = self._inside[body]
        beyond = np.flatnonzero(energy > most)
        if len(beyond):
            del self._inside[body]
            warn(
                f"flexible body {body.name!r} stores {energy[beyond[0]]:.4g} J at t = {t[beyond[0]]:.6g} s, more "
                f"than the {most:.4g} J up to which it was compared with its full model: from there on nothing is "
                "known of its error; reduce it for a larger range of loads, or cut it in several pieces",
                RangeWarning,
            )

    def _judge_locking(self, body: Body, t: FloatArray, q: FloatArray, energy: FloatArray) -> None:
        found = self._free[body].first(q, energy)
        if found is None:
            return
        del self._free[body]
        row, share = found
        warn(
            f"flexible body {body.name!r} locks at t = {t[row]:.6g} s: shapes that it has not would, by estimate, "
            f"relieve {share:.2g} of its strain energy, so that it is too stiff there; name the loads that bend it "
            "there in ModalDerivatives, and leave plane=True out",
            RangeWarning,
        )
