"""Swinging cube (Bonet).

A unit cube whose faces slide along themselves at the one end and across at the other swings in one exact mode, U
cos(omega t) (sin cos cos, cos sin cos, cos cos sin): a dilatational one, and an isochoric one (1, 1, -2) whose
frequency does not depend on nu, though nu is nearly one half.
"""

from __future__ import annotations

from mpi4py import MPI

import numpy as np

from flexmbd import meshes
from flexmbd.continuum import ExplicitRun, NonlinearModel, Support
from flexmbd.forms import j2_plasticity
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source("Aguirre, Gil, Bonet & Carreno 2014, Journal of Computational Physics 259; closed form by substitution")
REFERENCES = (
    Reference(
        "dilatational, nu = 0.3: amplitude after 0.7 periods over the exact one", "", (1.0,), 1e-2, Sureness.PRIMARY
    ),
    Reference(
        "isochoric, nu = 0.49: amplitude after 0.7 periods over the exact one", "", (1.0,), 1e-2, Sureness.PRIMARY
    ),
)
SIZE = 1e-5


def shape(x: np.ndarray, weights: tuple[float, float, float]) -> np.ndarray:
    """The mode at points (n, 3) of [0, 1] x [-1/2, 1/2]^2."""
    s, c = (function(0.5 * np.pi * (x + np.array([0.0, 0.5, 0.5]))) for function in (np.sin, np.cos))
    parts = [s[:, i] * c[:, (i + 1) % 3] * c[:, (i + 2) % 3] for i in range(3)]
    return SIZE * np.column_stack(parts) * np.array(weights)


def amplitude(weights: tuple[float, float, float], nu: float) -> float:
    """Of the exact shape in what is found after 0.7 periods, over the exact amplitude; shear modulus and density 1."""
    soft = j2_plasticity.Parameters(E=2.0 * (1.0 + nu), nu=nu, rho=1.0, yield_stress=1e6)
    mesh = meshes.block(1.0, 1.0, 1.0, divisions=(12, 12, 12), comm=MPI.COMM_SELF)
    body = NonlinearModel(mesh, j2_plasticity, soft, degree=1)
    stiffness = 2.0 * (1.0 - nu) / (1.0 - 2.0 * nu) if sum(weights) else 1.0
    omega = 0.5 * np.pi * np.sqrt(3.0 * stiffness)
    supports = [
        *(Support(f"{axis}_min", **{axis: True}) for axis in "xyz"),
        *(Support(f"{axis}_max", **{other: True for other in "xyz" if other != axis}) for axis in "xyz"),
    ]
    run = ExplicitRun(body, velocity=lambda x: omega * shape(x, weights), supports=supports)
    X, t = run.motion.x.copy(), 0.7 * 2.0 * np.pi / omega
    run.simulate(t, outputs=1)
    exact = np.sin(omega * t) * shape(X, weights)
    return float(np.vdot(run.motion.x - X, exact) / np.vdot(exact, exact))


def compute() -> Computed:
    """Both modes."""
    values = numbers(amplitude((1.0, 1.0, 1.0), 0.3)), numbers(amplitude((1.0, 1.0, -2.0), 0.49))
    return Computed(values, mesh="12 x 12 x 12 bricks", accuracy="stable steps of central differences")
