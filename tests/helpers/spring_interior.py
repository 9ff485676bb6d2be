"""An interior of point masses and springs between two frames, and the same machine made of rigid bodies."""

from __future__ import annotations

import numpy as np
import scipy.linalg

import flexmbd as fm
from flexmbd.errors import ConvergenceError
from flexmbd.multibody.bodies.continuum_body import InteriorFrame, Push
from flexmbd.multibody.interiors.steady import LinearInterior


def skew(r):
    return np.array([[0.0, -r[2], r[1]], [r[2], 0.0, -r[0]], [-r[1], r[0], 0.0]])


class Springs:
    """Point masses and springs whose first points are bonded to frames: what both ways of stepping share.

    A spring's force is k (e - s) + cubic e^3 at the elongation e; s slips where it exceeds yield + hardening p.
    """

    def __init__(
        self, points, bonds, springs, masses, *, stiffness, cubic=0.0, limit=np.inf, hardening=0.0,
        com=(0.01, 0.0, -0.02), R=None,
    ):
        self.points = np.array(points, float)
        self.bonds = np.array(bonds)  # frame of each of the first points
        self.springs = np.array(springs)
        self.masses = np.array(masses, float)
        self.k, self.cubic, self.limit, self.hardening = stiffness, cubic, limit, hardening
        ends = self.points[self.springs]
        self.lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        turns = [np.eye(3)] * 2 if R is None else R
        self.frames = tuple(
            InteriorFrame(
                f"end {k}", self.points[np.flatnonzero(self.bonds == k)].mean(axis=0), turns[k], 1.3,
                np.array(com), np.diag([0.02, 0.03, 0.025]),
            )
            for k in range(self.bonds.max() + 1)
        )
        self.arms = np.array(
            [self.frames[f].R_BI.T @ (self.points[i] - self.frames[f].p_BI_B) for i, f in enumerate(self.bonds)]
        )
        self.n = len(self.bonds)

    @property
    def mass(self):
        return float(self.masses.sum())

    def bonded(self, motion):
        """Positions, velocities, accelerations of the bonded points, and arms in inertial axes."""
        f = self.bonds
        r = np.einsum("iab,ib->ia", motion.R[f], self.arms)
        spin = np.cross(motion.w[f], r)
        a = motion.a[f] + np.cross(motion.alpha[f], r) + np.cross(motion.w[f], spin)
        return motion.p[f] + r, motion.v[f] + spin, a, r

    def begin(self, t, motion, gravity):
        self.t, self.g = t, np.array(gravity)
        first = self.frames[0]
        R = motion.R[0] @ first.R_BI.T
        arm = (self.points - first.p_BI_B) @ R.T
        self.x = motion.p[0] + arm
        self.v = motion.v[0] + np.cross(motion.w[0], arm)
        self.x[: self.n], self.v[: self.n], bonded_a, r = self.bonded(motion)
        self.slip, self.slipped = np.zeros((2, len(self.springs)))
        force, self.slip, self.slipped, _ = self.pull(self.x)
        self.a = np.zeros_like(self.x)
        self.a[self.n :] = force[self.n :] / self.masses[self.n :, None] + self.g
        self.a[: self.n] = bonded_a
        self.worked = 0.0
        return self.wrench(force, self.a, r)

    def pull(self, x):
        """Forces on the points, the history at the end, and slopes of the springs' forces."""
        d = x[self.springs[:, 1]] - x[self.springs[:, 0]]
        length = np.linalg.norm(d, axis=1)
        e = length - self.lengths
        if (length < 0.2 * self.lengths).any():
            raise ConvergenceError("a spring is crushed")
        N = self.k * (e - self.slip)
        excess = np.maximum(np.abs(N) - self.limit - self.hardening * self.slipped, 0.0)
        step = excess / (self.k + self.hardening)
        slip = self.slip + np.sign(N) * step
        slope = np.where(excess > 0.0, self.k * self.hardening / (self.k + self.hardening), self.k)
        N = self.k * (e - slip) + self.cubic * e**3
        slope = slope + 3.0 * self.cubic * e**2
        direction = d / length[:, None]
        force = np.zeros_like(x)
        np.add.at(force, self.springs[:, 0], N[:, None] * direction)
        np.add.at(force, self.springs[:, 1], -N[:, None] * direction)
        return force, slip, self.slipped + step, (N, slope, length, direction)

    def wrench(self, force, a, r):
        """What the bonded points exert on the frames, their own mass and weight included."""
        out = np.zeros((len(self.frames), 6))
        push = force[: self.n] - self.masses[: self.n, None] * (a[: self.n] - self.g)
        for i, f in enumerate(self.bonds):
            out[f, :3] += push[i]
            out[f, 3:] += np.cross(r[i], push[i])
        return out

    names = ("t", "x", "v", "a", "slip", "slipped", "g")

    def snapshot(self):
        return {name: np.array(getattr(self, name)) for name in self.names}

    def restore(self, memory):
        for name in self.names:
            setattr(self, name, np.array(memory[name]))

    def energies(self):
        e = np.linalg.norm(self.x[self.springs[:, 1]] - self.x[self.springs[:, 0]], axis=1) - self.lengths
        yielded = np.where(self.slipped > 0.0, self.limit, 0.0) * self.slipped
        return {
            "kinetic": 0.5 * float(self.masses @ (self.v**2).sum(axis=1)),
            "elastic": float((0.5 * self.k * (e - self.slip) ** 2 + 0.25 * self.cubic * e**4).sum()),
            "plastic": float((yielded + 0.5 * self.hardening * self.slipped**2).sum()),
            "gravitational": -float(self.masses @ self.x @ self.g),
        }


