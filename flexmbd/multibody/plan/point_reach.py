"""How far the point masses of a machine lie from each other, which says how large such a machine is."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.bodies.body import Frame, Ground
from flexmbd.multibody.bodies.point_mass import is_point
from flexmbd.multibody.force.protocol import Force
from flexmbd.multibody.joint.connection import Connection
from flexmbd.multibody.joint.joint_layout import AlikeJoints, JointLayout
from flexmbd.multibody.topology import Topology

FloatArray = NDArray[np.float64]


def point_reach(topology: Topology, forces: Sequence[Force]) -> float:
    """The diagonal (m) of the box around the point masses on the ground where they start, and what holds them there.

    A point has no size of its own, and wherever the ground's origin is, their distances are the same.
    """
    carried = [
        (branch.connection, branch.outer.body)
        for branch in topology.branches
        if branch.connection is not None and is_point(branch.outer.body) and isinstance(branch.inner.body, Ground)
    ]
    if not carried:
        return 0.0
    points = {id(body) for _, body in carried}
    ends: list[tuple[Frame, ...]] = [force.frames for force in forces]
    ends += [(one.parent, one.child) for one in topology.closures]
    fixed: list[FloatArray] = []
    for group in ends:
        on_ground = [frame.p_BF_B for frame in group if isinstance(frame.body, Ground)]
        if on_ground and any(id(frame.body) in points for frame in group):
            fixed += on_ground
    places = _places([joint for joint, _ in carried], topology.joints)
    return float(np.linalg.norm(np.ptp(np.concatenate([places, np.reshape(fixed, (-1, 3))]), axis=0)))


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
