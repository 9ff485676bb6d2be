"""Surfaces of elastic bodies that touch: patches of a record, which give way by modes and by residual flexibility.

Their kernels: ``kernels.elements.surface_forces``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias, cast
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import SceneError
from flexmbd.given import refuse_other
from flexmbd.multibody.bodies.body import FlexibleBody, Frame
from flexmbd.multibody.contact.hard_contact import Hard
from flexmbd.multibody.contact.impact_law import ImpactLaw
from flexmbd.multibody.contact.shapes import SHAPES, ConvexPolytope, TouchedShape, TouchShape, Vertex
from flexmbd.multibody.contact.table_shape import placed_numbers, tables_of
from flexmbd.multibody.contact.triangle_surface import TriangleSurface
from flexmbd.multibody.force.protocol import BetweenFrames, ElementTable
from flexmbd.multibody.force.shared_numbers import SharedNumbers, WithSharedNumbers
from flexmbd.multibody.kernels.elements.surface_forces import ELASTIC_SURFACE, ROUGH_SURFACE
from flexmbd.multibody.kernels.elements.surface_friction import PATCH_MEMORY, friction_scratch
from flexmbd.multibody.kernels.elements.surface_layout import surface_scratch
from flexmbd.record.contact_patches import ContactPatches
from flexmbd.record.reduced_body import ReducedBody
from flexmbd.round_off import WORTHLESS_PIVOT

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# Of the side of the largest patch: within it a patch is felt; the diagonal of a square one has to be.
_SUPPORT = 1.75

_tables: WeakKeyDictionary[ReducedBody, dict[str | None, SharedNumbers]] = WeakKeyDictionary()


@dataclass(frozen=True, eq=False)
class ElasticSurface:
    """A surface of a reduced elastic body, by whose contact patches it touches rigid shapes and other surfaces.

    What gives way is the body: its modes, and of each patch what these leave out, the record's residual flexibility
    (`ContactPatches`).  Patches of one surface give way together.

    Attributes:
        body: a flexible body whose record has contact patches.
        name: of a surface among ``record.contact.names``; None: all patches.
        shape: what it is undeformed, on the body's frame, where other surfaces touch it: an open or closed
            ``TriangleSurface``, or what has a formula, as a ``Cylinder``.  None: its facets, of a record that keeps the
            modes at its nodes.

    Raises:
        SceneError: the record has no patches, none of this name, or patches that give way by the modes alone.
    """

    body: FlexibleBody
    name: str | None = None
    shape: TouchedShape | None = None

    def __post_init__(self) -> None:
        refuse_other(self.body, FlexibleBody, "the body of an ElasticSurface", wanted="fm.FlexibleBody(record)")
        group = self.body.record.contact
        label = self.body.name or "the body"
        if group is None:
            raise SceneError(
                f"ElasticSurface of {label}: its record has no contact patches; reduce the part again with "
                "craig_bampton(..., contact=[Patch(name, size=...)]): they need the factor of its stiffness, which no "
                "record holds"
            )
        if self.name is not None and self.name not in group.names:
            there = ", ".join(map(repr, group.names))
            raise SceneError(f"ElasticSurface of {label}: no surface {self.name!r}; its record has {there}")
        self._refuse_stiff(group)
        if self.shape is not None:
            refuse_other(self.shape, SHAPES, f"{self.what}: its shape", wanted="a shape as fm.contact.Cylinder(...)")
            if not self._is_own(self.shape.frame):
                raise SceneError(f"{self.what}: its shape must be on the body's own frame, {label}.frame()")

    @property
    def frame(self) -> Frame:
        """The body's frame."""
        return self.body.frame()

    @property
    def what(self) -> str:
        """Its name in messages."""
        return f"elastic surface {self.name or 'of all patches'!s} of {self.body.name or 'a flexible body'}"

    @cached_property
    def patches(self) -> IntArray:
        """(p,) its patches, by their rows in ``record.contact``."""
        group = self._group
        if self.name is None:
            return np.arange(len(group.area))
        return np.flatnonzero(group.surface == group.names.index(self.name))

    @cached_property
    def touched(self) -> TouchedShape:
        """What it is undeformed, where other surfaces touch it.

        Raises:
            SceneError: nothing says it.
        """
        if self.shape is not None:
            return self.shape
        group, modes = self._group, self.body.record.modes
        if modes is None or not len(group.facet):
            raise SceneError(
                f"{self.what}: other surfaces touch it by what it is undeformed, and its record keeps no nodes: reduce "
                "it with keep=Keep(modes=True), or give ElasticSurface(..., shape=), as contact.TriangleSurface("
                "body.frame(), points, triangles, open=True) or a Cylinder, Sphere or HalfSpace on the body's frame"
            )
        own = np.isin(group.patch, self.patches)
        corners = np.searchsorted(modes.node, group.facet[own])
        if corners.shape[1] == 4:
            corners = np.concatenate([corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]])
        used, places = np.unique(corners, return_inverse=True)
        return TriangleSurface(self.body.frame(), modes.x[used], places.reshape(-1, 3), open=True)

    @property
    def parts(self) -> tuple[ElasticSurface, ...]:
        """The named surfaces that it is of."""
        if self.name is not None:
            return (self,)
        return tuple(ElasticSurface(self.body, name) for name in self._group.names)

    @property
    def area(self) -> FloatArray:
        """(p,) m^2 of its patches."""
        return self._group.area[self.patches]

    @property
    def table(self) -> SharedNumbers:
        """What the kernels know of it (``kernels.elements.surface_layout``)."""
        known = _tables.setdefault(self.body.record, {})
        if self.name not in known:
            known[self.name] = SharedNumbers(_table(self._group, self.patches))
        return known[self.name]

    @property
    def _group(self) -> ContactPatches:
        group = self.body.record.contact
        assert group is not None  # noqa: S101  (refused when it was made)
        return group

    def _is_own(self, frame: Frame) -> bool:
        """Whether a frame is the body's."""
        placed = bool(np.any(frame.p_BF_B)) or not np.array_equal(frame.R_BF, np.eye(3)) or frame.modes is not None
        return frame.body is self.body and not placed

    def _refuse_stiff(self, group: ContactPatches) -> None:
        """Raise SceneError where patches have no flexibility of their own along their normals."""
        along = 3 * self.patches
        G = group.G[np.ix_(along, along)]
        size = np.sqrt(np.maximum(np.diag(G), 0.0))
        none = np.flatnonzero(~(size > 0.0))
        remedy = "keep fewer modes, or take patches of another size"
        if len(none):
            k = int(self.patches[none[0]])
            raise SceneError(
                f"{self.what}: the modes leave nothing of the dent of patch {k} of {group.names[group.surface[k]]!r}, "
                f"so that nothing but its mass would resist a contact there: {remedy}"
            )
        least = float(np.linalg.eigvalsh(G / np.outer(size, size))[0])
        if not least > WORTHLESS_PIVOT:
            raise SceneError(
                f"{self.what}: some loads on its patches dent it by the modes alone (the least eigenvalue of its "
                f"residual flexibility is {least:.2g} of the patches'): {remedy}"
            )


