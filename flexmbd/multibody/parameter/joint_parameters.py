"""Parameters of joints and of modal coordinates: where a machine starts, and its prescribed motions."""

from __future__ import annotations

import copy
from dataclasses import dataclass

from numpy.typing import ArrayLike

from flexmbd.errors import SceneError
from flexmbd.given import refuse_other
from flexmbd.multibody.bodies.body import FlexibleBody
from flexmbd.multibody.functions.time_function import TimeFunction
from flexmbd.multibody.joint.connection import Connection
from flexmbd.multibody.plan.compiled_scene import CompiledScene


class _OfJoint:
    """What parameters of a joint share; a base for frozen dataclasses."""

    joint: Connection

    @property
    def of(self) -> Connection:
        """The joint."""
        return self.joint

    def check(self, scene: CompiledScene) -> None:
        """Raise SceneError unless the scene has this joint."""
        what = f"the joint of a parameter {type(self).__name__}"
        refuse_other(self.joint, Connection, what, wanted="what scene.connect() gives")
        if self.joint not in scene.index.joints and self.joint not in scene.index.closures:
            raise SceneError(f"joint {self.joint.name!r} is not in this scene")


@dataclass(frozen=True, eq=False)
class InitialPosition(_OfJoint):
    """The initial coordinates of a joint (rad or m), which must be set in the scene."""

    joint: Connection

    def check(self, scene: CompiledScene) -> None:
        """Raise SceneError unless the scene has this joint and its position is set."""
        super().check(scene)
        _refuse_unset(self.joint.position, f"the position of joint {self.joint.name!r}", "joint.position")

    def changed(self, now: Connection, value: ArrayLike) -> Connection:
        """The joint that starts there."""
        joint = copy.copy(now)
        joint.position = value  # type: ignore[assignment]
        _refuse_unset(joint.position, f"the position of joint {now.name!r}", "joint.position")
        return joint


@dataclass(frozen=True, eq=False)
class InitialVelocity(_OfJoint):
    """The initial velocities of a joint (rad/s or m/s), which must be set in the scene."""

    joint: Connection

    def check(self, scene: CompiledScene) -> None:
        """Raise SceneError unless the scene has this joint and its velocity is set."""
        super().check(scene)
        _refuse_unset(self.joint.velocity, f"the velocity of joint {self.joint.name!r}", "joint.velocity")

    def changed(self, now: Connection, value: ArrayLike) -> Connection:
        """The joint that starts as fast."""
        joint = copy.copy(now)
        joint.velocity = value  # type: ignore[assignment]
        _refuse_unset(joint.velocity, f"the velocity of joint {now.name!r}", "joint.velocity")
        return joint


@dataclass(frozen=True, eq=False)
class PrescribedMotion(_OfJoint):
    """The prescribed motion of a joint: another function of time of the same kind and size."""

    joint: Connection

    def check(self, scene: CompiledScene) -> None:
        """Raise SceneError unless the scene has this joint and its motion is prescribed."""
        super().check(scene)
        if self.joint.motion is None:
            raise SceneError(f"joint {self.joint.name!r} has no prescribed motion to vary; joint.prescribe(...) first")

    def changed(self, now: Connection, value: TimeFunction) -> Connection:
        """The joint with this motion."""
        joint = copy.copy(now)
        joint.prescribe(value)
        return joint


class _OfModes:
    """What parameters of modal coordinates share; a base for frozen dataclasses."""

    body: FlexibleBody

    @property
    def of(self) -> FlexibleBody:
        """The body."""
        return self.body

    def check(self, scene: CompiledScene) -> None:
        """Raise SceneError unless the scene has this flexible body."""
        what = f"the body of a parameter {type(self).__name__}"
        refuse_other(self.body, FlexibleBody, what, wanted="a FlexibleBody")
        scene.index.modal(self.body)


@dataclass(frozen=True, eq=False)
class ModalPosition(_OfModes):
    """The initial modal coordinates q (n,) of a flexible body, m kg^(1/2), which must be set in the scene."""

    body: FlexibleBody

    def check(self, scene: CompiledScene) -> None:
        """Raise SceneError unless the scene has this body and its q is set."""
        super().check(scene)
        _refuse_unset(self.body.q, f"q of body {self.body.name!r}", "body.q")

    def changed(self, now: FlexibleBody, value: ArrayLike) -> FlexibleBody:
        """The body that starts deformed so."""
        body = copy.copy(now)
        body.q = value  # type: ignore[assignment]
        return body


@dataclass(frozen=True, eq=False)
class ModalVelocity(_OfModes):
    """The initial rates of the modal coordinates (n,) of a flexible body, m kg^(1/2)/s, which must be set."""

    body: FlexibleBody

    def check(self, scene: CompiledScene) -> None:
        """Raise SceneError unless the scene has this body and its q_rate is set."""
        super().check(scene)
        _refuse_unset(self.body.q_rate, f"q_rate of body {self.body.name!r}", "body.q_rate")

    def changed(self, now: FlexibleBody, value: ArrayLike) -> FlexibleBody:
        """The body that starts with these rates."""
        body = copy.copy(now)
        body.q_rate = value  # type: ignore[assignment]
        return body


def _refuse_unset(value: object, what: str, name: str) -> None:
    """Raise SceneError where initial coordinates are not given: a start that may move them is another one."""
    if value is None:
        raise SceneError(f"{what} is not set: give it a number, {name} = ..., before it can be a parameter")
