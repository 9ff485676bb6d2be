"""A consistent start: loops closed, velocities on the loops, accelerations and reactions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from flexmbd.errors import AssemblyError
from flexmbd.multibody.connection import Connection
from flexmbd.multibody.kernels import layout as at
from flexmbd.multibody.kernels.closure import constraints
from flexmbd.multibody.kernels.joints import joint_pose, retract
from flexmbd.multibody.kernels.layout import Work, without_forces
from flexmbd.multibody.kernels.recursion import forward, frame_motion
from flexmbd.multibody.kernels.residual import drive, residual
from flexmbd.multibody.kernels.series import constraint_matrix
from flexmbd.multibody.plan import CompiledScene
from flexmbd.rotation import to_quaternion

FloatArray = NDArray[np.float64]
Mask = NDArray[np.bool_]

# A loop counts as closed when it stays open by no more than this share of the machine's extent,
# as where the frames of an overconstrained loop come from a mesh; it closes further if it can.
_CLOSED = 1e-7
_ROUND_OFF = 1e-14
_ITERATIONS = 50


@dataclass(frozen=True, eq=False)
class Start:
    """The consistent start.

    Attributes:
        scene: the scene without its redundant constraint rows.
        unreduced: the scene with them.
        x, v, a: (nx,), (nv,), (nv,) configuration, velocity, acceleration.
        multipliers: (m,) reactions of the loops (N or N m).
        moved: what the projection changed: (coordinate, from, to), positions and velocities.
        residual: largest constraint residual after the projection (m or rad).
    """

    scene: CompiledScene
    unreduced: CompiledScene
    x: FloatArray
    v: FloatArray
    a: FloatArray
    multipliers: FloatArray
    moved: tuple[tuple[str, float, float], ...]
    residual: float


def consistent_start(
    scene: CompiledScene, work: Work, x: FloatArray, v: FloatArray, *, held_x: Mask, held_v: Mask
) -> Start:
    """Project a user's start onto the loops and solve for accelerations and reactions.

    Coordinates that the user set (``held``) stay where the others can close the loops alone;
    modal coordinates move only where the joints cannot.

    Args:
        scene: the scene with all its constraint rows.
        work: scratch; ``work.time`` holds the functions of time at the start.
        x: (nx,) wanted configuration.
        v: (nv,) wanted velocity.
        held_x: (nv,) tangent directions of coordinates set by the user.
        held_v: (nv,) velocities set by the user.

    Raises:
        AssemblyError: no configuration closes the loops, or they contradict each other.
    """
    x, v = x.copy(), v.copy()
    drive(scene.plan, work, x, v, np.zeros(scene.nv))
    _place_flying(scene, work, x)
    closed, moved = _close_loops(scene, work, x, held_x)
    _refuse_turned_over(scene, work, closed)
    kept = _independent_rows(scene, work, closed)
    reduced = scene.keep_rows(kept)
    # without the redundant rows, which may stay open a little, the others close to round-off
    closed, moved_on = _close_loops(reduced, work, closed, held_x)
    moved += moved_on
    velocity, moved_v = _match_velocities(scene, work, closed, v, held_v)
    a, multipliers = _accelerations(reduced, work, closed, velocity)
    phi = constraint_values(scene, work, closed, velocity)[0]
    return Start(
        reduced,
        scene,
        closed,
        velocity,
        a,
        multipliers,
        tuple(moved + moved_v),
        float(np.abs(phi).max(initial=0.0)),
    )


def _place_flying(scene: CompiledScene, work: Work, x: FloatArray) -> None:
    """Put each body that only loops hold where the first of its joints wants it."""
    plan, zero = scene.plan, np.zeros(scene.nv)
    for row, branch in enumerate(scene.topology.branches):
        if branch.connection is not None:
            continue
        for f, g, connection in _closure_frames(scene):
            ends = (plan.frame_of[f, at.FRAME_BODY], plan.frame_of[g, at.FRAME_BODY])
            if row in ends and min(ends) < row == max(ends):
                forward(plan, work, x, zero, zero)
                o = int(plan.tree[row, at.JOINT_X])
                x[o : o + 7] = _pose_by_joint(scene, work, connection, f, g, flies=row == ends[1])
                break


def _closure_frames(scene: CompiledScene) -> list[tuple[int, int, Connection]]:
    """(row of F, row of G, joint) of each loop closure."""
    found = dict.fromkeys(
        (int(row[at.ROW_F]), int(row[at.ROW_G]), connection)
        for row, connection in zip(scene.plan.rows, scene.row_connections, strict=True)
    )
    return list(found)


def _world_pose(scene: CompiledScene, work: Work, f: int) -> tuple[FloatArray, FloatArray]:
    p, R, *_ = frame_motion(scene.plan, work, f)
    return np.array(p), np.array(R).reshape(3, 3)


def _pose_by_joint(
    scene: CompiledScene, work: Work, connection: Connection, f: int, g: int, *, flies: bool
) -> FloatArray:
    """Position and quaternion (7,) of the flying body that puts G on F as the joint says.

    ``flies``: the flying body carries G; else it carries F.
    """
    joint = connection.joint
    coordinates = joint.start if connection.position is None else connection.position
    p, R = joint_pose(joint.kind, 0.0, np.array([*coordinates, 0.0]), 0)
    p_FG, R_FG = np.array(p), np.array(R).reshape(3, 3)
    row = work.frame[g if flies else f]
    p_B, R_B = row[at.F_P : at.F_P + 3], row[at.F_R : at.F_R + 9].reshape(3, 3)
    p_held, R_held = _world_pose(scene, work, f if flies else g)
    R_W = R_held @ (R_FG if flies else R_FG.T)
    p_W = p_held + (R_held @ p_FG if flies else -R_W @ p_FG)
    R_WB = R_W @ R_B.T
    return np.concatenate([p_W - R_WB @ p_B, to_quaternion(R_WB)])


def _refuse_turned_over(scene: CompiledScene, work: Work, x: FloatArray) -> None:
    """Raise AssemblyError where a loop closed with its axes opposed instead of aligned."""
    forward(scene.plan, work, x, np.zeros(scene.nv), np.zeros(scene.nv))
    for f, g, connection in _closure_frames(scene):
        kinds = {kind for kind, _, _ in connection.joint.rows}
        R_FG = _world_pose(scene, work, f)[1].T @ _world_pose(scene, work, g)[1]
        opposed = (at.ROW_DIRECTION in kinds and R_FG[2, 2] < 0.0) or (
            at.ROW_AXIS in kinds and np.trace(R_FG) < 1.0
        )
        if opposed:
            raise AssemblyError(
                f"joint {connection.name!r} can be closed only turned over from this start; set "
                "the positions of the joints along the loop nearer to the assembly that is meant"
            )


def constraint_values(
    scene: CompiledScene, work: Work, x: FloatArray, v: FloatArray, a: FloatArray | None = None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Residuals (m,) of all rows and their first and second time derivatives."""
    m = len(scene.plan.rows)
    values = np.zeros((3, m))
    forward(scene.plan, work, x, v, np.zeros(scene.nv) if a is None else a)
    constraints(scene.plan, work, *values)
    return values[0], values[1], values[2]


