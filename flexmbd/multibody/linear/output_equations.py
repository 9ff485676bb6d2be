"""Outputs of a linearised machine and their derivatives."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import SceneError
from flexmbd.multibody.bodies.body import FlexibleBody, Frame
from flexmbd.multibody.bodies.port import StrainFlow
from flexmbd.multibody.bodies.pseudo_rigid_body import PseudoRigidBody
from flexmbd.multibody.joint.connection import Connection
from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.kernels.reading.constraint_tables import three_rows
from flexmbd.multibody.kernels.reading.force_tables import without_loads
from flexmbd.multibody.kernels.reading.tree import with_frame
from flexmbd.multibody.linear.derivatives import derive
from flexmbd.multibody.linear.working_point import frame_motion
from flexmbd.multibody.motion.quantity import ORDERS, LinearOutput, Rotation
from flexmbd.multibody.plan.compiled_scene import CompiledScene, add_probe
from flexmbd.multibody.plan.scene_matrices import coordinate_sizes

FloatArray = NDArray[np.float64]

@dataclass(frozen=True, eq=False)
class OutputDerivatives:
    """Derivatives of an output: it is L xi, or L dv + G xi, or the rate of that.

    Attributes:
        names: (k,).
        order: 0 for a place, 1 for a velocity, 2 for an acceleration.
        L, G: (k, nv).
    """

    names: tuple[str, ...]
    order: int
    L: FloatArray
    G: FloatArray

    def extended(self, added: int) -> OutputDerivatives:
        """The same for a machine with further coordinates, on which it does not depend."""
        return replace(self, L=np.pad(self.L, ((0, 0), (0, added))), G=np.pad(self.G, ((0, 0), (0, added))))


def output_derivatives(scene: CompiledScene, x: FloatArray, v: FloatArray, output: LinearOutput) -> OutputDerivatives:
    """Derivatives of an output at configuration x (nx,) and velocities v (nv,).

    Raises:
        SceneError: it is not in the scene, has no coordinates there, or is not an output.
    """
    if isinstance(output, StrainFlow):
        slots = scene.index.modal(output.port.body)
        port, unit = output.port, np.eye(scene.nv)[slots.v]
        changing = np.zeros(len(unit)) if port.second is None else port.second @ v[slots.v]
        L, G = (row[None] @ unit for row in (port.slope(x[slots.x]), changing))
        return OutputDerivatives((output.label,), output.order, L, G)
    if type(output) not in ORDERS:
        raise SceneError(
            f"{output!r} is not an output; give fm.output.Position, Velocity or Acceleration of a frame, a joint or a "
            "flexible body, or fm.output.Rotation of a frame"
        )
    order, of = ORDERS[type(output)], output.of
    kind = type(output).__name__.lower()
    if isinstance(of, Frame):
        L, G = _frame_slopes(scene, x, v, of, turns=isinstance(output, Rotation))
        return OutputDerivatives(tuple(f"{kind} {axis} of {of.label}" for axis in "xyz"), order, L, G)
    if isinstance(output, Rotation) or not isinstance(of, Connection | FlexibleBody | PseudoRigidBody):
        raise SceneError(f"an output {type(output).__name__} of {of!r}: there is none; give a frame")
    slots = (scene.index.joints.get(of) if isinstance(of, Connection) else scene.index.modes.get(of))
    if slots is None:
        raise SceneError(
            f"an output of {of.name!r}: it has no coordinates in this scene, as a joint held by constraints or one of "
            "another scene; give the positions of frames"
        )
    L = np.eye(scene.nv)[slots.v]
    names = tuple(f"{kind} of {name}" for name in scene.velocity_names[slots.v])
    return OutputDerivatives(names, order, L, np.zeros_like(L))


def _frame_slopes(
    scene: CompiledScene, x: FloatArray, v: FloatArray, frame: Frame, *, turns: bool
) -> tuple[FloatArray, FloatArray]:
    """L and G (3, nv), as those of constraint rows between the frame and one of the ground where it stands now."""
    motion = frame_motion(scene, frame, x, v)
    plan = add_probe(scene, frame)
    g = len(plan.frames) - 1
    kind = kinds.ROW_AXIS if turns else kinds.ROW_TRANSLATION
    plan = with_frame(without_loads(plan), -1, motion[:3], motion[3:12] if turns else np.eye(3))
    plan = plan.replace(rows=three_rows(g + 1, g, kind))
    found = derive(plan, new_work(plan), x, v, np.zeros(3), size=coordinate_sizes(scene))
    return found.jacobian, found.rate_slope
