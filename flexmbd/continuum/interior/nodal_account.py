"""The account of energies of nodes that step explicitly: works of their forces, and what the body stores and loses."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.interior.carried_mesh import CarriedMesh

FloatArray = NDArray[np.float64]

# Energies of the formulation that have a place of their own.
_NAMED = ("elastic", "plastic", "viscous")


class NodalAccount:
    """Works since the start, this rank's parts.

    Attributes:
        works: (6,) J, of the deformation, of loads, contact, friction and damping, and of bulk viscosity, a part of
            the first.
        lost: J, what contact took at the start of the first step.
    """

    def __init__(self, mesh: CarriedMesh, *, has_loads: bool) -> None:
        """Nothing has been done yet."""
        self._mesh, self._has_loads = mesh, has_loads
        self.works: FloatArray = np.zeros(6)
        self.lost = 0.0

    def begin(self) -> None:
        """Nothing has been done yet."""
        self.works[:], self.lost = 0.0, 0.0

    def add(self, move: FloatArray, before: Sequence[FloatArray], after: Sequence[FloatArray]) -> None:
        """Count a step of the nodes (owned nodes, 3) m, with the forces (owned nodes, 3) N each before and after it."""
        for i, (first, last) in enumerate(zip(before, after, strict=True)):
            self.works[i] += np.vdot(move, first + last) / 2

    def add_touched(self, works: FloatArray) -> None:
        """Count the works (2,) J of contact and friction on what is touched."""
        self.works[2:4] += works

    def internal_work(self) -> float:
        """J, done on the deformation. Collective."""
        return -float(self._mesh.sum(self.works[:1])[0])

    def energies(self, kinetic: float, weight: float, x: FloatArray) -> dict[str, float]:
        """See `NodalMotion.energies`; kinetic and weight: J, this rank's parts; nodes at x (owned nodes, 3) m."""
        mesh = self._mesh
        body_energies = mesh.body.energies()
        _, loads, contact, friction, damping, viscous = self.works
        sums = mesh.sum(np.array([kinetic, weight, self.lost - contact, -friction, -damping, -loads, -viscous]))
        outer = {"loads": float(sums[5])} if self._has_loads else {}
        if mesh.bulk is not None or "viscous" in body_energies:
            outer["viscous"] = body_energies.get("viscous", 0.0) + float(sums[6])
        return {
            "kinetic": float(sums[0]),
            "elastic": body_energies.get("elastic", 0.0),
            "plastic": body_energies.get("plastic", 0.0),
            "contact": float(sums[2]),
            "friction": float(sums[3]),
            "damping": float(sums[4]),
            "gravitational": float(sums[1]),
            **{name: value for name, value in body_energies.items() if name not in _NAMED},
            **self._spring_energy(x),
            **({} if mesh.fields is None else {"splitting": -mesh.fields.lost}),
            **outer,
        }

    def _spring_energy(self, x: FloatArray) -> dict[str, float]:
        springs = self._mesh.body.springs
        if springs is None or self._mesh.fields is not None:
            return {}
        return {"springs": springs.energy_of_nodes(x - self._mesh.X)}

    def snapshot(self) -> FloatArray:
        """(7,) J, of the whole body. Collective."""
        return self._mesh.sum(np.array([*self.works, self.lost]))

    def restore(self, kept: FloatArray) -> None:
        """Go back to a snapshot; the first rank has the whole."""
        *self.works[:], self.lost = kept * (self._mesh.body.comm.rank == 0)
