"""Nodes of one body that touch facets of another one, both stepped by central differences side by side.

A node at the depth d behind a facet is pushed out by k d, and the facet's nodes the other way round, as the place where
the node is hangs on them: that before it on the facet, and the depth, which turns as the facet's nodes do in the mean.
So the reaction has the moment of the force at the node, and friction keeps angular momentum.  k is a share of what the
shorter stable step of both bodies allows, with the masses of the node and of the place on the facet in series.  Contact
begins where a node comes through the facets from before them, so that what comes from beside them, behind their plane,
is not thrown out.  Friction is that of bristles as stiff as the push (`nodal_push`).
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.history.body_memory import BodyMemory
from flexmbd.continuum.history.nonlinear_model import NonlinearModel
from flexmbd.continuum.interior.facet_places import carried_places
from flexmbd.continuum.interior.facet_push import push_out
from flexmbd.continuum.interior.facet_search import FacetSurface, NearFacets, check_facets, check_same_ranks
from flexmbd.continuum.interior.nodal_push import penalty_stiffness
from flexmbd.continuum.interior.shape_contacts import surface_nodes
from flexmbd.continuum.interior.touched_frames import refuse_inside
from flexmbd.multibody.interiors.touching_interior import FacingSurface

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# As of `shape_contacts`: steps for which the stable one is to hold.
_AHEAD = 20.0

#: The two sides of a pair.
NODES, FACETS = 0, 1


class SteppedNodes(Protocol):
    """The nodes of a body that is stepped, as `NodalMotion` has them, with the same units."""

    body: NonlinearModel
    memory: BodyMemory
    x: FloatArray
    v: FloatArray

    @property
    def masses(self) -> FloatArray:
        """(owned nodes,) kg."""

    @property
    def limit(self) -> float:
        """The longest stable step, s."""

    @property
    def step_at_rest(self) -> float:
        """The same without contact and deformation."""

    @property
    def ahead(self) -> FloatArray:
        """(owned nodes, 3) m, where nodes are at the step's end."""

    @property
    def size(self) -> float:
        """m, of the body."""


