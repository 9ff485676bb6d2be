"""Coordinates and velocities that the user gave joints held by constraints: how far a state is from them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import SceneError
from flexmbd.multibody.joint.connection import Connection, motion_name
from flexmbd.multibody.joint.pose import joint_state
from flexmbd.multibody.joint.protocol import Joint
from flexmbd.multibody.kernels.algebra.so3 import rotation_vector
from flexmbd.multibody.kernels.base.arrays import Work
from flexmbd.multibody.kernels.inverse_dynamics.closure import relative_motion
from flexmbd.multibody.kernels.inverse_dynamics.recursion import forward_kinematics
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.rotation import z_onto
from flexmbd.round_off import SAME_PLACE

FloatArray = NDArray[np.float64]



@dataclass(frozen=True)
class GivenCoordinates:
    """Joints held by constraints whose coordinates or velocities the user gave, each as a row a coordinate.

    Attributes:
        positions, velocities: the joints.
    """

    positions: tuple[Connection, ...]
    velocities: tuple[Connection, ...]

    def position_gaps(self, scene: CompiledScene, work: Work, x: FloatArray) -> FloatArray:
        """(k,) m or rad: coordinates of the joints at configuration x (nx,), less those given."""
        forward_kinematics(scene.plan, work, x, np.zeros(scene.nv), np.zeros(scene.nv))
        gaps = [np.zeros(0)]
        for connection in self.positions:
            joint = connection.joint
            rest = np.zeros(len(joint.velocity_names))
            p_given, R_given, _, _ = joint_state(joint, np.asarray(scene.index.now(connection).position), rest)
            p, R = _relative(scene, work, connection)
            turned = rotation_vector(tuple((R @ R_given.T).ravel()))
            gaps.append(_measure(joint, R) @ np.concatenate([p - p_given, turned]))
        return np.concatenate(gaps)

    def velocity_gaps(self, scene: CompiledScene, work: Work, x: FloatArray, v: FloatArray) -> FloatArray:
        """(k,) m/s or rad/s: velocities of the joints at (x (nx,), v (nv,)), less those given."""
        wanted = [np.zeros(0), *(np.asarray(scene.index.now(c).velocity) for c in self.velocities)]
        return _rates(scene, work, x, v[None], self.velocities)[0] - np.concatenate(wanted)

    def position_slopes(self, scene: CompiledScene, work: Work, x: FloatArray) -> FloatArray:
        """(k, nv) rates of ``position_gaps`` per unit of each velocity."""
        return _slopes(scene, work, x, self.positions)

    def velocity_slopes(self, scene: CompiledScene, work: Work, x: FloatArray) -> FloatArray:
        """(k, nv) ``velocity_gaps`` per unit of each velocity."""
        return _slopes(scene, work, x, self.velocities)

    def position_sizes(self, scene: CompiledScene) -> FloatArray:
        """(k,) 1 rad or the machine's extent (m), of the rows of ``position_gaps``."""
        return _sizes(scene, self.positions)

    def velocity_sizes(self, scene: CompiledScene) -> FloatArray:
        """(k,) 1 rad or the machine's extent (m), of the rows of ``velocity_gaps``."""
        return _sizes(scene, self.velocities)


#: No coordinates or velocities were given to such joints.
NOTHING_GIVEN = GivenCoordinates((), ())


def coordinates_given(scene: CompiledScene) -> GivenCoordinates:
    """Coordinates and velocities given to the scene's joints held by constraints."""
    held = [c for c in scene.topology.closures if c.joint.steps]
    return GivenCoordinates(
        tuple(c for c in held if c.position is not None), tuple(c for c in held if c.velocity is not None)
    )


def refuse_against_motions(scene: CompiledScene, work: Work, connections: Sequence[Connection]) -> None:
    """Refuse positions and velocities of prescribed joints that are not those of the motion.

    Raises:
        SceneError: the first that contradicts its motion at the time of ``work``.
    """
    for connection in connections:
        if connection.motion is None:
            continue
        values = work.time[scene.time_names.index(motion_name(connection))]
        size = _sizes(scene, [connection])[0]
        now = scene.index.now(connection)
        for k, (what, given) in enumerate((("position", now.position), ("velocity", now.velocity))):
            if given is None or abs(given[0] - values[k]) <= SAME_PLACE * max(size, abs(values[k])):
                continue
            raise SceneError(
                f"joint {connection.name!r}: its {what} was set to {given[0]:.9g}, but its prescribed motion starts "
                f"at {values[k]:.9g}; a prescribed joint is where its motion has it, so leave out the {what}, "
                "or set it to None"
            )


