"""Surfaces of elastic bodies that touch: contact patches of a record, which give way by modes and by residual flexibility.

Their kernels: ``kernels.elements.surface_forces``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import SceneError
from flexmbd.given import refuse_other
from flexmbd.multibody.bodies.body import FlexibleBody, Frame
from flexmbd.multibody.contact.hard_contact import Hard
from flexmbd.multibody.contact.impact_law import ImpactLaw
from flexmbd.multibody.contact.shapes import SHAPES, ConvexPolytope, TouchedShape, Vertex
from flexmbd.multibody.contact.table_shape import placed_numbers, tables_of
from flexmbd.multibody.force.protocol import BetweenFrames, ElementTable
from flexmbd.multibody.force.shared_numbers import SharedNumbers, WithSharedNumbers
from flexmbd.multibody.kernels.elements.surface_forces import ELASTIC_SURFACE
from flexmbd.multibody.kernels.elements.surface_layout import surface_scratch
from flexmbd.record.contact_patches import ContactPatches
from flexmbd.record.reduced_body import ReducedBody
from flexmbd.round_off import WORTHLESS_PIVOT

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_tables: WeakKeyDictionary[ReducedBody, dict[str | None, SharedNumbers]] = WeakKeyDictionary()


@dataclass(frozen=True, eq=False)
class ElasticSurface:
    """A surface of a reduced elastic body, by whose contact patches it touches rigid shapes.

    What gives way is the body: its modes, and of each patch what these leave out, the record's residual flexibility
    (`ContactPatches`).  Patches of one surface give way together.

    Attributes:
        body: a flexible body whose record has contact patches.
        name: of a surface among ``record.contact.names``; None: all patches.

    Raises:
        SceneError: the record has no patches, none of this name, or patches that give way by the modes alone.
    """

    body: FlexibleBody
    name: str | None = None

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
        assert group is not None  # refused when it was made
        return group

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
    most = np.linalg.norm(phi, axis=1).max(axis=0)
    parts = ([p, n], centre, [radius], most, x, phi, G, group.area[rows])
    return np.concatenate([np.ravel(np.asarray(one, float)) for one in parts])


@dataclass(frozen=True, eq=False)
class SurfaceContact(BetweenFrames, WithSharedNumbers):
    """An elastic surface that touches a rigid shape; ``System.touch`` makes it.

    Attributes:
        surface: of the body on frame G.
        shape: on frame F.
        law: of friction; nothing enters.
    """

    surface: ElasticSurface
    shape: TouchedShape
    law: Hard

    @property
    def frame_F(self) -> Frame:  # type: ignore[override]
        """The shape's."""
        return self.shape.frame

    @cached_property
    def frame_G(self) -> Frame:  # type: ignore[override]
        """The elastic body's."""
        return self.surface.frame

    @property
    def what(self) -> str:
        """Its name in messages."""
        return f"contact of {self.surface.what} with {type(self.shape).__name__} {self.frame_F.label}"

    @property
    def shared_numbers(self) -> tuple[SharedNumbers, ...]:
        """The surface's and the shape's tables."""
        return (self.surface.table, *tables_of(self.shape))

    def check(self) -> None:
        """Raise SceneError for a law or a shape that does not fit."""
        refuse_other(self.law, Hard, f"{self.what}: its law", wanted="fm.contact.Hard(mu=...)")
        self.law.check(self.what)
        if self.law.restitution != 0.0 or self.law.impact is not ImpactLaw.NEWTON:
            raise SceneError(
                f"{self.what}: restitution = {self.law.restitution:g} and impact={self.law.impact} are of rigid bodies; "
                "what an elastic one loses in an impact is what its waves keep: leave both out"
            )
        refuse_other(self.shape, SHAPES, f"{self.what}: what it touches", wanted="a shape as fm.contact.HalfSpace(...)")
        if isinstance(self.shape, Vertex | ConvexPolytope):
            raise SceneError(f"{self.what}: a {type(self.shape).__name__} is not touched by patches")
        if self.shape.frame.body is self.surface.body:
            raise SceneError(f"{self.what}: both are on one body, and never touch")

    def assemble(self, table: ElementTable) -> None:
        """One row."""
        numbers = [float(table.shared(self.surface.table)), *placed_numbers(self.shape, table), 0.0, self.law.mu]
        table.element(
            ELASTIC_SURFACE, self.what, f=table.frame(self.frame_F), g=table.frame(self.frame_G),
            data=table.numbers(numbers),
            count=surface_scratch(len(self.surface.patches), self.surface.body.record.n_modes),
        )  # fmt: skip


def surface_contacts(one: object, other: object, law: object, *, friction: object) -> list[SurfaceContact] | None:
    """The contacts of elastic surfaces with shapes, each with each; None where neither side is one.

    Raises:
        SceneError: there is friction beside the law's, or surfaces on both sides.
    """
    sides = [list(side) if isinstance(side, (list, tuple)) else [side] for side in (one, other)]
    elastic = [[isinstance(shape, ElasticSurface) for shape in side] for side in sides]
    if not any(map(any, elastic)):
        return None
    if any(elastic[1]):
        sides, elastic = sides[::-1], elastic[::-1]
    surfaces, shapes = sides
    if any(elastic[1]) or not all(elastic[0]):
        raise SceneError("elastic surfaces touch rigid shapes: give surfaces on one side and shapes on the other")
    if friction is not None:
        raise SceneError(f"{surfaces[0].what}: its friction is the law's, fm.contact.Hard(mu=...): leave `friction` out")
    for shape in shapes:
        refuse_other(shape, SHAPES, "what an elastic surface touches", wanted="a shape as fm.contact.HalfSpace(...)")
    return [SurfaceContact(surface, shape, law) for surface in surfaces for shape in shapes]
