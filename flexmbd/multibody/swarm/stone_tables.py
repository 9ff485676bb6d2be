"""What pseudo-rigid bodies that touch are made of: shapes about their centres, walls, and the law as numbers."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.errors import SceneError
from flexmbd.given import refuse_other
from flexmbd.multibody.bodies.body import Ground
from flexmbd.multibody.bodies.solid import Outline, Solid
from flexmbd.multibody.contact.contact_laws import Friction, PowerLaw
from flexmbd.multibody.contact.polytopes import Polytope, hull
from flexmbd.multibody.contact.shape_tables import cores, shape_table
from flexmbd.multibody.contact.shapes import SHAPES, ConvexPolytope, TouchShape
from flexmbd.multibody.kernels.contact import normal_force as law_numbers
from flexmbd.multibody.kernels.contact.finding.shape_table import CUBE, FIRST_VERTEX, POLYTOPE, ShapeTable

FloatArray = NDArray[np.float64]

_FEW = 32  # points of an outline that are all taken; a pair of shapes costs the product of their edges
_DIRECTIONS = np.array([one for one in product((-1.0, 0.0, 1.0), repeat=3) if any(one)])


def polytopes_of(solids: Sequence[Solid], shapes: Sequence[Polytope | ArrayLike] | None) -> list[Polytope]:
    """The shape of each solid, in its axes; of shapes or outlines that are one object the hull is found once.

    Raises:
        SceneError: another number of shapes than of solids; points that have no hull; a solid without an outline.
    """
    if shapes is not None and len(shapes) != len(solids):
        raise SceneError(f"a swarm of {len(solids)} solids and {len(shapes)} shapes: give one a solid")
    known: dict[int, Polytope] = {}
    found = []
    for k, solid in enumerate(solids):
        given = solid.outline if shapes is None else shapes[k]
        if given is None:
            raise SceneError(f"solid {k} of the swarm has no outline that could touch: give shapes=, points of each")
        if id(given) not in known:
            what = f"the shape of body {k} of the swarm"
            if isinstance(given, Polytope):
                known[id(given)] = given
            else:
                known[id(given)] = hull(_foremost(given) if isinstance(given, Outline) else given, what=what)
        found.append(known[id(given)])
    return found


def _foremost(outline: Outline) -> FloatArray:
    """The points of an outline; of many those that are foremost along 26 directions, before scaling."""
    if len(outline.points) <= _FEW:
        return outline.x
    directions = _DIRECTIONS / np.linalg.norm(_DIRECTIONS, axis=1)[:, None]
    return outline.x[np.unique((outline.points @ directions.T).argmax(axis=0))]


def table_of(forms: Sequence[Polytope], centres: FloatArray, walls: Sequence[TouchShape]) -> ShapeTable:
    """The table of bodies' shapes, each with a core of its own about the body's centre (n, 3) m, then of the walls.

    Raises:
        SceneError: a wall that is no shape, or not on the ground.
    """
    for wall in walls:
        refuse_other(wall, SHAPES, "a wall of a swarm", wanted="a shape of flexmbd.contact, as contact.HalfSpace(...)")
        if not isinstance(wall.frame.body, Ground):
            raise SceneError(
                f"a wall of a swarm does not move: {type(wall).__name__} is on {wall.frame.label}, not on the ground"
            )
    n = len(forms)
    fixed = shape_table(walls, body_of=lambda _: -1)
    known = {id(wall.polytope): wall.polytope for wall in walls if isinstance(wall, ConvexPolytope)}
    every = cores([*forms, *known.values()])
    for k, (form, centre) in enumerate(zip(forms, centres, strict=True)):
        first = every.head[CUBE + 1 + k, FIRST_VERTEX]
        every.vertices[first : first + len(form.vertices)] = form.vertices - centre
    reach = np.array([np.linalg.norm(form.vertices - c, axis=1).max() for form, c in zip(forms, centres, strict=True)])
    rows = np.arange(n)
    return ShapeTable(
        numbers=np.concatenate([np.tile([POLYTOPE, 0.0, 0.0, 0.0], n), fixed.numbers]),
        core=np.concatenate([CUBE + 1 + rows, np.where(fixed.core > CUBE, fixed.core + n, fixed.core)]),
        scale=np.concatenate([np.ones((n, 3)), fixed.scale]),
        radius=np.concatenate([np.zeros(n), fixed.radius]),
        bound=np.concatenate([reach, fixed.bound]),
        body=np.concatenate([rows, fixed.body]),
        place=np.concatenate([np.zeros((n, 3)), fixed.place]),
        turn=np.concatenate([np.tile(np.eye(3).ravel(), (n, 1)), fixed.turn]),
        bounded=np.concatenate([rows, n + fixed.bounded]),
        unbounded=n + fixed.unbounded,
        group=np.zeros(n + len(walls), np.int64),
        law=np.zeros((1, 1), np.int64),
        excluded=np.zeros(0, np.int64),
        cores=every,
    )


def data_of(law: PowerLaw, friction: Friction | None) -> FloatArray:
    """The law's numbers, as the kernels of ``contact_law`` take them.

    Raises:
        SceneError: no such law, or numbers that it does not have.
    """
    what = "contacts of a swarm"
    refuse_other(law, PowerLaw, f"the law of {what}", wanted="fm.contact.PowerLaw(...): corners have no curvature")
    law.check(what)
    if law.speed is None:
        raise SceneError(f"{what}: a restitution at every speed needs a memory that they do not have; give its speed")
    data = np.zeros(law_numbers.CENTRE + 3)
    data[law_numbers.STIFFNESS], data[law_numbers.EXPONENT] = law.k, law.p
    data[law_numbers.DISSIPATION] = law.dissipation()
    if friction is not None:
        refuse_other(friction, Friction, f"friction of {what}", wanted="fm.contact.Friction(...)")
        friction.check(what)
        if friction.resists:
            raise SceneError(f"{what}: they do not resist rolling and spinning; leave `rolling` and `spinning` out")
        if friction.stretch() > 0.0:
            data[law_numbers.FRICTION : law_numbers.CENTRE] = friction.numbers()
    return data
