"""A consistent start: loops closed, velocities on the loops, accelerations and reactions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from flexmbd.errors import AssemblyError
from flexmbd.multibody.connection import Connection
from flexmbd.multibody.joint.protocol import ALIGNED
from flexmbd.multibody.kernels import layout as at
from flexmbd.multibody.kernels.closure import constraints
from flexmbd.multibody.kernels.joints import retract
from flexmbd.multibody.kernels.layout import Work, without_forces
from flexmbd.multibody.kernels.recursion import forward, frame_motion
from flexmbd.multibody.kernels.residual import drive, residual
from flexmbd.multibody.kernels.series import constraint_matrix
from flexmbd.multibody.plan import CompiledScene
from flexmbd.multibody.pose import joint_state
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
    _place_flying(scene, work, x, v)
    scene = _set_couplings(scene, work, x, held_x)
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


def placing_joints(scene: CompiledScene) -> dict[int, Connection]:
    """The joint that says where each body that only constraints hold starts, by the body's row.

    Of the joints that lead to bodies placed before, it is the first whose position or velocity the
    user set, else the first that has coordinates, else the first.
    """
    found: dict[int, Connection] = {}
    for branch in scene.topology.branches:
        if branch.connection is not None:
            continue
        row = scene.body_row[id(branch.outer.body)]
        candidates: list[tuple[int, int, Connection]] = []
        for c in scene.topology.closures:
            ends = (scene.body_row[id(c.parent.body)], scene.body_row[id(c.child.body)])
            if row in ends and min(ends) < row == max(ends):
                unset = c.position is None and c.velocity is None
                candidates.append((2 * unset + (not c.joint.steps), len(candidates), c))
        if candidates:
            found[row] = min(candidates)[2]
    return found


def _place_flying(scene: CompiledScene, work: Work, x: FloatArray, v: FloatArray) -> None:
    """Put each body that only constraints hold where its placing joint wants it, moving as that says."""
    plan, zero = scene.plan, np.zeros(scene.nv)
    for row, connection in placing_joints(scene).items():
        forward(plan, work, x, v, zero)
        ox, ov = int(plan.tree[row, at.JOINT_X]), int(plan.tree[row, at.JOINT_V])
        flies = scene.body_row[id(connection.child.body)] == row
        x[ox : ox + 7], v[ov : ov + 6] = _state_by_joint(scene, work, connection, flies=flies)


def _set_couplings(scene: CompiledScene, work: Work, x: FloatArray, held: Mask) -> CompiledScene:
    """Give the couplings the sums that they have where all other constraints are fulfilled."""
    kinds = scene.plan.rows[:, at.ROW_KIND]
    coupling = np.flatnonzero(kinds == at.ROW_COUPLING)
    if len(coupling) == 0:
        return scene
    others = scene.keep_rows([int(k) for k in np.flatnonzero(kinds != at.ROW_COUPLING)])
    closed, _ = _close_loops(others, work, x, held)
    data = scene.plan.data.copy()
    data[scene.plan.rows[coupling, at.ROW_DATA] + 1] = 0.0
    bare = replace(scene, plan=scene.plan._replace(data=data))
    sums = constraint_values(bare, work, closed, np.zeros(scene.nv))[0]
    data[scene.plan.rows[coupling, at.ROW_DATA] + 1] = sums[coupling]
    return bare


def _state_by_joint(
    scene: CompiledScene, work: Work, connection: Connection, *, flies: bool
) -> tuple[FloatArray, FloatArray]:
    """Coordinates (7,) and velocities (6,) of the flying body that put G against F as the joint says.

    ``flies``: the flying body carries G; else it carries F.
    """
    joint = connection.joint
    position = np.array(joint.start) if connection.position is None else connection.position
    rest = np.zeros(len(joint.velocity_names))
    p, R, rate, spin = joint_state(joint, position, rest if connection.velocity is None else connection.velocity)
    f, g = scene.closure_frames[id(connection)]
    p_held, R_held, v_held, w_held = _world_motion(scene, work, f if flies else g)
    R_WF = R_held if flies else R_held @ R.T
    p, rate, spin = R_WF @ p, R_WF @ rate, R_WF @ spin
    if flies:
        R_W, p_W, w = R_held @ R, p_held + p, w_held + spin
        velocity = v_held + np.cross(w_held, p) + rate
    else:
        R_W, p_W, w = R_WF, p_held - p, w_held - spin
        velocity = v_held - np.cross(w, p) - rate
    frame = work.frame[g if flies else f]
    R_WB = R_W @ frame[at.F_R : at.F_R + 9].reshape(3, 3).T
    arm = R_WB @ frame[at.F_P : at.F_P + 3]
    x = np.concatenate([p_W - arm, to_quaternion(R_WB)])
    return x, np.concatenate([velocity - np.cross(w, arm), R_WB.T @ w])


def _world_motion(scene: CompiledScene, work: Work, f: int) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """p_WF_W, R_WF, velocity and angular velocity of frame row f in world axes."""
    p, R, v, w, *_ = frame_motion(scene.plan, work, f)
    matrix = np.array(R).reshape(3, 3)
    return np.array(p), matrix, matrix @ v, matrix @ w


def _refuse_turned_over(scene: CompiledScene, work: Work, x: FloatArray) -> None:
    """Raise AssemblyError where a loop closed with its axes opposed instead of aligned."""
    forward(scene.plan, work, x, np.zeros(scene.nv), np.zeros(scene.nv))
    for connection in scene.topology.closures:
        rows = connection.joint.rows
        f, g = scene.closure_frames[id(connection)]
        R_FG = _world_motion(scene, work, f)[1].T @ _world_motion(scene, work, g)[1]
        opposed = (set(ALIGNED) <= set(rows) and R_FG[2, 2] < 0.0) or (
            any(row.kind == at.ROW_AXIS for row in rows) and np.trace(R_FG) < 1.0
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


def _mass_factor(scene: CompiledScene, work: Work, x: FloatArray) -> FloatArray:
    """Cholesky factor of M on the free coordinates.

    Raises:
        AssemblyError: some motion moves no mass; the message names its largest coordinate.
    """
    free = scene.plan.free
    mass = mass_matrix(scene, work, x)[np.ix_(free, free)]
    try:
        lower: FloatArray = np.linalg.cholesky(mass).astype(np.float64, copy=False)
    except np.linalg.LinAlgError as reason:
        _, vectors = np.linalg.eigh(mass)
        name = scene.velocity_names[free[int(np.argmax(np.abs(vectors[:, 0])))]]
        raise AssemblyError(
            f"moving {name!r} moves no mass, so no force tells its acceleration; give the body an inertia, "
            "or fix what does not turn"
        ) from reason
    return lower


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
    holds = scene.plan.rows[:, at.ROW_LEVEL] == at.LEVEL_POSITION
    trial, total = x, rest
    phi = constraint_values(scene, work, trial, rest)[0]
    for _ in range(_ITERATIONS):
        jacobian = constraint_jacobian(scene, work, trial)[np.ix_(holds, movable)]
        step = np.zeros(scene.nv)
        step[movable] = -scipy.linalg.lstsq(jacobian, phi[holds], cond=1e-10)[0]
        step *= min(1.0, 0.5 / max(np.abs(step).max(), 1e-300))
        moved = np.empty_like(trial)
        retract(scene.plan, trial, step, moved)
        left = constraint_values(scene, work, moved, rest)[0]
        settled = np.abs(phi).max() <= _CLOSED * scene.extent
        if settled and np.abs(left).max() >= 0.1 * np.abs(phi).max():
            break
        trial, total, phi = moved, total + step, left
    return trial, total, phi


def scaled_jacobian(scene: CompiledScene, work: Work, x: FloatArray) -> FloatArray:
    """C on the free coordinates, per unit of kinetic energy, rows over the largest of them."""
    free = scene.plan.free
    jacobian = constraint_jacobian(scene, work, x)[:, free]
    lower = _mass_factor(scene, work, x)
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
        scaled = scaled_jacobian(scene, work, place)
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
    scene.refuse_failed(work)
    lower = _mass_factor(scene, work, x)
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
