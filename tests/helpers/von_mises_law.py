"""A von Mises law with linear hardening, as a function of a point: elastic strain kept by itself, closed return."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Metal:
    E: float
    nu: float
    rho: float
    yield_stress: float
    hardening: float


def von_mises(step, p):
    """State: plastic strain (6,), with twice the tensor's shears, and the accumulated one."""
    mu, bulk = p.E / (2 * (1 + p.nu)), p.E / (3 * (1 - 2 * p.nu))
    elastic = step.strain + step.increment - step.state[:6]
    volume = elastic[0] + elastic[1] + elastic[2]
    deviator = np.empty(6)
    for i in range(6):
        deviator[i] = 2 * mu * (elastic[i] - volume / 3) if i < 3 else mu * elastic[i]
    size = np.sqrt(1.5 * (np.sum(deviator[:3] ** 2) + 2 * np.sum(deviator[3:] ** 2)))
    over = size - p.yield_stress - p.hardening * step.state[6]
    growth = max(over, 0.0) / (3 * mu + p.hardening)
    share, state = 1.0, step.state.copy()
    tangent = np.zeros((6, 6))
    if growth > 0.0:
        share = 1 - 3 * mu * growth / size
        for i in range(6):
            state[i] += 1.5 * growth / size * deviator[i] * (1 if i < 3 else 2)
        state[6] += growth
        factor = 9 * mu**2 * (growth / size - 1 / (3 * mu + p.hardening)) / size**2
        tangent += factor * np.outer(deviator, deviator)
    for i in range(3):
        tangent[:3, i] += bulk - 2 / 3 * mu * share
        tangent[i, i] += 2 * mu * share
        tangent[3 + i, 3 + i] += mu * share
    stress = share * deviator
    stress[:3] += bulk * volume
    return stress, tangent, state


def energies(strain, stress, state, p):
    """Elastic energy and the yield stress's work, J/m^3."""
    elastic = sum(stress[i] * (strain[i] - state[i]) for i in range(6)) / 2
    return {"elastic": elastic, "plastic": p.yield_stress * state[6] + p.hardening / 2 * state[6] ** 2}


STEEL = Metal(E=2.1e11, nu=0.3, rho=7850.0, yield_stress=2.1e8, hardening=4.2e9)
STATE = {"plastic_strain_tensor": [0.0] * 6, "plastic_strain": [0.0]}
