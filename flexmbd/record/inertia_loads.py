"""Loads of a body's own motion: their names in the record, and the centrifugal force by products of angular velocities.

At r from the body frame's origin the centrifugal acceleration is -w x (w x r), the sum over a <= b of w_a w_b S_ab r
with S_aa = 1 - e_a e_a^T and S_ab = -(e_a e_b^T + e_b e_a^T).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

AXES = "xyz"

#: Of which two components of the angular velocity each of the six products is, in the record's order.
SPIN_PRODUCTS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))

#: Names of the loads of `GeometricStiffness`, component by component, of products in the order above.
ACCELERATIONS = tuple(f"acceleration {axis}" for axis in AXES)
ANGULAR_ACCELERATIONS = tuple(f"angular acceleration {axis}" for axis in AXES)
CENTRIFUGAL = tuple(f"angular velocity {AXES[a]}{AXES[b]}" for a, b in SPIN_PRODUCTS)

#: In the provenance of a body that was reduced about the state of a spin: that spin, (3,) rad/s along B's axes.
PRESTRESS_SPIN = "prestress angular velocity"

#: (6, 3, 3) S_ab of each product.
CENTRIFUGAL_FIELDS = np.zeros((6, 3, 3))
for _k, (_a, _b) in enumerate(SPIN_PRODUCTS):
    CENTRIFUGAL_FIELDS[_k] = np.eye(3) if _a == _b else 0.0
    for _place in {(_a, _b), (_b, _a)}:
        CENTRIFUGAL_FIELDS[_k][_place] -= 1.0
CENTRIFUGAL_FIELDS.flags.writeable = False


def spin_products(spin: FloatArray) -> FloatArray:
    """(..., 6) products of an angular velocity (..., 3), rad/s in the body's axes."""
    first, second = np.transpose(SPIN_PRODUCTS)
    return np.asarray(spin[..., first] * spin[..., second])


def centrifugal_forces(levers: FloatArray) -> FloatArray:
    """(6, ...) modal forces by a unit of each product.

    Args:
        levers: (3, ..., 3) mass integrals of r_a phi_b, a first, phi the displacement by a mode.
    """
    return np.asarray(np.einsum("kba,a...b->k...", CENTRIFUGAL_FIELDS, levers))
