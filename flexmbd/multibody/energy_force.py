"""Forces of a pseudo-rigid body's compiled energy, beyond the stiffness in its record."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexmbd.multibody.bodies.pseudo_rigid_body import PseudoRigidBody
from flexmbd.multibody.force.protocol import ElementTable, OnState
from flexmbd.multibody.kernels.elements.homogeneous_energy import HOMOGENEOUS_ENERGY


@dataclass(frozen=True, eq=False)
class EnergyForce(OnState):
    """The rest of a body's energy, as a force element on its modes; the machine adds it with the body."""

    body: PseudoRigidBody

    def check(self) -> None:
        """Nothing to check: the body was when it was made."""

    def assemble(self, table: ElementTable) -> None:
        """One row with the function's address."""
        body, record = self.body, self.body.reduced()
        if record is None:
            return
        x, v = table.modes(body)
        data = table.numbers(np.concatenate([[body.solid.volume], record.stiffness, body.modes.ravel()]))
        what = f"energy {record.provenance['energy']} of {body.name}"
        count, address = record.n_modes, body.material.address
        table.element(HOMOGENEOUS_ENERGY, what, x=x, v=v, data=data, count=count, address=address)