class ExplicitSprings(Springs):
    """By central differences; bonded points have no mass of their own."""

    share = 1.0

    def stable_step(self):
        """Of the interior points alone, their frames held: the largest eigenvalue."""
        K = np.zeros((3 * len(self.x),) * 2)
        _, _, _, (N, slope, length, n) = self.pull(self.x)
        for s, (i, j) in enumerate(self.springs):
            k = slope[s] * np.outer(n[s], n[s]) + N[s] / length[s] * (np.eye(3) - np.outer(n[s], n[s]))
            for a, b, sign in ((i, i, 1), (j, j, 1), (i, j, -1), (j, i, -1)):
                K[3 * a : 3 * a + 3, 3 * b : 3 * b + 3] += sign * k
        free = slice(3 * self.n, None)
        root = np.sqrt(np.repeat(self.masses[self.n :], 3))
        rate = np.sqrt(np.linalg.eigvalsh(K[free, free] / np.outer(root, root))[-1])
        return self.share * 2.0 / rate

    def advance(self, h, start, end):
        x0, v0, _, _ = self.bonded(start)
        x1, v1, _, r1 = self.bonded(end)
        steps = max(1, int(np.ceil(h / self.stable_step() - 1e-9)))
        dt = h / steps
        first = self.wrench(self.pull(self.x)[0], 0.0 * self.a, self.bonded(start)[3])
        total = np.zeros_like(first)
        for k in range(steps):
            self.x[self.n :] += dt * self.v[self.n :] + 0.5 * dt * dt * self.a[self.n :]
            s = (k + 1) / steps
            self.x[: self.n] = x1 if s == 1.0 else x0 + s * h * v0 + s * s * (x1 - x0 - h * v0)
            force, self.slip, self.slipped, _ = self.pull(self.x)
            a = force[self.n :] / self.masses[self.n :, None] + self.g
            self.v[self.n :] += 0.5 * dt * (self.a[self.n :] + a)
            self.a[self.n :] = a
            r = r1 if s == 1.0 else (1 - s) * self.bonded(start)[3] + s * r1
            last = self.wrench(force, 0.0 * self.a, r)
            total += 0.5 * (first + last) / steps
            first = last
        self.v[: self.n] = v1
        self.t = self.t + h
        return Push(last, total)


