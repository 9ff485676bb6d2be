"""Steady motions: the whole turns at one rate about one line, and inside symmetric bodies turn at rates of their own.

Each body's pose is g(t) = exp(t xi) g(0) exp(t eta): the twist xi is that of the whole, in inertial axes, eta the body's
own, in its axes; the ground's own takes back that of the whole, -xi.  So the frame G of a joint moves against F, on
another body, by h(t) = exp(t lambda) h(0) exp(t rho), lambda what F's body takes back and rho G's own, and h has the
velocities (in F's axes the linear one, in G's the angular one)

    dp/dt = l + w_l x p + R r,    w = R^T w_l + w_r,    lambda = (w_l, l), rho = (w_r, r).

Coordinates that slide or turn one way have constant rates.  Those of a joint that holds a frame by two slides or more,
or by a ball, do not: their velocities change with the place, V(x), and along the motion.  Motions beside the steady one
are seen from the turning axes: a change xi of the place at one time is T(t) xi at another, velocities w become T w.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from flexmbd.multibody.kernels.base.arrays import Plan, Work
from flexmbd.multibody.kernels.inverse_dynamics.recursion import forward_kinematics
from flexmbd.multibody.kernels.physics.joints import retract
from flexmbd.multibody.kernels.reading.evaluated_motion import RigidMotion, body_motion, world_motion
from flexmbd.multibody.kernels.reading.tree import joint_frame, masses, parents, second_moment, tree_joint
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.plan.scene_matrices import coordinate_sizes
from flexmbd.rotation import from_quaternion, to_quaternion

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_SAME = 1e-9  # of the fastest motion: what two bodies that move as one may differ by


@dataclass(frozen=True, eq=False)
class FramePair:
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


@dataclass(frozen=True, eq=False)
class CarriedPair:
    """A pair in a steady motion.

    Attributes:
        pair: the joint.
        along, own: (6,) lambda in F's axes and rho in G's, angular, then linear.
        rotor: a number that those have in common that turn of their own as one body; -1 of what turns with the whole.
    """

    pair: FramePair
    along: FloatArray
    own: FloatArray
    rotor: int


@dataclass(frozen=True, eq=False)
class Slopes:
    """Derivatives (nv, nv) of a steady motion's velocities and accelerations, seen from the turning axes.

    Attributes:
        velocity: A, of V by the configuration: d xi/dt = dw - A xi.
        turning: B, by which what is constant seen from these axes changes: dT/dt.
        acceleration: of dV/dt by the configuration.
    """

    velocity: FloatArray
    turning: FloatArray
    acceleration: FloatArray


@dataclass(frozen=True, eq=False)
class SteadyMotion:
    """See the module; without pairs all velocities are constant."""

    scene: CompiledScene
    pairs: tuple[CarriedPair, ...] = ()

    def velocities(self, work: Work, x: FloatArray, v: FloatArray) -> FloatArray:
        """(nv,) V at a configuration x (nx,); v (nv,) has those that are constant."""
        if not self.pairs:
            return v
        v = v.copy()
        for one, p, R in self._poses(work, x):
            linear, w = _rates(one, p, R)
            v[one.pair.slides] = one.pair.D.T @ linear
            if one.pair.spin is not None:
                v[one.pair.spin] = w
        return v

    def accelerations(self, work: Work, x: FloatArray) -> FloatArray:
        """(nv,) rates of ``velocities`` along the motion."""
        a = np.zeros(self.scene.nv)
        for one, p, R in self._poses(work, x):
            (w_l, _), (w_r, r) = np.split(one.along, 2), np.split(one.own, 2)
            linear, w = _rates(one, p, R)
            a[one.pair.slides] = one.pair.D.T @ (np.cross(w_l, linear) + R @ np.cross(w, r))
            if one.pair.spin is not None:
                a[one.pair.spin] = -np.cross(w_r, R.T @ w_l)
        return a

    def slopes(self, work: Work, x: FloatArray) -> Slopes:
        """At a configuration x (nx,)."""
        A, B, A2 = np.zeros((3, self.scene.nv, self.scene.nv))
        for one, _, R in self._poses(work, x):
            pair = one.pair
            (w_l, _), (w_r, r) = np.split(one.along, 2), np.split(one.own, 2)
            seen = R.T @ w_l
            across, lever, spun = _cross(w_l), R @ _cross(r), _cross(seen)
            places, turn = np.ix_(pair.slides, pair.slides), np.ix_(pair.slides, pair.turns)
            A[places] = B[places] = pair.D.T @ across @ pair.D
            A[turn] = B[turn] = -pair.D.T @ lever @ pair.S
            A2[places] = pair.D.T @ across @ across @ pair.D
            change = across @ lever + R @ _cross(np.cross(seen + w_r, r)) + lever @ spun
            A2[turn] = -pair.D.T @ change @ pair.S
            if pair.spin is not None:
                A[pair.spin, pair.spin], B[pair.spin, pair.spin] = spun, -_cross(w_r)
                A2[pair.spin, pair.spin] = -_cross(w_r) @ spun
        return Slopes(A, B, A2)

    def phases(self, work: Work, x: FloatArray, v: FloatArray) -> list[FloatArray]:
        """Directions (nv,) along which the motion goes on: v itself, each body's own turn, and each constant rate.

        A steady motion is one wherever it is on its way, so that nothing pulls along those that the loops allow.
        """
        own: dict[int, FloatArray] = {}
        constant = moves(self.scene, v)
        for one, _, R in self._poses(work, x):
            constant[one.pair.v] = False
            if one.rotor < 0:
                continue
            w_r, r = np.split(one.own, 2)
            along = own.setdefault(one.rotor, np.zeros_like(v))
            along[one.pair.slides] += one.pair.D.T @ R @ r
            if one.pair.spin is not None:
                along[one.pair.spin] += w_r
        whole = [v] if self.pairs else []
        return [*whole, *own.values(), *np.eye(len(v))[constant]]

    def later(self, work: Work, x: FloatArray, v: FloatArray, t: float) -> FloatArray:
        """(nx,) the configuration a time t (s) after x (nx,), from which the velocities are v (nv,)."""
        after = np.empty_like(x)
        retract(self.scene.plan, x, np.where(self.scene.state_mask, 0.0, v * t), after)
        for one, p, R in self._poses(work, x):
            left, right = _displacement(one.along * t), _displacement(one.own * t)
            here = np.eye(4)
            here[:3, :3], here[:3, 3] = R, p
            there = left @ here @ right
            after[one.pair.slides_x] = x[one.pair.slides_x] + one.pair.D.T @ (there[:3, 3] - p)
            if one.pair.quaternion is not None:
                # x's own is against the link before, which may stand turned against F
                fixed = from_quaternion(x[one.pair.quaternion]) @ R.T
                after[one.pair.quaternion] = to_quaternion(fixed @ there[:3, :3])
        return after

    def transport(self, work: Work, x: FloatArray, t: float) -> FloatArray:
        """(nv, nv) T: what small motions beside the one at x (nx,) have become a time t (s) later."""
        T = np.eye(self.scene.nv)
        for one, _, R in self._poses(work, x):
            pair = one.pair
            left, right = _displacement(one.along * t), _displacement(one.own * t)
            E = left[:3, :3]
            T[np.ix_(pair.slides, pair.slides)] = pair.D.T @ E @ pair.D
            T[np.ix_(pair.slides, pair.turns)] = -pair.D.T @ E @ R @ _cross(right[:3, 3]) @ pair.S
            if pair.spin is not None:
                T[pair.spin, pair.spin] = right[:3, :3].T
        return T

    def _poses(self, work: Work, x: FloatArray) -> Iterator[tuple[CarriedPair, FloatArray, FloatArray]]:
        """Of each pair p_FG_F and R_FG."""
        if self.pairs:
            forward_kinematics(self.scene.plan, work, x, *np.zeros((2, self.scene.nv)))
        for one in self.pairs:
            F, G = (world_motion(self.scene.plan, work, frame) for frame in (one.pair.f, one.pair.g))
            yield one, F.R.T @ (G.p - F.p), F.R.T @ G.R


def moves(scene: CompiledScene, v: FloatArray) -> NDArray[np.bool_]:
    """(nv,) which coordinates move with the velocities v (nv,), beyond round-off; states do not."""
    rates = np.where(scene.state_mask, 0.0, np.abs(v / coordinate_sizes(scene)))
    return np.asarray(rates > _SAME * rates.max(initial=0.0))


def frame_pairs(scene: CompiledScene, work: Work, x: FloatArray) -> tuple[FramePair, ...]:
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
        columns = [_column(plan, work, x, f, g, k) for k in v]
        turn = np.array([w for w, _ in columns]).reshape(-1, 3).T
        slide = np.array([linear for _, linear in columns]).reshape(-1, 3).T
        slides = ~turn.any(axis=0)
        among = slides[: len(plain)]
        if last.spin is None and among.sum() < 2:
            continue
        on_ground = bool(parents(plan)[rows[0]] < 0)
        pair = FramePair(
            f, g, rows[-1], on_ground, v, places[among], plain[among], slide[:, slides], plain[~among],
            turn[:, ~slides], last.quaternion, last.spin,
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


def carried(scene: CompiledScene, work: Work, x: FloatArray, v: FloatArray, whole: FloatArray) -> SteadyMotion:
    """The steady motion that goes through x (nx,), v (nv,) if the whole has the twist ``whole`` (6,).

    Args:
        scene: the machine.
        work: scratch.
        x, v: where, and how fast.
        whole: angular velocity (rad/s) and velocity of what is at the inertial origin (m/s), in inertial axes.
    """
    pairs = [pair for pair in frame_pairs(scene, work, x) if pair.on_ground or moves(scene, v)[pair.v].any()]
    forward_kinematics(scene.plan, work, x, v, np.zeros(scene.nv))
    ends = [[world_motion(scene.plan, work, frame) for frame in (pair.f, pair.g)] for pair in pairs]
    same = _Alike.of([_twist(one) for both in ends for one in both], scene.extent)
    rotors: list[FloatArray] = []
    found = []
    for pair, both in zip(pairs, ends, strict=True):
        along, own = (np.zeros(6) if same(_twist(one), whole) else _seen_by(one, _twist(one) - whole) for one in both)
        if not along.any() and not own.any():
            continue
        rotor = -1
        if own.any():
            twist = _twist(both[1])
            rotor = next((k for k, other in enumerate(rotors) if same(twist, other)), len(rotors))
            rotors[rotor:] = rotors[rotor:] or [twist]
        found.append(CarriedPair(pair, -along, own, rotor))
    return SteadyMotion(scene, tuple(found))


def twists(scene: CompiledScene, work: Work, x: FloatArray, v: FloatArray) -> list[FloatArray]:
    """Twists (6,), as ``carried`` takes them, that the whole may have, the likeliest first.

    That of most of the mass whose velocities change with the place; then rest, those of other bodies, and those of
    symmetric bodies that spin as they precess.
    """
    plan = scene.plan
    pairs = frame_pairs(scene, work, x)
    if not pairs:
        return [np.zeros(6)]
    weight = masses(plan)
    forward_kinematics(plan, work, x, v, np.zeros(scene.nv))
    motions = [_twist(world_motion(plan, work, joint_frame(plan, row))) for row in range(len(weight))]
    same = _Alike.of(motions, scene.extent)
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


def _precession(plan: Plan, work: Work, row: int) -> FloatArray | None:
    """The twist (6,) about the vertical, or the angular momentum, that a symmetric body has beside its own spin."""
    body = body_motion(work, row)
    centre, second = second_moment(plan, row)
    moments, axes = np.linalg.eigh(second)
    gaps = np.diff(moments)
    if gaps.max() <= _SAME * moments[-1] or gaps.min() > _SAME * moments[-1]:
        return None
    axis = body.R @ axes[:, 0 if gaps[0] > gaps[1] else 2]
    inertia = body.R @ (np.trace(second) * np.eye(3) - second) @ body.R.T
    upright = plan.gravity if plan.gravity.any() else inertia @ body.w
    pair = np.column_stack([upright / max(np.linalg.norm(upright), 1e-300), axis])
    rates, _, rank, _ = np.linalg.lstsq(pair, body.w, rcond=_SAME)
    if rank < 2 or np.linalg.norm(pair @ rates - body.w) > _SAME * np.linalg.norm(body.w):
        return None
    arm = body.R @ centre
    turn = rates[0] * pair[:, 0]
    return np.concatenate([turn, body.v + np.cross(body.w, arm) - np.cross(turn, body.p + arm)])


@dataclass(frozen=True)
class _Alike:
    """Whether two twists differ by round-off: ``most`` m/s, at a lever (m)."""

    lever: float
    most: float

    @classmethod
    def of(cls, twists: list[FloatArray], lever: float) -> _Alike:
        """By the fastest of these."""
        return cls(lever, _SAME * max((cls(lever, 0.0).size(twist) for twist in twists), default=0.0))

    def size(self, twist: FloatArray) -> float:
        """m/s, of its largest component."""
        return float(max(self.lever * np.abs(twist[:3]).max(), np.abs(twist[3:]).max()))

    def __call__(self, one: FloatArray, other: FloatArray) -> bool:
        return self.size(one - other) <= self.most


def _twist(moving: RigidMotion) -> FloatArray:
    """(6,) angular velocity, and velocity of what is at the inertial origin."""
    return np.concatenate([moving.w, moving.v - np.cross(moving.w, moving.p)])


def _seen_by(frame: RigidMotion, twist: FloatArray) -> FloatArray:
    """A twist (6,) of inertial axes about a frame's origin, in its axes."""
    return np.concatenate([frame.R.T @ twist[:3], frame.R.T @ (twist[3:] + np.cross(twist[:3], frame.p))])


def _rates(one: CarriedPair, p: FloatArray, R: FloatArray) -> tuple[FloatArray, FloatArray]:
    """dp/dt in F's axes and the angular velocity in G's."""
    (w_l, linear), (w_r, r) = np.split(one.along, 2), np.split(one.own, 2)
    return linear + np.cross(w_l, p) + R @ r, R.T @ w_l + w_r


def _cross(a: FloatArray) -> FloatArray:
    """(3, 3) a x."""
    return np.cross(a, np.eye(3)).T


def _displacement(twist: FloatArray) -> FloatArray:
    """(4, 4) exp of a twist (6,)."""
    matrix = np.zeros((4, 4))
    matrix[:3, :3], matrix[:3, 3] = _cross(twist[:3]), twist[3:]
    return np.asarray(scipy.linalg.expm(matrix), dtype=np.float64)
