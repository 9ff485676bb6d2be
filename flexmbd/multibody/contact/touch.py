"""Which spheres and points of two shapes touch what: the contacts of a pair."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

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
from flexmbd.multibody.contact.lowest_points import LowestPoint, ProfileOutline, Rim
from flexmbd.multibody.contact.profile import Profile
from flexmbd.multibody.contact.shapes import (
    SHAPES,
    Box,
    Capsule,
    ConvexPolytope,
    Disc,
    HalfSpace,
    Sphere,
    TouchedShape,
    TouchShape,
    Vertex,
    corners,
    ends,
)
from flexmbd.multibody.contact.surface_contact import SurfaceContact
from flexmbd.multibody.contact.touched_pairs import ShapeKey, shape_key

FloatArray = NDArray[np.float64]

_BYTES = 2500.0  # of a contact of lists, its names and numbers in a compiled scene included, about

Touching = TouchShape | Sequence[TouchShape]
AnyContact = Contact | HardContact | HardGroup | SurfaceContact


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
    first, second = shapes_of(one), shapes_of(other)
    single = len(first) == len(second) == 1
    if isinstance(law, Hard) and not any(shape.frame.modes is not None for shape in (*first, *second)):
        if not (single and _is_known(first[0], second[0])):
            return [HardGroup(tuple(first), tuple(second), law, tuple(joined))]
    _refuse_too_many(first, second)
    found: list[AnyContact] = []
    known: set[frozenset[ShapeKey]] = set()
    keys = {id(shape): shape_key(shape) for shape in (*first, *second)}
    for a in first:
        for b in second:
            pair = frozenset((keys[id(a)], keys[id(b)]))
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


def shapes_of(given: Touching) -> list[TouchShape]:
    """The shapes of a group, or one alone.

    Raises:
        SceneError: there are none, or what is no shape.
    """
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
        if spheres is None:
            continue
        frame = touching.frame
        if not isinstance(law, Hard):
            return [
                Contact(touched, frame, one.radius, one.centre, law, friction, one.lowest, second)
                for one in spheres
                for second in ((False, True) if _bears_twice(touched, one) else (False,))
            ]
        if any(one.lowest is not None for one in spheres):
            raise SceneError(
                f"{_called(a)} and {_called(b)}: a point that goes around as its body turns has no hard contact yet; "
                "take a smooth law, as contact.PowerLaw.bearing(load=..., depth=...)"
            )
        return [HardContact(touched, frame, one.radius, one.centre, law) for one in spheres]
    raise SceneError(
        f"{_called(a)} and {_called(b)}: no such pair is known yet. A Sphere or a Vertex touches each other shape but "
        "a ConvexPolytope; a Capsule, a Box, a ConvexPolytope, a Disc and a Profile touch a HalfSpace"
    )


def _is_known(a: TouchShape, b: TouchShape) -> bool:
    """Whether one of two shapes touches the other by spheres or points that are always the same."""
    pairs = ((a, b), (b, a))
    return any(not isinstance(x, Vertex | ConvexPolytope) and _spheres(y, x) is not None for x, y in pairs)


@dataclass(frozen=True)
class _Sphere:
    """A sphere, or a point, by which a shape touches another: its radius (m), and where it is in the shape's frame."""

    radius: float
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)
    lowest: LowestPoint | None = None


def _spheres(touching: TouchShape, touched: TouchedShape) -> list[_Sphere] | None:
    """The spheres by which a shape touches another; None: by none.

    Raises:
        SceneError: a point is to meet a disc without thickness.
    """
    if isinstance(touching, Vertex):
        if isinstance(touched, Disc) and touched.thickness == 0.0:
            raise SceneError(f"{_called(touching)} passes {_called(touched)}, which has no thickness; give it one")
        return [_Sphere(0.0)]
    if type(touching) is Sphere:
        return [_Sphere(touching.radius)]
    if isinstance(touched, HalfSpace):
        if isinstance(touching, Capsule):
            return _at(ends(touching), touching.radius)
        if isinstance(touching, Box):
            return _at(corners(touching), 0.0)
        if isinstance(touching, ConvexPolytope):
            return _at(touching.polytope.vertices, 0.0)
        if isinstance(touching, Disc):
            radius, half = touching.rim
            crown = touching.crowned
            heights = (crown - half, half - crown) if half > 0.0 else (0.0,)
            return [_Sphere(touching.rounding, (0.0, 0.0, z), Rim(radius, crown)) for z in heights]
        if isinstance(touching, Profile):
            return [_Sphere(0.0, lowest=ProfileOutline(touching))]
    return None


def _bears_twice(touched: TouchedShape, sphere: _Sphere) -> bool:
    """Whether a sphere may touch two points of a profile at once, less than its radius deep."""
    return isinstance(touched, Profile) and touched.hollow < 2.0 * sphere.radius


def _at(places: FloatArray, radius: float) -> list[_Sphere]:
    """Spheres about places (k, 3) m."""
    return [_Sphere(radius, (float(x), float(y), float(z))) for x, y, z in places]


def _called(shape: TouchShape) -> str:
    return f"{type(shape).__name__} on {shape.frame.label}"
