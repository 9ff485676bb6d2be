"""A consistent start: loops closed, velocities on the loops, accelerations and reactions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from flexmbd.errors import AssemblyError, SceneError
from flexmbd.multibody.interiors.scene_interiors import InteriorSnapshot
from flexmbd.multibody.kernels.base.arrays import Work, memories_end
from flexmbd.multibody.kernels.inverse_dynamics.memories import remember
from flexmbd.multibody.kernels.inverse_dynamics.residual import drive, residual
from flexmbd.multibody.kernels.inverse_dynamics.tree_accelerations import new_dense_work, tree_accelerations
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.plan.mass_solver import DENSE_UP_TO, MassSolver, mass_solver, row_mobilities
from flexmbd.multibody.plan.scene_matrices import (
    constraint_slopes,
    constraint_values,
    coordinate_sizes,
    mass_factor,
    row_sizes,
)
from flexmbd.multibody.start.closed_position import ClosedPosition, close_position
from flexmbd.multibody.start.energy_check import refuse_meeting
from flexmbd.multibody.start.given_coordinates import NOTHING_GIVEN, GivenCoordinates, coordinates_given
from flexmbd.multibody.start.independent_rows import (
    LEADS_ON,
    RowChoice,
    RowDecomposition,
)
from flexmbd.multibody.start.interior_start import begin_interiors
from flexmbd.multibody.start.loop_closing import SAME_RATE, match_velocities, own_rate
from flexmbd.multibody.start.placement import place_flying
from flexmbd.multibody.start.report import Strain, closing_strain, moved_coordinates
from flexmbd.multibody.start.sides import begin_sides
from flexmbd.overflow import looked_at, refuse_not_finite, refuse_overflow

FloatArray = NDArray[np.float64]
Mask = NDArray[np.bool_]

_SINGULAR = (
    "the start is a singular position (a dead centre, or where ways to assemble the machine meet), in which the loops "
    "do not tell all velocities; start beside it"
)


@dataclass(frozen=True, eq=False)
class Start:
    """The consistent start.

    Attributes:
        scene: the scene without its redundant constraint rows.
        unreduced: the scene with them.
        position: where the loops are closed.
        x, v, a: (nx,), (nv,), (nv,) configuration, velocity, acceleration.
        multipliers: (m,) reactions of the loops (N or N m).
        moved: what the projection changed: (coordinate, from, to), positions and velocities; rotations of several
            coordinates as rotation vectors.
        residual: largest constraint residual after the projection (m or rad).
        strain: what closing the loops bent.
    """

    scene: CompiledScene
    unreduced: CompiledScene
    position: ClosedPosition
    x: FloatArray
    v: FloatArray
    a: FloatArray
    multipliers: FloatArray
    moved: tuple[tuple[str, float, float], ...]
    residual: float
    strain: Strain

    @property
    def choice(self) -> RowChoice:
        """Which rows ``scene`` keeps."""
        return self.position.choice

    def copied(self) -> Start:
        """The same, of arrays of its own."""
        arrays = {name: getattr(self, name).copy() for name in ("x", "v", "a", "multipliers")}
        return replace(self, **arrays)

    def __repr__(self) -> str:
        """How many velocities and rows, and how well they fit."""
        return (
            f"<Start: {len(self.v)} velocities, {len(self.multipliers)} rows closed to {self.residual:.2g}, "
            f"{len(self.moved)} coordinates moved>"
        )


@refuse_overflow("the start")
def consistent_start(
    scene: CompiledScene,
    work: Work,
    x: FloatArray,
    v: FloatArray,
    *,
    held_x: Mask,
    held_v: Mask,
    memories: InteriorSnapshot | None = None,
    known: ClosedPosition | None = None,
) -> Start:
    """Project a user's start onto the loops and solve for accelerations and reactions.

    Coordinates of the tree that the user set (``held``) stay where the others can close the loops alone;
    modal coordinates move only by what no joint can close.  Where the user set any of a joint held by
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
        known: of a start of the same machine with other numbers, which is looked at before all is found anew.

    Raises:
        AssemblyError: no configuration closes the loops, or they contradict each other.
        SceneError: the loops close, but not with what was set on joints held by constraints; or the start is a
            singular position that the rates set do not lead out of.
    """
    x, v = x.copy(), v.copy()
    drive(scene.plan, work, x, v, np.zeros(scene.nv))
    if memories is None:
        place_flying(scene, work, x, v)
    given = coordinates_given(scene) if memories is None else NOTHING_GIVEN
    scene, reduced, position = close_position(
        scene, work, x, held_x, given, is_found=memories is not None, known=known
    )
    closed = position.x
    velocity = _velocities(scene, reduced, position, work, v, held_v, given)
    if memories_end(scene.plan):
        closed = closed.copy()
        remember(scene.plan, work, closed, velocity, float(work.time[-1, 0]))
    if scene.switches:
        closed = closed.copy()
        begin_sides(reduced, work, closed, velocity, accelerations)
    refuse_meeting(reduced, work, closed)
    solve: MassSolver | None = None
    if reduced.interiors is None:
        solve = None if is_dense_tree(reduced) else mass_solver(reduced, work, closed)
        a, multipliers = accelerations(reduced, work, closed, velocity, solve)
    else:
        machine = reduced, reduced.interiors, work, closed, velocity
        a, multipliers = begin_interiors(*machine, accelerations, kept=memories)
    refuse_not_finite("the start", closed, velocity, a, multipliers)
    phi = constraint_values(scene, work, closed, velocity)[0] if len(scene.plan.rows) else np.zeros(0)
    return Start(
        reduced,
        scene,
        position,
        closed,
        velocity,
        a,
        multipliers,
        moved_coordinates(scene, work, x, closed, v, velocity, held=held_x, solve=solve),
        float(np.abs(phi).max(initial=0.0)),
        closing_strain(reduced, work, closed, velocity, position.change, left_open=position.left_open),
    )


def _velocities(
    scene: CompiledScene,
    reduced: CompiledScene,
    position: ClosedPosition,
    work: Work,
    v: FloatArray,
    held: Mask,
    given: GivenCoordinates,
) -> FloatArray:
    """Velocities that keep the loops closed, in the next instant too.

    In a singular position rows lose their hold on velocities, and hold their squares instead; so do rows that were
    left out because they say nothing new there.

    Args:
        scene: with all its rows.
        reduced: without those that are redundant.
        position: with the loops closed.
        work: scratch; ``work.time`` holds the functions of time at the start.
        v: (nv,) wanted velocities.
        held: (nv,) velocities set by the user.
        given: of joints held by constraints.
    """
    x, places = position.x, position.places
    kept = (np.isin(block.rows, position.choice.rows).sum() for block in scene.row_blocks)
    if all(place.rank >= count for place, count in zip(places, kept, strict=True)):
        velocity = match_velocities(scene, work, x, v, held, given)
        velocity = match_velocities(reduced, work, x, velocity, held, given)
    else:
        try:
            velocity = match_velocities(scene, work, x, v, held, given)
        except (AssemblyError, SceneError) as reason:
            raise type(reason)(f"{reason}; {_SINGULAR}") from reason
    _refuse_rates_that_lead_out(scene, work, x, velocity, places)
    return velocity


def _refuse_rates_that_lead_out(
    scene: CompiledScene, work: Work, x: FloatArray, v: FloatArray, places: Sequence[RowDecomposition]
) -> None:
    """Raise SceneError where no accelerations keep all rows closed, those left out as redundant included."""
    if all(place.rank == len(block.rows) for block, place in zip(scene.row_blocks, places, strict=True)):
        return
    bend = constraint_values(scene, work, x, v)[2] / row_sizes(scene)
    with looked_at():
        squared = np.square(np.abs(v / coordinate_sizes(scene)).max(initial=0.0))
    refuse_not_finite("how the velocities set go with the loops", bend, squared)
    for block, place in zip(scene.row_blocks, places, strict=True):
        across = place.unmoved()
        lost = across @ (across.T @ bend[block.rows])  # what no acceleration changes
        if np.linalg.norm(lost) <= (LEADS_ON + place.known_to) * squared:
            continue
        # at rest what opens is round-off of the machine's own accelerations
        if np.linalg.norm(lost) > SAME_RATE * own_rate(scene, work, x) ** 2:
            worst = scene.row_names[block.rows[int(np.argmax(np.abs(lost)))]]
            raise SceneError(
                f"the velocities set lead out of the loops at once: no accelerations keep {worst} closed; {_SINGULAR}, "
                "or set the velocities of all joints to those of one of the motions that leave this position, if any"
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
    velocity = match_velocities(scene, work, x, velocity, held)
    a, multipliers = accelerations(scene, work, x, velocity)
    return velocity, a, multipliers


def is_dense_tree(scene: CompiledScene) -> bool:
    """Whether accelerations of a start come from a dense mass matrix by one kernel."""
    return len(scene.plan.rows) == 0 and scene.nv <= DENSE_UP_TO


def accelerations(
    scene: CompiledScene, work: Work, x: FloatArray, v: FloatArray, solve: MassSolver | None = None
) -> tuple[FloatArray, FloatArray]:
    """Accelerations and multipliers from M a + C^T nu = f, C a = -gamma; ``solve``: by M at x, if it is factored.

    Source: Ambrosio & Nikravesh 1992, eq. 76-77.
    """
    plan, free = scene.plan, scene.plan.free
    m = len(plan.rows)
    if is_dense_tree(scene):
        a, dense = np.zeros(scene.nv), new_dense_work(plan)
        if tree_accelerations(plan, scene.inertia_plan, work, dense, x, v, a):
            return a, np.zeros(0)
        scene.refuse_failed(work)
        mass_factor(scene, work, x)  # says which motion moves no mass
    a = np.zeros(scene.nv)
    drive(plan, work, x, v, a)
    force = np.zeros(scene.nv)
    residual(plan, work, x, v, a, np.zeros(m), force)
    scene.refuse_failed(work)
    solve = solve or mass_solver(scene, work, x)
    a += solve(-force[None])[0]
    multipliers: FloatArray = np.zeros(m)
    if m and len(free):
        opening = constraint_values(scene, work, x, v, a)[2]
        slopes = constraint_slopes(scene, work, x)
        reaction = np.zeros((1, scene.nv))
        for (block, part), mobility in zip(slopes, row_mobilities(slopes, solve), strict=True):
            # rows of unit length, since those in rad differ from those in m by the square of the machine's size
            lengths = np.sqrt(np.diag(mobility))
            lengths[lengths == 0.0] = 1.0
            unit = mobility / np.outer(lengths, lengths)
            tensions = scipy.linalg.lstsq(unit, opening[block.rows] / lengths, cond=1e-13)[0]
            multipliers[block.rows] = tensions / lengths
            reaction[0, block.free] += part[:, : len(block.free)].T @ multipliers[block.rows]
        a -= solve(reaction)[0]
    return a, multipliers
