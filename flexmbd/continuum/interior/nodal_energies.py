"""Energies of a body's nodes without the mass that moves with rigid frames, whose energy is the machine's."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.interior.frame_response import Condensation
from flexmbd.continuum.interior.nodal_turns import TurnState

FloatArray = NDArray[np.float64]


def kinetic_energy(frames: Condensation, v: FloatArray, turns: TurnState | None) -> float:
    """J, at velocities (local nodes, 3) m/s, and spins of nodes that turn. Collective."""
    momentum = frames.product(v)
    nodes, mass = _held(frames)
    energy = 0.5 * (momentum * v[: len(momentum)]).sum() - 0.5 * (mass[:, None] * v[nodes] ** 2).sum()
    if frames.turning is not None and turns is not None:
        energy += frames.turning.inertia.energy(turns, nodes)
    return float(frames.bonds.total(np.array(energy)))


def weight_energy(frames: Condensation, weight: FloatArray, gravity: FloatArray, x: FloatArray) -> float:
    """J, of the weight (owned nodes, 3) N by gravity (3,) m/s^2, of nodes at x (local nodes, 3) m. Collective."""
    nodes, mass = _held(frames)
    energy = (mass[:, None] * x[nodes] @ gravity).sum() - (weight * x[: len(weight)]).sum()
    return float(frames.bonds.total(np.array(energy)))


def _held(frames: Condensation) -> tuple[NDArray[np.integer], FloatArray]:
    """This rank's nodes that rigid frames hold, and what of their mass the frames have, kg."""
    bonds = frames.bonds
    mine = bonds.own & ~bonds.averaged
    return bonds.nodes[mine], bonds.mass[mine]
