"""Parameters of bodies and of the frames on them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from flexmbd.errors import SceneError
from flexmbd.given import numbers, refuse_other
from flexmbd.multibody.bodies.body import FlexibleBody, Frame, RigidBody
from flexmbd.multibody.bodies.point_mass import is_point
from flexmbd.multibody.force.gravitation import Gravitation
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.record.reduced_body import ReducedBody
from flexmbd.rotation import check_rotation


class _OfRigidBody:
    """What parameters of a rigid body share; a base for frozen dataclasses."""

    body: RigidBody

    @property
    def of(self) -> RigidBody:
        """The body."""
        return self.body

    def check(self, scene: CompiledScene) -> None:
        """Raise SceneError unless the scene has this rigid body."""
        refuse_other(self.body, RigidBody, f"the body of a parameter {type(self).__name__}", wanted="a RigidBody")
        if is_point(self.body) and not isinstance(self, Mass):
            raise SceneError(f"a parameter {type(self).__name__}: point mass {self.body.name!r} has a mass alone")
        _refuse_foreign(self.body, scene)


@dataclass(frozen=True, eq=False)
class Mass(_OfRigidBody):
    """The mass (kg) of a rigid body; its inertia about the centre of mass stays."""

    body: RigidBody

    def changed(self, now: RigidBody, value: float) -> RigidBody:
        """The body with this mass."""
        return replace(now, mass=value)


@dataclass(frozen=True, eq=False)
class Inertia(_OfRigidBody):
    """The inertia of a rigid body about its centre of mass, (3, 3) or its diagonal (3,), kg m^2, in body axes."""

    body: RigidBody

    def changed(self, now: RigidBody, value: ArrayLike) -> RigidBody:
        """The body with this inertia."""
        return replace(now, inertia=value)


@dataclass(frozen=True, eq=False)
class CentreOfMass(_OfRigidBody):
    """The centre of mass (3,) of a rigid body from its frame, m, in body axes."""

    body: RigidBody

    def check(self, scene: CompiledScene) -> None:
        """Raise SceneError unless the scene has this rigid body, and no force that acts at its centre."""
        super().check(scene)
        for force in scene.index.forces:
            if isinstance(force, Gravitation) and any(one is self.body for one in force.bodies):
                raise SceneError(
                    f"body {self.body.name!r}: {force.what} acts at its centre of mass, which cannot vary from run to "
                    "run then; build the scene anew"
                )

    def changed(self, now: RigidBody, value: ArrayLike) -> RigidBody:
        """The body with this centre of mass."""
        return replace(now, com=value)  # type: ignore[arg-type]


@dataclass(frozen=True, eq=False)
class BodyRecord(_OfRigidBody):
    """The record of a flexible body: another one with as many modes and the same interfaces."""

    body: FlexibleBody  # type: ignore[assignment]

    def check(self, scene: CompiledScene) -> None:
        """Raise SceneError unless the scene has this flexible body."""
        refuse_other(self.body, FlexibleBody, "the body of a BodyRecord", wanted="a FlexibleBody")
        _refuse_foreign(self.body, scene)

    def changed(self, now: FlexibleBody, value: ReducedBody) -> FlexibleBody:
        """The body with this record."""
        label = f"body {self.body.name!r}"
        refuse_other(value, ReducedBody, f"the record of {label}", wanted="a ReducedBody")
        if value.n_modes != now.record.n_modes:
            raise SceneError(
                f"{label}: a record of {value.n_modes} modes cannot take the place of one of {now.record.n_modes} in a "
                "compiled machine"
            )
        body = FlexibleBody(value, name=now.name)
        if now.q is not None:
            body.q = now.q
        if now.q_rate is not None:
            body.q_rate = now.q_rate
        return body


class _OfFrame:
    """What parameters of a marker share; a base for frozen dataclasses."""

    frame: Frame

    @property
    def of(self) -> Frame:
        """The frame."""
        return self.frame

    def check(self, scene: CompiledScene) -> None:
        """Raise SceneError unless it is a marker on a rigid body or on the ground of the scene."""
        what = f"the frame of a parameter {type(self).__name__}"
        refuse_other(self.frame, Frame, what, wanted="the frame that a joint or a force was given")
        scene.index.row_of(self.frame)
        if self.frame.body.reduced() is not None:
            raise SceneError(
                f"{what}: {self.frame.label} is an interface of a flexible body, whose place the record says; vary the "
                "record, fm.parameter.BodyRecord(body)"
            )
        if self.frame not in scene.sources.rows_of:
            raise SceneError(
                f"{what}: no joint and no force was given this frame {self.frame.label}; a parameter needs the very "
                "frame that one was given, pin = body.frame(...)"
            )


@dataclass(frozen=True, eq=False)
class FrameOrigin(_OfFrame):
    """The place p (3,), m, of a marker in its body: of the very frame that a joint or a force was given."""

    frame: Frame

    def changed(self, now: Frame, value: ArrayLike) -> Frame:
        """The frame at this place."""
        p = numbers(value)
        if p.shape != (3,) or not np.isfinite(p).all():
            raise SceneError(f"frame {now.label}: p must be three finite numbers (m), got {value!r}")
        if p.any() and is_point(now.body):
            raise SceneError(f"frame {now.label}: a point mass has no place but its own, got p = {value!r}")
        return replace(now, p_BF_B=p.copy())


@dataclass(frozen=True, eq=False)
class FrameAxes(_OfFrame):
    """The axes R (3, 3) of a marker, a rotation to its body's: of the very frame that a joint or a force was given."""

    frame: Frame

    def changed(self, now: Frame, value: ArrayLike) -> Frame:
        """The frame with these axes."""
        return replace(now, R_BF=check_rotation(value, f"frame {now.label}: R"))


def _refuse_foreign(body: RigidBody | FlexibleBody, scene: CompiledScene) -> None:
    if body not in scene.index.bodies:
        raise SceneError(f"body {body.name!r} is not in this scene")
