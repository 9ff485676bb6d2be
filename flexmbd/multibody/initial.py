"""A consistent start: loops closed, velocities on the loops, accelerations and reactions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from flexmbd.errors import AssemblyError
from flexmbd.multibody.given_coordinates import Given, coordinates_given
from flexmbd.multibody.interior_start import begin_interiors
from flexmbd.multibody.interiors import Kept
from flexmbd.multibody.kernels import layout as at
from flexmbd.multibody.kernels.joints import retract
from flexmbd.multibody.kernels.layout import Work
from flexmbd.multibody.kernels.residual import drive, residual
from flexmbd.multibody.loop_closing import close_loops, match_velocities
from flexmbd.multibody.placement import place_flying, refuse_turned_over
from flexmbd.multibody.plan import CompiledScene
from flexmbd.multibody.scene_matrices import constraint_jacobian, constraint_values, mass_factor, scaled_jacobian

FloatArray = NDArray[np.float64]
Mask = NDArray[np.bool_]


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
    scene: CompiledScene,
    work: Work,
    x: FloatArray,
    v: FloatArray,
    *,
    held_x: Mask,
    held_v: Mask,
    memories: Kept | None = None,
) -> Start:
    """Project a user's start onto the loops and solve for accelerations and reactions.

    Coordinates of the tree that the user set (``held``) stay where the others can close the loops alone;
    modal coordinates move only where the joints cannot.  Where the user set any of a joint held by
    constraints, all that are set stay.

    Args:
        scene: the scene with all its constraint rows.
        work: scratch; ``work.time`` holds the functions of time at the start.
        x: (nx,) wanted configuration.
        v: (nv,) wanted velocity.
        held_x: (nv,) tangent directions of coordinates set by the user.
        held_v: (nv,) velocities set by the user.
        memories: of a state found before, in which x and v are all set; what bodies with history go on from.  By
            default these begin undeformed.

    Raises:
        AssemblyError: no configuration closes the loops, or they contradict each other.
        SceneError: the loops close, but not with what was set on joints held by constraints.
    """
    x, v = x.copy(), v.copy()
    drive(scene.plan, work, x, v, np.zeros(scene.nv))
    if memories is None:
        place_flying(scene, work, x, v)
    given = coordinates_given(scene)
    scene = _set_couplings(scene, work, x, held_x, given)
    closed, moved = close_loops(scene, work, x, held_x, given)
    refuse_turned_over(scene, work, closed)
    kept = _independent_rows(scene, work, closed)
    reduced = scene.keep_rows(kept)
    # without the redundant rows, which may stay open a little, the others close to round-off
    closed, moved_on = close_loops(reduced, work, closed, held_x, given)
    moved += moved_on
    velocity, moved_v = match_velocities(scene, work, closed, v, held_v, given)
    if reduced.interiors is None:
        a, multipliers = _accelerations(reduced, work, closed, velocity)
    else:
        machine = reduced, reduced.interiors, work, closed, velocity
        a, multipliers = begin_interiors(*machine, _accelerations, kept=memories)
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


def _set_couplings(
    scene: CompiledScene, work: Work, x: FloatArray, held: Mask, given: Given
) -> CompiledScene:
    """Give the couplings the sums that they have where all other constraints are fulfilled."""
    kinds = scene.plan.rows[:, at.ROW_KIND]
    coupling = np.flatnonzero(kinds == at.ROW_COUPLING)
    if len(coupling) == 0:
        return scene
    others = scene.keep_rows([int(k) for k in np.flatnonzero(kinds != at.ROW_COUPLING)])
    closed, _ = close_loops(others, work, x, held, given)
    data = scene.plan.data.copy()
    data[scene.plan.rows[coupling, at.ROW_DATA] + 1] = 0.0
    bare = replace(scene, plan=scene.plan._replace(data=data))
    sums = constraint_values(bare, work, closed, np.zeros(scene.nv))[0]
    data[scene.plan.rows[coupling, at.ROW_DATA] + 1] = sums[coupling]
    return bare


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
            places.append(close_loops(scene, work, near, np.zeros(scene.nv, bool))[0])
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
    velocity, _ = match_velocities(scene, work, x, velocity, held)
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
    lower = mass_factor(scene, work, x)
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
