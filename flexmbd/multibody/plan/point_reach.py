"""How far the point masses of a machine lie from each other, which says how large such a machine is."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.bodies.body import Body, Frame, Ground
from flexmbd.multibody.bodies.point_mass import is_point
from flexmbd.multibody.contact.contact import Contact
from flexmbd.multibody.contact.hard_contact import HardContact
from flexmbd.multibody.contact.shapes import HalfSpace, TouchedShape
from flexmbd.multibody.force.protocol import Force
from flexmbd.multibody.joint.connection import Connection
from flexmbd.multibody.joint.protocol import Joint
from flexmbd.multibody.scene_index import IdentityMap
from flexmbd.multibody.topology import Topology
from flexmbd.rotation import z_onto

FloatArray = NDArray[np.float64]


def point_reach(topology: Topology, forces: Sequence[Force], gravity: FloatArray) -> float:
    """The diagonal (m) of the box around the point masses on the ground where they start, and what holds them there.

    A point has no size of its own, and wherever the ground's origin is, their distances are the same; a half space
    holds a point by the nearest place of its plane.  A point that nothing holds but contacts is as large as what it
    carries there, and as its flight: the length over which gravity (3,) m/s^2 bends its way at the start.
    """
    slides: dict[Joint, FloatArray] = {}
    points: IdentityMap[Body, FloatArray] = IdentityMap()
    places: list[FloatArray] = []
    speed = 0.0
    for branch in topology.branches:
        joint, body = branch.connection, branch.outer.body
        if joint is not None and is_point(body) and isinstance(branch.inner.body, Ground):
            points[body] = _place(joint, slides)
            places.append(points[body])
            speed = max(speed, 0.0 if joint.velocity is None else float(np.linalg.norm(joint.velocity)))
    if not places:
        return 0.0
    lone, radius = len(places) == 1 and not topology.closures, 0.0
    ends: list[tuple[Frame, ...]] = [(one.parent, one.child) for one in topology.closures]
    for force in forces:
        if not isinstance(force, Contact | HardContact):
            ends.append(force.frames)
            lone = False
        elif force.frame_G.body in points:
            radius = max(radius, force.radius)
            places += _touched(force.shape, points[force.frame_G.body])
    for group in ends:
        if len(group) > 1 and any(frame.body in points for frame in group):
            places += [frame.p_BF_B for frame in group if isinstance(frame.body, Ground)]
    reach = float(np.linalg.norm(np.ptp(np.array(places), axis=0)))
    if not lone:
        return reach
    weight = float(np.linalg.norm(gravity))
    return max(reach, radius, speed**2 / weight if weight > 0.0 else 0.0)


def _touched(shape: TouchedShape, place: FloatArray) -> list[FloatArray]:
    """Where (3,) m a shape on the ground is for a point at ``place``."""
    frame = shape.frame
    if not isinstance(frame.body, Ground):
        return []
    if isinstance(shape, HalfSpace):
        normal = frame.R_BF @ z_onto(shape.normal)[:, 2]
        return [place - normal * (normal @ (place - frame.p_BF_B))]
    return [frame.p_BF_B]


def _place(joint: Connection, slides: dict[Joint, FloatArray]) -> FloatArray:
    """(3,) m, where a point is at the start; ``slides`` are the joints' (3, k) known so far."""
    if joint.joint not in slides:
        turn = joint.joint.turn
        steps = [turn @ z_onto(step.axis) @ step.pair.numbers[:, 1:].T for step in joint.joint.steps]
        slides[joint.joint] = np.hstack([np.zeros((3, 0)), *steps])
    held = joint.parent
    if joint.position is None:
        return held.p_BF_B
    return held.p_BF_B + held.R_BF @ (slides[joint.joint] @ joint.position)
