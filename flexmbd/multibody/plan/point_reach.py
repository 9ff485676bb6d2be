"""How far the point masses of a machine lie from each other, which says how large such a machine is."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.bodies.body import Frame, Ground
from flexmbd.multibody.bodies.point_mass import is_point
from flexmbd.multibody.contact.contact import Contact
from flexmbd.multibody.contact.hard_contact import HardContact
from flexmbd.multibody.contact.shapes import HalfSpace, TouchedShape
from flexmbd.multibody.force.protocol import Force
from flexmbd.multibody.joint.connection import Connection
from flexmbd.multibody.joint.joint_layout import AlikeJoints, JointLayout
from flexmbd.multibody.topology import Topology
from flexmbd.rotation import z_onto

FloatArray = NDArray[np.float64]


def point_reach(topology: Topology, forces: Sequence[Force], gravity: FloatArray) -> float:
    """The diagonal (m) of the box around the point masses on the ground where they start, and what holds them there.

    A point has no size of its own, and wherever the ground's origin is, their distances are the same; a half space
    holds a point by the nearest place of its plane.  A point that nothing holds but contacts is as large as what it
    carries there, and as its flight: the length over which gravity (3,) m/s^2 bends its way at the start.
    """
    carried = [
        (branch.connection, branch.outer.body)
        for branch in topology.branches
        if branch.connection is not None and is_point(branch.outer.body) and isinstance(branch.inner.body, Ground)
    ]
    if not carried:
        return 0.0
    places = _places([joint for joint, _ in carried], topology.joints)
    points = {id(body): place for (_, body), place in zip(carried, places, strict=True)}
    lone, radius = len(carried) == 1 and not topology.closures, 0.0
    ends: list[tuple[Frame, ...]] = [(one.parent, one.child) for one in topology.closures]
    fixed: list[FloatArray] = []
    for force in forces:
        if not isinstance(force, Contact | HardContact):
            ends.append(force.frames)
            lone = False
        elif id(force.frame_G.body) in points:
            radius = max(radius, force.radius)
            fixed += _touched(force.shape, points[id(force.frame_G.body)])
    for group in ends:
        on_ground = [frame.p_BF_B for frame in group if isinstance(frame.body, Ground)]
        if on_ground and any(id(frame.body) in points for frame in group):
            fixed += on_ground
    reach = float(np.linalg.norm(np.ptp(np.concatenate([places, np.reshape(fixed, (-1, 3))]), axis=0)))
    if not lone:
        return reach
    weight, velocity = float(np.linalg.norm(gravity)), carried[0][0].velocity
    speed = 0.0 if velocity is None else float(np.linalg.norm(velocity))
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


def _places(joints: Sequence[Connection], known: AlikeJoints) -> FloatArray:
    """(n, 3) m, where the points that joints carry are at the start."""
    places = np.concatenate([joint.parent.p_BF_B for joint in joints]).reshape(-1, 3)
    moved: dict[JointLayout, list[int]] = {}
    for k, joint in enumerate(joints):
        if joint.position is not None:
            moved.setdefault(known.of(joint.joint), []).append(k)
    for layout, which in moved.items():
        axes = np.concatenate([joints[k].parent.R_BF for k in which]).reshape(-1, 3, 3)
        slides = np.array([joints[k].position for k in which]) @ layout.slides.T
        places[which] += (axes @ slides[:, :, None])[:, :, 0]
    return places