class ImplicitSprings(Springs):
    """By generalized-alpha, solved by Newton; bonded points may have mass."""

    names = (*Springs.names, "auxiliary", "h")

    def begin(self, t, motion, gravity):
        answer = super().begin(t, motion, gravity)
        self._start_scheme()
        return answer

    def _start_scheme(self):
        self.auxiliary, self.h = self.a.copy(), 0.0
        self.trials = 0
        self._trial = None

    def trial(self, t_end, h, scheme, motion):
        self.trials += 1
        n = self.n
        per_x, _ = scheme.slopes(h)
        auxiliary = self.auxiliary
        if self.h:
            auxiliary = scheme.carry(auxiliary, h, float(self.h), self.a)
        x, v, a = self.x.copy(), self.v.copy(), self.a.copy()
        x[:n], v[:n], a[:n], r = self.bonded(motion)
        masses = np.repeat(self.masses, 3)
        for _ in range(30):
            move, v[n:], last = scheme.end(h, self.v[n:], self.a[n:], auxiliary[n:], a[n:])
            x[n:] = self.x[n:] + move
            force, slip, slipped, (N, slope, length, d) = self.pull(x)
            K = self.matrix(N, slope, length, d)
            gap = (self.masses[n:, None] * (a[n:] - self.g) - force[n:]).ravel()
            inner = np.diag(masses[3 * n :]) / per_x + K[3 * n :, 3 * n :]
            change = np.linalg.solve(inner, gap) / per_x
            a[n:] -= change.reshape(-1, 3)
            if np.abs(change).max(initial=0.0) * per_x < 1e-15:
                break
        else:
            raise ConvergenceError("the springs find no balance")
        push = force[:n] - self.masses[:n, None] * (a[:n] - self.g)
        # bonded points' forces by their displacements: the others follow
        outer = K[: 3 * n, : 3 * n] + np.diag(masses[: 3 * n]) / per_x
        stiffness = outer - K[: 3 * n, 3 * n :] @ np.linalg.solve(inner, K[3 * n :, : 3 * n])
        rigid, tangent = self.carried(r, push)
        tangent -= rigid.T @ stiffness @ rigid
        whole = np.concatenate([np.zeros_like(auxiliary[:n]), last])
        self._trial = (t_end, x, v, a, slip, slipped, whole, h)
        return self.wrench(force, a, r), tangent

    def matrix(self, N, slope, length, d):
        """Derivative of minus the forces on the points by their places."""
        K = np.zeros((3 * len(self.points),) * 2)
        for s, (i, j) in enumerate(self.springs):
            k = slope[s] * np.outer(d[s], d[s]) + N[s] / length[s] * (np.eye(3) - np.outer(d[s], d[s]))
            for p, q, sign in ((i, i, 1), (j, j, 1), (i, j, -1), (j, i, -1)):
                K[3 * p : 3 * p + 3, 3 * q : 3 * q + 3] += sign * k
        return K

    def carried(self, r, push):
        """Motions of the bonded points by those of their frames, and what turning arms do to the moments of pushes."""
        rigid, turning = np.zeros((3 * self.n, 6 * len(self.frames))), np.zeros((6 * len(self.frames),) * 2)
        for i, f in enumerate(self.bonds):
            rigid[3 * i : 3 * i + 3, 6 * f : 6 * f + 3] = np.eye(3)
            rigid[3 * i : 3 * i + 3, 6 * f + 3 : 6 * f + 6] = -skew(r[i])
            turned = slice(6 * f + 3, 6 * f + 6)
            turning[turned, turned] += skew(push[i]) @ skew(r[i])
        return rigid, turning

    def equilibrate(self, t, motion):
        n, x, v, still = self.n, self.x.copy(), self.v.copy(), np.zeros_like(self.x)
        x[:n], _, _, r = self.bonded(motion)
        v[:] = motion.v[0]
        for _ in range(60):
            force, slip, slipped, parts = self.pull(x)
            K = self.matrix(*parts)
            inner = K[3 * n :, 3 * n :]
            change = np.linalg.solve(inner, (force[n:] + self.masses[n:, None] * self.g).ravel())
            x[n:] += min(1.0, 0.1 / max(np.abs(change).max(initial=0.0), 1e-9)) * change.reshape(-1, 3)
            if np.abs(change).max(initial=0.0) < 1e-13:
                break
        else:
            raise ConvergenceError("the springs find no balance")
        stiffness = K[: 3 * n, : 3 * n] - K[: 3 * n, 3 * n :] @ np.linalg.solve(inner, K[3 * n :, : 3 * n])
        rigid, tangent = self.carried(r, force[:n] + self.masses[:n, None] * self.g)
        self._trial = (t, x, v, still, slip, slipped, still, 0.0)
        return self.wrench(force, still, r), tangent - rigid.T @ stiffness @ rigid

    def resume(self, t, motion):
        _, _, bonded_a, r = self.bonded(motion)
        force = self.pull(self.x)[0]
        self.t = t
        self.a = np.zeros_like(self.x)
        self.a[: self.n] = bonded_a
        self.a[self.n :] = force[self.n :] / self.masses[self.n :, None] + self.g
        self._start_scheme()
        return self.wrench(force, self.a, r)

    def linear(self, motion, modes):
        n, (_, _, _, r) = self.n, self.bonded(motion)
        force, _, _, (N, _, length, d) = self.pull(self.x)
        K = self.matrix(N, self.k + 0.0 * N, length, d)
        masses = np.repeat(self.masses, 3)
        free = slice(3 * n, None)
        values, shapes = scipy.linalg.eigh(K[free, free], np.diag(masses[free]))
        count = min(modes.count, int(np.sum(values < (2.0 * np.pi * modes.below_hz) ** 2)))
        push = force + self.masses[:, None] * self.g
        rigid, turning = self.carried(r, push[:n])
        k = 6 * len(self.frames)
        onto = np.zeros((len(masses), k + count))
        onto[: 3 * n, :k] = rigid
        onto[free, :k] = -np.linalg.solve(K[free, free], K[free, : 3 * n] @ rigid)
        onto[free, k:] = shapes[:, :count]
        stiffness = onto.T @ K @ onto
        stiffness[:k, :k] -= turning
        lacking = -onto.T @ push.ravel()
        lacking[:k] = -self.wrench(force, 0.0 * self.a, r).ravel()
        return LinearInterior(onto.T @ (masses[:, None] * onto), 0.0 * stiffness, stiffness, lacking)

    def commit(self):
        (self.t, self.x, self.v, self.a, self.slip, self.slipped, self.auxiliary, self.h) = self._trial
        self._trial = None

    def revert(self):
        self._trial = None


