"""The twist of a whole machine that moves steadily: which ones it may have."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.kernels.base.arrays import Plan, Work
from flexmbd.multibody.kernels.inverse_dynamics.recursion import forward_kinematics
from flexmbd.multibody.kernels.reading.evaluated_motion import RigidMotion, body_motion, world_motion
from flexmbd.multibody.kernels.reading.tree import joint_frame, masses, second_moment
from flexmbd.multibody.linear.turning_pairs import TurningPair
from flexmbd.multibody.plan.compiled_scene import CompiledScene

FloatArray = NDArray[np.float64]

SAME_MOTION = 1e-9  #: of the fastest motion: what two bodies that move as one may differ by


@dataclass(frozen=True)
class Alike:
    """Whether two twists differ by round-off: ``most`` m/s, at a lever (m)."""

    lever: float
    most: float

    @classmethod
    def of(cls, twists: list[FloatArray], lever: float) -> Alike:
        """By the fastest of these."""
        return cls(lever, SAME_MOTION * max((cls(lever, 0.0).size(twist) for twist in twists), default=0.0))

    def size(self, twist: FloatArray) -> float:
        """m/s, of its largest component."""
        return float(max(self.lever * np.abs(twist[:3]).max(), np.abs(twist[3:]).max()))

    def __call__(self, one: FloatArray, other: FloatArray) -> bool:
        """Whether they do."""
        return self.size(one - other) <= self.most


def twist_of(moving: RigidMotion) -> FloatArray:
    """(6,) angular velocity, and velocity of what is at the inertial origin."""
    return np.concatenate([moving.w, moving.v - np.cross(moving.w, moving.p)])


def twists(
    scene: CompiledScene, work: Work, x: FloatArray, v: FloatArray, pairs: Sequence[TurningPair]
) -> list[FloatArray]:
    """Twists (6,), as ``steady_motion.carried`` takes them, that the whole may have, the likeliest first.

    That of most of the mass whose velocities change with the place; then rest, those of other bodies, and those of
    symmetric bodies that spin as they precess.
    """
    plan = scene.plan
    if not pairs:
        return [np.zeros(6)]
    weight = masses(plan)
    forward_kinematics(plan, work, x, v, np.zeros(scene.nv))
    motions = [twist_of(world_motion(plan, work, joint_frame(plan, row))) for row in range(len(weight))]
    same = Alike.of(motions, scene.extent)
    at_ground = [pair.body for pair in pairs if pair.on_ground]
    groups: list[tuple[FloatArray, float]] = [(np.zeros(6), 0.0)]
    for row, move in enumerate(motions):
        share = float(weight[row]) if row in at_ground else 0.0
        k = next((k for k, (twist, _) in enumerate(groups) if same(twist, move)), len(groups))
        before = groups[k] if k < len(groups) else (move, 0.0)
        groups[k:] = [(before[0], before[1] + share), *groups[k + 1 :]]
    precessions = [_precession(plan, work, row) for row in at_ground if weight[row] > 0.0]
    found = [twist for twist, _ in sorted(groups, key=lambda group: -group[1])]
    return found + [twist for twist in precessions if twist is not None]


def axes_of_symmetry(second: FloatArray) -> FloatArray:
    """(k, 3) axes about which a body may turn with this second moment (3, 3): one, three of any, or none."""
    moments, axes = np.linalg.eigh(second)
    low, high = np.diff(moments) <= SAME_MOTION * moments[-1]
    if low and high:
        return np.eye(3)
    return axes.T[[2]] if low else axes.T[[0]] if high else np.zeros((0, 3))


def _precession(plan: Plan, work: Work, row: int) -> FloatArray | None:
    """The twist (6,) about the vertical, or the angular momentum, that a symmetric body has beside its own spin."""
    body = body_motion(work, row)
    centre, second = second_moment(plan, row)
    alike = axes_of_symmetry(second)
    if len(alike) != 1:
        return None
    axis = body.R @ alike[0]
    inertia = body.R @ (np.trace(second) * np.eye(3) - second) @ body.R.T
    upright = plan.gravity if plan.gravity.any() else inertia @ body.w
    pair = np.column_stack([upright / max(float(np.linalg.norm(upright)), 1e-300), axis])
    rates, _, rank, _ = np.linalg.lstsq(pair, body.w, rcond=SAME_MOTION)
    if rank < 2 or np.linalg.norm(pair @ rates - body.w) > SAME_MOTION * np.linalg.norm(body.w):
        return None
    arm = body.R @ centre
    turn = rates[0] * pair[:, 0]
    return np.concatenate([turn, body.v + np.cross(body.w, arm) - np.cross(turn, body.p + arm)])
