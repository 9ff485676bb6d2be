"""What is asked of a machine, as a user would, and compared: nothing here depends on coordinates."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from random_machine import Units

#: The mirror: y becomes -y.
MIRROR = np.diag([1.0, -1.0, 1.0])


@dataclass(frozen=True, eq=False)
class Moment:
    """A machine at an instant, in inertial axes.

    Attributes:
        p, R, v, w, a: (k, 3), (k, 3, 3), ... of the probes.
        wrenches: (j, 6) N and N m about the ground's origin that each link exerts on its child.
        energies: (4,) kinetic, elastic, gravitational, of springs.
    """

    p: np.ndarray
    R: np.ndarray
    v: np.ndarray
    w: np.ndarray
    a: np.ndarray
    wrenches: np.ndarray
    energies: np.ndarray

    def mirrored(self):
        """Seen in the mirror of `transformations.mirrored`."""
        p, v, a = (one @ MIRROR for one in (self.p, self.v, self.a))
        forces, torques = self.wrenches[:, :3] @ MIRROR, -self.wrenches[:, 3:] @ MIRROR
        return Moment(
            p, MIRROR @ self.R @ MIRROR, v, -self.w @ MIRROR, a, np.hstack([forces, torques]), self.energies
        )

    def in_units(self, u):
        """With all numbers in other units."""
        moment = u.force * u.length
        return Moment(
            self.p * u.length,
            self.R,
            self.v * u.speed,
            self.w / u.time,
            self.a * u.speed / u.time,
            self.wrenches * np.repeat([u.force, moment], 3),
            self.energies * moment,
        )


def moment(machine, built, run, row):
    """A row of a run, as a Moment; links in the order of their names."""
    frames = [built.frame(machine.probes[name]) for name in sorted(machine.probes)]
    parts = [run.position, run.rotation, run.velocity, run.angular_velocity, run.acceleration]
    motion = [np.array([ask(frame)[row] for frame in frames]) for ask in parts]
    links = [] if machine.has_hard_contacts else machine.links  # beside impulses no reactions are told
    wrenches = [_wrench(built, run, link, row) for link in sorted(links, key=lambda link: link.name) if compared(link)]
    energy = run.energy()
    energies = [part[row] for part in (energy.kinetic, energy.elastic, energy.gravitational, energy.spring)]
    return Moment(*motion, np.array(wrenches).reshape(-1, 6), np.array(energies))  # type: ignore[call-arg]


def described(machine, seen):
    """What a machine's description has its probes do at the start, with the rest of a Moment as it was seen."""
    poses = [machine.pose(machine.probes[name]) for name in sorted(machine.probes)]
    return replace(seen, **{part: np.array([getattr(pose, part) for pose in poses]) for part in "pRvw"})


def compared(link):
    """Links that a transformation put in have no counterpart."""
    return not link.name.startswith("weld")


def _wrench(built, run, link, row):
    connection = built.joints[link.name]
    force, torque = np.split(run.reaction(connection)[row], 2)
    R, p = run.rotation(connection.child)[row], run.position(connection.child)[row]
    force, torque = R @ force, R @ torque
    return (-1.0 if link.swapped else 1.0) * np.concatenate([force, torque + np.cross(p, force)])


@dataclass(frozen=True, eq=False)
class Sizes:
    """What differences are measured by: the sizes of a machine's own motion and forces.

    Attributes:
        length, speed, turning, acceleration, force, energy: m, m/s, 1/s, m/s^2, N, J.
    """

    length: float
    speed: float
    turning: float
    acceleration: float
    force: float
    energy: float

    def in_units(self, u):
        force = u.force
        return Sizes(
            self.length * u.length,
            self.speed * u.speed,
            self.turning / u.time,
            self.acceleration * u.speed / u.time,
            self.force * force,
            self.energy * force * u.length,
        )


def sizes(machine, seen):
    """The sizes of a machine whose state is ``seen``: a speed is also what its accelerations make in its own time."""
    length = machine.extent
    acceleration = max(float(np.abs(seen.a).max()), float(np.abs(machine.gravity).max()), 1e-2 * length)
    turning = max(float(np.abs(seen.w).max()), np.sqrt(acceleration / length))
    speed = max(float(np.abs(seen.v).max()), length * turning)
    masses = [part.body.build().mass for part in machine.parts]
    force = max(float(np.abs(seen.wrenches[:, :3]).max(initial=0.0)), sum(masses) * acceleration)
    force = max(force, float(np.abs(seen.wrenches[:, 3:]).max(initial=0.0)) / length)
    return Sizes(length, speed, turning, acceleration, force, max(force * length, float(np.abs(seen.energies).max())))


def differences(one, other, by, *, reactions=True):
    """The largest difference of each kind between two Moments, over the size of its kind."""
    found = {
        "position": np.abs(one.p - other.p).max() / by.length,
        "rotation": np.abs(one.R - other.R).max(),
        "velocity": np.abs(one.v - other.v).max() / by.speed,
        "turning": np.abs(one.w - other.w).max() / by.turning,
        "acceleration": np.abs(one.a - other.a).max() / by.acceleration,
        "energy": np.abs(one.energies - other.energies).max() / by.energy,
    }
    if reactions and len(one.wrenches):
        gap = np.abs(one.wrenches - other.wrenches).max(axis=0)
        found["force"] = gap[:3].max() / by.force
        found["moment"] = gap[3:].max() / (by.force * by.length)
    return {name: float(value) for name, value in found.items()}


SAME = Units()
