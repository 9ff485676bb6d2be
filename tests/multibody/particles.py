"""Flexible bodies made of particles: a reduced record whose every integral is a plain sum."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexmbd.reduced import InterfaceFrame, ReducedBody


@dataclass(frozen=True)
class Particles:
    """Masses (k,), places (k, 3) and mode displacements (k, 3, n) of a body's particles."""

    mass: np.ndarray
    x: np.ndarray
    phi: np.ndarray
    record: ReducedBody


def particle_body(seed: int, *, modes: int, damping: float = 0.0, size: float = 0.3) -> Particles:
    """A body of random particles with mass-orthonormal random modes and two interfaces.

    "root" carries the body frame; "tip" moves and turns with the modes.
    """
    rng = np.random.default_rng(seed)
    k = 12
    mass = rng.uniform(0.1, 0.3, k)
    x = rng.standard_normal((k, 3)) * size
    weight = np.repeat(np.sqrt(mass), 3)
    basis = np.linalg.qr(rng.standard_normal((3 * k, modes)))[0] / weight[:, None]
    phi = basis.reshape(k, 3, modes)
    fields = np.concatenate([np.ones((1, k)), x.T, phi.transpose(2, 1, 0).reshape(-1, k)])
    stiffness = np.sort(rng.uniform(50.0, 200.0, modes))
    half = rng.standard_normal((modes, modes)) * np.sqrt(damping)
    tip = rng.standard_normal((6, modes)) * 0.4
    rotation = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    rotation *= np.sign(np.linalg.det(rotation))
    record = ReducedBody(
        gram=(fields * mass) @ fields.T,
        stiffness=stiffness,
        damping=half @ half.T,
        interfaces=(
            InterfaceFrame("root", np.zeros(3), np.eye(3), np.zeros((6, modes))),
            InterfaceFrame("tip", rng.standard_normal(3) * size, rotation, tip),
        ),
        frame="root",
        partition=np.eye(modes),
        partition_names=tuple(f"mode {i}" for i in range(modes)),
    )
    return Particles(mass, x, phi, record)
