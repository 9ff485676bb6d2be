"""Solids that are turned without strain.

A cube of steel whose nodes are led through a rotation: by 120 degrees at once, and where the form's mesh moves along
through 250 revolutions in steps of 90 degrees. Told is the largest stress over the modulus: no form finds a strain.
"""

from __future__ import annotations

from types import ModuleType

import numpy as np

from flexmbd.forms import hencky_plasticity, neo_hookean, st_venant_kirchhoff, updated_lagrangian
from verification.plasticity._pieces import brick, deform, turned
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source("Objectivity: a rigid rotation has no strain")
E = 210e9
AT_ONCE, ALONG = (neo_hookean, st_venant_kirchhoff), (hencky_plasticity, updated_lagrangian)
REFERENCES = tuple(
    Reference(f"{form.__name__.split('.')[-1]}, {what}: stress over E", "", (0.0,), 1e-10, Sureness.PRIMARY, size=1.0)
    for forms, what in ((AT_ONCE, "120 degrees at once"), (ALONG, "250 revolutions"))
    for form in forms
)


def stress(form: ModuleType, angles: np.ndarray) -> float:
    """Largest over E at the end of steps to these angles, in degrees."""
    given = {"yield_stress": 1e9} if form in ALONG else {}
    body = brick(form, form.Parameters(E=E, nu=0.3, rho=7800.0, **given))
    x = body.layout.node_x.copy()
    for angle in angles[:-1]:
        body.commit((x @ turned(angle).T - x).ravel() - body.displacement)
    return float(abs(deform(body, x, turned(angles[-1]))).max()) / E


def compute() -> Computed:
    """One brick."""
    at_once = [numbers(stress(form, np.array([120.0]))) for form in AT_ONCE]
    along = [numbers(stress(form, 90.0 * np.arange(1, 1001))) for form in ALONG]
    return Computed((*at_once, *along), mesh="one brick", accuracy="1 and 1000 steps")
