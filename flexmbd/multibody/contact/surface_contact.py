"""Elastic surfaces that touch shapes, each other, or a sphere at one point, as force elements."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import SceneError
from flexmbd.given import refuse_other
from flexmbd.multibody.bodies.body import FlexibleBody, Frame
from flexmbd.multibody.contact.contact_laws import Hertz, NormalLaw
from flexmbd.multibody.contact.elastic_surface import ElasticSurface, surface_table
from flexmbd.multibody.contact.hard_contact import Hard
from flexmbd.multibody.contact.impact_law import ImpactLaw
from flexmbd.multibody.contact.shapes import SHAPES, ConvexPolytope, HalfSpace, Sphere, TouchedShape, TouchShape, Vertex
from flexmbd.multibody.contact.table_shape import placed_numbers, tables_of
from flexmbd.multibody.force.protocol import BetweenFrames, ElementTable
from flexmbd.multibody.force.shared_numbers import SharedNumbers, WithSharedNumbers
from flexmbd.multibody.kernels.elements.surface_forces import ELASTIC_SURFACE, ROUGH_SURFACE
from flexmbd.multibody.kernels.elements.surface_friction import PATCH_MEMORY, friction_scratch
from flexmbd.multibody.kernels.elements.surface_layout import surface_scratch
from flexmbd.record.contact_patches import ContactPatches
from flexmbd.record.reduced_body import ReducedBody

FloatArray = NDArray[np.float64]

# The table of a surface that is one rigid point: no modes, a ball of no size, nothing felt, at the origin, no dent.
_POINT = SharedNumbers(
    surface_table(np.zeros((1, 3)), np.zeros((1, 3, 3)), np.zeros((1, 3, 0)), np.zeros((1, 1, 3, 3)))
)


@dataclass(frozen=True, eq=False)
class SurfaceContact(BetweenFrames, WithSharedNumbers):
    """An elastic surface that touches a rigid shape or another one, or is touched by a sphere at its nearest point.

    ``System.touch`` makes it.

    Attributes:
        surface: on frame G: its patches are the points that touch; a ``Sphere`` is one.
        other: on frame F.
        law: ``Hard``, of friction; of a sphere on an elastic surface the law of the dent, in series with the patches.
    """

    surface: ElasticSurface | Sphere
    other: TouchedShape | ElasticSurface
    law: Hard | NormalLaw

    @property
    def shape(self) -> TouchedShape:
        """What the patches touch, undeformed."""
        return self.other.touched if isinstance(self.other, ElasticSurface) else self.other

    @cached_property
    def frame_F(self) -> Frame:  # type: ignore[override]
        """The shape's, or the other surface's body's."""
        return self.other.frame

    @cached_property
    def frame_G(self) -> Frame:  # type: ignore[override]
        """The elastic body's, or the sphere's."""
        return self.surface.frame

    @property
    def area(self) -> FloatArray:
        """(p,) m^2 of the patches; of a sphere's point not a number."""
        return self.surface.area if isinstance(self.surface, ElasticSurface) else np.array([np.nan])

    @property
    def touching(self) -> tuple[tuple[TouchShape | ElasticSurface, ...], ...]:
        """What touches and what it touches, as the named surfaces of bodies."""
        ends = (self.surface, self.other)
        return tuple(one.parts if isinstance(one, ElasticSurface) else (cast(TouchShape, one),) for one in ends)

    @property
    def sides(self) -> tuple[ElasticSurface | Sphere, TouchedShape | ElasticSurface]:
        """What touches and what it touches."""
        return self.surface, self.other

    @property
    def elastic(self) -> tuple[ElasticSurface, ...]:
        """The elastic surfaces among them."""
        return tuple(one for one in self.sides if isinstance(one, ElasticSurface))

    @property
    def may_join(self) -> bool:
        """Whether it gives way together with others that press the same bodies: patches without friction."""
        return isinstance(self.law, Hard) and self.law.mu == 0.0

    @property
    def what(self) -> str:
        """Its name in messages."""
        ends = [
            one.what if isinstance(one, ElasticSurface) else f"{type(one).__name__} {one.frame.label}"
            for one in self.sides
        ]
        return f"contact of {ends[0]} with {ends[1]}"

    @property
    def shared_numbers(self) -> tuple[SharedNumbers, ...]:
        """The surfaces' and the shape's tables."""
        return (*self._tables, *tables_of(self.shape))

    @property
    def curved(self) -> TouchedShape:
        """The shape, whose curvatures a law asks for; of a plane surface of facets a half space."""
        if isinstance(self.other, ElasticSurface) and self.other.shape is None and self.other.is_plane:
            return HalfSpace(self.shape.frame)
        return self.shape

    @property
    def _tables(self) -> tuple[SharedNumbers, ...]:
        own = self.surface.table if isinstance(self.surface, ElasticSurface) else _POINT
        if not isinstance(self.other, ElasticSurface):
            return (own,)
        if isinstance(self.law, Hertz):
            return (own, self.other.table_without_dents(self.law.touched_modulus))
        return (own, self.other.table)

    def check(self) -> None:
        """Raise SceneError for a law or a shape that does not fit."""
        if self.other.frame.body is self.surface.frame.body:
            raise SceneError(f"{self.what}: both are on one body, and never touch")
        for one in self.elastic:
            one.check()
        if isinstance(self.surface, Sphere):
            self._check_law_of_point(self.surface.radius)
            return
        wanted = "fm.contact.Hard(mu=...); laws of a stiffness are of a Sphere on an elastic surface"
        refuse_other(self.law, Hard, f"{self.what}: its law", wanted=wanted)
        law = cast(Hard, self.law)
        law.check(self.what)
        if law.restitution != 0.0 or law.impact is not ImpactLaw.NEWTON:
            raise SceneError(
                f"{self.what}: restitution = {law.restitution:g} and impact={law.impact} are of rigid bodies; what an "
                "elastic one loses in an impact is what its waves keep: leave both out"
            )
        if isinstance(self.shape, Vertex | ConvexPolytope):
            raise SceneError(f"{self.what}: a {type(self.shape).__name__} is not touched by patches")

    def _check_law_of_point(self, radius: float) -> None:
        law = cast(NormalLaw, self.law)
        law.check(self.what)
        law.stiffness(self.curved, radius, self.what)
        if law.dissipation() != 0.0:
            raise SceneError(
                f"{self.what}: what an impact on an elastic body loses is what its waves keep: leave restitution out"
            )

    @property
    def _sizes(self) -> tuple[tuple[int, int], tuple[int, int]]:
        """Patches and modes of the surface, and of the other."""
        own, sizes = (1, 0), (0, 0)
        if isinstance(self.other, ElasticSurface):
            sizes = len(self.other.patches), self.other.body.record.n_modes
        if isinstance(self.surface, ElasticSurface):
            own = len(self.surface.patches), self.surface.body.record.n_modes
        return own, sizes

    @property
    def own_scratch(self) -> int:
        """How many numbers of ``work.generalized`` the kernels need for it by itself, without friction."""
        own, sizes = self._sizes
        return surface_scratch(*own, *sizes)

    def assemble(self, table: ElementTable) -> None:
        """One row."""
        places = [float(table.shared(one)) for one in self._tables]
        law, mu = (0.0, 1.0), 0.0
        radius = 0.0 if isinstance(self.surface, ElasticSurface) else self.surface.radius
        if isinstance(self.law, Hard):
            mu = self.law.mu
        else:
            law = self.law.stiffness(self.curved, radius, self.what), self.law.exponent
        shape = placed_numbers(self.shape, table)
        group, number, together = table.joined()
        other = places[1] if len(places) > 1 else -1.0
        data = table.numbers([places[0], *shape, radius, mu, other, *law, group, number])
        kind, count, memory, scratch = ELASTIC_SURFACE, 0, -1, max(self.own_scratch, together)
        if mu > 0.0:
            own, sizes = self._sizes
            kind, count = ROUGH_SURFACE, PATCH_MEMORY * own[0]
            memory = table.memory({f"_{k}": 0.0 for k in range(count)})
            scratch += friction_scratch(own[0], own[1] + sizes[1])
        f, g = table.frame(self.frame_F), table.frame(self.frame_G)
        table.element(kind, self.what, f=f, g=g, data=data, count=count, memory=memory, scratch=scratch)


