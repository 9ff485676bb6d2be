"""Flexible bodies made of particles: a reduced record whose every integral is a plain sum.

A second-order displacement is carried by pairs of particles of opposite mass at one place, displaced
by opposite amounts: what is of first order in it adds up, the rest cancels.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from flexmbd.reduced import FRAME_DOFS, GeometricStiffness, InterfaceFrame, ReducedBody


@dataclass(frozen=True)
class Particles:
    """Masses (k,), places (k, 3), mode displacements (k, 3, n) and their slopes (k, 3, n, n)."""

    mass: np.ndarray
    x: np.ndarray
    phi: np.ndarray
    bend: np.ndarray
    record: ReducedBody

    def places(self, q: np.ndarray) -> np.ndarray:
        """(k, 3) positions in the body frame."""
        return self.x + self.phi @ q + 0.5 * self.bend @ q @ q


def particle_body(
    seed: int, *, modes: int, damping: float = 0.0, size: float = 0.3, bends: bool = False
) -> Particles:
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
    bend = np.zeros((k, 3, modes, modes))
    if bends:
        bend = symmetric(rng.standard_normal((k, 3, modes, modes)))
        stiffening = geometric(mass, x, bend, tip_bend=symmetric(rng.standard_normal((6, modes, modes))) * 0.3)
        record = replace(record, geometric=stiffening)
        mass = np.concatenate([mass, 0.5 * mass, -0.5 * mass])
        x, phi = np.tile(x, (3, 1)), np.concatenate([phi, 0 * phi, 0 * phi])
        bend = np.concatenate([0 * bend, bend, -bend])
    return Particles(mass, x, phi, bend, record)


def symmetric(matrices: np.ndarray) -> np.ndarray:
    """The symmetric part of each (..., n, n)."""
    return 0.5 * (matrices + np.swapaxes(matrices, -1, -2))


def geometric(mass: np.ndarray, x: np.ndarray, bend: np.ndarray, *, tip_bend: np.ndarray) -> GeometricStiffness:
    """K of each load: minus the work of its force field on the second derivatives of the displacement."""
    e = np.eye(3)
    fields = {f"acceleration {a}": np.tile(-e[i], (len(x), 1)) for i, a in enumerate("xyz")}
    fields |= {f"angular acceleration {a}": -np.cross(e[i], x) for i, a in enumerate("xyz")}
    for i, a in enumerate("xyz"):
        fields[f"angular velocity {a}{a}"] = -np.cross(e[i], np.cross(e[i], x))
        for j, b in enumerate("xyz"):
            if j > i:
                both = np.cross(e[i], np.cross(e[j], x)) + np.cross(e[j], np.cross(e[i], x))
                fields[f"angular velocity {a}{b}"] = -both
    matrices = {name: -np.einsum("k,ka,kaij->ij", mass, f, bend) for name, f in fields.items()}
    matrices |= {f"tip.{dof}": -tip_bend[i] for i, dof in enumerate(FRAME_DOFS)}
    K = np.array(list(matrices.values()))
    return GeometricStiffness(tuple(matrices), K, following=K)
