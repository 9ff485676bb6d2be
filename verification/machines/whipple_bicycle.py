"""Whipple's bicycle.

The benchmark bicycle of 94 kg with its rider rides straight on, its wheels without slip: eigenvalues of the linear
machine, and between which speeds it is stable by itself.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.optimize import brentq

import flexmbd as fm
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source("Meijaard, Papadopoulos, Ruina & Schwab 2007, Proceedings of the Royal Society A 463")
REFERENCES = (
    Reference("eigenvalues at rest", "1/s", (3.13164324790656, 5.53094371765393), 1e-8, Sureness.PRIMARY),
    Reference("castering, weave (real, imaginary part), capsize at 5 m/s", "1/s",
              (-14.07838969, -0.77534188, 4.46486771, -0.32286643), 1e-9, Sureness.PRIMARY),
    Reference("speed from which weave dies out", "m/s", (4.29238253634111,), 1e-8, Sureness.PRIMARY),
    Reference("speed from which it capsizes", "m/s", (6.02426201538837,), 1e-7, Sureness.PRIMARY),
)  # fmt: skip


def eigenvalues(speed: float) -> np.ndarray:
    """1/s, of the bicycle at a speed (m/s), without those of riding on."""
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    rider = [[9.2, 0.0, -2.4], [0.0, 11.0, 0.0], [-2.4, 0.0, 2.8]]
    handlebar = [[0.05892, 0.0, 0.00756], [0.0, 0.06, 0.0], [0.00756, 0.0, 0.00708]]
    frame = scene.add(fm.RigidBody(85.0, rider, (0.3, 0.0, 0.6)), name="frame")
    fork = scene.add(fm.RigidBody(4.0, handlebar, (-0.2, 0.0, 0.7)), name="fork")
    rear = scene.add(fm.RigidBody(2.0, (0.0603, 0.12, 0.0603)), name="rear wheel")
    front = scene.add(fm.RigidBody(3.0, (0.1405, 0.28, 0.1405)), name="front wheel")
    ride = scene.connect(fm.joint.Free(), scene.ground.frame(), frame.frame(), name="ride")
    axis = (np.sin(np.pi / 10), 0.0, -np.cos(np.pi / 10))
    scene.connect(fm.joint.Revolute(axis), frame.frame(p=(1.1, 0.0, -0.3)), fork.frame(), name="steer")
    ride.position = [0.0, 0.0, 0.3, 1.0, 0.0, 0.0, 0.0]
    ride.velocity = [speed, 0.0, 0.0, 0.0, 0.0, 0.0]
    along_y = [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]  # the disc's z along the axle
    for hub, wheel, radius in ((frame.frame(), rear, 0.3), (fork.frame(p=(-0.08, 0.0, 0.35)), front, 0.35)):
        axle = scene.connect(fm.joint.Revolute("y"), hub, wheel.frame(), name=f"{wheel.name} axle")
        axle.velocity = speed / radius
        scene.connect(fm.joint.RollingDisc(radius), scene.ground.frame(), wheel.frame(R=along_y))
    found = scene.linearize().eigenvalues()
    return np.asarray(found[np.abs(found) > 1e-6])


def weave(speed: float) -> complex:
    """1/s, the eigenvalue with the largest imaginary part."""
    found = eigenvalues(speed)
    return complex(found[np.argmax(found.imag)])


def capsize(speed: float) -> float:
    """1/s, the real eigenvalue that is not castering's."""
    found = eigenvalues(speed)
    return float(found[np.abs(found.imag) < 1e-9].real.max())


def compute() -> Computed:
    """Linear machines at some speeds."""
    rest = eigenvalues(0.0)
    rest = np.sort(rest.real[rest.real > 0.0])
    five = eigenvalues(5.0)
    real = np.sort(five.real[np.abs(five.imag) < 1e-9])
    one = weave(5.0)
    return Computed(
        (
            numbers(rest),
            numbers(real[0], one.real, one.imag, real[-1]),
            numbers(brentq(lambda v: weave(v).real, 4.0, 4.6, xtol=1e-13)),
            numbers(_zero(capsize, 6.02, 0.05)),
        ),
        accuracy="eigenvalues of the linear machine",
    )


def _zero(function: Callable[[float], float], about: float, reach: float) -> float:
    """Where a smooth function is zero, by its inverse through places on both sides."""
    at = about + reach * np.array([-1.0, -0.75, -0.5, -0.25, 0.25, 0.5, 0.75, 1.0])
    values = [function(x) for x in at]
    weights = np.polynomial.polynomial.polyfit(values, (at - about) / reach, len(at) - 1)
    return float(about + reach * weights[0])