#: Surfaces of elastic bodies, as `System.touch` takes them.
Elastic: TypeAlias = ElasticSurface | Sequence[ElasticSurface]


def surface_contacts(one: object, other: object, law: Any, *, friction: object) -> list[SurfaceContact] | None:
    """The contacts of elastic surfaces with shapes, or with each other, each with each; None where there are none.

    Raises:
        SceneError: there is friction beside the law's, or what is no shape.
    """
    sides: list[list[Any]] = [list(side) if isinstance(side, list | tuple) else [side] for side in (one, other)]
    elastic = [[isinstance(shape, ElasticSurface) for shape in side] for side in sides]
    if not any(map(any, elastic)):
        return None
    if not all(elastic[0]):
        sides, elastic = sides[::-1], elastic[::-1]
    surfaces, shapes = sides
    if not all(elastic[0]):
        raise SceneError("elastic surfaces and rigid shapes do not stand in one list: give them in two calls of touch")
    if friction is not None:
        raise SceneError(
            f"{surfaces[0].what}: its friction is the law's, fm.contact.Hard(mu=...): leave `friction` out"
        )
    refuse_other(law, (Hard, NormalLaw), f"{surfaces[0].what}: its law", wanted="fm.contact.Hard(mu=...)")
    wanted = "a shape as fm.contact.HalfSpace(...)"
    for shape in shapes:
        refuse_other(shape, (*SHAPES, ElasticSurface), "what an elastic surface touches", wanted=wanted)
    of_point = not isinstance(law, Hard)
    return [
        SurfaceContact(shape, surface, law)
        if of_point and isinstance(shape, Sphere)
        else SurfaceContact(surface, shape, law)
        for surface in surfaces
        for shape in shapes
    ]


def refuse_other_patches(contact: SurfaceContact, body: FlexibleBody, record: ReducedBody) -> None:
    """Raise SceneError for another record of a body that a compiled contact presses, with other patches."""
    for one in contact.elastic:
        if one.body is body and not _are_alike(one.body.record.contact, record.contact):
            raise SceneError(
                f"{contact.what}: a record of {body.name!r} with other contact patches cannot take the place of that "
                "in a compiled machine, which knows the patches of the first; build the scene anew with it"
            )


def refuse_other_surfaces(contact: SurfaceContact, now: SurfaceContact) -> None:
    """Raise SceneError for a variant of a compiled contact by other patches: its group has the numbers of the first."""
    pressed = [[(id(one.body), one.patches.tolist()) for one in each.elastic] for each in (contact, now)]
    if pressed[0] != pressed[1]:
        raise SceneError(f"{contact.what}: it cannot vary to other patches, {now.what}; build the scene anew with them")


def _are_alike(one: ContactPatches | None, other: ContactPatches | None) -> bool:
    """Whether patches are the same, to the bit."""
    if one is None or other is None:
        return one is other
    return all(np.array_equal(getattr(one, field.name), getattr(other, field.name)) for field in fields(one))
