"""Bodies that a user gives by their inertia and active forces in Kane's form, solved with the machine's own.

Their inertia force follows from accelerations, which follow from it: both are found together at each evaluation of the
equations, so that it is a function of the state as any force is.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.errors import SceneError
from flexmbd.multibody.bodies.body import Frame
from flexmbd.multibody.kane.equations import Kinematics
from flexmbd.multibody.kane.force_response import ForceResponse
from flexmbd.multibody.kernels.reading.force_tables import without_function
from flexmbd.multibody.motion.machine import Contribution, Machine

FloatArray = NDArray[np.float64]

#: Inertia (6 k, 6 k) and active forces (6 k,) at k frames, in inertial axes.
InertiaAndForces = tuple[ArrayLike, ArrayLike]


@dataclass(frozen=True, eq=False)
class UserBody:
    """A body by what it does at frames of the machine.

    Attributes:
        frames: where.
        function: of the ``Kinematics``.
        what: its name in messages.
    """

    frames: tuple[Frame, ...]
    function: Callable[[Kinematics], InertiaAndForces]
    what: str


class KaneInertia:
    """The wrenches of all such bodies of a machine, as a function of its state; ``build`` comes first."""

    def __init__(self, bodies: Sequence[UserBody]) -> None:
        self._bodies = tuple(bodies)
        self._frames = [frame for body in bodies for frame in body.frames]

    def build(self, scene: Machine, address: int) -> None:
        """Take the compiled scene, whose element at ``address`` this is."""
        self._scene = scene
        self._response = ForceResponse(without_function(scene.plan, address), scene.extent)
        self._kinematics = Kinematics(scene)

    def __call__(self, t: float, x: FloatArray, v: FloatArray) -> FloatArray:
        """Generalised forces (nv,): v_r . R + w_r . T of all wrenches (R, T) = active - inertia times (a, alpha)."""
        partial, wrench = self._solve(t, x, v)
        return partial.T @ wrench

    def wrenches(self, t: float, x: FloatArray, v: FloatArray) -> list[Contribution]:
        """The wrenches themselves, frame by frame."""
        _, wrench = self._solve(t, x, v)
        return [(f, w[:3], w[3:]) for f, w in zip(self._frames, wrench.reshape(-1, 6), strict=True)]

    def _solve(self, t: float, x: FloatArray, v: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Generalised forces of unit wrenches (6 k, nv), and the wrenches (6 k,).

        With the frames' accelerations linear in the wrenches w, acc = acc_0 + Y w, these solve
        (1 + I Y) w = active - I acc_0.
        """
        kinematics = self._kinematics.move(t, x, v)
        inertia, active = self._ask(kinematics)
        units = [
            kinematics.generalised_forces([(frame, unit[:3], unit[3:])])
            for frame in self._frames for unit in np.eye(6)
        ]  # fmt: skip
        partial = np.array(units)
        answer = self._response.evaluate(t, x, v, partial)
        self._scene.refuse_failed(self._response.work)
        kinematics.move(t, x, v, answer.a)
        accelerations = np.concatenate(
            [part for f in self._frames for part in (kinematics.acceleration(f), kinematics.angular_acceleration(f))]
        )
        yielding = partial @ answer.a_slopes.T
        system = np.eye(len(active)) + inertia @ yielding
        return partial, np.linalg.solve(system, active - inertia @ accelerations)

    def _ask(self, kinematics: Kinematics) -> tuple[FloatArray, FloatArray]:
        """Inertia and active forces at all frames."""
        size = 6 * len(self._frames)
        inertia, active = np.zeros((size, size)), np.zeros(size)
        o = 0
        for body in self._bodies:
            n = 6 * len(body.frames)
            given = body.function(kinematics)
            parts = [np.asarray(part, dtype=np.float64) for part in given]
            if [part.shape for part in parts] != [(n, n), (n,)] or not all(np.isfinite(part).all() for part in parts):
                raise SceneError(
                    f"{body.what} must give finite numbers of the shapes ({n}, {n}) and ({n},), inertia and forces, "
                    f"not of {', '.join(str(part.shape) for part in parts)}"
                )
            inertia[o : o + n, o : o + n], active[o : o + n] = parts
            o += n
        return inertia, active
