"""Surfaces of elastic bodies that touch: patches of a record, which give way by modes and by residual flexibility.

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
from flexmbd.multibody.contact.patch_widths import SUPPORT, felt_forms
from flexmbd.multibody.contact.shapes import SHAPES, TouchedShape
from flexmbd.multibody.contact.table_shape import TableShape
from flexmbd.multibody.contact.triangle_surface import TriangleSurface
from flexmbd.multibody.force.shared_numbers import SharedNumbers
from flexmbd.multibody.kernels.base.lanes import padded_size
from flexmbd.multibody.kernels.contact.signed_distance import distances
from flexmbd.record.contact_patches import ContactPatches
from flexmbd.record.reduced_body import ReducedBody
from flexmbd.round_off import SEVEN_DIGITS, WORTHLESS_PIVOT

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_EDGE = 0.45 * np.pi  # rad, between the normals of neighbours: beyond it there is an edge between them

_tables: WeakKeyDictionary[ReducedBody, dict[tuple[str | None, float, bytes], SharedNumbers]] = WeakKeyDictionary()
_joined: WeakKeyDictionary[ReducedBody, dict[bytes, SharedNumbers]] = WeakKeyDictionary()


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
                raise SceneError(
                    f"{self.what}: its shape must be on the body's own frame, {label}.frame(); that this lies in a "
                    "bore and along it is said by Interface(name, origin=, axes=) and craig_bampton(..., frame=name)"
                )

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

    @cached_property
    def points(self) -> FloatArray:
        """(p, 3) m, where its patches touch, undeformed, in the body's axes: their centroids, brought onto its shape.

        The centroid of a curved patch lies behind it: of an arc of the width w and radius r by w^2 / (24 r).
        """
        x = self._group.x[self.patches]
        if self.shape is None or isinstance(self.shape, TableShape):
            return x
        found = self._from_shape(self.shape)
        return np.asarray(x - found[:, :1] * found[:, 1:])

    def check(self) -> None:
        """Raise SceneError for a shape that is beside its patches, or faces the other way.

        A shape of a formula is beside them where it is beside one, a table of triangles or a profile where it is beside
        all.
        """
        if self.shape is None:
            return
        found, width = self._from_shape(self.shape), np.sqrt(self.area)
        far, kind = np.abs(found[:, 0]), type(self.shape).__name__
        near = far <= 0.5 * width
        is_there = near.any() if isinstance(self.shape, TableShape) else near.all()
        if not is_there:
            k = int(np.argmin(near))
            raise SceneError(
                f"{self.what}: its shape, a {kind}, lies {far[k]:.3g} m from the centroid of "
                f"patch {self.patches[k]}, which is {width[k]:.2g} m wide, and is not its surface: check its size, "
                "and where it is in the body's axes (m)"
            )
        outwards = np.einsum("pa,pa->p", found[:, 1:], self.normals)
        if self.area[near] @ outwards[near] < 0.0:
            raise SceneError(
                f"{self.what}: its shape, a {kind}, faces the other way than its patches, whose normals point out of "
                "the body: of a bore it is a HollowCylinder or a HollowSphere, of a shaft or a ball a Cylinder or a "
                "Sphere, of a plane a HalfSpace whose normal points out of the body; of triangles the corners go "
                "anticlockwise as seen from outside"
            )

    def _from_shape(self, shape: TouchedShape) -> FloatArray:
        """(p, 4) signed distances (m) of a shape at the centroids, and their gradients."""
        x = np.ascontiguousarray(self._group.x[self.patches])
        if isinstance(shape, TableShape):
            return shape.distances(x)
        found = np.zeros((len(x), 4))
        distances(np.append(shape.numbers(), 0.0), x, found)
        return found

    @cached_property
    def displacements(self) -> FloatArray:
        """(p, 3, n) of its patches per unit modal coordinate, in the body's axes."""
        group, rows = self._group, self.patches
        return np.einsum("pab,pbn->pan", group.axes[rows], group.phi[rows])

    @property
    def normals(self) -> FloatArray:
        """(p, 3) mean outward normals of its patches, in the body's axes."""
        return self._group.axes[self.patches, :, 0]

    @cached_property
    def behind(self) -> FloatArray:
        """(p,) m, about how far a patch's centroid lies behind a curved surface, by how its neighbours' normals turn.

        Of an arc of the width w and radius r that is w^2 / (24 r).
        """
        x, n = self._group.x[self.patches], self.normals
        far = np.linalg.norm(x[:, None] - x, axis=2)
        turn = np.arccos(np.clip(n @ n.T, -1.0, 1.0))
        width = np.sqrt(self.area)
        near = (far > 0.0) & (far < 2.0 * np.maximum(width[:, None], width)) & (turn < _EDGE)
        curvature = np.divide(turn, far, out=np.zeros_like(far), where=near).max(axis=1, initial=0.0)
        return np.asarray(curvature * self.area / 24.0)

    @property
    def felt(self) -> float:
        """m, how far along its normal a patch is felt by what touches between the patches, at most."""
        return float(SUPPORT * np.sqrt(self.area.max()))

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
        return self.table_without_dents(np.inf)

    def table_without_dents(self, modulus: float) -> SharedNumbers:
        """The same, less what loads on patches dent a half space of this E / (1 - nu^2) (Pa); infinite: not at all.

        Which a law of the dent of bodies that are much larger than where they touch has in its depth: loads spread over
        discs of the patches' areas, by the mean displacement of a disc (Johnson 1985, section 3.4), and of others by
        their distance.
        """
        known = _tables.setdefault(self.body.record, {})
        key = self.name, modulus, self.points.tobytes()
        if key not in known:
            group, rows = self._group, self.patches
            far = np.linalg.norm(group.x[rows, None] - group.x[rows], axis=2)
            np.fill_diagonal(far, 3.0 * np.pi / 16.0 * np.sqrt(group.area[rows] / np.pi))
            known[key] = SharedNumbers(_table(group, rows, self.points, 1.0 / (np.pi * far * modulus)))
        return known[key]

    @property
    def is_plane(self) -> bool:
        """Whether the normals of all patches are one."""
        return bool(np.abs(self.normals - self.normals[0]).max() < SEVEN_DIGITS)

    @property
    def patch_radius(self) -> float:
        """m, of the disc of the smallest patch's area."""
        return float(np.sqrt(self.area.min() / np.pi))

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


