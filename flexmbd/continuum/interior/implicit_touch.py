"""Forces of a shape, or of a reduced body's facets, on a surface's nodes at a step's end that is solved for.

A node at the depth d is pushed by N = r d, r above the stiffness that it feels with its neighbours held.  Were nothing
to enter, the node's mass would be stopped at once, a jump of velocities that no step resolves, however short.  Friction
is what would hold a node where it was on what it touches, T' - r_t s with T' of the last accepted step and its way s
across, or as much of it as Coulomb's law has (Simo & Laursen 1992): bristles a few times as stiff as the node.
Newton's method has the derivative of both, of facets that turn and of places that wander on them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.interior.facet_places import Digits
from flexmbd.continuum.interior.facet_push import comes_through
from flexmbd.continuum.interior.facet_search import FacetMesh, NearFacets
from flexmbd.continuum.interior.reduced_contact import MovedFacets
from flexmbd.multibody.interiors.touching_interior import Obstacle, ReducedFacets

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

#: The stiffness of friction's bristles over that which a node feels: with one far above it Newton's method goes round
# between states in which a node slides and sticks.
BRISTLE = 2.0


@dataclass(frozen=True, eq=False)
class TouchedState:
    """Places and forces of one contact at an accepted or tried step's end, in the first frame's axes.

    Attributes:
        y: (n, 3) m, places of the surface's nodes.
        met, rubbed: (n, 3) N, forces on them, out of what they touch and across.
        p, R: (c, 3) m, (c, 3, 3) of the frames.
        reaction: (2, k + 1, 3) as of `MovedFacets.reaction`, of both kinds; (2, 0, 3) of a shape.
    """

    y: FloatArray
    met: FloatArray
    rubbed: FloatArray
    p: FloatArray
    R: FloatArray
    reaction: FloatArray

    @property
    def force(self) -> FloatArray:
        """(n, 3) N, on the nodes, in inertial axes."""
        return np.asarray((self.met + self.rubbed) @ self.R[0].T)


@dataclass(frozen=True, eq=False)
class Touch:
    """A tried step's end of one contact.

    Attributes:
        state: there.
        on: (n,) rows of the surface's nodes that touch.
        slopes: (n, 3, 3) N/m, minus the derivative of their forces, in the first frame's axes.
        y: (3 (c - 1),) m, displacements of the frames of modes.
        phi: (n, 3, 3 (c - 1)) what they move of the places, in these axes.
        wander: (n, 3, 3, 3 (c - 1)) 1/m, derivative of phi by the places' coordinates; these are the second index.
        normal: (n, 3) out of what is touched, where facets turn; else 0.
    """

    state: TouchedState
    on: IntArray
    slopes: FloatArray
    y: FloatArray
    phi: FloatArray
    wander: FloatArray
    normal: FloatArray


class KeptFacets:
    """Where nodes are behind facets: each before the one at which it was found first in a step.

    Beneath an edge the nearest facet, and with it the normal, would change from iteration to iteration.
    """

    def __init__(self, mesh: FacetMesh) -> None:
        """No step is tried yet."""
        self._mesh = mesh
        self._before: object = None  # the state from which a step is tried
        self._triangle: IntArray = np.zeros(0, dtype=np.int64)

    def find(self, y: FloatArray, points: FloatArray, before: object) -> NearFacets:
        """Of nodes at y (n, 3) m, with the facets' points (k, 3) m, in a step from the state before."""
        mesh = self._mesh
        if before is not self._before:
            self._before, self._triangle = before, np.full(len(y), -1, dtype=np.int64)
        rows = np.flatnonzero(self._triangle >= 0)
        kept = mesh.before(y, rows, self._triangle[rows], points)
        found = mesh.find(y, points)
        found = found.some(~np.isin(found.points, kept.points)).and_others(kept.some(kept.depth > 0.0))
        self._triangle[found.points] = found.triangle
        return found

    def forget(self) -> None:
        """Forget the step that was tried."""
        self._before = None


