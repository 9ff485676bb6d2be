"""Which spheres and points of two shapes touch what: the contacts of a pair."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import SceneError
from flexmbd.files.memory import available_memory
from flexmbd.given import refuse_other
from flexmbd.multibody.bodies.body import Body
from flexmbd.multibody.contact.contact import Contact
from flexmbd.multibody.contact.contact_laws import Friction, NormalLaw
from flexmbd.multibody.contact.hard_contact import Hard, HardContact
from flexmbd.multibody.contact.hard_group import HardGroup
from flexmbd.multibody.contact.shapes import (
    SHAPES,
    Box,
    Capsule,
    ConvexPolytope,
    HalfSpace,
    Sphere,
    TouchedShape,
    TouchShape,
    Vertex,
    corners,
    ends,
)

FloatArray = NDArray[np.float64]

_BYTES = 2500.0  # of a contact of lists, its names and numbers in a compiled scene included, about

Touching = TouchShape | Sequence[TouchShape]
AnyContact = Contact | HardContact | HardGroup


def contacts(
    one: Touching,
    other: Touching,
    law: NormalLaw | Hard,
    friction: Friction | None,
    *,
    are_joined: Callable[[Body, Body], bool],
    joined: Sequence[tuple[Body, Body]] = (),
) -> list[AnyContact]:
    """All contacts of a shape or of each of a group with another one, or with each of another group.

    Each pair of shapes touches once, in whatever lists they stand.  Of groups, pairs on one body and pairs of bodies
    that ``are_joined`` are left out; ``joined`` are these.  Hard contacts of groups, and of other pairs than of spheres
    or points, are one group, whose points are found in each step.

    Raises:
        SceneError: what is no shape; a pair of one body; a pair that does not touch by spheres or points.
    """
    wanted = "fm.contact.Hertz(...), fm.contact.PowerLaw(...) or fm.contact.Hard(...)"
    refuse_other(law, (NormalLaw, Hard), "the law of a contact", wanted=wanted)
    if isinstance(law, Hard) and friction is not None:
        raise SceneError("a hard contact has its own friction, fm.contact.Hard(mu=...): leave `friction` out")
    if friction is not None:
        refuse_other(friction, Friction, "friction", wanted="fm.contact.Friction(...)")
    first, second = _group(one), _group(other)
    single = len(first) == len(second) == 1
    if isinstance(law, Hard) and not any(shape.frame.modes is not None for shape in (*first, *second)):
        if not (single and _is_known(first[0], second[0])):
            return [HardGroup(tuple(first), tuple(second), law, tuple(joined))]
    _refuse_too_many(first, second)
    found: list[AnyContact] = []
    known: set[frozenset[int]] = set()
    for a in first:
        for b in second:
            pair = frozenset((id(a), id(b)))
            if pair in known or len(pair) == 1:
                continue
            known.add(pair)
            if a.frame.body is b.frame.body:
                if single:
                    raise SceneError(f"{_called(a)} and {_called(b)} are on one body: they never touch")
                continue
            if not single and are_joined(a.frame.body, b.frame.body):
                continue
            found += _pair(a, b, law, friction)
    if not found:
        raise SceneError(
            "none of these shapes can touch another: they are on one body, or on bodies that a joint joins; give two "
            "of them alone if they are to touch all the same"
        )
    return found


def _refuse_too_many(first: Sequence[TouchShape], second: Sequence[TouchShape]) -> None:
    """Raise SceneError where contacts of each shape of a list with each of another are beyond the memory there is."""
    count, left = len(first) * len(second), available_memory()
    if left is not None and count * _BYTES > left:
        raise SceneError(
            f"lists of {len(first)} and {len(second)} shapes make {count} contacts, each of which is watched in every "
            f"evaluation: they need some {count * _BYTES / 1e9:.3g} GB, and there are {left / 1e9:.3g} GB; take "
            "fm.contact.Hard(...), whose points are found in each step, or fm.PseudoRigidSwarm for stones"
        )


def _group(given: Touching) -> list[TouchShape]:
    """The shapes of a group, or one alone."""
    shapes: list[object] = [given] if isinstance(given, SHAPES) or not isinstance(given, Iterable) else [*given]
    if not shapes:
        raise SceneError("a list of shapes that are to touch is empty")
    for shape in shapes:
        refuse_other(shape, SHAPES, "what touches", wanted="a shape as fm.contact.Sphere(body.frame(), radius)")
    return [shape for shape in shapes if isinstance(shape, SHAPES)]


def _pair(a: TouchShape, b: TouchShape, law: NormalLaw | Hard, friction: Friction | None) -> list[AnyContact]:
    """The contacts of two shapes.

    Raises:
        SceneError: neither touches the other by spheres or points.
    """
    for touched, touching in ((a, b), (b, a)):
        if isinstance(touched, Vertex | ConvexPolytope):
            continue
        spheres = _spheres(touching, touched)
        if spheres is not None:
            places, radius = spheres
            frame = touching.frame
            centres = [(float(x), float(y), float(z)) for x, y, z in places]
            if isinstance(law, Hard):
                return [HardContact(touched, frame, radius, law, place) for place in centres]
            return [Contact(touched, frame, radius, law, friction, place) for place in centres]
    raise SceneError(
        f"{_called(a)} and {_called(b)}: no such pair is known yet. A Sphere or a Vertex touches each other shape but "
        "a ConvexPolytope; a Capsule, a Box and a ConvexPolytope touch a HalfSpace"
    )


def _is_known(a: TouchShape, b: TouchShape) -> bool:
    """Whether one of two shapes touches the other by spheres or points that are always the same."""
    pairs = ((a, b), (b, a))
    return any(not isinstance(x, Vertex | ConvexPolytope) and _spheres(y, x) is not None for x, y in pairs)


def _spheres(touching: TouchShape, touched: TouchedShape) -> tuple[FloatArray, float] | None:
    """Centres (k, 3) m, in its frame's axes, and radius of the spheres by which a shape touches another; None: none."""
    if isinstance(touching, Vertex):
        return np.zeros((1, 3)), 0.0
    if type(touching) is Sphere:
        return np.zeros((1, 3)), touching.radius
    if isinstance(touched, HalfSpace):
        if isinstance(touching, Capsule):
            return ends(touching), touching.radius
        if isinstance(touching, Box):
            return corners(touching), 0.0
        if isinstance(touching, ConvexPolytope):
            return touching.polytope.vertices, 0.0
    return None


def _called(shape: TouchShape) -> str:
    return f"{type(shape).__name__} on {shape.frame.label}"
