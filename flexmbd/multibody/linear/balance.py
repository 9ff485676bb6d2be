"""The forces that are out of balance at a configuration, their derivatives, and how a configuration is moved."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import AssemblyError, SceneError
from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base.arrays import Work
from flexmbd.multibody.kernels.inverse_dynamics.recursion import forward_kinematics
from flexmbd.multibody.kernels.inverse_dynamics.residual import drive, residual
from flexmbd.multibody.kernels.physics.joints import retract
from flexmbd.multibody.kernels.reading.evaluated_motion import world_places
from flexmbd.multibody.kernels.reading.force_tables import without_forces
from flexmbd.multibody.linear.derivatives import Derivatives, derive
from flexmbd.multibody.linear.elimination import Elimination, Prescribed, eliminate, own_coordinates
from flexmbd.multibody.linear.interior_balance import equilibrate_interiors
from flexmbd.multibody.linear.steady_motion import OwnTurns, SteadyMotion
from flexmbd.multibody.linear.whole_turn import SAME_MOTION
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.plan.scene_matrices import coordinate_sizes
from flexmbd.multibody.start.loop_closing import close_loops, match_velocities
from flexmbd.multibody.start.placement import follow_mates

FloatArray = NDArray[np.float64]



@dataclass(frozen=True, eq=False)
class ForceBalance:
    """What is out of balance at a state.

    Attributes:
        x, v: (nx,), (nv,) configuration and velocities.
        multipliers: (m,) reactions that leave least out of balance.
        of: derivatives of the equations.
        by: how changes of the configuration follow from the independent ones, z of them.
        force: (nv,) residual without reactions.
        lacking: (nz,) the same along the independent changes.
        parts: (nz,) sum of the sizes of what ``lacking`` is made of.
        mass: (nz, nz).
        motion: the steady motion in which they act; without turning at rest.
    """

    x: FloatArray
    v: FloatArray
    multipliers: FloatArray
    of: Derivatives
    by: Elimination
    force: FloatArray
    lacking: FloatArray
    parts: FloatArray
    mass: FloatArray
    motion: SteadyMotion

    def stiffness(self, more: FloatArray | float = 0.0) -> FloatArray:
        """(nz, nz) with ``more`` (nv, nv) beside that of the state."""
        return self.by.Vz.T @ (self.of.stiffness + more) @ self.by.Vz

    def open_force(self) -> FloatArray:
        """(nv,) what the reactions leave out of balance in each coordinate."""
        return self.force + self.of.jacobian.T @ self.multipliers


def nothing_prescribed(scene: CompiledScene) -> Prescribed:
    """No inputs."""
    nv, m = scene.nv, len(scene.plan.rows)
    return Prescribed(np.zeros((3, nv, 0)), np.zeros((2, m, 0)), np.zeros((0, 0)))


def balance(
    scene: CompiledScene,
    work: Work,
    x: FloatArray,
    v: FloatArray,
    *,
    given: Prescribed | None = None,
    further: FloatArray | float = 0.0,
    motion: SteadyMotion | None = None,
) -> ForceBalance:
    """Lacking forces at x with the velocities nearest to v, and the reactions that leave least of them.

    In a steady motion what changes with the place are the velocities and accelerations as well: derivatives by the
    configuration are those of the forces seen from the turning axes.

    Args:
        scene: without redundant rows.
        work: scratch; ``work.time`` holds the functions of time.
        x: (nx,) configuration, its loops closed.
        v: (nv,) velocities.
        given: motions that inputs prescribe, which ``by`` is to tell of.
        further: (nv,) forces added to the residual.
        motion: the steady motion; none where all accelerations are zero.

    Raises:
        SceneError: a user's function failed, interiors find no balance, or the rows are singular here.
    """
    size, motion = coordinate_sizes(scene), motion or SteadyMotion(scene)
    v = match_velocities(scene, work, x, motion.velocities(work, x, v), np.zeros(scene.nv, bool))
    of_interiors = 0.0 if scene.interiors is None else equilibrate_interiors(scene, scene.interiors, work, x, v)
    a, slopes = motion.accelerations(work, x), motion.slopes(work, x)
    force = np.zeros(scene.nv)
    residual(scene.plan, work, x, v, a, np.zeros(len(scene.plan.rows)), force)
    scene.refuse_failed(work)
    force += further
    multipliers = reactions(scene, work, x, v, force)
    of = derive(scene.plan, work, x, v, multipliers, size=size, a=a)
    by = eliminate(scene, own_coordinates(scene), of, slopes.velocity, given or nothing_prescribed(scene))
    if v.any():
        turned = of.damping @ slopes.velocity + of.mass @ slopes.acceleration
        of = replace(of, stiffness=of.stiffness + turned)
        open_ = force + of.jacobian.T @ multipliers
        allowed = (pair for turns in motion.symmetric_turns(work, x) for pair in _let_free(scene, of, turns))
        nothing = [u for u, B in allowed if _changes_nothing(scene, of, open_, u, B)]
        held = _held_phase(scene, [*motion.phases(work, x, v), *nothing], of, v)
        of = replace(of, stiffness=of.stiffness + held)
    of = replace(of, stiffness=of.stiffness + of_interiors)
    parts = np.abs(force) + np.abs(of.jacobian).T @ np.abs(multipliers)
    mass = by.Vz.T @ of.mass @ by.Vz
    return ForceBalance(x, v, multipliers, of, by, force, by.Vz.T @ force, np.abs(by.Vz).T @ parts, mass, motion)


def _let_free(scene: CompiledScene, of: Derivatives, turns: OwnTurns) -> list[tuple[FloatArray, FloatArray]]:
    """Directions (nv,) of a body's turns that joints and loops allow, and B (nv, nv) of each."""
    size = coordinate_sizes(scene)
    rows = np.abs(of.jacobian * size).max(axis=1, initial=0.0)[:, None]
    opened = np.vstack([of.jacobian @ turns.along / np.where(rows > 0.0, rows, 1.0), turns.held / scene.extent])
    _, values, across = np.linalg.svd(opened)
    most = SAME_MOTION * np.abs(turns.along / size[:, None]).max(initial=0.0)
    free = across[np.append(values, np.zeros(len(across) - len(values))) <= most]
    return [(turns.along @ part, np.tensordot(part, turns.turning, 1)) for part in free]


