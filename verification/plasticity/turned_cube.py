"""Cube that is pulled and turned by turns (after code_aster SSND107).

Four cycles of a pull and a rigid turn by 45 degrees, a step each: E = 200 GPa, nu = 0.3, yield stress 200 MPa, plastic
modulus 2 GPa, by logarithmic strain. In axes that turn with it the stress is that of a bar that does not turn, in
closed form. And a thousand turns by 30 degrees of a pulled cube, by logarithmic strain and by Truesdell's rate.
"""

from __future__ import annotations

from types import ModuleType

import numpy as np

from flexmbd.forms import hencky_plasticity, updated_lagrangian
from flexmbd.forms.j2_plasticity import LinearHardening
from verification.plasticity._pieces import brick, deform, turned
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source("code_aster V6.08.107 for the motion; closed form of a bar in tension by logarithmic strain")
E, NU, STRENGTH, SLOPE = 200e3, 0.3, 200.0, 2000.0
PLASTIC = (0.002, 0.005, 0.009, 0.014)


def bar(plastic: float) -> tuple[float, np.ndarray]:
    """Cauchy stress (MPa) and (3, 3) stretch of a bar pulled to a plastic strain."""
    tau = STRENGTH + SLOPE * plastic
    along, across = tau / E + plastic, -NU * tau / E - 0.5 * plastic
    return tau * float(np.exp(-along - 2.0 * across)), np.diag(np.exp([along, across, across]))


REFERENCES = (
    *(
        Reference(f"cycle {k}: stress along, pulled and turned", "MPa", (bar(one)[0],) * 2, 1e-9, Sureness.PRIMARY)
        for k, one in enumerate(PLASTIC, start=1)
    ),
    Reference("largest other stress of the cycles", "MPa", (0.0,), 1e-9, Sureness.PRIMARY, size=STRENGTH),
    Reference("plastic strain after each turn", "", PLASTIC, 1e-9, Sureness.PRIMARY),
    *(
        Reference(f"change of stress in 1000 turns, {name}", "MPa", (0.0,), 1e-10, Sureness.PRIMARY, size=STRENGTH)
        for name in ("logarithmic strain", "Truesdell's rate")
    ),
)  # fmt: skip


def many_turns(form: ModuleType) -> float:
    """MPa: by how much a thousand turns change the stress of a pulled cube, in axes that turn along."""
    body = brick(form, form.Parameters(E=E, nu=NU, rho=1.0, yield_stress=STRENGTH, hardening=LinearHardening(SLOPE)))
    x, (_, stretch) = body.layout.node_x.copy(), bar(PLASTIC[1])
    first = deform(body, x, stretch)
    for k in range(1, 1000):
        body.commit((x @ (turned(30.0 * k) @ stretch).T - x).ravel() - body.displacement)
    last = deform(body, x, turned(30.0 * 1000) @ stretch)
    return float(abs(turned(30.0 * 1000).T @ last @ turned(30.0 * 1000) - first).max())


def compute() -> Computed:
    """One brick, all of its nodes moved."""
    steel = hencky_plasticity.Parameters(
        E=E, nu=NU, rho=1.0, yield_stress=STRENGTH, hardening=LinearHardening(SLOPE)
    )
    body = brick(hencky_plasticity, steel)
    x, along, other, plastic = body.layout.node_x.copy(), [], [], []
    for k, one in enumerate(PLASTIC):
        _, stretch = bar(one)
        for degrees in (45.0 * k, 45.0 * (k + 1)):
            stress = turned(degrees).T @ deform(body, x, turned(degrees) @ stretch) @ turned(degrees)
            along.append(float(stress[0, 0]))
            other.append(abs(stress - np.diag([stress[0, 0], 0.0, 0.0])).max())
        plastic.append(body.history()[0][0, 6])
    values = [numbers(*along[2 * k : 2 * k + 2]) for k in range(len(PLASTIC))]
    values += [numbers(max(other)), numbers(*plastic), numbers(many_turns(hencky_plasticity))]
    return Computed(
        (*values, numbers(many_turns(updated_lagrangian))), mesh="one brick", accuracy="a step each pull and turn"
    )