def coordinate_names(connections: Sequence[Connection]) -> list[str]:
    """Names of the coordinates of joints, row by row."""
    return [f"{c.name}.{part}" for c in connections for part in c.joint.velocity_names]


def _sizes(scene: CompiledScene, joints: Sequence[Connection]) -> FloatArray:
    return np.array([1.0 if angular else scene.extent for c in joints for angular in c.joint.angular])


def _slopes(scene: CompiledScene, work: Work, x: FloatArray, joints: Sequence[Connection]) -> FloatArray:
    if not joints:
        return np.zeros((0, scene.nv))
    rest, *columns = _rates(scene, work, x, np.vstack([np.zeros(scene.nv), np.eye(scene.nv)]), joints)
    return (np.array(columns).reshape(scene.nv, len(rest)) - rest).T


def _rates(
    scene: CompiledScene, work: Work, x: FloatArray, velocities: FloatArray, joints: Sequence[Connection]
) -> FloatArray:
    """(n, k) velocities of joints by each of the machine's velocities (n, nv)."""
    ends = [scene.index.closures[connection] for connection in joints]
    twists, turns = np.zeros((len(joints), len(velocities), 6)), np.zeros((len(joints), 3, 3))
    for i, v in enumerate(velocities):
        forward_kinematics(scene.plan, work, x, v, np.zeros(scene.nv))
        for k, frames in enumerate(ends):
            _, turns[k].flat[:], rate, spin, _, _ = relative_motion(scene.plan, work, *frames)
            twists[k, i] = *rate, *spin
    parts = [twist @ _measure(one.joint, R).T for one, twist, R in zip(joints, twists, turns, strict=True)]
    return np.hstack([np.zeros((len(velocities), 0)), *parts])


def _relative(scene: CompiledScene, work: Work, connection: Connection) -> tuple[FloatArray, FloatArray]:
    """p_FG_F and R_FG of the turned frames."""
    p, R, *_ = relative_motion(scene.plan, work, *scene.index.closures[connection])
    return np.array(p), np.reshape(R, (3, 3))


def _measure(joint: Joint, R: FloatArray) -> FloatArray:
    """(k, 6) matrix that gives the velocities of a joint whose constraints hold from (rate, spin) in F's axes.

    ``R`` is R_FG.
    """
    rows: list[FloatArray] = [np.zeros((0, 6))]
    turns = iter(_turn_rates(joint, R))
    for step in joint.steps:
        turn = z_onto(step.axis)
        for column in step.pair.numbers:
            slide = turn @ column[1:]
            # what slides is told by how far: of a screw that counts its turns as well
            seen = [slide / (slide @ slide), np.zeros(3)] if slide.any() else [np.zeros(3), next(turns) / column[0]]
            rows.append(np.concatenate(seen)[None])
        if step.pair.ball:
            rows.append(np.hstack([np.zeros((3, 3)), turn.T @ R.T]))
    return np.concatenate(rows)


def _turn_rates(joint: Joint, R: FloatArray) -> FloatArray:
    """(h, 3) rates of a joint's turns per unit of angular velocity in F's axes, where ``R`` is R_FG.

    The first turns about an axis fixed in F, the last about one fixed in G, and one between about what is at right
    angles to both, as where three turns follow each other about axes at right angles.
    """
    own = [z_onto(s.axis)[:, 2] for s in joint.steps for c in s.pair.numbers if c[0] != 0.0 and not c[1:].any()]
    if len(own) < 2:
        return np.reshape(own, (-1, 3))
    if len(own) != 3:
        return np.array([*own[:-1], R @ own[-1]])
    first, last = own[0], R @ own[2]
    across = np.cross(last, first)
    across *= np.sign(own[1] @ np.cross(own[2], own[0])) / np.linalg.norm(across)
    return np.linalg.pinv(np.column_stack([first, across, last]))
