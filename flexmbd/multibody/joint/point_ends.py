"""What a joint may do to a point mass: lead its place, and ask nothing of the orientation that it does not have."""

from __future__ import annotations

from flexmbd.errors import SceneError
from flexmbd.multibody.bodies.body import Body
from flexmbd.multibody.bodies.point_mass import is_point
from flexmbd.multibody.joint.protocol import TOGETHER, Joint, Row
from flexmbd.multibody.kernels.base import kinds

_OF_PLACE = (kinds.ROW_TRANSLATION, kinds.ROW_DISTANCE)
_OF_TURN = (kinds.ROW_DIRECTION, kinds.ROW_AXIS)


def rows_at_point(rows: tuple[Row, ...]) -> tuple[Row, ...]:
    """Those constraints of a joint that its place alone can violate."""
    return tuple(row for row in rows if row.kind not in _OF_TURN)


def refuse_turned_point(joint: Joint, parent: Body, child: Body, name: str) -> None:
    """Raise SceneError where a joint has a point mass as an end and asks for the point's orientation.

    The child needs none where no coordinate turns it, or where constraints on its place alone stand for the joint.  The
    parent needs none where the joint holds nothing against its axes: a ball, a distance, a free flight.
    """
    kind = type(joint).__name__
    if is_point(child):
        turns, held = any(joint.angular), {row.kind for row in joint.rows}
        if not joint.rows and turns:
            raise SceneError(f"joint {name!r}: point mass {child.name!r} does not turn; take fm.joint.Translation()")
        if not held.issubset(_OF_PLACE + (() if turns else _OF_TURN)):
            raise SceneError(
                f"joint {name!r}: a {kind} turns what it carries, and point mass {child.name!r} has no orientation; "
                "take one of Fixed, Spherical, Prismatic, PlanarPoint, Translation, PointOnLine, PointOnPlane and "
                "Distance, or a RigidBody"
            )
    rows = rows_at_point(joint.rows) if is_point(child) else joint.rows
    if is_point(parent) and rows != TOGETHER and any(row.kind != kinds.ROW_DISTANCE for row in rows):
        raise SceneError(
            f"joint {name!r}: a {kind} holds its child against the axes of its parent, and point mass {parent.name!r} "
            "has none; make the point the child, or take Spherical, Distance or a RigidBody"
        )
