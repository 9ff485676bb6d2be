"""Which pairs of shapes of a scene touch already: a second contact of one pair would double what both do."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import SceneError
from flexmbd.multibody.bodies.body import Body
from flexmbd.multibody.contact.elastic_surface import ElasticSurface
from flexmbd.multibody.contact.shapes import ConvexPolytope, HalfSpace, HollowSphere, Sphere, TouchShape, Vertex
from flexmbd.multibody.contact.table_shape import tables_of
from flexmbd.rotation import z_onto

ShapeKey: TypeAlias = tuple[str, str, bytes]  # the body's name, and what tells a shape on it
AnyShape: TypeAlias = TouchShape | ElasticSurface
_Joined: TypeAlias = frozenset[frozenset[str]]
_NONE_JOINED: _Joined = frozenset()


@dataclass(frozen=True)
class _Call:
    """The shapes of both sides of one call of ``System.touch``, and the pairs of bodies that it left out."""

    one: dict[ShapeKey, AnyShape]
    other: dict[ShapeKey, AnyShape]
    joined: _Joined

    def holds(self, a: ShapeKey, b: ShapeKey) -> bool:
        """Whether both touch by it."""
        among = (a in self.one and b in self.other) or (b in self.one and a in self.other)
        return among and a != b and a[0] != b[0] and frozenset((a[0], b[0])) not in self.joined


class TouchedPairs:
    """Those of a scene, whose bodies have names, call by call."""

    def __init__(self) -> None:
        self._single: dict[frozenset[ShapeKey], _Call] = {}
        self._lists: list[_Call] = []

    def add(
        self, one: Sequence[AnyShape], other: Sequence[AnyShape], *, joined: Iterable[tuple[Body, Body]]
    ) -> None:
        """Take those of a call; of lists the pairs ``joined`` do not touch.

        Raises:
            SceneError: a pair of them touches already, or a shape stands twice in a list.
        """
        first = _by_key(one)
        second = first if other is one else _by_key(other)
        single = len(first) == len(second) == 1
        left_out = _NONE_JOINED if single else frozenset(frozenset((a.name, b.name)) for a, b in joined)
        call = _Call(first, second, left_out)
        pair = frozenset((*first, *second))
        alone = self._single.values() if not single else [self._single[pair]] if pair in self._single else []
        for known in (*self._lists, *alone):
            _refuse_common(call, known)
        if single:
            self._single[pair] = call
        else:
            self._lists.append(call)


def _refuse_common(call: _Call, known: _Call) -> None:
    """Raise SceneError for a pair that touches by both."""
    straight = (call.one.keys() & known.one.keys(), call.other.keys() & known.other.keys())
    crossed = (call.one.keys() & known.other.keys(), call.other.keys() & known.one.keys())
    for left, right in (straight, crossed):
        for a in left:
            for b in right:
                if call.holds(a, b) and known.holds(a, b):
                    first, second = call.one[a], call.other[b]
                    raise SceneError(
                        f"{_told(first)} and {_told(second)} touch already, by another call of touch; a second contact "
                        "would double what they do: leave one of them out"
                    )


def _told(shape: AnyShape) -> str:
    if isinstance(shape, ElasticSurface):
        return shape.what
    return f"{type(shape).__name__} on {shape.frame.label}"


def _by_key(shapes: Sequence[AnyShape]) -> dict[ShapeKey, AnyShape]:
    """The shapes by what tells them.

    Raises:
        SceneError: two are alike.
    """
    found: dict[ShapeKey, AnyShape] = {}
    for shape in shapes:
        known = found.setdefault(shape_key(shape), shape)
        if known is not shape:
            raise SceneError(f"{_told(shape)} is twice in a list of shapes, with one place and size; leave one out")
    return found


def shape_key(shape: AnyShape) -> ShapeKey:
    """What tells a shape from all others: its body, place and size; equal of copies."""
    frame = shape.frame
    place, turn = frame.p_BF_B, frame.R_BF
    told: list[object] = [frame.interface]
    values: NDArray[np.float64] = np.zeros(0)
    if isinstance(shape, ElasticSurface):
        told = [shape.name]
    elif isinstance(shape, HalfSpace):
        normal = turn @ z_onto(shape.normal)[:, 2]
        values = np.array([*normal, normal @ place])
    elif isinstance(shape, Sphere | HollowSphere):
        values = np.array([*place, shape.radius])
    elif isinstance(shape, Vertex):
        values = place
    elif isinstance(shape, ConvexPolytope):
        values = np.concatenate([place, turn.ravel(), np.asarray(shape.polytope.vertices).ravel()])
    else:
        values = np.concatenate([place, turn.ravel(), shape.numbers()])
        told += [hashlib.sha256(one.values.tobytes()).hexdigest() for one in tables_of(shape)]
    return frame.body.name, f"{type(shape).__name__} {told}", (np.asarray(values, float) + 0.0).tobytes()
