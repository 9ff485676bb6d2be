"""All contacts of bodies with history with each other, of those that are solved for together at a step's end."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.history.body_memory import BodyMemory
from flexmbd.continuum.history.nonlinear_model import NonlinearModel
from flexmbd.continuum.interior.facing_touch import FacetForces, FacingState, FacingTouch
from flexmbd.continuum.interior.step_equations import BodyAxes
from flexmbd.continuum.interior.touched_frames import refuse_inside

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class FacingForces:
    """The contacts at a place that is tried.

    Attributes:
        states: of each.
        points: of each, where it touches.
        on_bodies: (owned nodes, 3) N, by all, on each body's nodes, in inertial axes.
    """

    states: tuple[FacingState, ...]
    points: tuple[FacetForces, ...]
    on_bodies: tuple[FloatArray, ...]


@dataclass(frozen=True, eq=False)
class Facing:
    """A contact of nodes of one body, by its row, with facets of another.

    Attributes:
        touch: the contact.
        nodes, facets: rows of the bodies.
        dofs: (n, 3) of the nodes, and
        facet_dofs: (k, 3) of the facets' nodes among those of all bodies on all ranks.
        works: (2, 2) J, what contact and friction did, on the nodes' body and on the facets', the same on all ranks.
    """

    touch: FacingTouch
    nodes: int
    facets: int
    dofs: IntArray
    facet_dofs: IntArray
    works: FloatArray


class FacingContacts:
    """The contacts between some bodies.

    Attributes:
        contacts: them.
    """

    def __init__(self, bodies: Sequence[NonlinearModel], touches: Sequence[tuple[FacingTouch, int, int]] = ()) -> None:
        """Nothing touches yet; touches: each with the rows of the bodies of its nodes and facets. Collective."""
        self._bodies, self._comm = tuple(bodies), bodies[0].comm
        own = sum(body.n_owned for body in bodies)
        self._rows = own, sum(self._comm.allgather(own)[: self._comm.rank])
        starts = self._rows[1] + np.cumsum([0, *(body.n_owned for body in bodies)])
        dofs = [first + body.layout.displacement_dofs for first, body in zip(starts, bodies, strict=False)]
        found = []
        for touch, nodes, facets in touches:
            there = np.rint(touch.gathered(dofs[facets].astype(float))).astype(np.int64)
            found.append(Facing(touch, nodes, facets, dofs[nodes][touch.nodes], there, np.zeros((2, 2))))
        self.contacts: tuple[Facing, ...] = tuple(found)
        self._now: dict[int, FacingState] = {}  # those that have begun

    @property
    def names(self) -> list[str]:
        """Of the contacts."""
        return [one.touch.given.name for one in self.contacts]

    def stiffness(self, body: int) -> float:
        """N/m, 2-norm of that of the contacts of a body."""
        of = (one for one in self.contacts if body in (one.nodes, one.facets))
        return float(np.linalg.norm([one.touch.stiffness for one in of]))

    def begin(self, body: int, places: Mapping[int, tuple[FloatArray, BodyAxes]], sizes: Mapping[int, float]) -> None:
        """A body begins anew: its contacts with those that have begun, at places (nodes, 3) m, have not touched yet.

        Collective.

        Raises:
            SceneError: on all ranks: bodies begin within each other.
        """
        for k, one in enumerate(self.contacts):
            if body not in (one.nodes, one.facets):
                continue
            one.works[:] = 0.0
            self._now.pop(k, None)
            one.touch.forget()
            if one.nodes in places and one.facets in places:
                (x, _), (others, axes) = places[one.nodes], places[one.facets]
                self._now[k], distances = one.touch.begin(x, others, axes.p, axes.R)
                refuse_inside(self._comm, one.touch.given.name, distances, size=sizes[one.nodes])

    def evaluate(self, places: Sequence[FloatArray], axes: Sequence[BodyAxes]) -> FacingForces:
        """Forces with all bodies' nodes at places (local nodes, 3) m, and their axes. Collective."""
        found = []
        for k, one in enumerate(self.contacts):
            of = axes[one.facets]
            found.append(one.touch.evaluate(places[one.nodes], places[one.facets], of.p, of.R, self._now[k]))
        states = tuple(state for state, _ in found)
        on_bodies = self._on_bodies(dict(enumerate(states)))
        return FacingForces(states, tuple(points for _, points in found), tuple(on_bodies))

    def _on_bodies(self, states: Mapping[int, FacingState]) -> list[FloatArray]:
        """(owned nodes, 3) N on each."""
        out: list[FloatArray] = [np.zeros((body.layout.n_owned_nodes, 3)) for body in self._bodies]
        for k, state in sorted(states.items()):
            one, own = self.contacts[k], self.contacts[k].touch.owned
            out[one.nodes][one.touch.nodes] += state.on_nodes.sum(axis=0)
            out[one.facets][one.touch.surface.own[own]] += state.on_facets.sum(axis=0)[own]
        return out

    def slopes(self, forces: FacingForces, axes: Sequence[BodyAxes]) -> PETSc.Mat | None:
        """Minus the derivative of the forces by all displacements, in the bodies' axes; None of nothing. Collective."""
        count = sum(len(points.on) for points in forces.points)
        if not self._comm.allreduce(count, op=MPI.SUM):
            return None
        own = (self._rows[0], PETSc.DETERMINE)
        matrix = PETSc.Mat().createAIJ((own, own), comm=self._comm)
        matrix.setOption(PETSc.Mat.Option.NEW_NONZERO_ALLOCATION_ERR, False)
        matrix.setUp()
        for one, points in zip(self.contacts, forces.points, strict=True):
            facets = one.facet_dofs[points.facet]
            dofs = np.concatenate([one.dofs[points.on][:, None], facets], axis=1).reshape(-1, 15).astype(PETSc.IntType)
            turn, blocks = self._turn(one, axes), points.slopes.copy()
            blocks[:, 0] = np.einsum("ab,mbkc->makc", turn, blocks[:, 0])
            blocks[:, :, :, 0] = np.einsum("mkab,cb->mkac", blocks[:, :, :, 0], turn)
            for rows, block in zip(dofs, blocks.reshape(-1, 15, 15), strict=True):
                matrix.setValues(rows, rows, block, addv=PETSc.InsertMode.ADD_VALUES)
        matrix.assemble()
        return matrix

    def moved(
        self, forces: FacingForces, changes: Sequence[FloatArray], axes: Sequence[BodyAxes]
    ) -> list[FloatArray]:
        """(owned nodes, 3) N on each body, linearised; changes: (owned dofs,) N, minus those, in its axes."""
        acting = zip(forces.on_bodies, changes, axes, strict=True)
        return [force - one.to_inertial(change) for force, change, one in acting]

    def turned(
        self, forces: FacingForces, spans: Sequence[slice], axes: Sequence[BodyAxes]
    ) -> list[FloatArray]:
        """(owned dofs, c) N, by which residuals change where axes turn by themselves, in each body's. Collective.

        Args:
            forces: at a place.
            spans: of the columns of each body's frames; its axes turn by the rotations of the first one.
            axes: of the bodies.
        """
        out: list[FloatArray] = [np.zeros((body.n_owned, spans[-1].stop)) for body in self._bodies]
        for one, points in zip(self.contacts, forces.points, strict=True):
            if one.touch.given.friction == 0.0:  # nothing is remembered in axes
                continue
            mine = range(spans[one.facets].start + 3, spans[one.facets].start + 6)
            R = axes[one.facets].R
            of_turns = np.einsum("mkab,cb->mkac", points.turned, R)  # by turns about inertial axes
            there = np.zeros((len(one.facet_dofs), 3, 3))
            np.add.at(there, points.facet, of_turns[:, 1:])
            there = np.asarray(sum(self._comm.allgather(there)))
            rows, facets, own = one.dofs - self._start(one.nodes), one.touch.surface.own, one.touch.owned
            at_facets = self._bodies[one.facets].layout.displacement_dofs[facets[own]]
            on_nodes = np.einsum("ab,mbc->mac", self._turn(one, axes), of_turns[:, 0])
            for k, column in enumerate(mine):
                np.add.at(out[one.nodes][:, column], rows[points.on], -on_nodes[:, :, k])
                out[one.facets][at_facets, column] -= there[own, :, k]
        return out

    def _start(self, body: int) -> int:
        """The first of a body's dofs on this rank among those of all."""
        return self._rows[1] + sum(one.n_owned for one in self._bodies[:body])

    def _turn(self, one: Facing, axes: Sequence[BodyAxes]) -> FloatArray:
        """(3, 3) from the axes of a contact's facets to those of its nodes."""
        return np.asarray(axes[one.nodes].R.T @ axes[one.facets].R)

    def accept(self, forces: FacingForces) -> None:
        """Make a tried step's end the accepted one. Collective."""
        for k, (one, after) in enumerate(zip(self.contacts, forces.states, strict=True)):
            before = self._now[k]
            ways = [0.5 * (end - start) for start, end in zip(before.x, after.x, strict=True)]
            on_nodes = np.einsum("na,tna->t", ways[0], before.on_nodes + after.on_nodes)
            on_facets = np.einsum("na,tna->t", ways[1], before.on_facets + after.on_facets)
            one.works[0] += np.asarray(sum(self._comm.allgather(on_nodes)))
            one.works[1] += on_facets
            self._now[k] = after

    def revert(self) -> None:
        """Forget the step that was tried."""
        for one in self.contacts:
            one.touch.forget()

    def nodal(self, body: int) -> FloatArray:
        """(owned nodes, 3) N, on a body's nodes in the accepted state, in inertial axes."""
        return self._on_bodies(self._now)[body]

    def pushed(self, body: int) -> list[tuple[IntArray, FloatArray]]:
        """Owned nodes of a body on surfaces that touch, and sizes (n,) N of normal forces there."""
        found = []
        for k, state in self._now.items():
            one, own = self.contacts[k], self.contacts[k].touch.owned
            if one.nodes == body:
                found.append((one.touch.nodes, np.linalg.norm(state.met, axis=1)))
            if one.facets == body:
                found.append((one.touch.surface.own[own], np.linalg.norm(state.reaction[0, own], axis=1)))
        return found

    def resultants(self, body: int) -> dict[str, FloatArray]:
        """(3,) N by name, on a body in the accepted state. Collective where there are some."""
        found = {}
        for k, state in self._now.items():
            one = self.contacts[k]
            if body in (one.nodes, one.facets):
                on_facets = state.on_facets.sum(axis=(0, 1))
                found[one.touch.given.name] = on_facets if one.facets == body else -on_facets
        return found

    def works(self, body: int) -> FloatArray | None:
        """(2,) J, what contact and friction did on a body; None of one that touches no other."""
        found = [one.works[0] for one in self.contacts if one.nodes == body]
        found += [one.works[1] for one in self.contacts if one.facets == body]
        return np.asarray(sum(found)) if found else None

    def snapshot(self, body: int, memory: BodyMemory) -> dict[str, FloatArray]:
        """Copies of what contacts of a body's nodes remember, of the whole body. Collective."""
        kept: dict[str, FloatArray] = {}
        for k, state in self._now.items():
            one = self.contacts[k]
            if one.nodes == body:
                values = np.zeros((self._bodies[body].layout.n_owned_nodes, 9))
                values[one.touch.nodes] = np.hstack([state.y, state.met, state.rubbed])
                kept[f"facing {k}"] = memory.gather_nodes(values)
                kept[f"facing {k} facets"] = np.concatenate([state.points[None], state.reaction])
                kept[f"facing {k} axes"] = np.vstack([state.p, state.R])
                kept[f"facing {k} works"] = one.works.copy()
        return kept

    def restore(self, body: int, memory: BodyMemory, kept: Mapping[str, FloatArray]) -> None:
        """Go back to a snapshot of a body, on any number of ranks."""
        for k, one in enumerate(self.contacts):
            if one.nodes == body:
                values = memory.scatter_nodes(kept[f"facing {k}"])[one.touch.nodes]
                y, met, rubbed = (np.ascontiguousarray(part) for part in np.split(values, 3, axis=1))
                points, *reaction = kept[f"facing {k} facets"]
                axes = kept[f"facing {k} axes"]
                self._now[k] = FacingState(
                    y, points.copy(), met, rubbed, np.stack(reaction), axes[0].copy(), axes[1:].copy()
                )
                one.works[:] = kept[f"facing {k} works"]
                one.touch.forget()
