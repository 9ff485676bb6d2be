"""Bar pulled and pressed in turn.

E = 200 GPa, yield stress 250 MPa, strains of 0.01, -0.01, 0.01, -0.01, with isotropic and with kinematic hardening of
2 GPa, and half of each. The return is exact with one step a leg.
"""

from __future__ import annotations

import numpy as np

from flexmbd.continuum import follow, prescribed_dofs
from flexmbd.forms import j2_plasticity
from flexmbd.forms.j2_plasticity import LinearHardening
from verification.plasticity._pieces import brick
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source("Closed form of the return along one axis; Simo & Hughes 1998, Computational Inelasticity, chapter 1")
CYCLES = {
    (0.0, 0.0): (250.0, -250.0, 250.0, -250.0),
    (2000.0, 0.0): (267.326732673, -301.637094403, 335.268043028, -368.233032275),
    (0.0, 2000.0): (267.326732673, -267.326732673, 267.326732673, -267.326732673),
    (1000.0, 1000.0): (267.326732673, -284.481913538, 301.467241127, -318.284397155),
}
REFERENCES = tuple(
    Reference(f"stress at the ends of the legs, moduli {a:g} and {b:g} MPa", "MPa", row, 1e-9, Sureness.OWN)
    for (a, b), row in CYCLES.items()
)


def compute() -> Computed:
    """One brick, one step a leg."""
    found = []
    for isotropic, kinematic in CYCLES:
        steel = j2_plasticity.Parameters(
            E=200e3,
            nu=0.3,
            rho=1.0,
            yield_stress=250.0,
            hardening=LinearHardening(isotropic),
            kinematic_modulus=kinematic,
        )
        body = brick(j2_plasticity, steel)
        held = prescribed_dofs(body, {"x_min": "x", "x_max": "x", "y_min": "y", "z_min": "z"})
        pulled = np.isin(held, prescribed_dofs(body, {"x_max": "x"}))
        legs = {1.0: 0.01, 2.0: -0.01, 3.0: 0.01, 4.0: -0.01}
        path = follow(
            body, list(legs), prescribed=held, displacement=lambda t, legs=legs, on=pulled: legs[round(t)] * on
        )
        found.append(numbers(*(step.reactions[pulled].sum() for step in path.steps)))
    return Computed(tuple(found), mesh="one brick", accuracy="one step a leg")