def constraint_jacobian(scene: CompiledScene, work: Work, x: FloatArray) -> FloatArray:
    """C (m, nv): rates of the rows per unit of each velocity."""
    m = len(scene.plan.rows)
    jacobian = np.zeros((m, scene.nv))
    unit, rest = np.zeros((2, scene.nv))
    constraint_matrix(scene.plan, work, x, unit, rest, np.zeros((4, m)), jacobian)
    return jacobian


def mass_matrix(scene: CompiledScene, work: Work, x: FloatArray) -> FloatArray:
    """M (nv, nv) of the tree at configuration x, without its loops."""
    plan = without_forces(scene.plan)
    rest = np.zeros(scene.nv)
    none = np.zeros(len(plan.rows))
    offset, column = np.zeros(scene.nv), np.zeros(scene.nv)
    residual(plan, work, x, rest, rest, none, offset)
    matrix = np.zeros((scene.nv, scene.nv))
    for k, unit in enumerate(np.eye(scene.nv)):
        residual(plan, work, x, rest, unit, none, column)
        matrix[:, k] = column - offset
    return 0.5 * (matrix + matrix.T)


def _stages(scene: CompiledScene, held: Mask) -> list[Mask]:
    """Which coordinates may move, least intrusive first."""
    movable = np.zeros(scene.nv, bool)
    movable[scene.plan.free] = True
    modal = np.zeros(scene.nv, bool)
    for slots in scene.modal_slots.values():
        modal[slots.v] = True
    stages = [movable & ~held & ~modal, movable & ~held, movable & ~modal, movable]
    return [s for k, s in enumerate(stages) if s.any() and not any((s == t).all() for t in stages[:k])]


