"""Momentum of a machine at each instant."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.brief import brief
from flexmbd.errors import SceneError
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.kernels.reading.tree import masses
from flexmbd.multibody.kernels.sampling.series import momentum_series
from flexmbd.multibody.plan.compiled_scene import CompiledScene

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Momentum:
    """Momentum of all bodies together at each instant, in inertial axes.

    Attributes:
        mass: kg.
        centre: (nt, 3) m, of mass.
        linear: (nt, 3) N s.
        angular: (nt, 3) N m s, about the inertial origin.
    """

    mass: float
    centre: FloatArray
    linear: FloatArray
    angular: FloatArray

    __repr__ = brief

    @property
    def spin(self) -> FloatArray:
        """(nt, 3) N m s, angular momentum about the centre of mass."""
        return np.asarray(self.angular - np.cross(self.centre, self.linear))


def momentum_of(scene: CompiledScene, x: FloatArray, v: FloatArray) -> Momentum:
    """Momentum at configurations (nt, nx) and velocities (nt, nv).

    Raises:
        SceneError: the scene has no mass, or a body with history, whose interior has momentum of its own.
    """
    if scene.interiors is not None:
        raise SceneError(
            "the momentum of a machine with bodies with history is not told: what lies between their frames moves too"
        )
    plan = scene.bodies_alone
    mass = float(masses(plan).sum())
    if mass == 0.0:
        raise SceneError("the machine has no mass, so no centre of mass")
    out: FloatArray = np.zeros((len(x), 9))
    none, scratch = np.zeros((2, scene.nv))
    momentum_series(plan, new_work(plan), x, v, none, scratch, out)
    return Momentum(mass, np.asarray(out[:, :3] / mass, dtype=np.float64), out[:, 3:6], out[:, 6:])