class SurfacePair:
    """The contact of nodes with facets.

    Attributes:
        given: what it is, by its name.
        resultant: (3,) N, on the body of the nodes, this rank's part.
        memory: (owned nodes, 4): m, the stretch of its nodes' bristles, in inertial axes; and 1 of nodes that touch.
    """

    def __init__(
        self, given: FacingSurface, nodes: SteppedNodes, facets: SteppedNodes, surfaces: tuple[str, str]
    ) -> None:
        """Find nodes and facets. Collective.

        Raises:
            SceneError: on all ranks: the bodies are on other ranks; facets have nodes beside their corners, or are the
                edges of a plane body.
        """
        check_facets(facets.body, surfaces[FACETS], what=f"contact {given.name!r}")
        check_same_ranks(nodes.body, facets.body, what=f"contact {given.name!r}")
        self.given, self._motions, self._comm = given, (nodes, facets), nodes.body.comm
        self._nodes = surface_nodes(nodes.body, surfaces[NODES])
        self._surface = FacetSurface(facets.body, surfaces[FACETS])
        self._owned = np.flatnonzero(self._surface.own >= 0)
        self._facet_mass = self._gathered(facets.masses[:, None])[:, 0]
        self._stiffness = penalty_stiffness(given.penalty, min(nodes.step_at_rest, facets.step_at_rest))
        self.memory: FloatArray = np.zeros((len(nodes.masses), 4))
        self.resultant: FloatArray = np.zeros(3)
        self._forces: dict[int, tuple[FloatArray, FloatArray]] = {}
        self._starts: dict[int, FloatArray] = {}
        self._stride = 0.0

    def begin(self) -> None:
        """One of the bodies begins anew."""
        self.memory[:], self.resultant[:] = 0.0, 0.0
        self._forces, self._starts, self._stride = {}, {}, 0.0

    def check_start(self) -> None:
        """Refuse bodies that begin within each other. Collective.

        Raises:
            SceneError: on all ranks.
        """
        nodes, facets = self._motions
        found = self._surface.find(nodes.x[self._nodes], self._gathered(facets.x))
        refuse_inside(self._comm, self.given.name, -found.depth[~found.beside], size=nodes.size)

    def nodes(self, side: int) -> IntArray:
        """(n,) owned nodes of a body on the surface that touches."""
        return self._nodes if side == NODES else self._surface.own[self._owned]

    def plan(self, side: int) -> None:
        """A body is to step from where it is."""
        x = self._motions[side].x
        self._starts[side] = x[self._nodes] if side == NODES else x[self._surface.own[self._owned]]

    def take(self, side: int) -> tuple[FloatArray, FloatArray]:
        """(owned nodes, 3) N on a body's nodes at the step's end, out of the facets and across. Collective."""
        if side not in self._forces:
            self._evaluate()
        return self._forces.pop(side)

    def stiffness_bound(self) -> float:
        """1/s^2, a bound of the squared angular frequencies by this contact alone, for some steps. Collective."""
        nodes, facets = self._motions
        stride = max(self._comm.allgather(self._stride))
        x = self._gathered(facets.x)
        points = nodes.x[self._nodes]
        found = self._surface.find(points, x, margin=_AHEAD * stride)
        spring, on_facets = self._springs(found), np.zeros(len(x))
        straight = found.weights[:, :, None, None] * np.eye(3)
        turning = self._carry(found, points, x) - straight
        size = abs(found.weights) + np.sqrt((turning**2).sum(axis=(2, 3)))  # at least the spectral norms
        np.add.at(on_facets, found.nodes, spring[:, None] * size * size.sum(axis=1)[:, None])
        own = nodes.masses[self._nodes[found.points]]
        most = max([self._stiffness, *self._comm.allgather(float((spring / own).max(initial=0.0)))])
        summed = np.asarray(sum(self._comm.allgather(on_facets)))
        return most + float((summed / self._facet_mass).max(initial=0.0))

    def approach(self) -> None:
        """Foresee how far both go in a first step, by their velocities. Collective."""
        speeds = [abs(one.v).max(initial=0.0) * one.limit for one in self._motions]
        self._stride = float(np.sqrt(3.0) * sum(speeds))

    def snapshot(self) -> dict[str, FloatArray]:
        """Copies of what it remembers, of the whole body. Collective."""
        nodes = self._motions[NODES]
        stride = max(self._comm.allgather(self._stride))
        sums = np.asarray(sum(self._comm.allgather(self.resultant)))
        return {"memory": nodes.memory.gather_nodes(self.memory), "sums": np.append(sums, stride)}

    def restore(self, kept: dict[str, FloatArray]) -> None:
        """Go back to a snapshot."""
        self.begin()
        nodes = self._motions[NODES]
        self.memory = nodes.memory.scatter_nodes(kept["memory"])[: len(nodes.masses)]
        self.resultant = kept["sums"][:3] * (self._comm.rank == 0)
        self._stride = float(kept["sums"][3])

    def _evaluate(self) -> None:
        """Forces at the places where both bodies are when the step ends. Collective."""
        nodes, facets = self._motions
        points, x = nodes.ahead[self._nodes], self._gathered(facets.ahead)
        found = self._surface.find(points, x)
        carry = self._carry(found, points, x)
        went = self._went(points, x, found, carry)
        told = {"friction": self.given.friction, "size": nodes.size}
        pushed = push_out(found, went, self.memory[self._nodes], **told)
        carry = carry[np.isin(found.points, pushed.found.points)]
        found, touching = pushed.found, self._nodes[pushed.found.points]
        spring = self._springs(found)
        self.memory = np.zeros_like(self.memory)
        self.memory[self._nodes] = pushed.memory
        met, rubbed = spring[:, None] * pushed.met, spring[:, None] * pushed.rubbed
        self.resultant = (met + rubbed).sum(axis=0)
        on_nodes = np.zeros_like(nodes.x), np.zeros_like(nodes.x)
        self._forces = {NODES: on_nodes, FACETS: self._on_facets(found, carry, met, rubbed)}
        for out, force in zip(self._forces[NODES], (met, rubbed), strict=True):
            out[touching] = force

    def _on_facets(
        self, found: NearFacets, carry: FloatArray, met: FloatArray, rubbed: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """(owned nodes, 3) N, on the facets' body. Collective."""
        forces = np.zeros((len(self._surface.number), 2, 3))
        np.add.at(forces, found.nodes, -np.einsum("nkab,nca->nkcb", carry, np.stack([met, rubbed], axis=1)))
        forces = np.asarray(sum(self._comm.allgather(forces)))
        met_there, rubbed_there = np.zeros((2, len(self._motions[FACETS].masses), 3))
        own = self._surface.own[self._owned]
        met_there[own], rubbed_there[own] = forces[self._owned, 0], forces[self._owned, 1]
        return met_there, rubbed_there

    def _carry(self, found: NearFacets, points: FloatArray, x: FloatArray) -> FloatArray:
        """(n, 4, 3, 3) by how much of their facets' nodes' displacements the places go with these where points are.

        Args:
            found: where points are before facets.
            points: (all points, 3) m.
            x: (k, 3) m, of the facets' nodes.
        """
        width = self._surface.facets.shape[1]  # what is beyond is a corner again
        nodes = found.nodes[:, :width]
        return carried_places(found.weights, points[found.points], x[nodes], self._facet_mass[nodes])

    def _went(self, points: FloatArray, x: FloatArray, found: NearFacets, carry: FloatArray) -> FloatArray:
        """(n, 3) m, how far nodes went in the step against the places that go with facets. Collective."""
        if len(self._starts) < 2:  # at the start nothing has moved
            return np.zeros((len(found.points), 3))
        before = np.zeros_like(x)
        before[self._owned] = self._starts[FACETS]
        before = np.asarray(sum(self._comm.allgather(before)))
        own, other = points - self._starts[NODES], x - before
        way = np.sqrt((own**2).sum(axis=1).max(initial=0.0)) + np.sqrt((other**2).sum(axis=1).max(initial=0.0))
        self._stride = float(way)
        return np.asarray(own[found.points] - np.einsum("nkab,nkb->na", carry, other[found.nodes]))

    def _springs(self, found: NearFacets) -> FloatArray:
        """(n,) N/m, of nodes that touch: of the masses of node and place in series."""
        own = self._motions[NODES].masses[self._nodes[found.points]]
        moves = 1.0 / own + (found.weights**2 / self._facet_mass[found.nodes]).sum(axis=1)
        return np.asarray(self._stiffness / moves)

    def _gathered(self, values: FloatArray) -> FloatArray:
        """(k, m) values (owned nodes, m) of the facets' body on the surface, on all ranks. Collective."""
        out = np.zeros((len(self._surface.number), values.shape[1]))
        out[self._owned] = values[self._surface.own[self._owned]]
        return np.asarray(sum(self._comm.allgather(out)))