def _close_loops(
    scene: CompiledScene, work: Work, x: FloatArray, held: Mask
) -> tuple[FloatArray, list[tuple[str, float, float]]]:
    """Close the loops by the first stage that closes them to round-off, else by the best one."""
    if len(scene.plan.rows) == 0:
        return x, []
    best_x: FloatArray = x
    best_total: FloatArray = np.zeros(scene.nv)
    best = constraint_values(scene, work, x, best_total)[0]
    for movable in _stages(scene, held):
        trial, total, phi = _gauss_newton(scene, work, x, movable)
        if np.abs(phi).max() < 0.1 * np.abs(best).max():  # less intrusive stages have preference
            best_x, best_total, best = trial, total, phi
        if np.abs(best).max() <= _ROUND_OFF * scene.extent:
            break
    worst = int(np.argmax(np.abs(best)))
    if abs(best[worst]) > _CLOSED * scene.extent:
        raise AssemblyError(
            f"the mechanism cannot be assembled: {scene.row_names[worst]} stays open by "
            f"{abs(best[worst]):.3e} (m or rad); check lengths, frames and the joint positions set"
        )
    changed = np.flatnonzero(np.abs(best_total) > _CLOSED * scene.extent)
    return best_x, [(scene.velocity_names[k], 0.0, float(best_total[k])) for k in changed]


