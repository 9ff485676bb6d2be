"""Spanning tree and loop closures: which joints become coordinates, which constraints."""

from __future__ import annotations

import heapq
from collections import deque
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from flexmbd.errors import SceneError
from flexmbd.multibody.bodies.body import Body, Frame
from flexmbd.multibody.bodies.point_mass import is_point
from flexmbd.multibody.joint.connection import Connection
from flexmbd.multibody.joint.enforcement import Way
from flexmbd.multibody.joint.joint_layout import AlikeJoints


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
    """The tree's branches, parents before children, one a body; and the joints held by constraints.

    Attributes:
        joints: what was found of the joints, for those who go on with them now.
    """

    branches: tuple[Branch, ...]
    closures: tuple[Connection, ...]
    joints: AlikeJoints


def spanning_tree(
    ground: Body,
    bodies: Sequence[Body],
    connections: Sequence[Connection],
    *,
    wanted: Collection[int] = (),
    together: Sequence[Sequence[Body]] = (),
) -> Topology:
    """Grow the tree from the ground, always by the joint that is best carried by coordinates.

    That is a joint asked to go by coordinates; else one whose coordinates are ``wanted``, for a
    start, a motion or a force on them; else the one that would need most constraint rows, so that
    loops are cut where they cost fewest multipliers (a maximum spanning tree); else the one made
    first.  A joint is carried by coordinates where its outer frame is rigid in its body; a joint
    whose outer frame deforms closes a loop instead (Ambrosio & Nikravesh 1992, section 5).

    Args:
        ground: the inertial frame's body.
        bodies: all others.
        connections: all joints.
        wanted: ids of joints whose coordinates something asks for.
        together: bodies that hang together without a joint; the first to fly where no joint carries them.

    Raises:
        SceneError: a body that nothing connects, or a joint that cannot go by coordinates as asked.
    """
    at_body = _by_body(connections)
    _check_connected(ground, bodies, at_body, together)
    reached: set[int] = set()
    branches: list[Branch] = []
    used: set[int] = set()
    # rank of a joint, then the order in which joints were made; the index tells equal ones apart
    frontier: list[tuple[tuple[bool, bool, int], int, Connection]] = []
    neighbours: deque[Body] = deque()
    joints = AlikeJoints()

    def reach(body: Body) -> None:
        reached.add(id(body))
        for index, c in at_body.get(id(body), ()):
            parent, child = c.parent.body, c.child.body
            neighbours.append(parent)
            neighbours.append(child)
            if (id(parent) in reached and id(child) in reached) or c.must_be_constraints:
                continue
            layout, at_point = joints.of(c.joint), is_point(child)
            if layout.has_coordinates(at_point=at_point):
                rank = (c.way is not Way.COORDINATES, id(c) not in wanted, -len(layout.rows(at_point=at_point)))
                heapq.heappush(frontier, (rank, index, c))

    reach(ground)
    loose = iter(bodies)
    while len(branches) < len(bodies):
        branch = None
        while frontier and branch is None:
            branch = _branch(heapq.heappop(frontier)[2], reached)
        if branch is None:
            held = (parts for parts in together if any(id(b) in reached for b in parts))
            mate = next((b for parts in held for b in parts if id(b) not in reached), None)
            # outwards, so that the joint that says where a body starts leads from one that is placed already
            while neighbours and id(neighbours[0]) in reached:
                neighbours.popleft()
            near = neighbours[0] if neighbours else next(b for b in loose if id(b) not in reached)
            branch = _add_free_joint(ground, mate or _carrying_body(near, at_body, reached))
        branches.append(branch)
        reach(branch.outer.body)
        if branch.connection is not None:
            used.add(id(branch.connection))
    for c in connections:
        if c.way is Way.COORDINATES and id(c) not in used:
            raise SceneError(
                f"joint {c.name!r} cannot go by coordinates: other joints that do already carry both "
                "its bodies, or its frame on the outer body deforms, or it only runs from parent to child"
            )
    closures = tuple(c for c in connections if id(c) not in used)
    return Topology(tuple(_side_by_side(ground, branches, closures)), closures, joints)


