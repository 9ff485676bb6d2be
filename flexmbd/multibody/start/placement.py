"""Where bodies that only constraints hold start: as one of their joints says."""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

from flexmbd.errors import AssemblyError
from flexmbd.multibody.bodies.continuum_body import InteriorFrame
from flexmbd.multibody.joint.connection import Connection
from flexmbd.multibody.joint.pose import joint_state
from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base.arrays import Work
from flexmbd.multibody.kernels.inverse_dynamics.recursion import forward_kinematics
from flexmbd.multibody.kernels.reading.constraint_tables import constraint_rows, penalty_rows
from flexmbd.multibody.kernels.reading.evaluated_motion import body_motion, frame_in_body, world_motion
from flexmbd.multibody.kernels.reading.tree import tree_joint
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.rotation import to_quaternion

FloatArray = NDArray[np.float64]


def placing_joints(scene: CompiledScene) -> dict[int, Connection]:
    """The joint that says where each body that only constraints hold starts, by the body's row.

    Of the joints that lead to bodies placed before, it is the first whose position, velocity or motion the
    user set, else the first that has coordinates, else the first.
    """
    found: dict[int, Connection] = {}
    for branch in scene.topology.branches:
        if branch.connection is not None:
            continue
        row = scene.index.bodies[branch.outer.body]
        candidates: list[tuple[int, int, Connection]] = []
        for c in scene.topology.closures:
            ends = (scene.index.bodies[c.parent.body], scene.index.bodies[c.child.body])
            if row in ends and min(ends) < row == max(ends):
                unset = c.position is None and c.velocity is None and c.motion is None
                candidates.append((2 * unset + (not c.joint.steps), len(candidates), c))
        if candidates:
            found[row] = min(candidates)[2]
    return found


def place_flying(scene: CompiledScene, work: Work, x: FloatArray, v: FloatArray) -> None:
    """Put each body that only constraints hold where its placing joint wants it, moving as that says.

    An interface frame of a body with history goes where the body has it, by a frame of it placed before.
    """
    plan, zero = scene.plan, np.zeros(scene.nv)
    joints = placing_joints(scene)
    mates = _placing_mates(scene)
    for row in sorted({*joints, *mates}):
        forward_kinematics(plan, work, x, v, zero)
        flight = tree_joint(plan, row)
        if row in mates:
            x[flight.x], v[flight.v] = _state_by_mate(work, *mates[row])
            continue
        connection = joints[row]
        flies = scene.index.bodies[connection.child.body] == row
        place, motion = _state_by_joint(scene, work, connection, flies=flies)
        x[flight.x], v[flight.v] = place[: flight.x.stop - flight.x.start], motion[: flight.v.stop - flight.v.start]


def follow_mates(scene: CompiledScene, work: Work, x: FloatArray, step: FloatArray, moved: FloatArray) -> None:
    """Let flying parts of bodies with history follow the finite turns of the parts that they were placed by.

    A step turns a body as a whole; by straight lines that would stretch it.

    Args:
        scene: compiled.
        work: scratch.
        x: (nx,) before the step.
        step: (nv,).
        moved: (nx,) after it, changed in place: what a part moves against its mate is added to the mate's motion.
    """
    plan, zero = scene.plan, np.zeros(scene.nv)
    mates = _placing_mates(scene)
    for row in sorted(mates):
        forward_kinematics(plan, work, x, step, zero)
        p, R, shift, turn = body_motion(work, mates[row][0])
        p_own, R_own, shift_own, turn_own = body_motion(work, row)
        forward_kinematics(plan, work, moved, zero, zero)
        p_moved, R_moved, *_ = body_motion(work, mates[row][0])
        arm, swing = p_own - p, R_moved @ R.T
        bent = scipy.linalg.expm(np.cross(np.eye(3), turn_own - turn))
        place = p_moved + swing @ (arm + shift_own - shift - np.cross(turn, arm))
        moved[tree_joint(plan, row).x] = np.concatenate([place, to_quaternion(swing @ bent @ R_own)])


