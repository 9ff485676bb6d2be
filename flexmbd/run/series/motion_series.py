"""Kinematics of a machine over its rows: frames, joint and modal coordinates, momenta, at any time."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.given import checked, refuse_other
from flexmbd.multibody.bodies.body import Body, Frame
from flexmbd.multibody.bodies.point_mass import refuse_turn
from flexmbd.multibody.bodies.pseudo_rigid_body import PseudoRigidBody
from flexmbd.multibody.force.protocol import WithStates
from flexmbd.multibody.force.states import States
from flexmbd.multibody.joint.connection import Connection
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.kernels.sampling.series import body_series, frame_series
from flexmbd.multibody.plan.compiled_scene import CompiledScene, add_probe
from flexmbd.multibody.results.momentum import Momentum, momentum_of
from flexmbd.multibody.scene_index import Slots
from flexmbd.overflow import finite_answer, looked_at
from flexmbd.run.series.dense_output import motion_between
from flexmbd.run.series.departure import Departure

FloatArray = NDArray[np.float64]


class MotionSeries:
    """Questions to the rows of a `Trajectory` that its configurations, velocities and accelerations answer.

    An answer beyond what doubles hold at some instant, as of a run that diverged, is a SceneError that names it.

    Attributes:
        scene, t, x, v, a, departures: as there.
    """

    scene: CompiledScene
    t: FloatArray
    x: FloatArray
    v: FloatArray
    a: FloatArray
    departures: tuple[Departure, ...]

    def position(self, frame: Frame, *, t: ArrayLike | None = None) -> FloatArray:
        """(nt, 3) m, position of the frame's origin in the inertial frame; or at times ``t`` (k,)."""
        return self._frame(frame, t)[:, :3]

    def rotation(self, frame: Frame, *, t: ArrayLike | None = None) -> FloatArray:
        """(nt, 3, 3) rotations from the frame's axes to inertial ones; or at times ``t`` (k,).

        Raises:
            SceneError: a point mass has no orientation.
        """
        refuse_turn(frame, "rotation")
        return self._frame(frame, t)[:, 3:12].reshape(-1, 3, 3)

    def velocity(self, frame: Frame, *, t: ArrayLike | None = None) -> FloatArray:
        """(nt, 3) m/s, velocity of the frame's origin, in inertial axes; or at times ``t`` (k,)."""
        return self._frame(frame, t)[:, 12:15]

    def angular_velocity(self, frame: Frame, *, t: ArrayLike | None = None) -> FloatArray:
        """(nt, 3) rad/s, angular velocity of the frame, in inertial axes; or at times ``t`` (k,).

        Raises:
            SceneError: a point mass has no orientation.
        """
        refuse_turn(frame, "angular velocity")
        return self._frame(frame, t)[:, 15:18]

    def acceleration(self, frame: Frame, *, t: ArrayLike | None = None) -> FloatArray:
        """(nt, 3) m/s^2, acceleration of the frame's origin, in inertial axes; or at times ``t`` (k,)."""
        return self._frame(frame, t)[:, 18:21]

    def states(self, states: States | WithStates, *, t: ArrayLike | None = None) -> FloatArray:
        """(nt, n) values of state equations, or of the states of a force, in their own units; or at times ``t``."""
        places = self.scene.index.state_places(states)
        return (self.v if t is None else self.motion(t)[1])[:, places.v] * places.scale

    def body_motion(self, *, t: ArrayLike | None = None) -> FloatArray:
        """(nt, links, 21) of all bodies' axes, by their rows in the compiled scene, or at times ``t`` (k,).

        Position (3) m, rotation (9), velocity (3) m/s, angular velocity (3) rad/s, acceleration (3) m/s^2, in inertial
        axes: in one pass what ``position`` and its like tell frame by frame.
        """
        x, v, a = (self.x, self.v, self.a) if t is None else self.motion(t)
        plan = self.scene.plan
        out = np.zeros((len(x), len(plan.tree), 21))
        body_series(plan, new_work(plan), x, v, a, out)
        return finite_answer("the motion of bodies", self._instants(t), out)

    def beta(self, connection: Connection, *, t: ArrayLike | None = None) -> FloatArray:
        """Joint coordinates, (nt,) where there is one, else (nt, k); or at times ``t``."""
        x = self.x if t is None else self.motion(t)[0]
        return single(x[:, self._slots(connection).x])

    def beta_rate(self, connection: Connection, *, t: ArrayLike | None = None) -> FloatArray:
        """Joint velocities, (nt,) where there is one, else (nt, k); or at times ``t``."""
        v = self.v if t is None else self.motion(t)[1]
        return single(v[:, self._slots(connection).v])

    def q(self, body: Body, *, t: ArrayLike | None = None) -> FloatArray:
        """Modal coordinates (nt, n); or (k, n) at times ``t`` (k,), or (n,) at one time."""
        slots = self._modal_slots(body)
        if t is None:
            return self.x[:, slots.x]
        found = self.motion(t)[0][:, slots.x]
        return found if np.ndim(t) else found[0]

    def q_rate(self, body: Body, *, t: ArrayLike | None = None) -> FloatArray:
        """Rates of the modal coordinates (nt, n); or (k, n) at times ``t`` (k,), or (n,) at one time."""
        slots = self._modal_slots(body)
        if t is None:
            return self.v[:, slots.v]
        found = self.motion(t)[1][:, slots.v]
        return found if np.ndim(t) else found[0]

    @checked("t")
    def stretch(self, body: PseudoRigidBody, *, t: ArrayLike | None = None) -> FloatArray:
        """(nt, 3, 3) stretches U, in body axes; or at times ``t`` (k,)."""
        refuse_other(body, PseudoRigidBody, "what stretches", wanted="a PseudoRigidBody of the scene")
        if body.rigid:
            return np.tile(np.eye(3), (len(self.t) if t is None else np.size(t), 1, 1))
        return body.stretch_of(self.q(body, t=None if t is None else np.atleast_1d(t)))

    @checked("t")
    def deformation_gradient(self, body: PseudoRigidBody, *, t: ArrayLike | None = None) -> FloatArray:
        """(nt, 3, 3) F = R U, from the undeformed body's axes to inertial ones; or at times ``t`` (k,)."""
        refuse_other(body, PseudoRigidBody, "what deforms", wanted="a PseudoRigidBody of the scene")
        return self.rotation(body.frame(body.solid.com), t=t) @ self.stretch(body, t=t)

    def configuration(self, t: ArrayLike) -> FloatArray:
        """(k, nx) configurations at times ``t`` (s); see ``motion``."""
        return self.motion(t)[0]

    def motion(self, t: ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Configurations (k, nx), velocities and accelerations (k, nv) at times ``t`` (s).

        Between the steps' ends they come from x, v, a at both ends, with errors of order 6, 5, 4 in the
        step: of x at most h^6 / 46080 times the motion's sixth derivative, that is 2e-8 rad where an
        oscillation of 1 rad takes 20 steps a period.  This lies below rtol for methods up to order 5; one
        of order 8 takes steps so long that it may be some thirty times rtol.  Where that matters take the
        values at the steps' ends, or a fixed step.  Closed loops are open by as much.  Modal coordinates of bodies
        that vibrate more than once in two steps follow straight lines where their accelerations contradict the rest.

        Raises:
            SceneError: a time outside the trajectory, or not a time.
        """
        found = motion_between(self.scene.plan, (self.t, self.x, self.v, self.a), self.departures, t)
        finite_answer("the motion between steps", self._instants(t), np.hstack(found))
        return found

    def momentum(self, *, t: ArrayLike | None = None) -> Momentum:
        """Centre of mass, momentum and angular momentum of all bodies together at each instant, or at times ``t``.

        Raises:
            SceneError: the machine has no mass, or bodies with history, whose interiors have momenta of their own.
        """
        x, v = (self.x, self.v) if t is None else self.motion(t)[:2]
        with looked_at():
            found = momentum_of(self.scene, x, v)
        finite_answer("the momentum", self._instants(t), np.hstack([found.centre, found.linear, found.angular]))
        return found

    def _frame(self, frame: Frame, t: ArrayLike | None = None) -> FloatArray:
        """(nt, 21) rows of ``frame_series``, or (k, 21) at times ``t`` (k,)."""
        x, v, a = (self.x, self.v, self.a) if t is None else self.motion(t)
        plan = add_probe(self.scene, frame)
        out = np.zeros((len(x), 21))
        frame_series(plan, new_work(plan), len(plan.frames) - 1, x, v, a, out)
        return finite_answer(f"the motion of frame {frame.label!r}", self._instants(t), out)

    def _instants(self, t: ArrayLike | None) -> FloatArray:
        return self.t if t is None else np.atleast_1d(np.asarray(t, dtype=np.float64))

    def _slots(self, connection: Connection) -> Slots:
        return self.scene.index.coordinates(connection)

    def _modal_slots(self, body: Body) -> Slots:
        return self.scene.index.modal(body)


def single(values: FloatArray) -> FloatArray:
    """Values (nt, k), or (nt,) where k is one."""
    return values[:, 0] if values.shape[1] == 1 else values
