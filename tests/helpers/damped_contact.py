"""A ball that falls on a spring with a damper, whose force jumps where they touch: the motion by closed forms."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import brentq

import flexmbd as fm


@dataclass(frozen=True)
class DampedContact:
    """Force -stiffness (y - radius) - damping v on the ball where y < radius, none above; gravity (m/s^2) downwards."""

    stiffness: float = 2e6
    damping: float = 200.0
    mass: float = 0.25
    radius: float = 0.05
    gravity: float = 9.81
    height: float = 0.1

    def end(self, t_end: float) -> tuple[float, float]:
        """Height and velocity at ``t_end`` (s) after a fall from rest."""
        t, y, v = 0.0, self.height, 0.0
        while True:
            fall = (v + np.sqrt(v * v + 2.0 * self.gravity * (y - self.radius))) / self.gravity
            if t + fall >= t_end:
                s = t_end - t
                return y + v * s - 0.5 * self.gravity * s * s, v - self.gravity * s
            t, v = t + fall, v - self.gravity * fall
            place, speed, last = self._contact(v)
            if t + last >= t_end:
                return place(t_end - t), speed(t_end - t)
            t, y, v = t + last, self.radius, speed(last)

    def _contact(self, v):
        """Place and velocity over the time since they touched at a velocity, and how long they do."""
        decay = 0.5 * self.damping / self.mass
        rate = np.sqrt(self.stiffness / self.mass - decay**2)
        rest = self.radius - self.mass * self.gravity / self.stiffness
        a = self.radius - rest
        b = (v + decay * a) / rate

        def place(s):
            return rest + np.exp(-decay * s) * (a * np.cos(rate * s) + b * np.sin(rate * s))

        def speed(s):
            swing = (b * rate - decay * a) * np.cos(rate * s) - (a * rate + decay * b) * np.sin(rate * s)
            return np.exp(-decay * s) * swing

        turns = np.linspace(1e-3, 2.0 * np.pi, 4000) / rate
        k = int(np.flatnonzero(place(turns) > self.radius)[0])
        return place, speed, brentq(lambda s: place(s) - self.radius, turns[k - 1], turns[k], xtol=1e-18, rtol=1e-15)

    def scene(self, law, count: int = 1) -> tuple[fm.System, list]:
        """So many balls side by side, each with a law, and their joints."""
        scene, joints = fm.System(gravity=(0.0, -self.gravity, 0.0)), []
        for k in range(count):
            ball = scene.add(fm.RigidBody(self.mass, (1e-3,) * 3), name=f"ball {k}")
            joints.append(scene.connect(fm.joint.Prismatic("y"), scene.ground.frame(), ball.frame(), name=f"drop {k}"))
            joints[-1].position = self.height
            scene.add_force(fm.force.JointLaw(joints[-1], law))
        return scene, joints

    def errors(self, run, joint) -> tuple[float, float]:
        """Of a run's last height, over the first one, and of its last velocity, over that of the first touch."""
        y, v = self.end(float(run.t[-1]))
        fastest = np.sqrt(2.0 * self.gravity * (self.height - self.radius))
        return abs(run.beta(joint)[-1] - y) / self.height, abs(run.beta_rate(joint)[-1] - v) / fastest


CONTACT = DampedContact()
METHODS: dict[str, Any] = {
    "5(4)": fm.ExplicitRungeKutta(), "8(5,3)": fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8), "Radau": fm.RadauIIA(),
    "alpha": fm.GeneralizedAlpha(), "energy-momentum": fm.EnergyMomentum(), "central": fm.CentralDifference(),
}  # fmt: skip
