"""Contact of the nodes on a body's surface with shapes and reduced bodies of its machine, solved for at a step's end.

The laws are in `implicit_touch`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.history.body_memory import BodyMemory
from flexmbd.continuum.history.nonlinear_model import NonlinearModel
from flexmbd.continuum.interior.contact_field import PushedNodes
from flexmbd.continuum.interior.implicit_touch import ImplicitTouch, ReducedTouch, ShapeTouch, TouchedState
from flexmbd.continuum.interior.shape_contacts import surface_nodes
from flexmbd.continuum.interior.touched_frames import refuse_inside
from flexmbd.continuum.interior.touched_nodes import Carrier, TouchedNodes
from flexmbd.multibody.bodies.continuum_body import FrameMotion
from flexmbd.multibody.interiors.touching_interior import Obstacle, ReducedFacets

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


class ImplicitContacts:
    """The contacts of one body's surfaces, whose frames follow each other.

    Attributes:
        touches: them.
        stiffness: N/m, 2-norm of that of all nodes' contacts.
        works: (2,) J, this rank's part of what contact and friction did along the ways of nodes on what they touch.
    """

    def __init__(
        self, body: NonlinearModel, memory: BodyMemory, stiffness: FloatArray, *, size: float,
        obstacles: Sequence[Obstacle] = (), surfaces: Sequence[ReducedFacets] = (),
    ) -> None:
        """Find the nodes. Collective.

        Args:
            body: the body.
            memory: how nodal values are gathered.
            stiffness: (3 owned nodes,) N/m, of its tangent's diagonal at rest those of displacements.
            size: m, of the body, by which depths are told from round-off.
            obstacles: rigid shapes that its surfaces touch.
            surfaces: of reduced bodies, that they touch as well.
        """
        self._body, self._memory, self._size = body, memory, size
        self.obstacles = tuple(obstacles)
        reduced = [ReducedTouch(one, size=size) for one in surfaces]
        self.touches: tuple[ImplicitTouch, ...] = (*map(ShapeTouch, self.obstacles), *reduced)
        touched: list[Obstacle | ReducedFacets] = [*self.obstacles, *surfaces]
        self._nodes = [surface_nodes(body, one.surface) for one in touched]
        self._felt: FloatArray = stiffness.reshape(-1, 3).mean(axis=1)
        own = [one.stiffness_ratio * self._felt[nodes] for one, nodes in zip(touched, self._nodes, strict=True)]
        self.stiffness = float(body.norm(np.concatenate([np.zeros(0), *own])))
        self._now: tuple[TouchedState, ...] = ()
        self.works: FloatArray = np.zeros(2)

    @property
    def names(self) -> list[str]:
        """Of the contacts."""
        return [one.name for one in self.touches]

    def begin(self, x: FloatArray, motion: FrameMotion) -> None:
        """Nothing has touched yet, with nodes at x (local nodes, 3) m. Collective.

        Raises:
            SceneError: on all ranks: the body begins in what it touches.
        """
        self.works[:] = 0.0
        states = []
        for one, nodes, p, R in self._each(motion):
            state, distances = one.begin(x[nodes], p, R)
            refuse_inside(self._body.comm, one.name, distances, size=self._size)
            states.append(state)
        self._now = tuple(states)

    def evaluate(self, x: FloatArray, motion: FrameMotion) -> tuple[TouchedNodes, tuple[TouchedState, ...]]:
        """Contact forces at a tried step's end, with friction from the last accepted state. Not collective.

        Args:
            x: (local nodes, 3) m, of the nodes.
            motion: of the frames.
        """
        nothing: FloatArray = np.zeros((0, 3))
        no_nodes: IntArray = np.zeros(0, dtype=np.int64)
        no_slopes: FloatArray = np.zeros((0, 3, 3))
        parts = [(no_nodes, nothing, nothing, no_slopes)]
        carriers, states = [], []
        row = frame = 0
        for before, (one, nodes, p, R) in zip(self._now, self._each(motion), strict=True):
            touch = one.evaluate(x[nodes], p, R, before, self._felt[nodes])
            on, axes, n = nodes[touch.on], R[0], len(touch.on)
            turned = np.einsum("ab,nbc,dc->nad", axes, touch.slopes, axes)
            parts.append((on, x[on], touch.state.force[touch.on], turned))
            moves = touch.y, touch.phi, touch.wander, touch.normal
            carriers.append(Carrier(p[0], axes, *moves, slice(row, row + n), frame))
            states.append(touch.state)
            row, frame = row + n, frame + one.frames
        on_nodes, places, force, slopes = (np.concatenate(several) for several in zip(*parts, strict=True))
        return TouchedNodes(on_nodes, places, force, slopes, tuple(carriers)), tuple(states)

    def accept(self, states: tuple[TouchedState, ...]) -> None:
        """Make a tried step's end the accepted one."""
        for one, before, after in zip(self.touches, self._now, states, strict=True):
            self.works += one.works(before, after)
        self._now = states

    def revert(self) -> None:
        """Forget the step that was tried."""
        for one in self.touches:
            one.forget()

    def nodal(self) -> FloatArray:
        """(owned nodes, 3) N, on the nodes in the accepted state, in inertial axes."""
        out = np.zeros((self._body.layout.n_owned_nodes, 3))
        for nodes, state in zip(self._nodes, self._now, strict=True):
            out[nodes] += state.force
        return out

    def pushed(self, facing: Sequence[tuple[IntArray, FloatArray]]) -> PushedNodes | None:
        """The owned nodes in the accepted state; None where nothing is touched.

        ``facing``: nodes, and sizes (n,) N of normal forces, by other bodies of its kind.
        """
        own = [(nodes, np.linalg.norm(state.met, axis=1)) for nodes, state in zip(self._nodes, self._now, strict=True)]
        if not own and not facing:
            return None
        touches, force = np.zeros((2, self._body.layout.n_owned_nodes))
        for nodes, size in (*own, *facing):
            touches[nodes] = 1.0
            force[nodes] += size
        return PushedNodes(touches, force)

    def wrenches(self) -> FloatArray:
        """(m, 6) on the frames in the accepted state: this rank's part."""
        found = [one.wrenches(state) for one, state in zip(self.touches, self._now, strict=True)]
        return np.concatenate(found) if found else np.zeros((0, 6))

    def resultants(self) -> dict[str, FloatArray]:
        """(3,) N by name, on the body in the accepted state. Collective where there are some."""
        if not self.touches:
            return {}
        summed = sum(self._body.comm.allgather(np.array([one.force.sum(axis=0) for one in self._now])))
        return {one.name: force for one, force in zip(self.touches, np.asarray(summed), strict=True)}

    def energies(self, facing: FloatArray | None) -> dict[str, float]:
        """J, "contact" and "friction": minus what both did, stored by the first, lost by the second. Collective.

        ``facing``: (2,) J, what both did on it by other bodies of its kind, where there are some.
        """
        if not self.touches and facing is None:
            return {}
        contact, friction = sum(self._body.comm.allgather(self.works)) + (np.zeros(2) if facing is None else facing)
        return {"contact": -float(contact), "friction": -float(friction)}

    def snapshot(self) -> dict[str, FloatArray]:
        """Copies of all that tells how it goes on, of the whole body. Collective."""
        if not self.touches:
            return {}
        comm = self._body.comm
        kept = {"contact works": np.asarray(sum(comm.allgather(self.works)))}
        for k, (nodes, state) in enumerate(zip(self._nodes, self._now, strict=True)):
            values = np.zeros((self._body.layout.n_owned_nodes, 9))
            values[nodes] = np.hstack([state.y, state.met, state.rubbed])
            kept[f"touched {k}"] = self._memory.gather_nodes(values)
            kept[f"shape {k}"] = np.concatenate([state.p.ravel(), state.R.ravel()])
            kept[f"reaction {k}"] = np.asarray(sum(comm.allgather(state.reaction)))
        return kept

    def restore(self, kept: Mapping[str, FloatArray]) -> None:
        """Go back to a snapshot, on any number of ranks."""
        if not self.touches:
            return
        self.works = kept["contact works"] * (self._body.comm.rank == 0)
        states = []
        for k, (one, nodes) in enumerate(zip(self.touches, self._nodes, strict=True)):
            values = self._memory.scatter_nodes(kept[f"touched {k}"])[nodes]
            pose, c = kept[f"shape {k}"], one.frames
            y, met, rubbed = (np.ascontiguousarray(part) for part in np.split(values, 3, axis=1))
            p, R = pose[: 3 * c].reshape(c, 3).copy(), pose[3 * c :].reshape(c, 3, 3).copy()
            reaction = kept[f"reaction {k}"] * (self._body.comm.rank == 0)
            states.append(TouchedState(y, met, rubbed, p, R, reaction))
        self._now = tuple(states)

    def _each(self, motion: FrameMotion) -> Iterator[tuple[ImplicitTouch, IntArray, FloatArray, FloatArray]]:
        """Each contact, its nodes, and its frames."""
        first = len(motion.p) - sum(one.frames for one in self.touches)
        for one, nodes in zip(self.touches, self._nodes, strict=True):
            mine = slice(first, first + one.frames)
            yield one, nodes, motion.p[mine], motion.R[mine]
            first += one.frames
