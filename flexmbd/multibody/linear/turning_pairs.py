"""Joints of the tree whose velocities change along a turn of the whole."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.kernels.base.arrays import Plan, Work
from flexmbd.multibody.kernels.inverse_dynamics.recursion import forward_kinematics
from flexmbd.multibody.kernels.reading.evaluated_motion import world_motion
from flexmbd.multibody.kernels.reading.tree import joint_frame, masses, parents, tree_joint
from flexmbd.multibody.plan.compiled_scene import CompiledScene

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class TurningPair:
    """A joint between F and G whose velocities change along a turn, with the massless links that it is made of.

    Attributes:
        f, g: rows of ``Plan.frames``.
        body: row of the link that carries G.
        on_ground: whether the ground carries F.
        x, v: all its entries.
        slides_x, slides: entries in x and v of what slides, k of them.
        D: (3, k) along which unit vectors, in F's axes.
        hinge: the entry in v of what turns about one axis, or none.
        S: (3, n) angular velocity, in G's axes, a unit of each velocity of the turn.
        quaternion, spin: of a ball, in x and v.
    """

    f: int
    g: int
    body: int
    on_ground: bool
    v: IntArray
    slides_x: IntArray
    slides: IntArray
    D: FloatArray
    hinge: IntArray
    S: FloatArray
    quaternion: slice | None
    spin: slice | None

    @property
    def turns(self) -> IntArray:
        """(n,) entries in v of the turn."""
        return self.hinge if self.spin is None else np.arange(self.spin.start, self.spin.stop)


def turning_pairs(scene: CompiledScene, work: Work, x: FloatArray) -> tuple[TurningPair, ...]:
    """All joints of the tree whose velocities change along a turn: a ball, or two slides or more."""
    plan, found = scene.plan, []
    for rows in _chains(plan):
        joints = [tree_joint(plan, row) for row in rows]
        v = np.concatenate([np.arange(joint.v.start, joint.v.stop) for joint in joints])
        plain = np.concatenate([np.arange(joint.plain_v.start, joint.plain_v.stop) for joint in joints])
        places = np.concatenate([np.arange(joint.plain_x.start, joint.plain_x.stop) for joint in joints])
        last = joints[-1]
        if last.spin is None and len(plain) < 2:
            continue
        f, g = joint_frame(plan, rows[0], on_parent=True), joint_frame(plan, rows[-1])
        columns = [_column(plan, work, x, f, g, k) for k in plain]
        turn = np.array([w for w, _ in columns]).reshape(-1, 3).T
        slide = np.array([linear for _, linear in columns]).reshape(-1, 3).T
        among = np.abs(turn).max(axis=0) == 0.0
        if last.spin is None and among.sum() < 2:
            continue
        on_ground = bool(parents(plan)[rows[0]] < 0)
        pair = TurningPair(
            f, g, rows[-1], on_ground, v, places[among], plain[among], slide[:, among], plain[~among],
            turn[:, ~among] if last.spin is None else np.eye(3), last.quaternion, last.spin,
        )  # fmt: skip
        found.append(pair)
    return tuple(found)


def _chains(plan: Plan) -> Iterator[list[int]]:
    """Rows of each link with those of the massless ones before it that only slide: the steps of one joint."""
    weight, parent = masses(plan), parents(plan)
    slides = [tree_joint(plan, row).spin is None and not tree_joint(plan, row).is_hinge for row in range(len(parent))]
    carries = np.bincount(parent[parent >= 0], minlength=len(parent))
    passing = [slides[row] and weight[row] == 0.0 and carries[row] == 1 for row in range(len(parent))]
    for row in range(len(parent)):
        if passing[row]:
            continue
        chain = [row]
        while parent[chain[0]] >= 0 and passing[parent[chain[0]]]:
            chain.insert(0, int(parent[chain[0]]))
        yield chain


def _column(plan: Plan, work: Work, x: FloatArray, f: int, g: int, k: int) -> tuple[FloatArray, FloatArray]:
    """Angular velocity (G's axes) and linear one (F's axes) of G a unit of velocity k."""
    unit = np.zeros(plan.free.shape[0] + plan.driven.shape[0])
    unit[k] = 1.0
    forward_kinematics(plan, work, x, unit, np.zeros_like(unit))
    F, G = world_motion(plan, work, f), world_motion(plan, work, g)
    return G.R.T @ G.w, F.R.T @ G.v