def _side_by_side(ground: Body, branches: list[Branch], closures: Sequence[Connection]) -> list[Branch]:
    """The branches, those of bodies that hang together without the ground next to each other, otherwise in order.

    What moves on the ground as prescribed counts as the ground, and stands before all that hangs on it.
    """
    joined: dict[int, int] = {}
    still = {id(ground)}
    for branch in branches:
        prescribed = branch.connection is not None and branch.connection.motion is not None
        if prescribed and id(branch.inner.body) in still and branch.outer.body.reduced() is None:
            still.add(id(branch.outer.body))

    def root(body: Body) -> int:
        b = id(body)
        while joined.setdefault(b, b) != b:
            joined[b] = joined[joined[b]]
            b = joined[b]
        return b

    pairs = [(branch.inner.body, branch.outer.body) for branch in branches]
    pairs += [(c.parent.body, c.child.body) for c in closures]
    for one, other in pairs:
        if id(one) not in still and id(other) not in still:
            joined[root(other)] = root(one)
    first: list[Branch] = []
    groups: dict[int, list[Branch]] = {}
    for branch in branches:
        of_body = first if id(branch.outer.body) in still else groups.setdefault(root(branch.outer.body), [])
        of_body.append(branch)
    return first + [branch for group in groups.values() for branch in group]


def _by_body(connections: Sequence[Connection]) -> dict[int, list[tuple[int, Connection]]]:
    """The joints at each body, with the order in which they were made."""
    found: dict[int, list[tuple[int, Connection]]] = {}
    for index, c in enumerate(connections):
        for end in (c.parent, c.child):
            found.setdefault(id(end.body), []).append((index, c))
    return found


def _check_connected(
    ground: Body,
    bodies: Sequence[Body],
    at_body: Mapping[int, list[tuple[int, Connection]]],
    together: Sequence[Sequence[Body]],
) -> None:
    """Raise SceneError naming the bodies that no chain of joints ties to the ground."""
    joined = {id(ground)}
    waiting = [id(ground)]
    mates = {id(body): parts for parts in together for body in parts}
    while waiting:
        one = waiting.pop()
        ends = [end for _, c in at_body.get(one, ()) for end in (c.parent.body, c.child.body)]
        for end in map(id, (*ends, *mates.get(one, ()))):
            if end not in joined:
                joined.add(end)
                waiting.append(end)
    loose = [body.name for body in bodies if id(body) not in joined]
    if loose:
        raise SceneError(
            f"nothing connects {', '.join(map(repr, loose))} to the ground; connect one of them, "
            "with joint.Free() if it is to fly"
        )


def _branch(c: Connection, reached: set[int]) -> Branch | None:
    """The branch by which a joint leads from a reached body to a new one, if it does."""
    inside, outside = id(c.parent.body) in reached, id(c.child.body) in reached
    if inside and not outside and c.child.modes is None:
        return Branch(c, c.parent, c.child, False)
    if outside and not inside and c.parent.modes is None and c.reversible:
        return Branch(c, c.child, c.parent, True)
    return None


def _carrying_body(body: Body, at_body: Mapping[int, list[tuple[int, Connection]]], reached: set[int]) -> Body:
    """The body that must fly if joints asked to go by coordinates are to carry this one."""
    passed = set(reached)
    carrier: Body | None = body
    while carrier is not None:
        body, carrier = carrier, None
        passed.add(id(body))
        for _, c in at_body.get(id(body), ()):
            other = c.parent.body if c.child.body is body else c.child.body
            one_way = _branch(c, {id(body)}) is None and _branch(c, {id(other)}) is not None
            if c.way is Way.COORDINATES and one_way and id(other) not in passed:
                carrier = other
    return body


def _add_free_joint(ground: Body, body: Body) -> Branch:
    """Free coordinates for a body that no joint can carry, six, or three of a point mass."""
    frames = [Frame(b, np.zeros(3), np.eye(3), None, b.name) for b in (ground, body)]
    return Branch(None, frames[0], frames[1], False)