def patches_table(record: ReducedBody, rows: IntArray) -> SharedNumbers:
    """The same of patches (p,) of a record that has some, whose modes are left out."""
    group, known = record.contact, _joined.setdefault(record, {})
    assert group is not None  # noqa: S101  (they are of surfaces, which were refused without)
    if rows.tobytes() not in known:
        axes, without = group.axes[rows], np.zeros((len(rows), 3, 0))
        forms = felt_forms(group.x[rows], axes[:, :, 0], group.area[rows])
        known[rows.tobytes()] = SharedNumbers(surface_table(group.x[rows], forms, without, _flexibility(group, rows)))
    return known[rows.tobytes()]


def _table(group: ContactPatches, rows: IntArray, x: FloatArray, dents: FloatArray) -> FloatArray:
    """Of some patches at x (p, 3) m, less ``dents`` (p, p) m/N."""
    axes = group.axes[rows]
    phi = np.einsum("pab,pbn->pan", axes, group.phi[rows])
    G = _flexibility(group, rows) - dents[:, :, None, None] * np.eye(3)
    return surface_table(x, felt_forms(x, axes[:, :, 0], group.area[rows]), phi, G)


def _flexibility(group: ContactPatches, rows: IntArray) -> FloatArray:
    """(p, p, 3, 3) m/N of some patches, in the body's axes."""
    axes = group.axes[rows]
    G = group.G.reshape(len(group.area), 3, len(group.area), 3)[rows][:, :, rows]
    return np.asarray(np.einsum("pab,pbqc,qdc->pqad", axes, G, axes))


def surface_table(x: FloatArray, form: FloatArray, phi: FloatArray, G: FloatArray) -> FloatArray:
    """What kernels know of a surface (``kernels.elements.surface_layout``).

    Args:
        x: (p, 3) m, centroids.
        form: (p, 3, 3) 1/m^2, within which a patch is felt.
        phi: (p, 3, n) displacements by the modes.
        G: (p, p, 3, 3) m/N residual flexibility.
    """
    p, n = len(x), phi.shape[2]
    centre = 0.5 * (x.min(axis=0) + x.max(axis=0))
    radius = np.linalg.norm(x - centre, axis=1).max()
    most = np.linalg.norm(phi, axis=1).max(axis=0)
    six = np.array([form[:, a, b] for a in range(3) for b in range(a, 3)])
    planes = (x.T, six, phi.transpose(1, 2, 0), G.transpose(2, 3, 0, 1))
    beyond = padded_size(p) - p
    padded = [np.pad(one, [(0, 0)] * (one.ndim - 1) + [(0, beyond)]) for one in planes]
    return np.concatenate([np.ravel(np.asarray(one, float)) for one in ([p, n], centre, [radius], most, *padded)])
