"""Steady motions: the whole turns at one rate about one line, and inside symmetric bodies turn at rates of their own.

Each body's pose is g(t) = exp(t xi) g(0) exp(t eta): the twist xi is that of the whole, in inertial axes, eta the
body's own, in its axes; the ground's own takes back that of the whole, -xi.  So the frame G of a joint moves against F,
on another body, by h(t) = exp(t lambda) h(0) exp(t rho), lambda what F's body takes back and rho G's own, and h has
the velocities (in F's axes the linear one, in G's the angular one)

    dp/dt = l + w_l x p + R r,    w = R^T w_l + w_r,    lambda = (w_l, l), rho = (w_r, r).

Coordinates that slide or turn one way have constant rates.  Those of a joint that holds a frame by two slides or more,
or by a ball, do not: their velocities change with the place, V(x), and along the motion.  Motions beside the steady one
are seen from the turning axes: a change xi of the place at one time is T(t) xi at another, velocities w become T w.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from flexmbd.multibody.kernels.base.arrays import Work
from flexmbd.multibody.kernels.inverse_dynamics.recursion import forward_kinematics
from flexmbd.multibody.kernels.physics.joints import retract
from flexmbd.multibody.kernels.reading.evaluated_motion import RigidMotion, body_motion, world_motion
from flexmbd.multibody.kernels.reading.tree import masses, second_moment
from flexmbd.multibody.linear.turning_pairs import TurningPair
from flexmbd.multibody.linear.whole_turn import SAME_MOTION, Alike, axes_of_symmetry, twist_of
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.plan.scene_matrices import coordinate_sizes
from flexmbd.rotation import from_quaternion, to_quaternion

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class CarriedPair:
    """A pair in a steady motion.

    Attributes:
        pair: the joint.
        along, own: (6,) lambda in F's axes and rho in G's, angular, then linear.
        rotor: a number that those have in common that turn of their own as one body; -1 of what turns with the whole.
    """

    pair: TurningPair
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
class OwnTurns:
    """Turns of a symmetric body about k axes through its centre.

    Attributes:
        along: (nv, k) velocities at 1 rad/s.
        turning: (k, nv, nv) B of ``Slopes`` of each.
        held: (3, k) m/s, what its joint does not let it move by.
    """

    along: FloatArray
    turning: FloatArray
    held: FloatArray


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
            a[one.pair.slides] = one.pair.D.T @ (_cross(w_l) @ linear + R @ _cross(w) @ r)
            if one.pair.spin is not None:
                a[one.pair.spin] = -_cross(w_r) @ R.T @ w_l
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
            change = across @ lever + R @ _cross(_cross(seen + w_r) @ r) + lever @ spun
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

    def symmetric_turns(self, work: Work, x: FloatArray) -> Iterator[OwnTurns]:
        """Turns of symmetric bodies about their axes; whether they change anything depends on what holds the body."""
        plan = self.scene.plan
        bodies = {one.pair.body: one.pair for one in self.pairs if one.pair.spin is not None}
        forward_kinematics(plan, work, x, *np.zeros((2, self.scene.nv)))
        seen = [(pair, body_motion(work, row), world_motion(plan, work, pair.g)) for row, pair in bodies.items()]
        for pair, body, G in seen:
            if masses(plan)[pair.body] == 0.0:
                continue
            centre, second = second_moment(plan, pair.body)
            arm = G.R.T @ (body.p + body.R @ centre - G.p)
            axes = axes_of_symmetry(second) @ (G.R.T @ body.R).T
            if not len(axes):
                continue
            turns = [CarriedPair(pair, np.zeros(6), np.append(axis, _cross(arm) @ axis), 0) for axis in axes]
            motions = [SteadyMotion(self.scene, (turn,)) for turn in turns]
            along = np.array([one.velocities(work, x, np.zeros(self.scene.nv)) for one in motions]).T
            slides = np.array([turn.own[3:] for turn in turns]).T
            held = slides if not len(pair.slides) else np.zeros((3, len(axes)))
            yield OwnTurns(along, np.array([one.slopes(work, x).turning for one in motions]), held)

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

    def bend(self, work: Work, x: FloatArray, t: float, force: FloatArray) -> FloatArray:
        """(nv, nv) by which T^T force changes with the place x (nx,), as T does, a time t (s) later; force (nv,)."""
        change = np.zeros((self.scene.nv, self.scene.nv))
        for one, _, R in self._poses(work, x):
            pair = one.pair
            left, right = _displacement(one.along * t), _displacement(one.own * t)
            pull = R.T @ left[:3, :3].T @ pair.D @ force[pair.slides]
            change[np.ix_(pair.turns, pair.turns)] = pair.S.T @ _cross(right[:3, 3]) @ _cross(pull) @ pair.S
        return change

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
    return np.asarray(rates > SAME_MOTION * rates.max(initial=0.0))


def carried(
    scene: CompiledScene, work: Work, x: FloatArray, v: FloatArray, whole: FloatArray, pairs: Sequence[TurningPair]
) -> SteadyMotion:
    """The steady motion that goes through x (nx,), v (nv,) if the whole has the twist ``whole`` (6,).

    Args:
        scene: the machine.
        work: scratch.
        x: (nx,) where.
        v: (nv,) how fast.
        whole: angular velocity (rad/s) and velocity of what is at the inertial origin (m/s), in inertial axes.
        pairs: of ``turning_pairs``.
    """
    moving = moves(scene, v)
    pairs = [pair for pair in pairs if pair.on_ground or moving[pair.v].any()]
    forward_kinematics(scene.plan, work, x, v, np.zeros(scene.nv))
    ends = [[world_motion(scene.plan, work, frame) for frame in (pair.f, pair.g)] for pair in pairs]
    same = Alike.of([twist_of(one) for both in ends for one in both], scene.extent)
    rotors: list[FloatArray] = []
    found = []
    for pair, both in zip(pairs, ends, strict=True):
        beside = [(one, twist_of(one) - whole) for one in both]
        along, own = (_seen_by(one, twist) if same.size(twist) > same.most else np.zeros(6) for one, twist in beside)
        if not along.any() and not own.any():
            continue
        rotor = -1
        if own.any():
            twist = twist_of(both[1])
            rotor = next((k for k, other in enumerate(rotors) if same(twist, other)), len(rotors))
            rotors[rotor:] = rotors[rotor:] or [twist]
        found.append(CarriedPair(pair, -along, own, rotor))
    return SteadyMotion(scene, tuple(found))


def _seen_by(frame: RigidMotion, twist: FloatArray) -> FloatArray:
    """A twist (6,) of inertial axes about a frame's origin, in its axes."""
    return np.concatenate([frame.R.T @ twist[:3], frame.R.T @ (twist[3:] + np.cross(twist[:3], frame.p))])


def _rates(one: CarriedPair, p: FloatArray, R: FloatArray) -> tuple[FloatArray, FloatArray]:
    """dp/dt in F's axes and the angular velocity in G's."""
    (w_l, linear), (w_r, r) = np.split(one.along, 2), np.split(one.own, 2)
    return linear + _cross(w_l) @ p + R @ r, R.T @ w_l + w_r


def _cross(a: FloatArray) -> FloatArray:
    """(3, 3) a x."""
    x, y, z = a
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def _displacement(twist: FloatArray) -> FloatArray:
    """(4, 4) exp of a twist (6,)."""
    matrix = np.zeros((4, 4))
    matrix[:3, :3], matrix[:3, 3] = _cross(twist[:3]), twist[3:]
    return np.asarray(scipy.linalg.expm(matrix), dtype=np.float64)
