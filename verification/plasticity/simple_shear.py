"""Simple shear by logarithmic strain.

Elastic, shear modulus 1: with h = asinh(gamma / 2) the stresses are 4 h / sqrt(4 + gamma^2) and 2 h gamma / sqrt(4 +
gamma^2); no rate oscillates. The form's logarithm is exact to 3e-5 up to stretches of 8.
"""

from __future__ import annotations

import numpy as np

from flexmbd.continuum import follow, prescribed_dofs
from flexmbd.forms import hencky_plasticity
from verification.plasticity._pieces import brick, places_of
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source("Xiao, Bruhns & Meyers 1997, Acta Mechanica 124")
GAMMA = (0.5, 1.0, 2.0, 4.0)


def exact(gamma: float) -> tuple[float, float]:
    """sigma_12, sigma_11."""
    share = float(np.arcsinh(0.5 * gamma) / np.sqrt(4.0 + gamma**2))
    return 4.0 * share, 2.0 * gamma * share


REFERENCES = tuple(
    Reference(
        f"sigma_12, sigma_11 at gamma = {gamma:g}", "", exact(gamma), 1e-7 if gamma < 3.0 else 1e-5, Sureness.PRIMARY
    )
    for gamma in GAMMA
)


def compute() -> Computed:
    """One brick, all of its nodes moved."""
    soft = hencky_plasticity.Parameters(E=2.6, nu=0.3, rho=1.0, yield_stress=1e6)
    body = brick(hencky_plasticity, soft)
    held = prescribed_dofs(body, {f"{axis}_{end}": "xyz" for axis in "xyz" for end in ("min", "max")})
    along = np.isin(held, body.displacement_dofs[:, 0]) * (places_of(body, held)[:, 1] + 0.5)
    found = []

    def read(_: float) -> None:
        sigma = body.stress()[0][0, 0]
        found.append(numbers(sigma[0, 1], sigma[0, 0]))

    follow(body, GAMMA, prescribed=held, displacement=lambda t: t * along, accepted=read)
    return Computed(tuple(found), mesh="one brick", accuracy="four steps")
