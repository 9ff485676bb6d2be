"""Nodes on the surface of a body with history, which touch rigid shapes and facets of other bodies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import SceneError
from flexmbd.given import is_number, refuse_no_name, refuse_other
from flexmbd.multibody.bodies.body import Body, FlexibleBody, Frame, Ground
from flexmbd.multibody.bodies.continuum_body import ContinuumBody
from flexmbd.multibody.contact.hard_contact import Hard
from flexmbd.multibody.contact.profile import Profile
from flexmbd.multibody.contact.shapes import (
    Box,
    Capsule,
    Cylinder,
    Disc,
    HalfSpace,
    HollowCylinder,
    HollowSphere,
    Sphere,
)
from flexmbd.multibody.contact.surface_facets import SurfaceFacets, check_surface, reduced_facets
from flexmbd.multibody.contact.table_shape import tables_of
from flexmbd.multibody.contact.triangle_surface import TriangleSurface
from flexmbd.multibody.force.protocol import check_numbers
from flexmbd.multibody.interiors.scene_interiors import InteriorForce
from flexmbd.multibody.interiors.touching_interior import (
    CoupledInterior,
    FacingSurface,
    Obstacle,
    ReducedFacets,
    ReducedTouchingInterior,
    TouchingInterior,
)
from flexmbd.multibody.kernels.contact import signed_distance as at
from flexmbd.round_off import WORTHLESS_PIVOT

FloatArray = NDArray[np.float64]

_WANTED = "a fm.ContinuumBody, as scene.add returned it"
TouchedByNodes: TypeAlias = (
    Sphere | HollowSphere | Cylinder | HollowCylinder | Disc | Capsule | Box | HalfSpace | Profile | TriangleSurface
)
_TOUCHED = (Sphere, HollowSphere, Cylinder, HollowCylinder, Disc, Capsule, Box, HalfSpace, Profile, TriangleSurface)


@dataclass(frozen=True, eq=False)
class Nodes:
    """The nodes on a surface of a body with history, those bonded to its frames included.

    Attributes:
        body: in the scene, an ExplicitContinuum or ImplicitContinuum its interior.
        surface: the name of a group of facets of its mesh.
        penalty: of explicit steps: between 0 and 3, the stiffness of contact over that of the stable step, as of a
            ``RigidPlane``; None: what meets the shape stops, which must then be on the ground.
        stiffness_ratio: of implicit steps: the stiffness of contact over that which a node feels with its neighbours
            held, positive.  The higher, the less nodes enter, and the shorter the steps that resolve an impact.
        name: of the contact in ``run.outer_forces``; by default made of the surface and the shape's frame.

    Raises:
        SceneError: it is no such body, has no such surface, or the penalty is none.
    """

    body: ContinuumBody
    surface: str
    penalty: float | None = 0.5
    stiffness_ratio: float = 10.0
    name: str | None = None

    def __post_init__(self) -> None:
        if self.name is not None:
            refuse_no_name(self.name, "the name of contact.Nodes")
        refuse_other(self.body, ContinuumBody, "the body of contact.Nodes", wanted=_WANTED)
        known = self.penalty is None or (is_number(self.penalty) and 0.0 < self.penalty < 3.0)
        if not known:
            raise SceneError(f"{self.what}: penalty must be None or between 0 and 3, got {self.penalty!r}")
        check_numbers(self.what, positive={"stiffness_ratio": self.stiffness_ratio})
        check_surface(self.body, self.surface, kind="Nodes", what=self.what)

    @property
    def what(self) -> str:
        """How messages call it."""
        return f"nodes on {self.surface!r} of body {self.body.name!r}"


@dataclass(frozen=True, eq=False)
class NodalContact:
    """The contact of a surface's nodes with one rigid shape, or with facets; ``System.touch`` makes them.

    Attributes:
        nodes: the surface.
        shape: on the ground, a rigid body, or a frame of a body with history; or facets of another body, with history
            or reduced.
        law: hard, with Coulomb's friction.
        name: in ``run.outer_forces(nodes.body)``.
    """

    nodes: Nodes
    shape: TouchedByNodes | SurfaceFacets
    law: Hard
    name: str

    def obstacle(self) -> Obstacle:
        """What the interior is told of a rigid shape.

        Raises:
            SceneError: the shape's body has no inertia about an axis.
        """
        if not isinstance(self.shape, _TOUCHED):
            raise SceneError(f"contact {self.name!r} is with no rigid shape")
        frame = self.shape.frame
        mass = None if isinstance(frame.body, Ground) else _mass_about(frame, self.name)
        numbers, table = self.shape.numbers(), tables_of(self.shape)
        if table:
            numbers[at.TABLE] = at.SHAPE_NUMBERS
        data = np.concatenate([numbers, *(one.values for one in table)])

        def distances(points: FloatArray) -> FloatArray:
            out = np.zeros((len(points), 4))
            at.distances(data, np.ascontiguousarray(points), out)
            return out

        told, box = self.nodes, _box(self.shape)
        steps = self.law.mu, told.penalty, told.stiffness_ratio
        return Obstacle(self.name, told.surface, frame, distances, box, *steps, mass)

    @property
    def is_with_reduced(self) -> bool:
        """Whether it is with facets of a reduced body."""
        return isinstance(self.shape, SurfaceFacets) and isinstance(self.shape.body, FlexibleBody)

    @property
    def is_with_other(self) -> bool:
        """Whether it is with facets of another body with history."""
        return isinstance(self.shape, SurfaceFacets) and isinstance(self.shape.body, ContinuumBody)

    def reduced(self) -> ReducedFacets:
        """What the interior is told of a reduced body's surface.

        Raises:
            SceneError: it is with none.
        """
        told, facets = self.nodes, self.shape
        if not (isinstance(facets, SurfaceFacets) and isinstance(facets.body, FlexibleBody)):
            raise SceneError(f"contact {self.name!r} is with no reduced body")
        return reduced_facets(
            facets.body, facets.surface, what=facets.what, name=self.name, surface=told.surface, friction=self.law.mu,
            penalty=told.penalty, stiffness_ratio=told.stiffness_ratio,
        )

    def facing(self) -> FacingSurface:
        """What the interior is told of a surface of another body with history.

        Raises:
            SceneError: it is with none.
        """
        told, facets = self.nodes, self.shape
        if not isinstance(facets, SurfaceFacets) or not isinstance(facets.body, ContinuumBody):
            raise SceneError(f"contact {self.name!r} is with no other body with history")
        interior = facets.body.interior
        steps = self.law.mu, float(told.penalty or 0.0), told.stiffness_ratio
        return FacingSurface(self.name, told.surface, interior, str(facets.surface), *steps)


def nodal_contacts(
    nodes: Nodes, shapes: object, law: object, *, friction: object, known: Sequence[NodalContact]
) -> list[NodalContact]:
    """The contacts of a surface with a shape or each of a list.

    Raises:
        SceneError: no such shape, law or name.
    """
    what = nodes.what
    if not isinstance(law, Hard) or friction is not None:
        raise SceneError(
            f"{what} touch by fm.contact.Hard(mu=...), with friction in it: their body is what gives way, and has no "
            "further stiffness"
        )
    law.check(what)
    if law.restitution != 0.0:
        raise SceneError(
            f"{what}: restitution = {law.restitution} is of rigid bodies; what an elastic body's impact leaves follows "
            "from its waves and what yields: leave it out"
        )
    found: list[NodalContact] = []
    listed = list(shapes) if isinstance(shapes, list | tuple) else [shapes]
    if not listed:
        raise SceneError(f"{what}: a list of shapes that are to touch is empty")
    for shape in listed:
        if isinstance(shape, SurfaceFacets):
            found.append(_facing(nodes, shape, law, (*known, *found)))
            continue
        wanted = "a shape as fm.contact.Box(body.frame(), sides), or fm.contact.SurfaceFacets(body, surface)"
        refuse_other(shape, _TOUCHED, f"what {what} touch", wanted=wanted)
        if isinstance(shape, _TOUCHED):
            found.append(_shaped(nodes, shape, law, (*known, *found)))
    return found


def _shaped(nodes: Nodes, shape: TouchedByNodes, law: Hard, known: Sequence[NodalContact]) -> NodalContact:
    """The contact of nodes with a rigid shape.

    Raises:
        SceneError: it deforms, has no thickness, gives way without a penalty, or is known already.
    """
    frame = shape.frame
    what = f"{nodes.what} and {type(shape).__name__} on {frame.label}"
    if frame.modes is not None:
        raise SceneError(
            f"{what}: this frame deforms, and the shapes that nodes of a body with history touch are on rigid bodies"
        )
    if isinstance(shape, Disc) and shape.thickness == 0.0:
        raise SceneError(f"{what}: nodes pass a disc which has no thickness; give it one")
    if nodes.penalty is None and not isinstance(frame.body, Ground):
        raise SceneError(
            f"{what}: without a penalty nodes stop where they meet what does not move; this shape's body gives way: "
            "give a penalty, as 0.5"
        )
    for one in known:
        if one.shape is shape and one.nodes.body is nodes.body and one.nodes.surface == nodes.surface:
            raise SceneError(f"{what} touch already")
    name = _free_name(nodes.name or f"{nodes.surface} on {frame.label}", (nodes.body,), known)
    return NodalContact(nodes, shape, law, name)


def interior_forces(bodies: Sequence[ContinuumBody], contacts: Sequence[NodalContact]) -> list[InteriorForce]:
    """The forces of bodies' interiors, which are told what their surfaces touch.  Collective where some touch.

    Raises:
        SceneError: as ``NodalContact.obstacle`` and ``TouchingInterior``.
    """
    alone = {id(body.interior): InteriorForce(body, *_met(body, contacts)) for body in bodies}
    for one in contacts:
        interior = one.nodes.body.interior
        if one.is_with_other and isinstance(interior, TouchingInterior):
            interior.face(one.facing())
    forces = []
    for body in bodies:
        own, interior = alone[id(body.interior)], body.interior
        pairs = tuple(
            one.name
            for one in contacts
            if one.is_with_other and isinstance(one.shape, SurfaceFacets) and body in (one.nodes.body, one.shape.body)
        )
        others = interior.beside if isinstance(interior, CoupledInterior) else ()
        beside = tuple(frame for one in others for frame in alone[id(one)].frames)
        forces.append(InteriorForce(body, own.obstacles, own.reduced, pairs, beside))
    return forces


def _met(
    body: ContinuumBody, contacts: Sequence[NodalContact]
) -> tuple[tuple[Obstacle, ...], tuple[ReducedFacets, ...]]:
    """The shapes and reduced bodies that a body touches, of which its interior is told."""
    own = [one for one in contacts if one.nodes.body is body]
    obstacles = tuple(one.obstacle() for one in own if isinstance(one.shape, _TOUCHED))
    reduced = tuple(one.reduced() for one in own if one.is_with_reduced)
    if isinstance(body.interior, TouchingInterior):
        body.interior.meet(obstacles)
    if isinstance(body.interior, ReducedTouchingInterior):
        body.interior.meet_reduced(reduced)
    return obstacles, reduced


def _facing(nodes: Nodes, facets: SurfaceFacets, law: Hard, known: Sequence[NodalContact]) -> NodalContact:
    """The contact of nodes with facets.

    Raises:
        SceneError: of one body, without a penalty, or known already.
    """
    what = f"{nodes.what} and {facets.what}"
    if nodes.body is facets.body:
        raise SceneError(f"{what}: a body with history does not touch itself yet")
    if nodes.penalty is None:
        raise SceneError(f"{what}: without a penalty nodes stop where they meet what does not move; give one, as 0.5")
    interior = nodes.body.interior
    if isinstance(facets.body, FlexibleBody) and not isinstance(interior, ReducedTouchingInterior):
        raise SceneError(
            f"{what}: the interior of {nodes.body.name!r}, {type(interior).__name__}, touches no reduced bodies; take "
            "ExplicitContinuum or ImplicitContinuum"
        )
    for one in known:
        other = one.shape
        same = isinstance(other, SurfaceFacets) and other.body is facets.body and other.surface == facets.surface
        if same and one.nodes.body is nodes.body and one.nodes.surface == nodes.surface:
            raise SceneError(f"{what} touch already")
    own = nodes.name or f"{nodes.surface} on {facets.label}"
    return NodalContact(nodes, facets, law, _free_name(own, (nodes.body, facets.body), known))


def _free_name(name: str, bodies: Sequence[Body | ContinuumBody], known: Sequence[NodalContact]) -> str:
    """A name that no contact of some bodies has."""
    taken = {
        one.name
        for one in known
        if one.nodes.body in bodies or (isinstance(one.shape, SurfaceFacets) and one.shape.body in bodies)
    }
    if name not in taken:
        return name
    return next(f"{name} {k}" for k in range(2, len(taken) + 3) if f"{name} {k}" not in taken)


def _box(shape: TouchedByNodes) -> FloatArray:
    """(2, 3) m, between which corners a shape is, in its frame's axes."""
    half: FloatArray = np.full(3, np.inf)
    if isinstance(shape, Box):
        half = 0.5 * np.asarray(shape.sides, dtype=float)
    elif isinstance(shape, Sphere):
        half = np.full(3, shape.radius)
    elif isinstance(shape, Capsule):
        half = np.array([shape.radius, shape.radius, 0.5 * shape.length + shape.radius])
    elif isinstance(shape, Disc):
        half = np.array([shape.radius, shape.radius, 0.5 * shape.thickness])
    elif isinstance(shape, Cylinder):
        half = np.array([shape.radius, shape.radius, np.inf])
    return np.array([-half, half])


def _mass_about(frame: Frame, name: str) -> FloatArray:
    """(6, 6) mass matrix of a frame's body, as rigid, about the frame's origin and in its axes."""
    body: Body = frame.body
    (first, second), m, p, R = body.moments(), float(body.mass), frame.p_BF_B, frame.R_BF
    shifted = first - m * p
    moved = R.T @ (second - np.outer(p, first) - np.outer(first, p) + m * np.outer(p, p)) @ R
    x, y, z = R.T @ shifted
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    mass = np.block([[m * np.eye(3), -skew], [skew, np.trace(moved) * np.eye(3) - moved]])
    scale = np.sqrt(np.diag(mass))
    if not (scale > 0.0).all() or not np.linalg.eigvalsh(mass / np.outer(scale, scale))[0] > WORTHLESS_PIVOT:
        raise SceneError(
            f"contact {name!r}: body {body.name!r}, which carries the shape, has no inertia about an axis; give it one"
        )
    return mass
