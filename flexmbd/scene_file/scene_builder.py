"""From the description of a scene to the machine."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from flexmbd.errors import FlexmbdError, SceneError
from flexmbd.force import Force
from flexmbd.multibody.bodies.body import FlexibleBody, Frame, Ground, RigidBody
from flexmbd.multibody.joint.connection import Connection
from flexmbd.record.reduced_body import ReducedBody
from flexmbd.scene_file.entry_kinds import COUPLINGS, FORCES, JOINTS
from flexmbd.scene_file.scene_description import BodyName, FramePlace, JointName, RigidEntry, SceneFile
from flexmbd.system import System


@dataclass(frozen=True, eq=False)
class Built:
    """A machine made from a scene file.

    Attributes:
        system: the machine.
        bodies: by their names, the ground too.
        joints: by their names.
        forces: by their places in the file.
    """

    system: System
    bodies: Mapping[str, RigidBody | FlexibleBody | Ground]
    joints: Mapping[str, Connection]
    forces: Mapping[str, Force]

    def frame(self, place: FramePlace) -> Frame:
        """The frame at a place.

        Raises:
            SceneError, InterfaceError: R is not a rotation, or the body has no such interface.
        """
        body = self.bodies[place.body]
        if isinstance(body, FlexibleBody):
            return body.frame(place.interface)
        return body.frame((0.0, 0.0, 0.0) if place.p is None else place.p, R=place.R)


def build(scene: SceneFile) -> Built:
    """Make the machine that a scene file describes; records are loaded now. Not collective.

    Raises:
        SceneError: a record cannot be loaded, or something does not fit; the message says where in the file.
    """
    system = System(gravity=scene.gravity)
    bodies: dict[str, RigidBody | FlexibleBody | Ground] = {system.ground.name: system.ground}
    joints: dict[str, Connection] = {}
    forces: dict[str, Force] = {}
    built = Built(system, bodies, joints, forces)
    for body in scene.bodies:
        with _at(scene, body.place, body.name):
            if isinstance(body, RigidEntry):
                bodies[body.name] = system.add(RigidBody(body.mass, body.inertia, body.com), name=body.name)
            else:
                bodies[body.name] = system.add(FlexibleBody(ReducedBody.load(body.path)), name=body.name)
    for joint in scene.joints:
        with _at(scene, joint.place, joint.name):
            kind = JOINTS[joint.kind].make(**joint.arguments)
            connection = system.connect(
                kind, built.frame(joint.parent), built.frame(joint.child), name=joint.name
            )
            if joint.position is not None:
                connection.position = joint.position
            if joint.velocity is not None:
                connection.velocity = joint.velocity
            if joint.motion is not None:
                connection.prescribe(joint.motion)
            joints[joint.name] = connection
    for element in scene.forces:
        with _at(scene, element.place, element.kind):
            force = FORCES[element.kind].make(**_resolved(built, element.arguments))
            forces[element.place] = system.add_force(force)
    for element in scene.couplings:
        with _at(scene, element.place, element.kind):
            system.couple(COUPLINGS[element.kind].make(**_resolved(built, element.arguments)))
    return built


def _resolved(built: Built, arguments: Mapping[str, object]) -> dict[str, Any]:
    """Arguments in which the names of frames, joints and bodies have become these."""
    resolved: dict[str, Any] = {}
    for name, value in arguments.items():
        if isinstance(value, FramePlace):
            resolved[name] = built.frame(value)
        elif isinstance(value, JointName):
            resolved[name] = built.joints[value.name]
        elif isinstance(value, BodyName):
            resolved[name] = built.bodies[value.name]
        else:
            resolved[name] = value
    return resolved


@contextmanager
def _at(scene: SceneFile, place: str, name: str) -> Iterator[None]:
    """Errors raised within say where in the file the cause stands."""
    try:
        yield
    except FlexmbdError as error:
        raise SceneError(f"{scene.path}: {place} ({name}): {error}") from error
