"""Limits of bodies with nonlinear stiffness: the states and loads at which they were compared with their full model."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import RangeWarning, warn
from flexmbd.multibody.bodies.body import Body
from flexmbd.multibody.kernels.physics.elasticity import strain_energies, strain_forces
from flexmbd.multibody.kernels.reading.tree import flexible_row
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.results.locked_energy import LockedEnergy
from flexmbd.multibody.results.state_rows import StateRows

FloatArray = NDArray[np.float64]


def compared_limits(scene: CompiledScene, bodies: Iterable[Body]) -> Iterator[_MostEnergy | _Locking]:
    """Two of each such body."""
    for body in bodies:
        record = scene.index.now(body).reduced()
        if record is not None and record.nonlinear is not None:
            yield _MostEnergy(body, float(record.nonlinear.energy[0]))
            yield _Locking(body, LockedEnergy(record, record.nonlinear))


def _energies(body: Body, rows: StateRows) -> FloatArray:
    """(k,) J, strain energies of a body."""
    plan, energy = rows.scene.plan, np.zeros(len(rows.t))
    flex = flexible_row(plan, rows.scene.index.bodies[body])
    strain_energies(plan, flex, np.ascontiguousarray(rows.x), rows.scene.index.modes[body].x.start, energy)
    return energy


@dataclass(frozen=True, eq=False)
class _MostEnergy:
    """The largest strain energy (J) at which a body was compared."""

    body: Body
    most: float

    def tells(self, rows: StateRows) -> bool:
        """As `Limit`."""
        energy = _energies(self.body, rows)
        beyond = np.flatnonzero(energy > self.most)
        if not len(beyond):
            return False
        warn(
            f"flexible body {self.body.name!r} stores {energy[beyond[0]]:.4g} J at t = {rows.t[beyond[0]]:.6g} s, more "
            f"than the {self.most:.4g} J up to which it was compared with its full model: from there on nothing "
            "is known of its error; reduce it for a larger range of loads, or cut it in several pieces",
            RangeWarning,
            subject=f"energy of {self.body.name}",
        )
        return True


@dataclass(frozen=True, eq=False)
class _Locking:
    """The share of a body's energy that no shape relieves."""

    body: Body
    locks: LockedEnergy

    def tells(self, rows: StateRows) -> bool:
        """As `Limit`."""
        plan, place = rows.scene.plan, rows.scene.index.modes[self.body].x
        n = place.stop - place.start
        force = np.zeros((len(rows.t), n))
        flex, x = flexible_row(plan, rows.scene.index.bodies[self.body]), np.ascontiguousarray(rows.x)
        strain_forces(plan, flex, x, place.start, np.zeros(n), np.zeros(n), force)
        share = self.locks.share(force, _energies(self.body, rows))
        beyond = np.flatnonzero(share > self.locks.tolerance)
        if not len(beyond):
            return False
        warn(
            f"flexible body {self.body.name!r} locks at t = {rows.t[beyond[0]]:.6g} s under loads in directions that "
            f"it was not reduced for: {100.0 * share[beyond[0]]:.2g} % of its strain energy is what no shape relieves "
            f"({100.0 * self.locks.tolerance:.2g} % were allowed), so that it is too stiff there; give "
            "ModalDerivatives loads in these directions as well, as forces and moments of bending in this plane",
            RangeWarning,
            subject=f"locking of {self.body.name}",
        )
        return True
