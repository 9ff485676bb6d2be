"""Watches when bodies with nonlinear stiffness leave the states and loads at which they were compared."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import RangeWarning, warn
from flexmbd.multibody.bodies.body import Body
from flexmbd.multibody.kernels.physics.elasticity import strain_energies, strain_forces
from flexmbd.multibody.kernels.reading.tree import flexible_row
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.results.locked_energy import LockedEnergy
from flexmbd.multibody.results.stretch_watch import StoredRows

FloatArray = NDArray[np.float64]


@dataclass(eq=False)
class _KnownStates:
    """A body's largest known strain energy, J, what locks it, and which of the two it has not left so far."""

    most: float
    locks: LockedEnergy
    inside: bool = True
    free: bool = True


class RangeWatch:
    """Looks through the rows of a simulation as they come, and warns once of each body."""

    def __init__(self, scene: CompiledScene, bodies: Iterable[Body]) -> None:
        self._scene = scene
        records = ((body, scene.index.now(body).reduced()) for body in bodies)
        self._watched = {
            body: _KnownStates(float(record.nonlinear.energy[0]), LockedEnergy(record, record.nonlinear))
            for body, record in records
            if record is not None and record.nonlinear is not None
        }
        self._rows = 0

    def look(self, stored: StoredRows) -> None:
        """Look at the rows that came since; each begins with its time (s) and its configuration.

        Warns:
            RangeWarning: a body has left its range, or locks under loads beside it; each once a body.
        """
        if not self._watched:
            return
        t, x, *_ = stored.since(self._rows)
        self._rows += len(t)
        self.judge(t, x)

    def judge(self, t: FloatArray, x: FloatArray) -> None:
        """The same of states that are no run's, as equilibria: times or load factors (k,), configurations (k, nx)."""
        for body, watched in tuple(self._watched.items()):
            flex = flexible_row(self._scene.plan, self._scene.index.bodies[body])
            place, x = self._scene.index.modes[body].x, np.ascontiguousarray(x)
            energy = np.zeros(len(t))
            strain_energies(self._scene.plan, flex, x, place.start, energy)
            if watched.inside:
                self._judge_energy(body, watched, t, energy)
            if watched.free:
                n = place.stop - place.start
                force = np.zeros((len(t), n))
                strain_forces(self._scene.plan, flex, x, place.start, np.zeros(n), np.zeros(n), force)
                self._judge_loads(body, watched, t, watched.locks.share(force, energy))
            if not (watched.inside or watched.free):
                del self._watched[body]

    def _judge_energy(self, body: Body, watched: _KnownStates, t: FloatArray, energy: FloatArray) -> None:
        beyond = np.flatnonzero(energy > watched.most)
        if len(beyond):
            watched.inside = False
            warn(
                f"flexible body {body.name!r} stores {energy[beyond[0]]:.4g} J at t = {t[beyond[0]]:.6g} s, more "
                f"than the {watched.most:.4g} J up to which it was compared with its full model: from there on nothing "
                "is known of its error; reduce it for a larger range of loads, or cut it in several pieces",
                RangeWarning,
            )

    def _judge_loads(self, body: Body, watched: _KnownStates, t: FloatArray, share: FloatArray) -> None:
        allowed = watched.locks.tolerance
        beyond = np.flatnonzero(share > allowed)
        if len(beyond):
            watched.free = False
            warn(
                f"flexible body {body.name!r} locks at t = {t[beyond[0]]:.6g} s under loads in directions that it was "
                f"not reduced for: {100.0 * share[beyond[0]]:.2g} % of its strain energy is what no shape relieves "
                f"({100.0 * allowed:.2g} % were allowed), so that it is too stiff there; give ModalDerivatives loads "
                "in these directions as well, as forces and moments of bending in this plane",
                RangeWarning,
            )