def _table(group: ContactPatches, rows: IntArray) -> FloatArray:
    p, n = len(rows), group.phi.shape[2]
    x, axes = group.x[rows], group.axes[rows]
    phi = np.einsum("pab,pbn->pan", axes, group.phi[rows])
    G = group.G.reshape(len(group.area), 3, len(group.area), 3)[rows][:, :, rows]
    G = np.einsum("pab,pbqc,qdc->pqad", axes, G, axes)
    centre = 0.5 * (x.min(axis=0) + x.max(axis=0))
    radius = np.linalg.norm(x - centre, axis=1).max()
    support = _SUPPORT * np.sqrt(group.area[rows].max())
    most = np.linalg.norm(phi, axis=1).max(axis=0)
    parts = ([p, n], centre, [radius, support], most, x, phi, G)
    return np.concatenate([np.ravel(np.asarray(one, float)) for one in parts])


@dataclass(frozen=True, eq=False)
class SurfaceContact(BetweenFrames, WithSharedNumbers):
    """An elastic surface that touches a rigid shape, or another elastic surface; ``System.touch`` makes it.

    Attributes:
        surface: of the body on frame G; its patches are the points that touch.
        other: on frame F.
        law: of friction; nothing enters.
    """

    surface: ElasticSurface
    other: TouchedShape | ElasticSurface
    law: Hard

    @property
    def shape(self) -> TouchedShape:
        """What the patches touch, undeformed."""
        return self.other.touched if isinstance(self.other, ElasticSurface) else self.other

    @cached_property
    def frame_F(self) -> Frame:  # type: ignore[override]
        """The shape's, or the other surface's body's."""
        return self.other.frame if not isinstance(self.other, ElasticSurface) else self.shape.frame

    @cached_property
    def frame_G(self) -> Frame:  # type: ignore[override]
        """The elastic body's."""
        return self.surface.frame

    @property
    def touching(self) -> tuple[TouchShape | ElasticSurface, ...]:
        """What it touches, as the named surfaces of a body."""
        return self.other.parts if isinstance(self.other, ElasticSurface) else (cast(TouchShape, self.other),)

    @property
    def what(self) -> str:
        """Its name in messages."""
        if isinstance(self.other, ElasticSurface):
            return f"contact of {self.surface.what} with {self.other.what}"
        return f"contact of {self.surface.what} with {type(self.other).__name__} {self.frame_F.label}"

    @property
    def shared_numbers(self) -> tuple[SharedNumbers, ...]:
        """The surfaces' and the shape's tables."""
        others = (self.other.table,) if isinstance(self.other, ElasticSurface) else ()
        return (self.surface.table, *others, *tables_of(self.shape))

    def check(self) -> None:
        """Raise SceneError for a law or a shape that does not fit."""
        refuse_other(self.law, Hard, f"{self.what}: its law", wanted="fm.contact.Hard(mu=...)")
        self.law.check(self.what)
        if self.law.restitution != 0.0 or self.law.impact is not ImpactLaw.NEWTON:
            raise SceneError(
                f"{self.what}: restitution = {self.law.restitution:g} and impact={self.law.impact} are of rigid "
                "bodies; what an elastic one loses in an impact is what its waves keep: leave both out"
            )
        wanted = "a shape as fm.contact.HalfSpace(...)"
        refuse_other(self.other, (*SHAPES, ElasticSurface), f"{self.what}: what it touches", wanted=wanted)
        if self.other.frame.body is self.surface.body:
            raise SceneError(f"{self.what}: both are on one body, and never touch")
        if isinstance(self.shape, Vertex | ConvexPolytope):
            raise SceneError(f"{self.what}: a {type(self.shape).__name__} is not touched by patches")

    def assemble(self, table: ElementTable) -> None:
        """One row."""
        other, sizes = -1.0, (0, 0)
        if isinstance(self.other, ElasticSurface):
            other = float(table.shared(self.other.table))
            sizes = len(self.other.patches), self.other.body.record.n_modes
        own = len(self.surface.patches), self.surface.body.record.n_modes
        shape = placed_numbers(self.shape, table)
        data = table.numbers([float(table.shared(self.surface.table)), *shape, 0.0, self.law.mu, other])
        kind, count, memory, scratch = ELASTIC_SURFACE, 0, -1, surface_scratch(*own, *sizes)
        if self.law.mu > 0.0:
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
        SceneError: there is friction beside the law's.
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
    wanted = "a shape as fm.contact.HalfSpace(...)"
    for shape in shapes:
        refuse_other(shape, (*SHAPES, ElasticSurface), "what an elastic surface touches", wanted=wanted)
    return [SurfaceContact(surface, shape, law) for surface in surfaces for shape in shapes]
