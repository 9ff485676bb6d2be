"""Flexible bodies made of particles: a reduced record whose every integral is a plain sum."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise, permutations

import numpy as np

from flexmbd.record.reduced_body import Gyroscopic, InterfaceFrame, ModalStretch, NonlinearStiffness, ReducedBody


@dataclass(frozen=True)
class Particles:
    """Masses (k,), places (k, 3) and mode displacements (k, 3, n) of a body's particles."""

    mass: np.ndarray
    x: np.ndarray
    phi: np.ndarray
    record: ReducedBody


def of_unit_mass(phi: np.ndarray, masses: np.ndarray) -> np.ndarray:
    """(k, 3, n) combinations of the modes phi of masses (k,) whose modal mass matrix is the identity."""
    modal = np.einsum("k,kai,kaj->ij", masses, phi, phi)
    return phi @ np.linalg.inv(np.linalg.cholesky(modal)).T


def particle_body(
    seed: int,
    *,
    modes: int,
    damping: float = 0.0,
    size: float = 0.3,
    stretched: tuple[int, ...] = (),
    rotors: bool = False,
    nonlinear: bool = False,
) -> Particles:
    """A body of random particles with mass-orthonormal random modes and two interfaces.

    "root" carries the body frame; "tip" moves and turns with the modes. The modes ``stretched`` have a strain of
    second order; ``rotors``: angular momentum of its own, that the particles have no part in. ``nonlinear``: the energy
    of these strains as a polynomial, and a tip whose face is strained by the modes as well.
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
    if stretched:
        size = np.sqrt(stiffness)
        P = rng.standard_normal((len(stretched), modes, modes)) * 100.0 / size[list(stretched), None, None]
        # the modes that are named are membrane fields, in another basis of the same space
        turn = np.linalg.qr(np.random.default_rng(0).standard_normal((len(stretched), len(stretched))))[0]
        strain, second = turn @ np.diag(size)[list(stretched)], np.tensordot(turn, P + P.transpose(0, 2, 1), 1)
        record = replace(record, stretch=ModalStretch(strain, second))
    if nonlinear:
        face = np.random.default_rng(200 + seed).standard_normal((2, 6, modes)) * 0.3
        face[0] = 0.0
        record = replace(record, stretch=None, nonlinear=polynomial(record.stretch, face))
    if rotors:
        rng = np.random.default_rng(100 + seed)
        half = rng.standard_normal((modes, modes))
        record = replace(
            record,
            gyroscopic=Gyroscopic(rng.standard_normal(3), rng.standard_normal((3, modes)), half - half.T),
        )
    return Particles(mass, x, phi, record)


def polynomial(stretch: ModalStretch | None, face: np.ndarray) -> NonlinearStiffness:
    """The energy ((c q + q P q / 2)^2 - (c q)^2) / 2 of membrane strains, multiplied out."""
    n = face.shape[2]
    cubic, quartic = np.zeros((n,) * 3), np.zeros((n,) * 4)
    if stretch is not None:
        cubic += 0.5 * np.einsum("mi,mjk->ijk", stretch.strain, stretch.P)
        quartic += 0.125 * np.einsum("mij,mkl->ijkl", stretch.P, stretch.P)
    more = np.array([1e3]), np.array([1e-3]), np.eye(n)
    return NonlinearStiffness(packed(cubic), packed(quartic), face, *more)


def packed(tensor: np.ndarray) -> np.ndarray:
    """Coefficients of the products q_i q_j ... with i >= j >= ..., of a sum over all i, j, ..."""
    falling = [i for i in np.ndindex(*tensor.shape) if all(a >= b for a, b in pairwise(i))]
    return np.array([sum(tensor[i] for i in set(permutations(one))) for one in falling])


def polynomial_energy(record: ReducedBody, q: np.ndarray) -> np.ndarray:
    """q K q / 2 and the cubic and quartic terms, one by one."""
    n, energy = len(q), 0.5 * np.sum(record.stiffness * q**2)
    for degree, terms in ((3, record.nonlinear.cubic), (4, record.nonlinear.quartic)):
        falling = [i for i in np.ndindex(*(n,) * degree) if all(a >= b for a, b in pairwise(i))]
        energy += sum(c * np.prod(q[list(i)]) for c, i in zip(terms, falling, strict=True))
    return energy


def strain_energy(record: ReducedBody, q: np.ndarray) -> np.ndarray:
    """K_kk e_k^2 / 2 over all modes, e = q + sum_m K^-1 c_m q^T P_m q / 2."""
    if record.nonlinear is not None:
        return polynomial_energy(record, q)
    strain = q.copy()
    if record.stretch is not None:
        for c, P in zip(record.stretch.strain, record.stretch.P, strict=True):
            strain += c / record.stiffness * (q @ P @ q) / 2.0
    return 0.5 * np.sum(record.stiffness * strain**2)


def elastic_forces(record: ReducedBody, q: np.ndarray) -> np.ndarray:
    """Derivatives of the strain energy, by complex steps."""
    steps = 1e-30j * np.eye(len(q))
    return np.array([strain_energy(record, q + step).imag for step in steps]) / 1e-30
