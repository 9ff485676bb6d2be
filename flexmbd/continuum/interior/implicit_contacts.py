"""Contact of the nodes on a body's surface with rigid shapes of its machine, solved for at a step's end.

A node at the depth d is pushed by N = r d, r above the stiffness that it feels with its neighbours held.  Were nothing
to enter, the node's mass would be stopped at once, a jump of velocities that no step resolves, however short.  Friction
is what would hold a node where it was on the shape, T' - r_t s with T' of the last accepted step and its way s across,
or as much of it as Coulomb's law has (Simo & Laursen 1992): bristles a few times as stiff as the node.  Newton's method
has the derivative of both.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from petsc4py import PETSc

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.history.body_memory import BodyMemory
from flexmbd.continuum.history.nonlinear_model import NonlinearModel
from flexmbd.continuum.interior.shape_contacts import surface_nodes
from flexmbd.continuum.interior.touched_frames import refuse_inside
from flexmbd.multibody.bodies.continuum_body import FrameMotion
from flexmbd.multibody.interiors.touching_interior import Obstacle

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# The stiffness of friction's bristles over that which a node feels: with one far above it Newton's method goes round
# between states in which a node slides and sticks.
_BRISTLE = 2.0


@dataclass(frozen=True, eq=False)
class TouchedNodes:
    """Contact forces on n nodes by m shapes, and their derivatives, in inertial axes.

    Attributes:
        nodes: (n,) owned nodes; one may stand in it several times.
        shape: (n,) which shape.
        x: (n, 3) m, of the nodes.
        force: (n, 3) N, on the nodes.
        slopes: (n, 3, 3) N/m, minus its derivative by the node's motion against the shape.
        origins: (m, 3) m, of the shapes' frames.
    """

    nodes: IntArray
    shape: IntArray
    x: FloatArray
    force: FloatArray
    slopes: FloatArray
    origins: FloatArray

    @property
    def arms(self) -> FloatArray:
        """(n, 3) m, from the shapes' frames to the nodes."""
        return self.x - self.origins[self.shape]

    def at_nodes(self, values: FloatArray, n_owned: int) -> FloatArray:
        """(owned nodes, 3) sums of values (n, 3)."""
        out = np.zeros((n_owned, 3))
        np.add.at(out, self.nodes, values)
        return out

    def add_slopes(self, matrix: PETSc.Mat, R: FloatArray) -> PETSc.Mat:
        """The body's tangent, in axes that R turns to inertial ones, with the derivatives; it changes. Collective."""
        first = matrix.getOwnershipRange()[0]
        blocks = np.einsum("ba,nbc,cd->nad", R, self.slopes, R)
        for node, block in zip(self.nodes, blocks, strict=True):
            dofs = (first + 3 * node + np.arange(3)).astype(PETSc.IntType)
            matrix.setValues(dofs, dofs, block, addv=PETSc.InsertMode.ADD_VALUES)
        matrix.assemble()
        return matrix

    def moved(self, nodal: FloatArray) -> TouchedNodes:
        """Linearised, where the nodes have moved by (owned nodes, 3) m and the shapes have not."""
        dx = nodal[self.nodes]
        return replace(self, x=self.x + dx, force=self.force + self.changes(dx))

    def changes(self, dx: FloatArray) -> FloatArray:
        """(n, 3) N, changes of the forces by displacements (n, 3) m of the nodes against the shapes."""
        return np.asarray(-np.einsum("nab,nb->na", self.slopes, dx))

    def by_frame(self, j: int, axis: int) -> tuple[FloatArray, FloatArray]:
        """Of a unit displacement or rotation of shape j: changes (n, 3) of forces, way (n, 3) of what it carries."""
        mine, unit = self.shape == j, np.eye(3)[axis % 3]
        way = np.where(mine[:, None], unit if axis < 3 else np.cross(unit, self.arms), 0.0)
        turned = np.where(mine[:, None], np.cross(unit, self.force) if axis >= 3 else 0.0, 0.0)
        return self.changes(-way) + turned, way

    def wrenches(self, force: FloatArray, arms: FloatArray) -> FloatArray:
        """(m, 6) minus forces (n, 3) at arms (n, 3) m, about the shapes' origins: this rank's part."""
        out = np.zeros((len(self.origins), 6))
        np.add.at(out, self.shape, -np.hstack([force, np.cross(arms, force)]))
        return out