class ImplicitTouch(Protocol):
    """A contact of a surface's nodes with what c frames carry."""

    @property
    def name(self) -> str:
        """Of the contact."""

    @property
    def frames(self) -> int:
        """c."""

    def begin(self, x: FloatArray, p: FloatArray, R: FloatArray) -> tuple[TouchedState, FloatArray]:
        """Nothing touches; and the signed distances of nodes that are near."""

    def evaluate(self, x: FloatArray, p: FloatArray, R: FloatArray, before: TouchedState, felt: FloatArray) -> Touch:
        """With nodes at x (n, 3) m and frames at p (c, 3), R (c, 3, 3); felt: (n,) N/m, a node's stiffness."""

    def forget(self) -> None:
        """Forget the step that was tried."""

    def works(self, before: TouchedState, after: TouchedState) -> FloatArray:
        """(2,) J, what contact and friction did along the ways of nodes against what they touch."""

    def wrenches(self, state: TouchedState) -> FloatArray:
        """(c, 6) on the frames in a state."""


class ShapeTouch:
    """The contact with a rigid shape."""

    frames = 1

    def __init__(self, obstacle: Obstacle) -> None:
        """Of this shape."""
        self._obstacle, self.name = obstacle, obstacle.name

    def begin(self, x: FloatArray, p: FloatArray, R: FloatArray) -> tuple[TouchedState, FloatArray]:
        """See `ImplicitTouch`."""
        y = (x - p[0]) @ R[0]
        nothing = TouchedState(y, np.zeros_like(y), np.zeros_like(y), p, R, np.zeros((2, 0, 3)))
        return nothing, self._obstacle.distances(y)[:, 0]

    def evaluate(self, x: FloatArray, p: FloatArray, R: FloatArray, before: TouchedState, felt: FloatArray) -> Touch:
        """See `ImplicitTouch`."""
        y, one = (x - p[0]) @ R[0], self._obstacle
        r, bristle = one.stiffness_ratio * felt, BRISTLE * felt
        found = one.distances(y)
        met, rubbed, slopes = law(found, y - before.y, before.rubbed, r=r, bristle=bristle, friction=one.friction)
        on = np.flatnonzero(met.any(axis=1))
        state = TouchedState(y, met, rubbed, p, R, np.zeros((2, 0, 3)))
        n = len(on)
        return Touch(state, on, slopes[on], np.zeros(0), np.zeros((n, 3, 0)), np.zeros((n, 3, 3, 0)), np.zeros((n, 3)))

    def forget(self) -> None:
        """See `ImplicitTouch`."""

    def works(self, before: TouchedState, after: TouchedState) -> FloatArray:
        """See `ImplicitTouch`."""
        return _works_on_nodes(before, after)

    def wrenches(self, state: TouchedState) -> FloatArray:
        """See `ImplicitTouch`."""
        arms = state.y @ state.R[0].T
        return -np.append(state.force.sum(axis=0), np.cross(arms, state.force).sum(axis=0))[None]


class ReducedTouch:
    """The contact with facets of a reduced body."""

    def __init__(self, given: ReducedFacets, *, size: float) -> None:
        """Of these facets; size: m, of the body whose nodes touch them."""
        self._given, self._facets, self._size, self.name = given, MovedFacets(given), size, given.name
        self._kept = KeptFacets(self._facets.mesh)

    @property
    def frames(self) -> int:
        """See `ImplicitTouch`."""
        return len(self._given.frames)

    def begin(self, x: FloatArray, p: FloatArray, R: FloatArray) -> tuple[TouchedState, FloatArray]:
        """See `ImplicitTouch`."""
        facets = self._facets
        facets.place(p, R)
        y = facets.seen(x)
        found = facets.mesh.find(y, facets.points)
        reaction = np.zeros((2, len(facets.points) + 1, 3))
        return TouchedState(y, np.zeros_like(y), np.zeros_like(y), p, R, reaction), -found.depth[~found.beside]

    def evaluate(self, x: FloatArray, p: FloatArray, R: FloatArray, before: TouchedState, felt: FloatArray) -> Touch:
        """See `ImplicitTouch`."""
        facets, given = self._facets, self._given
        facets.place(p, R)
        y = facets.seen(x)
        found = self._kept.find(y, facets.points, before)
        went = (y - before.y)[found.points]
        went -= np.einsum("nk,nka->na", found.weights, (facets.points - self._points(before))[found.nodes])
        touched = (before.met != 0.0).any(axis=1)
        entered = comes_through(found, went, touched[found.points], size=self._size)
        found, went = found.some(entered), went[entered]
        r, on = felt[found.points], found.points
        of_law = {"r": given.stiffness_ratio * r, "bristle": BRISTLE * r}
        gaps = np.column_stack([-found.depth, found.normal])
        met, rubbed, slopes = law(gaps, went, before.rubbed[on], friction=given.friction, **of_law)
        slopes += of_law["r"][:, None, None] * found.bends
        whole = np.zeros((2, *y.shape))
        whole[:, on] = met, rubbed
        reaction = np.array([facets.reaction(found, y[on], one) for one in (met, rubbed)])
        state = TouchedState(y, whole[0], whole[1], p, R, reaction)
        shapes = given.shapes[found.nodes]
        phi = np.einsum("nk,nkai->nai", found.weights, shapes)
        wander = np.einsum("nkb,nkai->nbai", found.gradients, shapes)
        return Touch(state, on, slopes, facets.y, phi, wander, found.normal)

    def forget(self) -> None:
        """See `ImplicitTouch`."""
        self._kept.forget()

    def works(self, before: TouchedState, after: TouchedState) -> FloatArray:
        """See `ImplicitTouch`."""
        way = 0.5 * (self._points(after) - self._points(before))
        reaction = (before.reaction + after.reaction)[:, :-1]  # a couple does no work in the body's axes
        return _works_on_nodes(before, after) + np.einsum("ka,tka->t", way, reaction)

    def wrenches(self, state: TouchedState) -> FloatArray:
        """See `ImplicitTouch`."""
        facets = self._facets
        facets.place(state.p, state.R)
        found = facets.wrenches(state.reaction.sum(axis=0))
        return facets.turned(found.reshape(-1, 3)).reshape(-1, 6)

    def _points(self, state: TouchedState) -> FloatArray:
        self._facets.place(state.p, state.R)
        return self._facets.points


