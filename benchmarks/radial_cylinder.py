"""The thick cylinder of yielding.py along its radius alone: the values that all programs' meshes converge to.

An independent program, of numpy: quadratic cells along the radius, J2 flow with linear isotropic hardening in plane
strain, the same load steps, radial return with its consistent tangent (Simo & Hughes 1998, box 3.2).
"""

from __future__ import annotations

import numpy as np
import yielding_peers as case
from numpy.typing import NDArray


def displacements(hardening: float, *, cells: int = 400) -> tuple[float, float]:
    """Of the inner and the outer radius at the end, m; ``hardening``: plastic modulus, Pa."""
    r, weights, strains = _cells(cells)
    ends = 2 * np.arange(cells)[:, None] + np.arange(3)
    n = 2 * cells + 1
    u, plastic, alpha = np.zeros(n), np.zeros((*r.shape, 3)), np.zeros(r.shape)
    for step in range(1, case.STEPS + 1):
        load = np.zeros(n)
        load[0] = case.SHARE * case.LIMIT * step / case.STEPS * case.INNER
        for _ in range(30):
            strain = np.zeros_like(plastic)
            strain[..., :2] = np.einsum("epsi,ei->eps", strains, u[ends])
            stress, tangent, flow, growth = _return(strain - plastic, alpha, hardening)
            force = np.einsum("ep,eps,epsi->ei", weights, stress[..., :2], strains)
            stiffness = np.einsum("ep,epsi,epst,eptj->eij", weights, strains, tangent[..., :2, :2], strains)
            lack, matrix = -load, np.zeros((n, n))
            np.add.at(lack, ends, force)
            np.add.at(matrix, (ends[:, :, None], ends[:, None, :]), stiffness)
            change = np.linalg.solve(matrix, lack)
            u = u - change
            if np.linalg.norm(change) < 1e-11 * np.linalg.norm(u):
                break
        else:
            raise RuntimeError("the radial program did not converge")
        plastic, alpha = plastic + growth[..., None] * flow, alpha + growth
    return float(u[0]), float(u[-1])


def _cells(cells: int) -> tuple[NDArray, NDArray, NDArray]:
    """At two points of each cell: the radius, the weight r dr, and both strains (2) by the cell's three nodes."""
    edges = np.linspace(case.INNER, case.OUTER, cells + 1)
    half = np.diff(edges)[:, None] / 2
    at = np.array([-1.0, 1.0]) / np.sqrt(3)
    r = (edges[:-1, None] + edges[1:, None]) / 2 + half * at
    shapes = np.stack([at * (at - 1) / 2, 1 - at**2, at * (at + 1) / 2], axis=-1)
    slopes = np.stack([at - 0.5, -2 * at, at + 0.5], axis=-1)
    strains = np.stack([slopes / half[..., None], shapes / r[..., None]], axis=2)
    return r, r * half, strains


def _return(elastic: NDArray, alpha: NDArray, hardening: float) -> tuple[NDArray, NDArray, NDArray, NDArray]:
    """Stress (r, around, z), its derivative by the strain, flow direction, and growth of the plastic strain."""
    mu, bulk = case.YOUNG / 2 / (1 + case.POISSON), case.YOUNG / 3 / (1 - 2 * case.POISSON)
    deviatoric = np.eye(3) - 1 / 3
    s = 2 * mu * elastic @ deviatoric
    q = np.maximum(np.sqrt(1.5 * (s**2).sum(axis=-1)), 1e-6)
    growth = np.maximum(q - case.YIELD - hardening * alpha, 0.0) / (3 * mu + hardening)
    flow = 1.5 * s / q[..., None]
    less = 3 * mu * growth / q
    stress = s * (1 - less)[..., None] + bulk * elastic.sum(axis=-1, keepdims=True)
    along = np.where(growth > 0, 3 * mu / (3 * mu + hardening) - less, 0.0) * 4 / 3 * mu
    tangent = bulk * np.ones((3, 3)) + 2 * mu * (1 - less)[..., None, None] * deviatoric
    tangent = tangent - along[..., None, None] * flow[..., :, None] * flow[..., None, :]
    return stress, tangent, flow, growth


if __name__ == "__main__":
    for modulus in (700e6, 0.0):
        print(modulus, *(displacements(modulus, cells=n) for n in (100, 400)))
