"""Forces between nodes of one body and facets of another one, at a step's end that is solved for.

The law is that of nodes before shapes (`implicit_touch`), in the axes of the facets' body, which friction remembers a
node's way in; the stiffness of contact is above that of node and facets in series.  The facets' nodes get the force at
the node the other way round, its moment included (`carried_places`).  A contact hangs on five nodes alone, that before
the facet and the facet's: derivatives by their places are exact ones of complex numbers.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.history.nonlinear_model import NonlinearModel
from flexmbd.continuum.interior.facet_places import Digits, carried_places, nearest_places
from flexmbd.continuum.interior.facet_push import comes_through
from flexmbd.continuum.interior.facet_search import FacetSurface
from flexmbd.continuum.interior.implicit_touch import BRISTLE, KeptFacets, contact_forces
from flexmbd.continuum.interior.shape_contacts import surface_nodes
from flexmbd.multibody.interiors.touching_interior import FacingSurface

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# A perturbation so small that no digit of the real part feels it.
_TINY = 1e-30


@dataclass(frozen=True, eq=False)
class FacingState:
    """Places and forces at an accepted or tried step's end, in the axes of the facets' body.

    Attributes:
        y: (n, 3) m, this rank's nodes.
        points: (k, 3) m, the facets' nodes, the same on all ranks.
        met, rubbed: (n, 3) N, on the nodes, out of the facets and across.
        reaction: (2, k, 3) N, of both on the facets' nodes, the same on all ranks.
        p, R: (3,) m, (3, 3) of these axes.
    """

    y: FloatArray
    points: FloatArray
    met: FloatArray
    rubbed: FloatArray
    reaction: FloatArray
    p: FloatArray
    R: FloatArray

    @property
    def on_nodes(self) -> FloatArray:
        """(2, n, 3) N, both forces, in inertial axes."""
        return np.asarray(np.stack([self.met, self.rubbed]) @ self.R.T)

    @property
    def on_facets(self) -> FloatArray:
        """(2, k, 3) N, both, in inertial axes."""
        return np.asarray(self.reaction @ self.R.T)

    @property
    def x(self) -> tuple[FloatArray, FloatArray]:
        """(n, 3) and (k, 3) m, inertial."""
        return self.p + self.y @ self.R.T, self.p + self.points @ self.R.T


@dataclass(frozen=True, eq=False)
class FacetForces:
    """Nodes that touch, each with the four nodes of its facet (one twice of a triangle), in the facets' axes.

    Attributes:
        on: (m,) rows of the nodes.
        facet: (m, 4) rows of the facets' nodes.
        places: (m, 5, 3) m.
        of: (2, m, 5, 3) N, normal and friction forces on nodes at places like these.
    """

    on: IntArray
    facet: IntArray
    places: FloatArray
    of: Callable[[Digits], Digits]

    @cached_property
    def forces(self) -> FloatArray:
        """(2, m, 5, 3) N."""
        return np.asarray(self.of(self.places))

    @cached_property
    def slopes(self) -> FloatArray:
        """(m, 5, 3, 5, 3) N/m, minus the derivative of both together by the places."""
        out = np.zeros((len(self.on), 5, 3, 5, 3))
        for k in range(5 if len(self.on) else 0):
            for a in range(3):
                places = self.places.astype(complex)
                places[:, k, a] += 1j * _TINY
                out[:, :, :, k, a] = -self.of(places).sum(axis=0).imag / _TINY
        return out

    @cached_property
    def turned(self) -> FloatArray:
        """(m, 5, 3, 3) N, change of both together where the axes, in which friction remembers, turn by themselves.

        The last index is the axis of the turn.  With the nodes it would turn the forces.
        """
        unit = np.eye(3)
        whole = self.forces.sum(axis=0)
        ways = np.cross(unit, self.places[:, :, None, :])
        back = np.einsum("mkalb,mlcb->mkca", self.slopes, ways)
        return np.asarray((np.cross(unit, whole[:, :, None, :]) + back).swapaxes(2, 3))


class FacingTouch:
    """The contact of one body's nodes with another one's facets.

    Attributes:
        given: what it is, by its name.
        nodes: (n,) this rank's nodes.
        surface: the facets.
        owned: rows of the facets' nodes that this rank owns.
        stiffness: N/m, 2-norm of that of all nodes.
    """

    def __init__(
        self, given: FacingSurface, nodes: NonlinearModel, facets: NonlinearModel, felt: tuple[FloatArray, FloatArray],
        *, size: float,
    ) -> None:
        """Find nodes and facets. Collective.

        Args:
            given: the surfaces.
            nodes: the body of the nodes.
            facets: that of the facets.
            felt: (owned nodes,) N/m of both, which a node feels with its neighbours held.
            size: m, of the first body.

        Raises:
            SceneError: on all ranks: facets have nodes beside their corners.
        """
        self.given, self._comm, self._size = given, nodes.comm, size
        self.nodes, self.surface = surface_nodes(nodes, given.surface), FacetSurface(facets, given.facets)
        self.owned = np.flatnonzero(self.surface.own >= 0)
        of_facets = 1.0 / self.gathered(felt[1][:, None])[:, 0].mean()
        self._felt: FloatArray = 1.0 / (1.0 / felt[0][self.nodes] + of_facets)
        self.stiffness = float(nodes.norm(given.stiffness_ratio * self._felt))
        self._kept = KeptFacets(self.surface)

    def gathered(self, values: FloatArray) -> FloatArray:
        """(k, m) values (nodes, m) of the facets' body on its surface, on all ranks. Collective."""
        out = np.zeros((len(self.surface.number), values.shape[1]))
        out[self.owned] = values[self.surface.own[self.owned]]
        return np.asarray(sum(self._comm.allgather(out)))

    def begin(self, x: FloatArray, others: FloatArray, p: FloatArray, R: FloatArray) -> tuple[FacingState, FloatArray]:
        """Nothing touches; and the signed distances of nodes that are near. Collective.

        Args:
            x: (nodes, 3) m, of the nodes' body.
            others: (nodes, 3) m, of the facets' body.
            p: (3,) m, of that body's axes.
            R: (3, 3) of these.
        """
        y, points = (x[self.nodes] - p) @ R, self.gathered((others - p) @ R)
        found = self.surface.find(y, points)
        still = np.zeros_like(y)
        state = FacingState(y, points, still, still, np.zeros((2, *points.shape)), p, R)
        return state, -found.depth[~found.beside]

    def evaluate(
        self, x: FloatArray, others: FloatArray, p: FloatArray, R: FloatArray, before: FacingState
    ) -> tuple[FacingState, FacetForces]:
        """Forces with nodes and axes as of `begin`, after the accepted state. Collective."""
        y, points, width = (x[self.nodes] - p) @ R, self.gathered((others - p) @ R), self.surface.facets.shape[1]
        found = self._kept.find(y, points, before)
        spread = self.surface.spread(found.triangle)
        places = np.concatenate([y[found.points, None], points[found.nodes]], axis=1)
        begun = np.concatenate([before.y[found.points, None], before.points[found.nodes]], axis=1)
        mass = np.ones((len(places), width))

        def way(places: Digits, some: Any = slice(None)) -> tuple[Digits, Digits, Digits, Digits]:
            """Depths, normals, what of the facets' nodes the places have, and their way in the step."""
            node, facet = places[:, 0], places[:, 1:]
            corners = np.einsum("nij,nja->nia", spread[some], facet)
            depth, normal, share = nearest_places(node, corners, found.off[some])
            weights = np.einsum("ni,nij->nj", share, spread[some])
            carry = carried_places(weights, node, facet[:, :width], mass[some])
            went = places - begun[some]
            return depth, normal, carry, went[:, 0] - np.einsum("nkab,nkb->na", carry, went[:, 1:])

        touched = (before.met != 0.0).any(axis=1)
        entered = comes_through(found, way(places)[3].real, touched[found.points], size=self._size)
        on = found.points[entered]
        rubbed, felt, given = before.rubbed[on], self._felt[on], self.given
        told: dict[str, Any] = {"r": given.stiffness_ratio * felt, "bristle": BRISTLE * felt}

        def forces(places: Digits) -> Digits:
            depth, normal, carry, went = way(places, entered)
            met, held, _, share = contact_forces(depth, normal, went, rubbed, friction=given.friction, **told)
            both = np.stack([met, share[:, None] * held])
            return np.concatenate([both[:, :, None], -np.einsum("nkab,tna->tnkb", carry, both)], axis=2)

        touch = FacetForces(on, found.nodes[entered], places[entered], forces)
        whole = np.zeros((2, *y.shape))
        whole[:, on] = touch.forces[:, :, 0]
        reaction = np.zeros((2, *points.shape))
        for kind in range(2):
            np.add.at(reaction[kind], touch.facet, touch.forces[kind, :, 1:])
        reaction = np.asarray(sum(self._comm.allgather(reaction)))
        return FacingState(y, points, whole[0], whole[1], reaction, p, R), touch

    def forget(self) -> None:
        """Forget the step that was tried."""
        self._kept.forget()
