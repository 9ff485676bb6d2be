"""A planar geometrically exact beam in absolute coordinates, hinged or clamped at one end: an oracle.

Two-node elements with one integration point (Simo & Vu-Quoc 1986, doi:10.1115/1.3171870), consistent mass,
generalized-alpha. It shares nothing with flexmbd: no body frame, no modes, no geometric stiffness.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh

_RHO = 0.9


@dataclass(frozen=True)
class PlanarBeam:
    """Stiffnesses EA, GA (N), EI (N m^2), masses rho A (kg/m), rho I (kg m), and the length (m)."""

    EA: float
    GA: float
    EI: float
    rho_A: float
    rho_I: float
    length: float


def hinged_tip(
    beam: PlanarBeam, torque: Callable[[float], float], *, elements: int, h: float, end: float
) -> np.ndarray:
    """(2,) m, the tip at the time `end`, from rest along x, with a torque (N m) on the hinge at the origin."""
    return _march(beam, torque, place=2, held=2, tip=(0.0, 0.0), elements=elements, h=h, end=end)


def clamped_tip(
    beam: PlanarBeam,
    force: Callable[[float], float],
    *,
    tip: tuple[float, float],
    elements: int,
    h: float,
    end: float,
) -> np.ndarray:
    """(2,) m, the tip, which carries a mass (kg) and inertia (kg m^2), with a force (N) along y there."""
    return _march(beam, force, place=-2, held=3, tip=tip, elements=elements, h=h, end=end)


def bent_frequencies(beam: PlanarBeam, force: float, *, elements: int) -> np.ndarray:
    """(n,) rad/s, of the beam clamped at the origin and bent by a dead force (N) along y at its tip, ascending."""
    q = np.zeros(3 * (elements + 1))
    q[::3] = np.linspace(0.0, beam.length, elements + 1)
    load = np.zeros(len(q))
    for share in np.linspace(0.1, 1.0, 10):
        load[-2] = share * force
        for _ in range(30):
            internal, tangent = _internal(beam, q)
            change = np.linalg.solve(tangent[3:, 3:], (load - internal)[3:])
            q[3:] += change
            if abs(change).max() < 1e-11 * beam.length:
                break
        else:
            raise AssertionError(f"no equilibrium at {share:.1f} of the load")
    _, tangent = _internal(beam, q)
    return np.sqrt(eigh(tangent[3:, 3:], _mass(beam, elements)[3:, 3:], eigvals_only=True))


def _mass(beam: PlanarBeam, elements: int) -> np.ndarray:
    size = beam.length / elements
    mass = np.zeros((3 * (elements + 1),) * 2)
    for e in range(elements):
        for dof, line in enumerate((beam.rho_A, beam.rho_A, beam.rho_I)):
            rows = [3 * e + dof, 3 * e + 3 + dof]
            mass[np.ix_(rows, rows)] += line * size / 6 * np.array([[2, 1], [1, 2]])
    return mass


def _march(
    beam: PlanarBeam,
    action: Callable[[float], float],
    *,
    place: int,
    held: int,
    tip: tuple[float, float],
    elements: int,
    h: float,
    end: float,
) -> np.ndarray:
    n = 3 * (elements + 1)
    mass = _mass(beam, elements)
    mass[[-3, -2, -1], [-3, -2, -1]] += tip[0], tip[0], tip[1]
    alpha_m, alpha_f = (2 * _RHO - 1) / (1 + _RHO), _RHO / (1 + _RHO)
    beta, gamma = 0.25 * (1 - alpha_m + alpha_f) ** 2, 0.5 - alpha_m + alpha_f
    q, v, a = np.zeros(n), np.zeros(n), np.zeros(n)
    q[::3] = np.linspace(0.0, beam.length, elements + 1)
    load = np.zeros(n)
    for step in range(round(end / h)):
        q_0, v_0, a_0 = q, v, a
        load[place] = action((step + 1 - alpha_f) * h)
        for _ in range(20):
            q = q_0 + h * v_0 + h * h * ((0.5 - beta) * a_0 + beta * a)
            v = v_0 + h * ((1 - gamma) * a_0 + gamma * a)
            force, tangent = _internal(beam, (1 - alpha_f) * q + alpha_f * q_0)
            residual = mass @ ((1 - alpha_m) * a + alpha_m * a_0) + force - load
            residual[:held] = 0.0
            # the rounding of the axial force
            if abs(residual).max() < 1e-14 * beam.EA * elements:
                break
            matrix = (1 - alpha_m) * mass + (1 - alpha_f) * beta * h * h * tangent
            matrix[:held] = np.eye(held, n)
            a = a - np.linalg.solve(matrix, residual)
        else:
            raise AssertionError(f"no convergence in step {step}")
    return q[-3:-1]


def _internal(beam: PlanarBeam, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Internal forces (n,) and their tangent (n, n)."""
    nodes = q.reshape(-1, 3)
    count = len(nodes) - 1
    size = beam.length / count
    slope = np.diff(nodes, axis=0) / size
    angle = 0.5 * (nodes[1:, 2] + nodes[:-1, 2])
    c, s, zero = np.cos(angle), np.sin(angle), np.zeros(count)
    axial = c * slope[:, 0] + s * slope[:, 1]
    shear = -s * slope[:, 0] + c * slope[:, 1]
    resultants = np.stack([beam.EA * (axial - 1), beam.GA * shear, beam.EI * slope[:, 2]])
    # first derivatives of the strains by the six coordinates of each element
    along = np.stack([-c / size, -s / size, shear / 2, c / size, s / size, shear / 2])
    across = np.stack([s / size, -c / size, -axial / 2, -s / size, c / size, -axial / 2])
    bending = np.stack([zero, zero, zero - 1 / size, zero, zero, zero + 1 / size])
    first = np.stack([along, across, bending])
    # second derivatives: those by an angle turn the axial strain's into the shear's and back
    half = np.array([0, 0, 0.5, 0, 0, 0.5])
    second = np.zeros((2, 6, 6, count))
    for strain, (other, sign) in enumerate(((across, 1.0), (along, -1.0))):
        turned = sign * other * np.array([1, 1, 0.5, 1, 1, 0.5])[:, None]
        second[strain] = turned[:, None] * half[:, None] + half[:, None, None] * turned
    stiffness = np.array([beam.EA, beam.GA, beam.EI])
    forces = size * np.einsum("se,sie->ei", resultants, first)
    tangents = size * np.einsum("s,sie,sje->eij", stiffness, first, first)
    tangents += size * np.einsum("se,sije->eij", resultants[:2], second)
    force, tangent = np.zeros(len(q)), np.zeros((len(q), len(q)))
    for e in range(count):
        rows = slice(3 * e, 3 * e + 6)
        force[rows] += forces[e]
        tangent[rows, rows] += tangents[e]
    return force, tangent