def _works_on_nodes(before: TouchedState, after: TouchedState) -> FloatArray:
    way = 0.5 * (after.y - before.y)
    return np.array([np.vdot(way, before.met + after.met), np.vdot(way, before.rubbed + after.rubbed)])


def law(
    found: FloatArray, way: FloatArray, rubbed: FloatArray, *, r: FloatArray, bristle: FloatArray, friction: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Forces (n, 3) N out of a shape and across, and minus their derivative (n, 3, 3) by the nodes' motion.

    Args:
        found: (n, 4) m, signed distances and gradients.
        way: (n, 3) m, of the nodes against the shape in the step.
        rubbed: (n, 3) N, friction in the accepted state.
        r: (n,) N/m, of contact.
        bristle: (n,) N/m, of friction.
        friction: Coulomb's coefficient.
    """
    n, plane = found[:, 1:], np.eye(3) - found[:, 1:, None] * found[:, None, 1:]
    met, held, size, share = contact_forces(-found[:, 0], n, way, rubbed, r=r, bristle=bristle, friction=friction)
    on = size > 0.0
    slopes = np.where(on, r, 0.0)[:, None, None] * n[:, :, None] * n[:, None, :]
    if friction == 0.0 or not on.any():
        return met, np.zeros_like(met), slopes
    slides, across = on & (share < 1.0), plane.copy()
    need = np.sqrt((held**2).sum(axis=1))
    direction = held / np.where(need > 0.0, need, 1.0)[:, None]
    across[slides] -= (direction[:, :, None] * direction[:, None, :])[slides]
    slopes = slopes + (share * bristle)[:, None, None] * across
    slopes[slides] += friction * r[slides, None, None] * direction[slides, :, None] * n[slides, None, :]
    return met, share[:, None] * held, slopes


def contact_forces(
    depth: Digits, normal: Digits, way: Digits, rubbed: FloatArray, *, r: FloatArray, bristle: FloatArray,
    friction: float,
) -> tuple[Digits, Digits, Digits, Digits]:
    """The law by itself, of complex numbers too: they touch, stick and slide as their real parts do.

    Arguments as of `law`, with depths (n,) m behind what is touched, and its normals (n, 3).

    Returns:
        (n, 3) N out of it; (n, 3) N what would hold nodes; (n,) N, the first one's size; (n,) the share of the second
        that friction has.
    """
    on = depth.real > 0.0
    size = np.where(on, r * depth, 0.0)
    held = rubbed - bristle[:, None] * way
    held = held - np.einsum("na,na->n", normal, held)[:, None] * normal
    need, most = np.sqrt(np.einsum("na,na->n", held, held)), friction * size
    slides = (need.real > most.real) | (friction == 0.0)
    share = np.where(slides, most / np.where(slides & (need != 0.0), need, 1.0), np.where(on, 1.0, 0.0))
    return size[:, None] * normal, held, size, share
