"""Friction that follows the joints' own reactions: both are found together at each evaluation of the equations.

A friction force changes the accelerations, these the reactions, and those the friction.  At a given state the
accelerations and reactions are affine in the friction forces, so that a few unit forces tell all, and what remains are
as many scalar equations as there are such joints.  The forces then are a function of the state, and every integrator
keeps its order.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import SceneError
from flexmbd.multibody.joint.connection import Connection
from flexmbd.multibody.kane.force_response import ForceResponse
from flexmbd.multibody.kernels.base.native import N_SIZES
from flexmbd.multibody.kernels.inverse_dynamics.bearings import normal_forces, settle
from flexmbd.multibody.kernels.reading.force_tables import without_function
from flexmbd.multibody.kernels.reading.tree import joint_frame
from flexmbd.multibody.motion.machine import Machine
from flexmbd.overflow import looked_at, refuse_not_finite

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Bearing:
    """A joint with friction.

    Attributes:
        connection: a revolute or prismatic joint.
        factor: friction force or torque over the normal force: the coefficient, or it times the radius (m).
        regularisation: m/s or rad/s.
    """

    connection: Connection
    factor: float
    regularisation: float


class Bearings:
    """The friction of all such joints of a machine, as a function of its state; ``build`` comes first."""

    def __init__(self, bearings: Sequence[Bearing]) -> None:
        self._bearings = tuple(bearings)
        self._factor = np.array([b.factor for b in bearings])
        self._speed = np.array([b.regularisation for b in bearings])

    def build(self, scene: Machine, address: int) -> None:
        """Take the compiled scene, whose element at ``address`` this is."""
        self._scene = scene
        self._response = ForceResponse(without_function(scene.plan, address), scene.extent)
        slots = [scene.index.joints[b.connection] for b in self._bearings]
        self._coordinate = np.array([s.v.start for s in slots])
        self._places = np.array([_joint_place(scene, b.connection) for b in self._bearings])
        self._units = np.eye(scene.nv)[self._coordinate]

    @looked_at()
    def __call__(self, t: float, x: FloatArray, v: FloatArray) -> FloatArray:
        """Generalised forces (nv,).

        Raises:
            SceneError: a joint locks by its own friction.
            AssemblyError: numbers beyond what doubles hold.
        """
        out: FloatArray = np.zeros(self._scene.nv)
        sliding = self._factor * np.tanh(v[self._coordinate] / self._speed)
        if not sliding.any():  # as about an equilibrium, whatever else is moved for its derivatives
            return out
        answer = self._response.evaluate(t, x, v, self._units)
        k, nv, m = len(sliding), len(v), len(answer.multipliers)
        here, slopes = np.zeros((k, 2)), np.zeros((k, k, 2))
        normal_forces(
            self._response.plan, self._response.work, self._places, self._factor, t, x, v, *answer,
            np.zeros(2 * nv + m), here, slopes,
        )  # fmt: skip
        self._scene.refuse_failed(self._response.work)
        refuse_not_finite(f"the friction of joints at t = {t:g} s", sliding, here, slopes)
        found = friction_forces(self._scene.plan.lapack, sliding, here, slopes)
        if found is None:
            worst = self._bearings[int(np.argmax(np.abs(sliding)))]
            raise SceneError(
                f"the friction of joint {worst.connection.name!r} at t = {t:g} s holds itself: the reaction that it "
                "causes is no smaller than the one it comes from; the joint locks, take a smaller coefficient"
            )
        np.add.at(out, self._coordinate, found)  # a joint may bear several
        return out


def friction_forces(
    lapack: IntArray, sliding: FloatArray, here: FloatArray, slopes: FloatArray
) -> FloatArray | None:
    """Forces f (k,) with f_i = -sliding_i |N_i| and N = here (k, 2) + sum of f_j slopes_j (k, 2), by Newton's method.

    None where no such forces are reached from none, or only some that would grow by themselves; ``lapack`` is a plan's.
    """
    k = len(sliding)
    f: FloatArray = np.zeros(k)
    whole = np.zeros(k, np.int32), np.zeros(N_SIZES, np.int32)
    return f if settle(lapack, sliding, here, slopes, f, np.zeros((k, k)), np.zeros((1, k)), *whole) else None


def _joint_place(scene: Machine, connection: Connection) -> tuple[int, int]:
    """The row of ``Plan.tree`` that a joint of one coordinate leads to, and its frame there, z along its axis."""
    (row,) = scene.index.links[connection]
    return row, joint_frame(scene.plan, row)