def _gauss_newton(
    scene: CompiledScene, work: Work, x: FloatArray, movable: Mask
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Move some coordinates until the loops close no further: configuration, move, residuals."""
    rest: FloatArray = np.zeros(scene.nv)
    trial, total = x, rest
    phi = constraint_values(scene, work, trial, rest)[0]
    for _ in range(_ITERATIONS):
        jacobian = constraint_jacobian(scene, work, trial)[:, movable]
        step = np.zeros(scene.nv)
        step[movable] = -scipy.linalg.lstsq(jacobian, phi, cond=1e-10)[0]
        step *= min(1.0, 0.5 / max(np.abs(step).max(), 1e-300))
        moved = np.empty_like(trial)
        retract(scene.plan, trial, step, moved)
        left = constraint_values(scene, work, moved, rest)[0]
        settled = np.abs(phi).max() <= _CLOSED * scene.extent
        if settled and np.abs(left).max() >= 0.1 * np.abs(phi).max():
            break
        trial, total, phi = moved, total + step, left
    return trial, total, phi


def _scaled_jacobian(scene: CompiledScene, work: Work, x: FloatArray) -> FloatArray:
    """C on the free coordinates, per unit of kinetic energy, rows over the largest of them."""
    free = scene.plan.free
    jacobian = constraint_jacobian(scene, work, x)[:, free]
    mass = mass_matrix(scene, work, x)[np.ix_(free, free)]
    lower = np.linalg.cholesky(mass)
    return scipy.linalg.solve_triangular(lower, jacobian.T, lower=True).T


def _independent_rows(scene: CompiledScene, work: Work, x: FloatArray) -> Sequence[int]:
    """Rows that constrain anything new, by a rank-revealing factorisation.

    Redundancy is a property of the mechanism, not of one singular position: the rank is taken
    where it is largest among the start and two positions near it on the loops.
    """
    m = len(scene.plan.rows)
    if m == 0 or len(scene.plan.free) == 0:
        return range(m)
    places = [x]
    generator = np.random.default_rng(0)
    for _ in range(2):
        step = np.zeros(scene.nv)
        joint = [k for slots in scene.joint_slots.values() for k in range(slots.v.start, slots.v.stop)]
        step[joint] = 0.05 * generator.standard_normal(len(joint))
        step[scene.plan.driven[:, at.DRIVEN_V]] = 0.0
        near = np.empty_like(x)
        retract(scene.plan, x, step, near)
        try:
            places.append(_close_loops(scene, work, near, np.zeros(scene.nv, bool))[0])
        except AssemblyError:
            continue
    kept: Sequence[int] = ()
    for place in places:
        scaled = _scaled_jacobian(scene, work, place)
        norms = np.linalg.norm(scaled, axis=1)
        _, r, order = scipy.linalg.qr(scaled.T / max(norms.max(), 1e-300), mode="economic", pivoting=True)
        rank = int(np.sum(np.abs(np.diag(r)) > 1e-8))
        if rank > len(kept):
            kept = order[:rank]
    return [int(k) for k in kept]


def _match_velocities(
    scene: CompiledScene, work: Work, x: FloatArray, v: FloatArray, held: Mask
) -> tuple[FloatArray, list[tuple[str, float, float]]]:
    """The velocity nearest to v that keeps the loops closed."""
    if len(scene.plan.rows) == 0:
        return v, []
    jacobian = constraint_jacobian(scene, work, x)
    gap = constraint_values(scene, work, x, v)[1]
    scale = max(1.0, float(np.abs(v).max(initial=0.0)))
    left = gap
    if np.abs(gap).max() <= 1e-13 * scale:
        return v, []
    for movable in _stages(scene, held):
        step = np.zeros(scene.nv)
        step[movable] = -scipy.linalg.lstsq(jacobian[:, movable], gap, cond=1e-10)[0]
        left = gap + jacobian @ step
        if np.abs(left).max() <= 1e-9 * scale:
            changes = [
                (f"rate of {scene.velocity_names[k]}", float(v[k]), float(v[k] + step[k]))
                for k in np.flatnonzero(np.abs(step) > 1e-12 * scale)
            ]
            return v + step, changes
    worst = int(np.argmax(np.abs(left)))
    raise AssemblyError(
        f"the start's velocities contradict the loops: {scene.row_names[worst]} opens at "
        f"{abs(left[worst]):.3e} (m/s or rad/s); check prescribed motions and joint velocities"
    )


def match_motion(
    scene: CompiledScene, work: Work, x: FloatArray, v: FloatArray, *, held: Mask
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Velocities near v that keep the loops closed, with accelerations and multipliers.

    Args:
        scene: without redundant rows.
        work: scratch; ``work.time`` holds the functions of time at the instant.
        x: (nx,) configuration, loops closed.
        v: (nv,) wanted velocities.
        held: (nv,) those that stay where the others can follow.

    Raises:
        AssemblyError: the velocities contradict the loops.
    """
    velocity = v.copy()
    drive(scene.plan, work, x.copy(), velocity, np.zeros(scene.nv))
    velocity, _ = _match_velocities(scene, work, x, velocity, held)
    a, multipliers = _accelerations(scene, work, x, velocity)
    return velocity, a, multipliers


def _accelerations(
    scene: CompiledScene, work: Work, x: FloatArray, v: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Accelerations and multipliers from M a + C^T nu = f, C a = -gamma.

    Source: Ambrosio & Nikravesh 1992, eq. 76-77.
    """
    plan, free = scene.plan, scene.plan.free
    m = len(plan.rows)
    a = np.zeros(scene.nv)
    drive(plan, work, x, v, a)
    force = np.zeros(scene.nv)
    residual(plan, work, x, v, a, np.zeros(m), force)
    lower = np.linalg.cholesky(mass_matrix(scene, work, x)[np.ix_(free, free)])
    scaled: FloatArray = scipy.linalg.solve_triangular(lower, -force[free], lower=True)
    multipliers: FloatArray = np.zeros(m)
    if m and len(free):
        gamma = constraint_values(scene, work, x, v, a)[2]
        jacobian = scipy.linalg.solve_triangular(
            lower, constraint_jacobian(scene, work, x)[:, free].T, lower=True
        ).T
        right = jacobian @ scaled + gamma
        multipliers = scipy.linalg.lstsq(jacobian @ jacobian.T, right, cond=1e-13)[0]
        scaled = scaled - jacobian.T @ multipliers
    a[free] = scipy.linalg.solve_triangular(lower, scaled, lower=True, trans="T")
    return a, multipliers
