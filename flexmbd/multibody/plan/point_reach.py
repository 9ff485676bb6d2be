"""How far the point masses of a machine lie from each other, which says how large such a machine is."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.bodies.body import Body, Frame, Ground
from flexmbd.multibody.bodies.point_mass import is_point
from flexmbd.multibody.force.protocol import Force
from flexmbd.multibody.joint.connection import Connection
from flexmbd.multibody.joint.protocol import Joint
from flexmbd.multibody.scene_index import IdentityMap
from flexmbd.multibody.topology import Topology
from flexmbd.rotation import z_onto

FloatArray = NDArray[np.float64]


def point_reach(topology: Topology, forces: Sequence[Force]) -> float:
    """The diagonal (m) of the box around the point masses on the ground where they start, and what holds them there.

    A point has no size of its own, and wherever the ground's origin is, their distances are the same.
    """
    slides: dict[Joint, FloatArray] = {}
    points: IdentityMap[Body, None] = IdentityMap()
    places: list[FloatArray] = []
    for branch in topology.branches:
        joint, body = branch.connection, branch.outer.body
        if joint is not None and is_point(body) and isinstance(branch.inner.body, Ground):
            points[body] = None
            places.append(_place(joint, slides))
    if not places:
        return 0.0
    ends: list[tuple[Frame, ...]] = [force.frames for force in forces]
    ends += [(one.parent, one.child) for one in topology.closures]
    for group in ends:
        if len(group) > 1 and any(frame.body in points for frame in group):
            places += [frame.p_BF_B for frame in group if isinstance(frame.body, Ground)]
    return float(np.linalg.norm(np.ptp(np.array(places), axis=0)))


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
