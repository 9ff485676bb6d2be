"""Stress that turns (code_aster SSNP14).

A point of steel under tension and shear along three straight legs to A (151.2, 93.1) MPa, B (257.3, 33.1), C (259.3,
0), with linear kinematic hardening. To A one step is exact; from there on a return in n steps a leg is off by what
others find, in proportion to 1 / n.
"""

from __future__ import annotations

import numpy as np

from flexmbd.continuum import follow
from flexmbd.forms import j2_plasticity
from flexmbd.reduction import Traction, load_vectors
from verification.plasticity._pieces import brick, node_at
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source("code_aster V6.03.014; B by substeps of second order, errors by the return at a point")
REFERENCES = (
    Reference(
        "strains xx, yy, xy at A, one step", "", (1.48297136e-2, -7.2597799e-3, 1.36014011e-2), 1e-6, Sureness.PRIMARY
    ),
    Reference("strains at B, 100 steps a leg", "", (4.0692557e-2, -2.0082381e-2, 2.0026769e-2), 5e-3, Sureness.OWN),
    Reference("error of the shear at B with 10 steps a leg", "", (-3.35e-2,), 1e-2, Sureness.OWN),
    Reference("error of the shear at B with 100 steps a leg", "", (-3.54e-3,), 1e-2, Sureness.OWN),
)
PATH = np.array([(0.0, 0.0), (151.2, 93.1), (257.3, 33.1)])


def strains(steps: int, leg: int) -> np.ndarray:
    """(3,) xx, yy, xy at the end of a leg."""
    E, slope = 195000.0, 1930.0
    # the modulus over plastic strain; Prager's law has two thirds of it for the deviator
    steel = j2_plasticity.Parameters(
        E=E, nu=0.3, rho=1.0, yield_stress=181.0, kinematic_modulus=E * slope / (E - slope)
    )
    body = brick(j2_plasticity, steel)
    pull = [Traction("right", "x_max", (1.0, 0.0, 0.0)), Traction("left", "x_min", (-1.0, 0.0, 0.0))]
    shear = [
        Traction("r", "x_max", (0.0, 1.0, 0.0)), Traction("l", "x_min", (0.0, -1.0, 0.0)),
        Traction("t", "y_max", (1.0, 0.0, 0.0)), Traction("b", "y_min", (-1.0, 0.0, 0.0)),
    ]  # fmt: skip
    forces = np.column_stack([load_vectors(body, one).sum(axis=1) for one in (pull, shear)])
    first, right, up = (node_at(body, place) for place in ((0, -0.5, -0.5), (1, -0.5, -0.5), (0, 0.5, -0.5)))
    dofs = body.displacement_dofs
    held = np.sort([*dofs[first], dofs[right, 1], dofs[right, 2], dofs[up, 2]]).astype(np.int32)

    def load(t: float) -> np.ndarray:
        return forces @ np.array([np.interp(t, range(3), PATH[:, k]) for k in range(2)])

    times = [k / steps for k in range(1, leg * steps + 1)] if leg > 1 else [1.0]
    follow(body, times, prescribed=held, load=load)
    u = body.displacement[dofs]
    return np.array([u[right, 0] - u[first, 0], u[up, 1] - u[first, 1], 0.5 * (u[up, 0] - u[first, 0])])


def compute() -> Computed:
    """One brick."""
    exact = REFERENCES[1].published[2]
    ten, hundred = strains(10, 2), strains(100, 2)
    return Computed(
        (numbers(strains(1, 1)), numbers(hundred), numbers(ten[2] / exact - 1.0), numbers(hundred[2] / exact - 1.0)),
        mesh="one brick", accuracy="1, 10 and 100 steps a leg",
    )  # fmt: skip
