"""A machine at one instant: kinematics of its frames, coordinates of joints and bodies, reactions."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.errors import SceneError
from flexmbd.given import numbers, refuse_other
from flexmbd.multibody.bodies.body import Body, Frame
from flexmbd.multibody.bodies.point_mass import refuse_turn
from flexmbd.multibody.bodies.port import Port
from flexmbd.multibody.joint.connection import Connection
from flexmbd.multibody.kernels.reading.force_tables import refuse_hard_contacts
from flexmbd.multibody.motion.machine import Machine
from flexmbd.multibody.motion.memory_series import memory_series
from flexmbd.multibody.motion.moving_frames import MovingFrames
from flexmbd.multibody.motion.port_efforts import port_efforts
from flexmbd.multibody.motion.quantity import ORDERS, Output
from flexmbd.multibody.motion.reaction import reactions
from flexmbd.overflow import finite_answer, looked_at

FloatArray = NDArray[np.float64]


class Instant:
    """A machine at one instant; vectors are in inertial axes.

    All answers raise SceneError where a frame, joint or body is of another scene, and where a joint has no coordinates
    or a body no modes.  They are arrays of their own.

    Attributes:
        scene: the compiled scene.
        t: time (s).
        x, v, a: (nx,), (nv,), (nv,) configuration, velocities and accelerations.
        multipliers: (m,) reactions of the loops (N or N m); None where they are not solved for.
    """

    scene: Machine
    t: float
    x: FloatArray
    v: FloatArray
    a: FloatArray
    multipliers: FloatArray | None

    def __init__(
        self,
        scene: Machine,
        t: float,
        x: FloatArray,
        v: FloatArray,
        a: FloatArray,
        multipliers: FloatArray | None = None,
    ) -> None:
        self.scene, self.t, self.multipliers = scene, t, multipliers
        self.x, self.v, self.a = (np.ascontiguousarray(part) for part in (x, v, a))

    def position(self, frame: Frame) -> FloatArray:
        """(3,) m, of the frame's origin."""
        return self._told(frame, "p")

    def rotation(self, frame: Frame) -> FloatArray:
        """(3, 3) rotation from the frame's axes to inertial ones."""
        refuse_turn(frame, "rotation")
        return self._told(frame, "R")

    def velocity(self, frame: Frame) -> FloatArray:
        """(3,) m/s, of the frame's origin."""
        return self._told(frame, "v")

    def angular_velocity(self, frame: Frame) -> FloatArray:
        """(3,) rad/s."""
        refuse_turn(frame, "angular velocity")
        return self._told(frame, "w")

    def acceleration(self, frame: Frame) -> FloatArray:
        """(3,) m/s^2, of the frame's origin."""
        return self._told(frame, "a")

    def angular_acceleration(self, frame: Frame) -> FloatArray:
        """(3,) rad/s^2."""
        refuse_turn(frame, "angular acceleration")
        return self._told(frame, "alpha")

    def beta(self, connection: Connection) -> FloatArray:
        """Coordinates of a joint (rad or m): a number where there is one, else (k,)."""
        return _single(self.x[self.scene.index.coordinates(connection).x])

    def beta_rate(self, connection: Connection) -> FloatArray:
        """Velocities of a joint (rad/s or m/s): a number where there is one, else (k,)."""
        return _single(self.v[self.scene.index.coordinates(connection).v])

    def q(self, body: Body) -> FloatArray:
        """(n,) modal coordinates."""
        return self.x[self.scene.index.modal(body).x].copy()

    def q_rate(self, body: Body) -> FloatArray:
        """(n,) rates of the modal coordinates."""
        return self.v[self.scene.index.modal(body).v].copy()

    def port_effort(self, port: Port) -> float:
        """Effort of a body's port, as an electrode's voltage (V)."""
        refuse_other(port, Port, "what is asked for its effort", wanted='a port, as body.port("top")')
        return float(self._efforts(port)[port.number])

    def port_flow(self, port: Port) -> float:
        """Flow of a body's port, as an electrode's charge (C): that of the strain, and capacity . efforts."""
        refuse_other(port, Port, "what is asked for its flow", wanted='a port, as body.port("top")')
        capacity = port.body.record.ports.capacity[port.number]
        return float(port.flow_of_strain(self.q(port.body)[None])[0] + capacity @ self._efforts(port))

    def _efforts(self, port: Port) -> FloatArray:
        """Of all ports of a port's body."""
        return port_efforts(self.scene, port.body, np.array([self.t]), self.x[None], self.v[None])[0]

    def states(self, states: object) -> FloatArray:
        """(n,) values of a user's state equations, of ``System.add_states``."""
        places = self.scene.index.state_places(states)
        return self.v[places.v] * places.scale

    def remembered(self, force: object) -> dict[str, FloatArray]:
        """The memory of a force element, by name, each a number; see ``Trajectory.remembered``."""
        return {name: series[0] for name, series in memory_series(self.scene.index, force, self.x[None]).items()}

    def reaction(self, connection: Connection) -> FloatArray:
        """(6,) force (N) and moment (N m) that a joint's parent exerts on its child through the joint.

        The moment is about the origin of the child's frame; both are in that frame's axes.

        Raises:
            SceneError: nobody has solved for the loops' reactions, or they are redundant, so that only a trajectory
                shares them out.
        """
        if self.multipliers is None or self.scene.redundant:
            why = "its loops are redundant" if self.scene.redundant else "nobody has solved for it there"
            raise SceneError(
                f"the reaction of joint {connection.name!r} at t = {self.t:g} s is not known: {why}; ask a "
                "trajectory, run.reaction(joint)"
            )
        refuse_hard_contacts(self.scene.plan, "the reaction of a joint at one instant")
        rows = (np.array([self.t]), self.x[None], self.v[None], self.a[None], self.multipliers[None])
        with looked_at():
            found = reactions(self.scene, connection, *rows)
        return finite_answer(f"the reaction of joint {connection.name!r}", rows[0], found)[0]

    def _told(self, frame: Frame, quantity: str) -> FloatArray:
        """One of ``FrameKinematics``."""
        with looked_at():
            found: FloatArray = getattr(self._frames.motion(frame), quantity)
        if not np.isfinite(found).all():
            finite_answer(f"the motion of frame {frame.label!r}", np.array([self.t]), found[None])
        return found

    @cached_property
    def _frames(self) -> MovingFrames:
        return MovingFrames(self.scene).move(self.x, self.v, self.a)


def _single(values: FloatArray) -> FloatArray:
    return values[0] if len(values) == 1 else values.copy()


def measure(quantity: Output | Callable[[Instant], ArrayLike], now: Instant) -> FloatArray:
    """A quantity at an instant, (k,): of a frame in inertial axes, of a joint or a flexible body its coordinates.

    Raises:
        SceneError: it is not in the machine, or a function gives no finite numbers (k,).
    """
    if isinstance(quantity, Output):
        of, order = quantity.of, ORDERS[type(quantity)]
        if isinstance(of, Frame):
            return np.array((now.position, now.velocity, now.acceleration)[order](of))
        index = now.scene.index
        slots = index.coordinates(of) if isinstance(of, Connection) else index.modal(of)
        return np.array((now.x[slots.x], now.v[slots.v], now.a[slots.v])[order])
    values = np.atleast_1d(numbers(quantity(now)))
    if values.ndim != 1 or not np.isfinite(values).all():
        raise SceneError(f"a measurement gave {values}, not finite numbers (k,)")
    return values
