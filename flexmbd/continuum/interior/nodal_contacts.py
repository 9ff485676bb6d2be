"""Contacts of the nodes of a body that steps explicitly: with planes, shapes, reduced bodies and others of its kind."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.history.body_memory import BodyMemory
from flexmbd.continuum.history.nonlinear_model import NonlinearModel
from flexmbd.continuum.interior.contact_field import PushedNodes
from flexmbd.continuum.interior.contact_plane import RigidPlane
from flexmbd.continuum.interior.nodal_inertia import NodalInertia
from flexmbd.continuum.interior.reduced_contact import reduced_contacts
from flexmbd.continuum.interior.shape_contacts import shape_contacts
from flexmbd.continuum.interior.surface_pair import NODES, SurfacePair
from flexmbd.continuum.interior.touched_frames import FrameContacts
from flexmbd.errors import SceneError
from flexmbd.multibody.interiors.touching_interior import Obstacle, ReducedFacets

FloatArray = NDArray[np.float64]
Poses: TypeAlias = tuple[FloatArray, FloatArray]


class NodalContacts:
    """All contacts of one body. Constructing it is not collective.

    Attributes:
        planes: rigid ones at rest, which all nodes may touch.
        shapes: contacts of surfaces with shapes and reduced bodies of the machine.
        pairs: contacts with other bodies, and on which side of each this one is.
        met, rubbed: (owned nodes, 3) N, by normal forces and by friction; on bonded nodes those of planes are left out.
    """

    def __init__(
        self, body: NonlinearModel, inertia: NodalInertia, memory: BodyMemory, *, planes: Sequence[RigidPlane],
        loads: Sequence[str], h: float,
    ) -> None:
        """Nothing is touched but planes.

        Args:
            body: whose nodes touch something.
            inertia: of these.
            memory: how nodal values are gathered.
            planes: rigid ones at rest.
            loads: names that contacts may not have.
            h: s, the stable step of the undeformed body without contact.

        Raises:
            SceneError: a plane has the name of a load.
        """
        both = {plane.name for plane in planes} & set(loads)
        if both:
            raise SceneError(f"a plane and a load are both called {sorted(both)[0]!r}; give each its own name")
        self._taken = {plane.name for plane in planes} | set(loads)
        self._body, self._inertia, self._memory, self._h = body, inertia, memory, h
        self._comm, self._masses = body.comm, inertia.masses
        self.planes = tuple(planes)
        self._stiffness = [plane.stiffness(h) for plane in planes]
        self._plane_forces: FloatArray = np.zeros((len(planes), 3))
        self.met, self.rubbed = np.zeros((2, len(inertia.masses), 3))
        self._pushes: list[tuple[Any, FloatArray]] = []  # of the last step, by contact: which nodes; N, along normals
        self.meet(())

    def meet(self, obstacles: Sequence[Obstacle]) -> None:
        """See `NodalMotion.meet`. Collective."""
        self._refuse_taken(obstacles)
        found = shape_contacts(self._body, self._masses, obstacles, h=self._h, bonded=self._inertia.bonded)
        self.shapes = FrameContacts(self._body, self._memory, self._masses, found)
        self.pairs: list[tuple[SurfacePair, int]] = []

    def meet_reduced(self, surfaces: Sequence[ReducedFacets], *, size: float) -> None:
        """See `NodalMotion.meet_reduced`; size: m, of the body. Collective."""
        self._refuse_taken(surfaces)
        found = reduced_contacts(self._body, self._masses, surfaces, h=self._h, size=size)
        self.shapes = FrameContacts(self._body, self._memory, self._masses, (*self.shapes.contacts, *found))

    def _refuse_taken(self, contacts: Sequence[Obstacle | ReducedFacets]) -> None:
        both = sorted(self._taken & {one.name for one in contacts})
        if both:
            raise SceneError(f"a contact, and a plane or load, are both called {both[0]!r}; give each its own name")

    def begin(self, x: FloatArray, poses: Poses | None, *, size: float) -> None:
        """Nothing has touched yet, with nodes at x (owned nodes, 3) m; the rest as of `NodalMotion.begin`. Collective.

        Raises:
            SceneError: the body begins behind a plane or in a shape.
        """
        self.met, self.rubbed = np.zeros((2, *x.shape))
        self._pushes = []
        self._plane_forces[:] = 0.0
        for plane in self.planes:
            depths = self._comm.allgather(float(plane.depth(x).max(initial=-np.inf)))
            plane.check_start(max(depths), size)
        for pair, _ in self.pairs:
            pair.begin()
        if poses is not None:
            self.shapes.begin(x, *poses, size=size)

    def limited(self, h: float, bound: float = 0.0) -> float:
        """The longest stable step, s, where it is h without contact, and ``bound`` (1/s^2) by shapes and pairs."""
        by_itself = max(1.0, self.shapes.own_rate * h**2 / 4)  # of this body and those that it touches
        return float(h / np.sqrt(by_itself + (max(self._stiffness, default=0.0) + bound) * h**2 / 4))

    def bound(self, x: FloatArray, *, starts: bool) -> float:
        """1/s^2, of contacts with shapes and other bodies, with nodes at x (owned nodes, 3) m. Collective."""
        for pair, _ in self.pairs if starts else ():
            pair.approach()
            pair.check_start()
        return self.shapes.stiffness_bound(x) + sum(pair.stiffness_bound() for pair, _ in self.pairs)

    def push(self, x: FloatArray, v: FloatArray, a: FloatArray, *, h: float, reach: float) -> FloatArray:
        """Find the forces at a step's end; arguments as of `nodal_push.push`. Collective.

        Returns:
            (owned nodes, 3) m/s^2, the accelerations a (owned nodes, 3) and those by contact.
        """
        inertia, m, alone = self._inertia, self._inertia.touching[:, None], a
        self.met, self.rubbed = np.zeros((2, *x.shape))
        self._pushes = []
        for k, (plane, stiffness) in enumerate(zip(self.planes, self._stiffness, strict=True)):
            met, rubbed = plane.push(x, v, a, h=h, reach=reach, stiffness=stiffness)
            self._add(slice(None), m * met, m * rubbed)
            self._plane_forces[k] = (m * (met + rubbed)).sum(axis=0)
            a = a + inertia.answered(inertia.held(met + rubbed))
        for shape in self.shapes.contacts:
            pushed = shape.push(x, v, a, h=h, reach=reach)
            nodes, on = pushed.nodes, self._masses[pushed.nodes, None]
            self._add(nodes, on * pushed.met, on * pushed.rubbed)
            shape.take(x[nodes], on * pushed.met, on * pushed.rubbed)
            answer = np.zeros_like(a)
            answer[nodes] = inertia.held(pushed.met + pushed.rubbed, nodes)
            a = a + inertia.answered(answer)
        for pair, side in self.pairs:
            met, rubbed = pair.take(side)
            self._add(slice(None), met, rubbed)
            a = a + inertia.answered(inertia.held((met + rubbed) / self._masses[:, None]))
        if self._body.ties is not None and (self.planes or self.shapes.contacts or self.pairs):
            a = inertia.passed_on(alone, self.met + self.rubbed)
        return a

    def pushed(self) -> PushedNodes | None:
        """The owned nodes, by planes, shapes and other bodies; None where nothing is touched."""
        surfaces = [*(shape.nodes for shape in self.shapes.contacts), *(pair.nodes(side) for pair, side in self.pairs)]
        if not (surfaces or self.planes):
            return None
        touches = np.full(len(self.met), float(bool(self.planes)))  # a plane is met by all nodes
        for nodes in surfaces:
            touches[nodes] = 1.0
        return PushedNodes(touches, self._pressed())

    def resultants(self) -> dict[str, FloatArray]:
        """(3,) N by name, on the body at a step's end, of planes of one name their sum. Collective."""
        found: dict[str, FloatArray] = {plane.name: np.zeros(3) for plane in self.planes}
        for plane, force in zip(self.planes, self._sum(self._plane_forces), strict=True):
            found[plane.name] = found[plane.name] + force
        found.update(self.shapes.resultants())
        for pair, side in self.pairs:
            found[pair.given.name] = self._sum(pair.resultant) * (1.0 if side == NODES else -1.0)
        return found

    def snapshot(self) -> dict[str, FloatArray]:
        """Copies of what they remember, of the whole body. Collective."""
        kept = {"_met": self._memory.gather_nodes(self.met), "_rubbed": self._memory.gather_nodes(self.rubbed)}
        kept["pressed"] = self._memory.gather_nodes(self._pressed()[:, None])
        kept["plane forces"] = self._sum(self._plane_forces)
        kept |= self.shapes.snapshot()
        for k, (pair, side) in enumerate(self.pairs):
            if side == NODES:
                kept |= {f"pair {k} {name}": part for name, part in pair.snapshot().items()}
        return kept

    def restore(self, kept: dict[str, FloatArray], x: FloatArray) -> None:
        """Go back to a snapshot with nodes at x (owned nodes, 3) m, on any number of ranks. Collective."""
        n = len(self._masses)
        self.met, self.rubbed = (self._memory.scatter_nodes(kept[name])[:n] for name in ("_met", "_rubbed"))
        self._pushes = [(slice(None), self._memory.scatter_nodes(kept["pressed"])[:n])]
        # the first rank has the sum over all
        self._plane_forces = kept["plane forces"] * (self._comm.rank == 0)
        self.shapes.restore(kept, x)
        for k, (pair, side) in enumerate(self.pairs):
            if side == NODES:
                pair.restore({name: kept[f"pair {k} {name}"] for name in ("memory", "sums")})

    def _add(self, nodes: Any, met: FloatArray, rubbed: FloatArray) -> None:
        """Take the forces (n, 3) N of one contact on some owned nodes."""
        self.met[nodes] += met
        self.rubbed[nodes] += rubbed
        self._pushes.append((nodes, met))

    def _pressed(self) -> FloatArray:
        """(owned nodes,) N, sums over the contacts, whatever their normals."""
        force = np.zeros(len(self.met))
        for nodes, met in self._pushes:
            force[nodes] += np.linalg.norm(met, axis=1)
        return force

    def _sum(self, part: FloatArray) -> FloatArray:
        return np.asarray(sum(self._comm.allgather(part)))