def _changes_nothing(
    scene: CompiledScene, of: Derivatives, open_: FloatArray, along: FloatArray, turning: FloatArray
) -> bool:
    """Whether a body's own turn changes nothing: the forces on it then turn with it, K u = - B^T f, in balance or not.

    Args:
        scene: the machine.
        of: derivatives.
        open_: (nv,) force out of balance.
        along: (nv,) the turn, u.
        turning: (nv, nv) B.
    """
    size, free = coordinate_sizes(scene), scene.plan.free
    change = np.abs(of.stiffness @ along + turning.T @ open_) * size  # J
    at_play = (np.abs(of.stiffness) @ size + np.abs(turning.T) @ np.abs(open_)) * size
    own = np.abs(along / size).max(initial=0.0)
    allowed = SAME_MOTION * own * np.maximum(at_play, at_play[along != 0.0].max(initial=0.0))
    return bool((change <= allowed)[free].all())


def _held_phase(scene: CompiledScene, phases: Sequence[FloatArray], of: Derivatives, v: FloatArray) -> FloatArray:
    """(nv, nv) a stiffness along the motion itself: of the places on its way the nearest one is looked for.

    Args:
        scene: the machine.
        phases: directions (nv,) along which it goes on; those count that the loops allow.
        of: derivatives there.
        v: (nv,) velocities.
    """
    held, free, size = np.zeros((scene.nv, scene.nv)), np.zeros(scene.nv), coordinate_sizes(scene)
    free[scene.plan.free] = 1.0
    rate = np.abs(v / size)[~scene.state_mask].max(initial=0.0)
    rows = np.abs(of.jacobian * size).max(axis=1, initial=0.0)
    for along in phases:
        allowed = np.abs(of.jacobian @ along) <= SAME_MOTION * rows * np.abs(along / size).max(initial=0.0)
        momentum = of.mass @ (along * free) * free
        energy = momentum @ along
        if energy > 0.0 and allowed.all():
            held += np.outer(momentum, momentum) * (rate**2 / energy)
    return held


def reactions(scene: CompiledScene, work: Work, x: FloatArray, v: FloatArray, force: FloatArray) -> FloatArray:
    """(m,) reactions in balance with a force (nv,) in the norm of the forces' work on each other: M^-1."""
    multipliers: FloatArray = np.zeros(len(scene.plan.rows))
    if len(multipliers):
        free = scene.plan.free
        bare = derive(without_forces(scene.plan), work, x, v, multipliers, size=coordinate_sizes(scene))
        weighted = np.linalg.solve(bare.mass[np.ix_(free, free)], bare.jacobian[:, free].T)
        apart = bare.jacobian[:, free] @ weighted
        multipliers = np.asarray(-np.linalg.solve(apart, weighted.T @ force[free]), dtype=np.float64)
    return multipliers


def moved(
    scene: CompiledScene, work: Work, x: FloatArray, step: FloatArray, *, driven: bool = False
) -> FloatArray:
    """(nx,) configuration after a step (nv,), with its loops closed.

    With ``driven`` prescribed coordinates are set where ``work.time`` has them now.

    Raises:
        SceneError: they do not close.
    """
    after = np.empty_like(x)
    retract(scene.plan, x, step, after)
    follow_mates(scene, work, x, step, after)
    if driven:
        drive(scene.plan, work, after, *np.zeros((2, scene.nv)))
    try:
        return close_loops(scene, work, after, np.zeros(scene.nv, bool)).x
    except AssemblyError as reason:
        raise SceneError(
            f"no equilibrium found: on the way to it the loops do not close ({reason}); start nearer to it"
        ) from reason


def motion_sizes(scene: CompiledScene, work: Work, x: FloatArray) -> FloatArray:
    """(nv,) what counts as a large motion of each coordinate: 1 rad, and the size of the machine as it stands.

    That is the distance over which its frames are spread, if it is more than the reach of its largest body
    (``CompiledScene.extent``): a beam of a hundred sections is as long as it is, not as thick.
    """
    plan = scene.plan
    forward_kinematics(plan, work, x, *np.zeros((2, scene.nv)))
    places = np.zeros((len(plan.frames), 3))
    world_places(plan, work, places)
    spread = float(np.linalg.norm(np.ptp(places, axis=0))) if len(places) else 0.0
    grows = max(1.0, spread / scene.extent)
    lengths = np.isin(scene.group_kind[scene.group_of], (kinds.GROUP_LENGTH, kinds.GROUP_MODAL))
    return coordinate_sizes(scene) * np.where(lengths, grows, 1.0)


def step_size(sizes: FloatArray, step: FloatArray) -> float:
    """Of a step (nv,), in the sizes of ``motion_sizes``."""
    return float(np.abs(step / sizes).max(initial=0.0))
