"""Hencky's chain as a machine.

N rigid rods of equal length with springs EI / h at their hinges, 2 EI / h at the clamp: relative errors of the lowest
three frequencies of a cantilever, the same as of a beam whose mass is lumped to its nodes, and its highest frequency,
which tends to sqrt(48 EI / rho A) / h^2.
"""

from __future__ import annotations

import numpy as np

import flexmbd as fm
from verification.machines._rods import rod
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source("Hencky 1920, Der Eisenbau 11; errors by an assembly apart, the limit in closed form")
TABLE = {
    4: (-2.787e-2, -8.823e-2, -0.1377), 8: (-7.118e-3, -2.419e-2, -3.920e-2), 16: (-1.789e-3, -6.181e-3, -1.012e-2),
    32: (-4.479e-4, -1.553e-3, -2.549e-3), 64: (-1.120e-4, -3.889e-4, -6.384e-4),
}  # fmt: skip
BETA = np.array([1.87510406871, 4.69409113297, 7.85475743824])
REFERENCES = (
    *(Reference(f"N = {n}", "", row, 1e-3, Sureness.OWN) for n, row in TABLE.items()),
    Reference("highest frequency times h^2 sqrt(rho A / EI), N = 64", "", (6.92,), 1e-3, Sureness.OWN),
)


def rates(n: int) -> np.ndarray:
    """rad/s, ascending, of a chain of unit length, mass and stiffness."""
    scene = fm.System()
    before, h = scene.ground.frame(), 1.0 / n
    for k in range(n):
        link = scene.add(rod(h, h), name=f"link {k}")
        hinge = scene.connect(fm.joint.Revolute("z"), before, link.frame())
        scene.add_force(fm.force.JointSpring(hinge, (2.0 if k == 0 else 1.0) / h))
        before = link.frame(p=(h, 0.0, 0.0))
    return np.sort(2.0 * np.pi * np.asarray(scene.linearize().frequencies()))


def compute() -> Computed:
    """Straight at rest."""
    found = {n: rates(n) for n in TABLE}
    values = [numbers(found[n][:3] / BETA**2 - 1.0) for n in TABLE]
    return Computed((*values, numbers(found[64][-1] / 64.0**2)), mesh="4 to 64 rigid rods")