def chain(kind, n=3, *, span=1.0, density=0.4, **options):
    """A slender lattice from x = 0 to ``span``: n cross sections of three points; those at the ends are bonded."""
    ring = 0.1 * np.array([[0.0, 1.0, 0.0], [0.0, -0.5, 0.8], [0.0, -0.5, -0.8]])
    stations = [0, n + 1, *range(1, n + 1)]
    points = [np.array([span * s / (n + 1), 0.0, 0.0]) + p for s in stations for p in ring]
    bonds = [0, 0, 0, 1, 1, 1]
    index = {s: k for k, s in enumerate(stations)}
    springs = [(3 * k + a, 3 * k + b) for s, k in index.items() if 0 < s <= n for a, b in ((0, 1), (1, 2), (2, 0))]
    for s in range(n + 1):
        i, j = 3 * index[s], 3 * index[s + 1]
        springs += [(i + a, j + b) for a in range(3) for b in range(3)]
    masses = [0.0] * 6 + [density] * (3 * n)
    return kind(points, bonds, springs, masses, **options)


def as_continuum(scene, interior):
    """Put the interior into a scene; its frames by number."""
    body = scene.add(fm.ContinuumBody(interior), name="lattice")
    return body, [body.frame(frame.name) for frame in interior.frames]


def as_rigid_bodies(scene, interior, *, spin=(0.0, 0.0, 0.0)):
    """The same of rigid bodies and the machine's own springs, turning about the origin: the frames."""
    parts = [
        scene.add(fm.RigidBody(f.mass, f.inertia, tuple(f.com)), name=f"twin.{f.name}") for f in interior.frames
    ]
    marks = [parts[f].frame(interior.arms[i]) for i, f in enumerate(interior.bonds)]
    for i in range(interior.n, len(interior.points)):
        m = interior.masses[i]
        point = scene.add(fm.RigidBody(m, (m, m, m)), name=f"point {i}")
        free = scene.connect(fm.joint.Free(), scene.ground.frame(), point.frame())
        arm = interior.points[i]
        free.position = [*arm, 1.0, 0.0, 0.0, 0.0]
        free.velocity = [*np.cross(spin, arm), 0.0, 0.0, 0.0]
        marks.append(point.frame())
    for s, (i, j) in enumerate(interior.springs):
        scene.add_force(fm.force.SpringDamper(marks[i], marks[j], interior.k, interior.lengths[s]))
    return [part.frame() for part in parts]

