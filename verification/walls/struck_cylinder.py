"""Elastic cylinder under a short pressure pulse.

R = 1 m, h = 10 mm, steel. Pressed from within by p0 sin(pi t / T) until T, 0.3 of the period of breathing: an endless
cylinder breathes at sqrt(E / (rho (1 - nu^2))) / R, with one degree of freedom; one of length 2 R between diaphragms,
which hold its ends round and let them slide and turn, moves in axisymmetric waves. Their sum has membrane forces,
bending along the axis and both inertias of each half wave, and no shear. Told at 16 instants until 4 T. An octant.
"""

from __future__ import annotations

from mpi4py import MPI

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh

from flexmbd import meshes
from flexmbd.continuum import ExplicitRun, NonlinearModel, PressureOnFacets, Support
from flexmbd.forms import solid_shell
from verification.reference import Computed, Reference, Source, Sureness, numbers
from verification.walls._wall import radial

FloatArray = NDArray[np.float64]

SOURCE = Source("Closed form: modes of a shell by membrane forces and bending, as in Leissa 1973, NASA SP-288")
E, NU, RHO = 2.1e11, 0.3, 7850.0
RADIUS, THICKNESS, HALF = 1.0, 0.01, 1.0
PRESSURE = 1e4
BREATHING = float(np.sqrt(E / (RHO * (1.0 - NU**2)))) / RADIUS
PULSE = 0.3 * 2.0 * np.pi / BREATHING
LAST, OUTPUTS = 4.0 * PULSE, 16
MODES = 50


def answered(omega: FloatArray, t: FloatArray) -> FloatArray:
    """(modes, instants) s^2 of q'' + omega^2 q = sin(pi t / T) while the pulse lasts, from rest."""
    a = np.pi / PULSE
    w, t = omega[:, None], t[None]

    def forced(s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """q and its rate."""
        d = w**2 - a**2
        return (np.sin(a * s) - a / w * np.sin(w * s)) / d, a * (np.cos(a * s) - np.cos(w * s)) / d

    q, rate = forced(np.full_like(t, PULSE))
    after = q * np.cos(w * (t - PULSE)) + rate / w * np.sin(w * (t - PULSE))
    return np.where(t < PULSE, forced(t)[0], after)


def breathing(t: FloatArray) -> FloatArray:
    """(instants,) m, of the endless cylinder outwards."""
    return np.asarray(PRESSURE / (RHO * THICKNESS) * answered(np.array([BREATHING]), t)[0])


def waves(t: FloatArray) -> FloatArray:
    """(instants,) m, in the middle of the length 2 HALF, by half waves w sin(k x), u cos(k x), each of two modes."""
    membrane, bending = E * THICKNESS / (1.0 - NU**2), E * THICKNESS**3 / 12.0 / (1.0 - NU**2)
    found = np.zeros_like(t)
    for m in range(1, 2 * MODES, 2):
        k = m * np.pi / (2.0 * HALF)
        stiffness = np.array([
            [membrane * k**2, -membrane * NU * k / RADIUS],
            [-membrane * NU * k / RADIUS, membrane / RADIUS**2 + bending * k**4],
        ])
        squares, shapes = eigh(stiffness / (RHO * THICKNESS))
        load = 4.0 / (np.pi * m) * PRESSURE / (RHO * THICKNESS)
        crown = np.sin(0.5 * np.pi * m)
        found += crown * load * shapes[1] ** 2 @ answered(np.sqrt(squares), t)
    return found


TIMES = np.linspace(0.0, LAST, OUTPUTS + 1)[1:]
REFERENCES = (
    Reference("endless: deflection", "um", numbers(1e6 * breathing(TIMES)), 1e-2, Sureness.PRIMARY),
    Reference("between diaphragms: deflection in the middle", "um", numbers(1e6 * waves(TIMES)), 1e-2,
              Sureness.PRIMARY),
)  # fmt: skip


def pressed(cells: tuple[int, int], half: float, *, diaphragm: bool) -> FloatArray:
    """(instants,) m outwards, mean of the middle's nodes; cells around a quarter and along half of the length."""
    surface = meshes.sheet(1.0, 1.0, divisions=cells, comm=MPI.COMM_SELF)
    x = surface.mesh.geometry.x
    around, along = 0.5 * np.pi * x[:, 0], half * (x[:, 1] + 0.5)
    x[:] = np.column_stack([RADIUS * np.sin(around), along, RADIUS * np.cos(around)])
    mesh = meshes.wall(surface, THICKNESS, normals=radial)
    metal = solid_shell.Parameters(E=E, nu=NU, rho=RHO)
    body = NonlinearModel(mesh, solid_shell, metal, degree=1)
    end = Support("y_max", x=True, z=True) if diaphragm else Support("y_max", y=True)
    supports = [Support("x_min", x=True), Support("x_max", z=True), Support("y_min", y=True), end]
    inside = PRESSURE * RADIUS / (RADIUS - THICKNESS / 2.0)  # of the force of a pressure on the middle surface
    push = PressureOnFacets("bottom", lambda t: inside * np.sin(np.pi * t / PULSE) if t < PULSE else 0.0, follows=False)
    run = ExplicitRun(body, supports=supports, loads=[push])
    run.simulate(LAST, outputs=OUTPUTS)
    middle = body.layout.node_x[:, 1] < 1e-6
    out = np.array([np.hypot(*place[middle][:, [0, 2]].T).mean() for place in run.places])
    return np.asarray(out[1:] - out[0])


def compute() -> Computed:
    """By ExplicitRun."""
    endless, held = pressed((16, 1), 0.1, diaphragm=False), pressed((16, 32), HALF, diaphragm=True)
    return Computed(
        (numbers(1e6 * endless), numbers(1e6 * held)),
        mesh="16 x 1 and 16 x 32 solid-shells, an octant", accuracy="stable steps of central differences",
    )  # fmt: skip
