"""Places and motions of a machine's frames in one state."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.bodies.body import Body, Frame
from flexmbd.multibody.kernels.base.arrays import Plan, Work, new_work
from flexmbd.multibody.kernels.inverse_dynamics.recursion import forward_kinematics, frame_motion
from flexmbd.multibody.kernels.reading.force_tables import without_forces
from flexmbd.multibody.motion.machine import Machine
from flexmbd.multibody.scene_index import IdentityMap

FloatArray = NDArray[np.float64]


class FrameKinematics(NamedTuple):
    """Kinematics of one frame, in inertial axes.

    Attributes:
        p: (3,) m, its origin.
        R: (3, 3) rotation from its axes to inertial ones.
        v, w: (3,) velocity of its origin (m/s) and angular velocity (rad/s).
        a, alpha: (3,) acceleration of its origin (m/s^2) and angular acceleration (rad/s^2).
    """

    p: FloatArray
    R: FloatArray
    v: FloatArray
    w: FloatArray
    a: FloatArray
    alpha: FloatArray


class MovingFrames:
    """The frames of a machine in one state, which ``move`` sets; forces and weights play no part."""

    def __init__(self, scene: Machine) -> None:
        self._index = scene.index
        self._plan = without_forces(scene.plan)
        self._work = new_work(self._plan)
        self._rows: IdentityMap[Body, dict[tuple[bytes, ...], int]] = IdentityMap()
        self._state: tuple[FloatArray, ...] = (np.zeros(0),) * 3
        self._stale = True

    def move(self, x: FloatArray, v: FloatArray, a: FloatArray) -> MovingFrames:
        """Bring the machine to x (nx,), v (nv,), a (nv,); return these frames."""
        self._state, self._stale = (x, v, a), True
        return self

    def motion(self, frame: Frame) -> FrameKinematics:
        """How a frame moves.

        Raises:
            SceneError: it is of another scene.
        """
        row = self.row(frame)
        p, R, *rates = frame_motion(*self.evaluated(), row)
        turn = np.reshape(R, (3, 3))
        return FrameKinematics(np.array(p), turn, *(turn @ rate for rate in rates))

    def row(self, frame: Frame) -> int:
        """The row of ``Plan.frames`` that stands for a frame here."""
        # by its place, for functions make the same frame anew at each call
        now = self._index.frame_now(frame)
        modes = b"" if now.modes is None else now.modes.tobytes()
        place = now.p_BF_B.tobytes(), now.R_BF.tobytes(), modes
        rows = self._rows.setdefault(frame.body, {})
        if place not in rows:
            self._plan = self._index.with_probe(self._plan, frame)
            self._work = new_work(self._plan)
            rows[place] = len(self._plan.frames) - 1
            self._stale = True
        return rows[place]

    def evaluated(self) -> tuple[Plan, Work]:
        """The plan with all frames used so far, and work arrays that hold the motion."""
        if self._stale:
            forward_kinematics(self._plan, self._work, *self._state)
            self._stale = False
        return self._plan, self._work
