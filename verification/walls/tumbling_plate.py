"""Elastic plate that falls and tumbles, 10^5 steps of central differences.

An aluminium plate of 200 x 120 x 4 mm is thrown with 500 rad/s about its middle axis, a twentieth of that about the
long one, while it bends, and falls freely: it makes five turns, and turns over. Nothing but round-off may change
its momenta, and its centre goes along the parabola; the energy of steps of 0.9 of the stable one only swings. Where
its axes point at the end is that of a rigid plate of the same masses, by Euler's equations, but for what the spin
stretches it. The bend takes a hundredth of the energy.
"""

from __future__ import annotations

from dataclasses import dataclass

from mpi4py import MPI

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from flexmbd import meshes
from flexmbd.continuum import ExplicitRun, NonlinearModel
from flexmbd.forms import solid_shell
from verification.reference import Computed, Reference, Source, Sureness, numbers

FloatArray = NDArray[np.float64]

SOURCE = Source(
    "Newton's and Euler's laws of a free body; Hairer, Lubich & Wanner 2003, Acta Numerica 12:399, of central "
    "differences",
    "10.1017/S0962492902000144",
)
REFERENCES = (
    Reference("linear momentum at the end, over m v0 + m g t", "", (1.0,), 1e-10, Sureness.PRIMARY),
    Reference("angular momentum about the centre at the end, over that at the start", "", (1.0, 0.0, 0.0), 1e-10,
              Sureness.PRIMARY),
    Reference("way of the centre over v0 t + g t^2 / 2", "", (1.0,), 1e-10, Sureness.PRIMARY),
    Reference("largest and least energy over that at the start", "", (1.0, 1.0), 1e-4, Sureness.PRIMARY),
    Reference("axes at the end, three unit vectors, by Euler's equations", "", (0.0,) * 9, 1e-2, Sureness.OWN,
              size=1.0),
)  # fmt: skip
SIZES, SPIN, STEPS = (0.2, 0.12, 4e-3), 500.0, 100_000
THROWN, GRAVITY = np.array([3.0, -2.0, 5.0]), np.array([0.0, 0.0, -9.81])


@dataclass(frozen=True)
class Flight:
    """What is left of laws after a flight.

    Attributes:
        linear: momentum over its closed form, along that.
        angular: (3,) along the angular momentum at the start, and across it, over its size.
        way: of the centre over its closed form, along that.
        energy: (instants,) over that at the start.
        axes: (3, 3) of the plate, and
        rigid: (3, 3) of a rigid one.
        bent: largest elastic energy over the whole at the start.
        spun: rad, that the spin at the start turns through.
    """

    linear: float
    angular: FloatArray
    way: float
    energy: FloatArray
    axes: FloatArray
    rigid: FloatArray
    bent: float
    spun: float


def flown(steps: int, cells: tuple[int, int] = (5, 3)) -> Flight:
    """After so many steps of 0.9 of the stable one."""
    length, width, thickness = SIZES
    mesh = meshes.wall(meshes.sheet(length, width, divisions=cells, comm=MPI.COMM_SELF), thickness)
    body = NonlinearModel(mesh, solid_shell, solid_shell.Parameters(E=7e10, nu=0.3, rho=2700.0), degree=1)
    spin = SPIN * np.array([0.05, 1.0, 0.02])

    def thrown(x: FloatArray) -> FloatArray:
        far = x - x.mean(axis=0)
        bends = np.zeros_like(x)
        bends[:, 2] = 6.0 * np.cos(2.0 * np.pi * far[:, 0] / length)
        return THROWN + np.cross(spin, far) + bends

    run = ExplicitRun(body, velocity=thrown, gravity=GRAVITY)
    motion, masses = run.motion, run.motion.masses
    whole = masses.sum()

    def centre() -> FloatArray:
        return np.asarray(masses @ motion.x / whole)

    x0, c0 = motion.x.copy(), centre()
    before = motion.momentum(c0)
    h = 0.9 * run.stable_step
    t = steps * h
    account = run.simulate(t, h=h, outputs=50)
    after, c1 = motion.momentum(centre()), centre()
    falls, flies = before[:3] + whole * GRAVITY * t, before[:3] / whole * t + GRAVITY * t**2 / 2
    axis = before[3:] / np.linalg.norm(before[3:])
    across = np.linalg.svd(axis[None])[2][1:]
    held = after[3:] / np.linalg.norm(before[3:])
    inertia = _inertia(masses, x0 - c0)
    return Flight(
        linear=float(after[:3] @ falls / (falls @ falls)),
        angular=np.array([axis @ held, *(across @ held)]),
        way=float((c1 - c0) @ flies / (flies @ flies)),
        energy=account.total / account.total[0],
        axes=Rotation.align_vectors(motion.x - c1, x0 - c0, weights=masses)[0].as_matrix(),
        rigid=_rigid(inertia, before[3:], t),
        bent=float(account["elastic"].max() / account.total[0]),
        spun=float(np.linalg.norm(np.linalg.solve(inertia, before[3:])) * t),
    )


def _inertia(masses: FloatArray, x: FloatArray) -> FloatArray:
    """(3, 3) kg m^2 of masses at places (n, 3) about the origin."""
    return np.asarray(np.einsum("n,nk,nk", masses, x, x) * np.eye(3) - np.einsum("n,ni,nj->ij", masses, x, x))


def _rigid(inertia: FloatArray, momentum: FloatArray, t: float) -> FloatArray:
    """(3, 3) Axes of a rigid body after t (s), by a quaternion that the angular momentum turns."""

    def rate(_: float, q: FloatArray) -> FloatArray:
        turned = Rotation.from_quat(q)
        spin = turned.apply(np.linalg.solve(inertia, turned.inv().apply(momentum)))
        return np.append(0.5 * (spin * q[3] + np.cross(spin, q[:3])), -0.5 * spin @ q[:3])

    found = solve_ivp(rate, (0.0, t), [0.0, 0.0, 0.0, 1.0], method="DOP853", rtol=1e-11, atol=1e-11)
    return np.asarray(Rotation.from_quat(found.y[:, -1]).as_matrix())


def compute() -> Computed:
    """By ExplicitRun."""
    found = flown(STEPS)
    return Computed(
        (
            numbers(found.linear),
            numbers(found.angular),
            numbers(found.way),
            numbers(found.energy.max(), found.energy.min()),
            numbers(found.axes - found.rigid),
        ),
        mesh="5 x 3 solid-shells",
        accuracy=f"{STEPS} steps of 0.9 of the stable one",
    )
