"""One-dimensional inertias on joint coordinates: kinetic energy J v^2 / 2 of a coordinate's velocity, and nothing else.

They add J to the coordinate's entry of the mass matrix.  Forward dynamics adds it where the coordinate is eliminated
(``forward_dynamics.inward``).
"""

from __future__ import annotations

from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import kernel


@kernel
def add_shaft_inertias(shafts, motion, out):
    """Add to ``out`` (nv,) the inertias times ``motion`` (nv,): accelerations, or velocities for momenta."""
    for i in range(shafts.shape[0]):
        k = int(shafts[i, at.SHAFT_V])
        out[k] += shafts[i, at.SHAFT_INERTIA] * motion[k]


@kernel
def shaft_energy(shafts, v):
    """Their kinetic energy (J)."""
    energy = 0.0
    for i in range(shafts.shape[0]):
        speed = v[int(shafts[i, at.SHAFT_V])]
        energy += 0.5 * shafts[i, at.SHAFT_INERTIA] * speed * speed
    return energy