def _placing_mates(scene: CompiledScene) -> dict[int, tuple[int, InteriorFrame, InteriorFrame]]:
    """By rows of flying parts of bodies with history: the row of a part placed before, both interface frames."""
    found: dict[int, tuple[int, InteriorFrame, InteriorFrame]] = {}
    flying = {scene.index.bodies[b.outer.body] for b in scene.topology.branches if b.connection is None}
    for body in scene.interiors.bodies if scene.interiors is not None else ():
        pairs = zip(body.interior.frames, body.parts, strict=True)
        placed = ((scene.index.bodies[part], frame) for frame, part in pairs)
        (first, mate), *others = sorted(placed, key=lambda one: one[0])
        found.update({row: (first, mate, frame) for row, frame in others if row in flying})
    return found


def _state_by_mate(
    work: Work, row: int, mate: InteriorFrame, frame: InteriorFrame
) -> tuple[FloatArray, FloatArray]:
    """Coordinates (7,) and velocities (6,) of a flying part that moves with another as one rigid body."""
    p, R_WI, v, spin = body_motion(work, row)
    R_WB = R_WI @ mate.R_BI.T
    arm = R_WB @ (frame.p_BI_B - mate.p_BI_B)
    R = R_WB @ frame.R_BI
    return np.concatenate([p + arm, to_quaternion(R)]), np.concatenate([v + np.cross(spin, arm), R.T @ spin])


def _state_by_joint(
    scene: CompiledScene, work: Work, connection: Connection, *, flies: bool
) -> tuple[FloatArray, FloatArray]:
    """Coordinates (7,) and velocities (6,) of the flying body that put G against F as the joint says.

    ``flies``: the flying body carries G; else it carries F.
    """
    joint = connection.joint
    now = scene.index.now(connection)
    position = np.array(joint.start) if now.position is None else now.position
    velocity = np.zeros(len(joint.velocity_names)) if now.velocity is None else now.velocity
    f, g = scene.index.closures[connection]
    if connection.motion is not None:
        held = (constraint_rows(scene.plan), penalty_rows(scene.plan))
        times = np.concatenate([rows.time[rows.between(f, g) & (rows.time >= 0)] for rows in held])
        position, velocity = np.split(work.time[times[0], :2], 2)
    p, R, rate, spin = joint_state(joint, position, velocity)
    p_held, R_held, v_held, w_held = world_motion(scene.plan, work, f if flies else g)
    R_WF = R_held if flies else R_held @ R.T
    p, rate, spin = R_WF @ p, R_WF @ rate, R_WF @ spin
    if flies:
        R_W, p_W, w = R_held @ R, p_held + p, w_held + spin
        v = v_held + np.cross(w_held, p) + rate
    else:
        R_W, p_W, w = R_WF, p_held - p, w_held - spin
        v = v_held - np.cross(w, p) - rate
    p_BF, R_BF = frame_in_body(work, g if flies else f)
    R_WB = R_W @ R_BF.T
    arm = R_WB @ p_BF
    x = np.concatenate([p_W - arm, to_quaternion(R_WB)])
    return x, np.concatenate([v - np.cross(w, arm), R_WB.T @ w])


def refuse_turned_over(scene: CompiledScene, work: Work, x: FloatArray) -> None:
    """Raise AssemblyError where a loop closed with its axes opposed instead of aligned."""
    if not scene.topology.closures:
        return
    forward_kinematics(scene.plan, work, x, np.zeros(scene.nv), np.zeros(scene.nv))
    for connection in scene.topology.closures:
        rows = connection.rows
        f, g = scene.index.closures[connection]
        R_FG = world_motion(scene.plan, work, f).R.T @ world_motion(scene.plan, work, g).R
        across = {row.index for row in rows if row.kind == kinds.ROW_DIRECTION}
        aligned = [k for k in range(3) if {3 * i + k for i in range(3) if i != k} <= across]  # axis k of G along F's
        opposed = any(R_FG[k, k] < 0.0 for k in aligned) or (
            any(row.kind == kinds.ROW_AXIS for row in rows) and np.trace(R_FG) < 1.0
        )
        if opposed:
            raise AssemblyError(
                f"joint {connection.name!r} can be closed only turned over from this start; set "
                "the positions of the joints along the loop nearer to the assembly that is meant"
            )
