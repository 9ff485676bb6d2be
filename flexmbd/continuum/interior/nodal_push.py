"""What contact does to the nodes of a body that steps explicitly: the one law of planes and of shapes that move."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def penalty_stiffness(penalty: float | None, h: float) -> float:
    """The penalty stiffness per mass of a node, 1/s^2; zero without penalty.

    Args:
        penalty: between 0 and 4, dimensionless: the stable step in contact is sqrt(1 - penalty / 4) of that without.
        h: stable step of the undeformed body without contact, s.
    """
    return 0.0 if penalty is None else penalty / ((1.0 - penalty / 4.0) * h**2)


def push(
    depth: FloatArray,
    normal: FloatArray,
    v: FloatArray,
    a: FloatArray,
    *,
    h: float,
    reach: float,
    stiffness: float,
    friction: float,
    stretch: FloatArray | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Accelerations (n, 3) of nodes by contact, along the normals and across them, m/s^2.

    On planes at rest friction is the force that ends a node's step at rest, or as much of it as Coulomb's law has.  On
    a shape that gives way all its nodes would stop it at once: there friction is the force of bristles, as stiff as the
    penalty.  Either way what sticks does not creep.

    Args:
        depth: (n,) m, by which nodes are in what they touch; negative before it.
        normal: (n, 3) unit vectors out of it, or one (3,) for all.
        v: (n, 3) m/s, velocities with which the step is made before a and contact act.
        a: (n, 3) m/s^2, accelerations without contact.
        h: the step, s: places at its end are x + h v + reach (a + contact).
        reach: h^2, or half of it in a first step, s^2, less what damping takes of it.
        stiffness: 1/s^2, of the penalty; 0: none.
        friction: Coulomb's coefficient.
        stretch: (n, 3) m, of bristles, from where the nodes stick to where they are; None: there are none.
    """
    normal = np.broadcast_to(normal, v.shape)
    if stiffness == 0.0:
        size = (depth - h * _along(v, normal) - reach * _along(a, normal)) / reach
    else:
        size = stiffness * depth
    size = np.maximum(size, 0.0)
    across = np.zeros_like(v)
    if friction > 0.0 and size.any():
        # what stops a node, or as much of it as friction has
        stop = -(h / reach * v + a) if stretch is None else -stiffness * stretch
        stop -= _along(stop, normal)[:, None] * normal
        most = friction * size
        need = np.linalg.norm(stop, axis=1)
        across = stop * np.where(need > most, most / np.where(need > 0.0, need, 1.0), 1.0)[:, None]
    return size[:, None] * normal, across


def _along(vectors: FloatArray, normal: FloatArray) -> FloatArray:
    """(n,) components of vectors (n, 3) along normals (n, 3)."""
    return np.asarray(np.einsum("ij,ij->i", vectors, normal))
