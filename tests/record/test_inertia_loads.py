"""The centrifugal force, product by product of the angular velocity."""

import numpy as np

from flexmbd.record.inertia_loads import CENTRIFUGAL_FIELDS, centrifugal_forces, spin_products


def test_the_sum_over_the_products_is_the_centrifugal_force():
    rng = np.random.default_rng(3)
    w, r, phi = rng.normal(size=3), rng.normal(size=(20, 3)), rng.normal(size=(20, 4, 3))
    mass = rng.uniform(1.0, 2.0, size=20)
    force = -np.cross(w, np.cross(w, r))
    np.testing.assert_allclose(r @ np.tensordot(spin_products(w), CENTRIFUGAL_FIELDS, 1).T, force, rtol=1e-12)
    levers = np.einsum("k,ka,kib->aib", mass, r, phi)
    expected = np.einsum("k,kb,kib->i", mass, force, phi)
    np.testing.assert_allclose(spin_products(w) @ centrifugal_forces(levers), expected, rtol=1e-12)