@dataclass(frozen=True, eq=False)
class TouchedState:
    """What a shape does to the nodes of a surface at an accepted or tried step's end, in the axes of its frame.

    Attributes:
        y: (n, 3) m, places of the nodes.
        met, rubbed: (n, 3) N, forces on them, out of the shape and across.
        p, R: of the frame.
    """

    y: FloatArray
    met: FloatArray
    rubbed: FloatArray
    p: FloatArray
    R: FloatArray

    @property
    def force(self) -> FloatArray:
        """(n, 3) N, on the nodes, in inertial axes."""
        return np.asarray((self.met + self.rubbed) @ self.R.T)


class ImplicitContacts:
    """The contacts of one body's surfaces.

    Attributes:
        obstacles: what is touched.
        works: (2,) J, this rank's part of what contact and friction did along the ways of nodes against the shapes.
    """

    def __init__(
        self, body: NonlinearModel, memory: BodyMemory, stiffness: FloatArray,
        obstacles: Sequence[Obstacle] = (),
    ) -> None:
        """Find the nodes. Collective.

        Args:
            body: the body.
            memory: how nodal values are gathered.
            stiffness: (owned dofs,) N/m, the diagonal of its tangent at rest.
            obstacles: what its surfaces touch.
        """
        self._body, self._memory = body, memory
        self.obstacles = tuple(obstacles)
        self._nodes = [surface_nodes(body, one.surface) for one in self.obstacles]
        self._felt: FloatArray = stiffness.reshape(-1, 3).mean(axis=1)
        self._now: tuple[TouchedState, ...] = ()
        self.works: FloatArray = np.zeros(2)

    def begin(self, x: FloatArray, motion: FrameMotion, *, size: float) -> None:
        """Nothing has touched yet, with nodes at x (local nodes, 3) m. Collective.

        Raises:
            SceneError: on all ranks: the body begins in a shape.
        """
        self.works[:] = 0.0
        states = []
        for one, nodes, p, R in self._each(motion):
            y = (x[nodes] - p) @ R
            refuse_inside(self._body.comm, one.name, one.distances(y)[:, 0], size=size)
            states.append(TouchedState(y, np.zeros_like(y), np.zeros_like(y), p, R))
        self._now = tuple(states)

    def evaluate(self, x: FloatArray, motion: FrameMotion) -> tuple[TouchedNodes, tuple[TouchedState, ...]]:
        """What shapes do to nodes at x (local nodes, 3) m at a step's end, by the last accepted state. Not collective.

        Args:
            x: of the nodes.
            motion: of the frames.
        """
        rows, states = [], []
        for j, (one, nodes, p, R) in enumerate(self._each(motion)):
            y, before = (x[nodes] - p) @ R, self._now[j]
            found = one.distances(y)
            r, bristle = one.stiffness_ratio * self._felt[nodes], _BRISTLE * self._felt[nodes]
            met, rubbed, slopes = _law(
                found, y - before.y, before.rubbed, r=r, bristle=bristle, friction=one.friction
            )
            states.append(TouchedState(y, met, rubbed, p, R))
            on = met.any(axis=1)
            turned = np.einsum("ab,nbc,dc->nad", R, slopes[on], R)
            rows.append((nodes[on], np.full(on.sum(), j), x[nodes[on]], states[-1].force[on], turned))
        if not rows:
            none = np.zeros(0, dtype=np.int64)
            nothing = np.zeros((0, 3))
            return TouchedNodes(none, none, nothing, nothing, np.zeros((0, 3, 3)), nothing), ()
        on_nodes, shape, places, force, turned = (np.concatenate(parts) for parts in zip(*rows, strict=True))
        return TouchedNodes(on_nodes, shape, places, force, turned, self._shapes(motion)[0]), tuple(states)

    def accept(self, states: tuple[TouchedState, ...]) -> None:
        """Make a tried step's end the accepted one."""
        for before, after in zip(self._now, states, strict=True):
            way = 0.5 * (after.y - before.y)
            self.works += [np.vdot(way, before.met + after.met), np.vdot(way, before.rubbed + after.rubbed)]
        self._now = states

    def nodal(self) -> FloatArray:
        """(owned nodes, 3) N, on the nodes in the accepted state, in inertial axes."""
        out = np.zeros((self._body.layout.n_owned_nodes, 3))
        for nodes, state in zip(self._nodes, self._now, strict=True):
            out[nodes] += state.force
        return out

    def wrenches(self) -> FloatArray:
        """(m, 6) on the shapes' frames in the accepted state: this rank's part."""
        found = [
            -np.append(one.force.sum(axis=0), np.cross(one.y @ one.R.T, one.force).sum(axis=0)) for one in self._now
        ]
        return np.array(found).reshape(-1, 6)

    def resultants(self) -> dict[str, FloatArray]:
        """(3,) N by name, on the body in the accepted state. Collective where there are some."""
        if not self.obstacles:
            return {}
        summed = sum(self._body.comm.allgather(-self.wrenches()[:, :3]))
        return {one.name: force for one, force in zip(self.obstacles, np.asarray(summed), strict=True)}

    def energies(self) -> dict[str, float]:
        """J, "contact" and "friction": minus what both did, stored by the first, lost by the second. Collective."""
        if not self.obstacles:
            return {}
        contact, friction = np.asarray(sum(self._body.comm.allgather(self.works)))
        return {"contact": -float(contact), "friction": -float(friction)}

    def snapshot(self) -> dict[str, FloatArray]:
        """Copies of all that tells how it goes on, of the whole body. Collective."""
        if not self.obstacles:
            return {}
        kept = {"contact works": np.asarray(sum(self._body.comm.allgather(self.works)))}
        for k, (nodes, state) in enumerate(zip(self._nodes, self._now, strict=True)):
            values = np.zeros((self._body.layout.n_owned_nodes, 9))
            values[nodes] = np.hstack([state.y, state.met, state.rubbed])
            kept[f"touched {k}"] = self._memory.gather_nodes(values)
            kept[f"shape {k}"] = np.concatenate([state.p, state.R.ravel()])
        return kept

    def restore(self, kept: Mapping[str, FloatArray]) -> None:
        """Go back to a snapshot, on any number of ranks."""
        if not self.obstacles:
            return
        self.works = kept["contact works"] * (self._body.comm.rank == 0)
        states = []
        for k, nodes in enumerate(self._nodes):
            values = self._memory.scatter_nodes(kept[f"touched {k}"])[nodes]
            pose = kept[f"shape {k}"]
            y, met, rubbed = (np.ascontiguousarray(part) for part in np.split(values, 3, axis=1))
            states.append(TouchedState(y, met, rubbed, pose[:3].copy(), pose[3:].reshape(3, 3).copy()))
        self._now = tuple(states)

    def _shapes(self, motion: FrameMotion) -> tuple[FloatArray, FloatArray]:
        m = len(self.obstacles)
        return motion.p[len(motion.p) - m :], motion.R[len(motion.R) - m :]

    def _each(self, motion: FrameMotion) -> list[tuple[Obstacle, IntArray, FloatArray, FloatArray]]:
        return list(zip(self.obstacles, self._nodes, *self._shapes(motion), strict=True))


def _law(
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
    size = np.maximum(0.0, -r * found[:, 0])
    on = size > 0.0
    met = np.where(on[:, None], size[:, None] * n, 0.0)
    slopes = np.where(on, r, 0.0)[:, None, None] * n[:, :, None] * n[:, None, :]
    if friction == 0.0 or not on.any():
        return met, np.zeros_like(met), slopes
    held = np.einsum("nab,nb->na", plane, rubbed - bristle[:, None] * way)
    need, most = np.sqrt((held**2).sum(axis=1)), friction * size
    slides = on & (need > most)
    share = np.where(slides, most / np.where(need > 0.0, need, 1.0), np.where(on, 1.0, 0.0))
    across = plane.copy()
    direction = held / np.where(need > 0.0, need, 1.0)[:, None]
    across[slides] -= (direction[:, :, None] * direction[:, None, :])[slides]
    slopes = slopes + (share * bristle)[:, None, None] * across
    slopes[slides] += friction * r[slides, None, None] * direction[slides, :, None] * n[slides, None, :]
    return met, share[:, None] * held, slopes
