"""Uniform thin rods."""

from __future__ import annotations

import numpy as np

import flexmbd as fm


def rod(length: float, mass: float, *, along: int = 0, thin: float = 1e-6) -> fm.RigidBody:
    """A rod from the body frame along one of its axes; ``thin`` is the share of inertia that it has about itself."""
    across = mass * length**2 / 12.0
    inertia, com = np.full(3, across), np.zeros(3)
    inertia[along] = thin * across
    com[along] = 0.5 * length
    return fm.RigidBody(mass, tuple(inertia), tuple(com))
