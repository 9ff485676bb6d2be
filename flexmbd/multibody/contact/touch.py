"""Which spheres and points of two shapes touch what: the contacts of a pair."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from flexmbd.errors import SceneError
from flexmbd.given import refuse_other
from flexmbd.multibody.bodies.body import Body, Frame
from flexmbd.multibody.contact.contact import Contact
from flexmbd.multibody.contact.contact_laws import Friction, NormalLaw
from flexmbd.multibody.contact.shapes import (
    SHAPES,
    Box,
    Capsule,
    HalfSpace,
    Sphere,
    TouchedShape,
    TouchShape,
    Vertex,
    corners,
    ends,
)

Touching = TouchShape | Sequence[TouchShape]


def contacts(
    one: Touching,
    other: Touching,
    law: NormalLaw,
    friction: Friction | None,
    *,
    are_joined: Callable[[Body, Body], bool],
) -> list[Contact]:
    """All contacts of a shape or of each of a group with another one, or with each of another group.

    A group given twice touches within itself, each pair once.  Of groups, pairs on one body and pairs of bodies that
    ``are_joined`` are left out.

    Raises:
        SceneError: what is no shape; a pair of one body; a pair that does not touch by spheres or points.
    """
    refuse_other(law, NormalLaw, "the law of a contact", wanted="fm.contact.Hertz(...) or fm.contact.PowerLaw(...)")
    if friction is not None:
        refuse_other(friction, Friction, "friction", wanted="fm.contact.Friction(...)")
    first, second = _group(one), _group(other)
    single = len(first) == len(second) == 1
    found: list[Contact] = []
    for i, a in enumerate(first):
        for b in first[i + 1 :] if one is other else second:
            if a.frame.body is b.frame.body:
                if single:
                    raise SceneError(f"{_called(a)} and {_called(b)} are on one body: they never touch")
                continue
            if not single and are_joined(a.frame.body, b.frame.body):
                continue
            found += _pair(a, b, law, friction)
    return found


def _group(given: Touching) -> list[TouchShape]:
    """The shapes of a group, or one alone."""
    shapes: list[object] = [*given] if isinstance(given, list | tuple) else [given]
    for shape in shapes:
        refuse_other(shape, SHAPES, "what touches", wanted="a shape as fm.contact.Sphere(body.frame(), radius)")
    return [shape for shape in shapes if isinstance(shape, SHAPES)]


def _pair(a: TouchShape, b: TouchShape, law: NormalLaw, friction: Friction | None) -> list[Contact]:
    """The contacts of two shapes.

    Raises:
        SceneError: neither touches the other by spheres or points.
    """
    for touched, touching in ((a, b), (b, a)):
        spheres = None if isinstance(touched, Vertex) else _spheres(touching, touched)
        if spheres is not None and not isinstance(touched, Vertex):
            return [Contact(touched, frame, radius, law, friction) for frame, radius in spheres]
    raise SceneError(
        f"{_called(a)} and {_called(b)}: no such pair is known yet. A Sphere or a Vertex touches each other shape, a "
        "Capsule and a Box touch a HalfSpace"
    )


def _spheres(touching: TouchShape, touched: TouchedShape) -> list[tuple[Frame, float]] | None:
    """The spheres, as centres and radii, by which one shape touches another; None: it does not."""
    if isinstance(touching, Vertex):
        return [(touching.frame, 0.0)]
    if type(touching) is Sphere:
        return [(touching.frame, touching.radius)]
    if isinstance(touched, HalfSpace):
        if isinstance(touching, Capsule):
            return [(end, touching.radius) for end in ends(touching)]
        if isinstance(touching, Box):
            return [(corner, 0.0) for corner in corners(touching)]
    return None


def _called(shape: TouchShape) -> str:
    return f"{type(shape).__name__} on {shape.frame.label}"
