"""The state that a machine is linearised about: an equilibrium, or a steady motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.bodies.body import FlexibleBody, Frame
from flexmbd.multibody.bodies.pseudo_rigid_body import PseudoRigidBody
from flexmbd.multibody.interiors.scene_interiors import NOTHING_KEPT, Kept
from flexmbd.multibody.joint.connection import Connection
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.kernels.sampling.series import frame_series
from flexmbd.multibody.plan.compiled_scene import CompiledScene, add_probe

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class WorkingPoint:
    """A state of a machine whose accelerations are to be zero.

    Attributes:
        scene: the compiled scene, without redundant rows.
        t: s, at which functions of time are taken.
        x, v: (nx,), (nv,) configuration and velocities.
        multipliers: (m,) reactions of the loops (N or N m).
        interiors: what bodies with history remember there.
        unstable: of an equilibrium how many independent motions have a negative tangent stiffness: with none it is
            stable; None of a state of a trajectory. In a steady motion gyroscopic forces may hold what they count.
    """

    scene: CompiledScene
    t: float
    x: FloatArray
    v: FloatArray
    multipliers: FloatArray
    interiors: Kept = NOTHING_KEPT
    unstable: int | None = None

    def beta(self, connection: Connection) -> FloatArray:
        """Joint coordinates, () where there is one, else (k,); rad or m."""
        values = self.x[self.scene.index.coordinates(connection).x]
        return values[0] if len(values) == 1 else values.copy()

    def q(self, body: FlexibleBody | PseudoRigidBody) -> FloatArray:
        """(n,) modal coordinates of a body."""
        return self.x[self.scene.index.modal(body).x].copy()

    def position(self, frame: Frame) -> FloatArray:
        """(3,) m, of the frame's origin in inertial axes."""
        return frame_motion(self.scene, frame, self.x, self.v)[:3]

    def rotation(self, frame: Frame) -> FloatArray:
        """(3, 3) rotation from the frame's axes to inertial ones."""
        return frame_motion(self.scene, frame, self.x, self.v)[3:12].reshape(3, 3)


def frame_motion(scene: CompiledScene, frame: Frame, x: FloatArray, v: FloatArray) -> FloatArray:
    """(21,) a row of ``kernels.series.frame_series`` at configuration x (nx,) and velocities v (nv,)."""
    plan = add_probe(scene, frame)
    out = np.zeros((1, 21))
    frame_series(plan, new_work(plan), len(plan.frames) - 1, x[None], v[None], np.zeros((1, scene.nv)), out)
    return out[0]
