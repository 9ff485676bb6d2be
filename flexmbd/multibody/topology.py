"""Spanning tree and loop closures: which joints become coordinates, which constraints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flexmbd.errors import SceneError
from flexmbd.multibody.body import Body, Frame
from flexmbd.multibody.connection import Connection
from flexmbd.multibody.enforcement import Way


@dataclass(frozen=True, eq=False)
class Branch:
    """A joint of the tree, from the body nearer to the ground to the one farther.

    Attributes:
        connection: the user's joint, or None for a body left to fly so that loops can hold it.
        inner: frame on the body nearer to the ground.
        outer: frame on the body that the branch adds.
        reversed: the branch runs from the user's child to the user's parent.
    """

    connection: Connection | None
    inner: Frame
    outer: Frame
    reversed: bool


@dataclass(frozen=True, eq=False)
class Topology:
    """The tree's branches, parents before children, one a body; and the joints held by constraints."""

    branches: tuple[Branch, ...]
    closures: tuple[Connection, ...]


def span(ground: Body, bodies: Sequence[Body], connections: Sequence[Connection]) -> Topology:
    """Grow the tree from the ground along joints in the order they were made.

    A joint is carried by coordinates where its outer frame is rigid in its body; a joint whose
    outer frame deforms closes a loop instead (Ambrosio & Nikravesh 1992, section 5).  Joints asked
    to go by coordinates have preference, those asked to go by constraints stay out of the tree.

    Raises:
        SceneError: a body that nothing connects, or a joint that cannot go by coordinates as asked.
    """
    order = sorted(connections, key=lambda c: c.way is not Way.COORDINATES)
    _check_connected(ground, bodies, connections)
    reached = {id(ground)}
    branches: list[Branch] = []
    used: set[int] = set()
    while len(branches) < len(bodies):
        branch = _next_branch(order, reached, used)
        if branch is None:
            branch = _fly(ground, bodies, reached)
        branches.append(branch)
        reached.add(id(branch.outer.body))
        if branch.connection is not None:
            used.add(id(branch.connection))
    for c in connections:
        if c.way is Way.COORDINATES and id(c) not in used:
            raise SceneError(
                f"joint {c.name!r} cannot go by coordinates: other joints that do already carry both "
                "its bodies, or its frame on the outer body deforms, or it only runs from parent to child"
            )
    closures = tuple(
        c for c in connections if id(c) not in used and (c.joint.rows or c.way is Way.CONSTRAINTS)
    )
    return Topology(tuple(branches), closures)


def _check_connected(
    ground: Body, bodies: Sequence[Body], connections: Sequence[Connection]
) -> None:
    """Raise SceneError naming the bodies that no chain of joints ties to the ground."""
    joined = {id(ground)}
    grown = True
    while grown:
        grown = False
        for c in connections:
            ends = {id(c.parent.body), id(c.child.body)}
            if ends & joined and not ends <= joined:
                joined |= ends
                grown = True
    loose = [body.name for body in bodies if id(body) not in joined]
    if loose:
        raise SceneError(
            f"nothing connects {', '.join(map(repr, loose))} to the ground; connect one of them, "
            "with joint.Free() if it is to fly"
        )


def _next_branch(
    connections: Sequence[Connection], reached: set[int], used: set[int]
) -> Branch | None:
    """The first unused joint that leads from a reached body to a new one."""
    for c in connections:
        if id(c) in used or not c.may_be_coordinates:
            continue
        inside, outside = id(c.parent.body) in reached, id(c.child.body) in reached
        if inside and not outside and c.child.modes is None:
            return Branch(c, c.parent, c.child, False)
        if outside and not inside and c.parent.modes is None and c.joint.reversible:
            return Branch(c, c.child, c.parent, True)
    return None


def _fly(ground: Body, bodies: Sequence[Body], reached: set[int]) -> Branch:
    """Six free coordinates for the first body that no joint can carry."""
    body = next(b for b in bodies if id(b) not in reached)
    frames = [Frame(b, np.zeros(3), np.eye(3), None, b.name) for b in (ground, body)]
    return Branch(None, frames[0], frames[1], False)
