"""Contact of the nodes on a body's surface with rigid shapes of its machine, for central differences.

Nodes are pushed as by planes (`nodal_push`), by forces that act on the shapes' frames the other way round.  What is
stored and lost is counted on the way of a node against the shape, so that work that a shape does on the body is none of
it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from mpi4py import MPI

import numpy as np
import scipy.linalg
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from flexmbd.continuum import parallel
from flexmbd.continuum.history.body_memory import BodyMemory
from flexmbd.continuum.history.nonlinear_model import NonlinearModel
from flexmbd.continuum.interior.machine_frames import mass_of_points
from flexmbd.continuum.interior.nodal_push import penalty_stiffness, push
from flexmbd.errors import SceneError
from flexmbd.multibody.interiors.touching_interior import Obstacle
from flexmbd.round_off import SAME_PLACE

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# Steps for which the stable one is to hold: what may touch within them, at the speed of the last, counts as touching.
_AHEAD = 20.0


@dataclass(frozen=True, eq=False)
class Pushed:
    """What a shape does to some nodes.

    Attributes:
        nodes: (n,) owned nodes.
        met, rubbed: (n, 3) m/s^2, accelerations out of the shape and across.
    """

    nodes: IntArray
    met: FloatArray
    rubbed: FloatArray


class ShapeContact:
    """One obstacle before the owned nodes of a surface.

    Attributes:
        obstacle: with its shape.
        nodes: (n,) owned nodes of the surface.
        stiffness: 1/s^2, of the penalty.
        p, R: (3,) m, (3, 3): the shape's frame in inertial axes.
        wrenches: (2, 6) on the frame, N and N m about its origin, by what pushes and by friction: this rank's part.
        stuck: (owned nodes, 4) m, where nodes stick, in the frame's axes, and 1 where they do.
        stride: m, the longest way of a node against the shape in the last step.
    """

    def __init__(self, obstacle: Obstacle, nodes: IntArray, n_owned: int, *, h: float) -> None:
        """Nothing touches yet; h: s, the stable step of the undeformed body."""
        self.obstacle, self.nodes = obstacle, nodes
        self.stiffness = penalty_stiffness(obstacle.penalty, h)
        self.p: FloatArray = np.zeros(3)
        self.R: FloatArray = np.eye(3)
        self.wrenches: FloatArray = np.zeros((2, 6))
        self.stuck: FloatArray = np.zeros((n_owned, 4))
        self.stride = 0.0
        self._before: FloatArray | None = None

    @property
    def has_bristles(self) -> bool:
        """Whether what sticks does so by bristles."""
        return self.stiffness > 0.0 and self.obstacle.friction > 0.0

    def place(self, p: FloatArray, R: FloatArray) -> None:
        """Put the shape's frame to p (m), turned by R."""
        self.p, self.R = p.copy(), R.copy()

    def distances(self, x: FloatArray, *, margin: float = 0.0) -> tuple[IntArray, FloatArray]:
        """Which nodes of the surface, at x (owned nodes, 3) m, are less than a margin (m) outside of the shape's box.

        Returns:
            (k,) owned nodes; (k, 4) their signed distances and the gradients, in the frame's axes.
        """
        y = (x[self.nodes] - self.p) @ self.R
        low, high = self.obstacle.box
        near = ((y > low - margin) & (y < high + margin)).all(axis=1)
        return self.nodes[near], self.obstacle.distances(y[near])

    def push(self, x: FloatArray, v: FloatArray, a: FloatArray, *, h: float, reach: float) -> Pushed:
        """What the shape does to nodes at x (owned nodes, 3) m; the rest as of `nodal_push.push`."""
        near, found = self.distances(x, margin=0.0 if self.stiffness else np.inf)
        law: dict[str, Any] = {"stiffness": self.stiffness, "friction": self.obstacle.friction}
        if self.stiffness:
            touch = found[:, 0] < 0.0
            near, found = near[touch], found[touch]
        normal = found[:, 1:] @ self.R.T
        if not self.has_bristles:
            return Pushed(near, *push(-found[:, 0], normal, v[near], a[near], h=h, reach=reach, **law))
        held = self.stuck[near, 3:] > 0.0
        anchors = np.where(held, self.p + self.stuck[near, :3] @ self.R.T, x[near])
        stretch = x[near] - anchors
        met, rubbed = push(-found[:, 0], normal, v[near], a[near], h=h, reach=reach, stretch=stretch, **law)
        self.stuck[:] = 0.0
        # where bristles slide they are stretched as far as friction bears
        self.stuck[near, :3] = (x[near] + rubbed / self.stiffness - self.p) @ self.R
        self.stuck[near, 3] = 1.0
        return Pushed(near, met, rubbed)

    def take(self, x: FloatArray, met: FloatArray, rubbed: FloatArray) -> None:
        """Note the wrenches of forces (k, 3) N, of both kinds, on nodes at x (k, 3) m; a step ends."""
        for k, force in enumerate((met, rubbed)):
            self.wrenches[k] = -np.append(force.sum(axis=0), np.cross(x - self.p, force).sum(axis=0))

    def walk(self, x: FloatArray) -> None:
        """Note how far nodes, at x (owned nodes, 3) m, went against the shape since this was asked last."""
        y = (x[self.nodes] - self.p) @ self.R
        if self._before is not None:
            self.stride = float(np.sqrt(((y - self._before) ** 2).sum(axis=1).max(initial=0.0)))
        self._before = y

    def approach(self, x: FloatArray, v: FloatArray, frame_v: FloatArray, frame_w: FloatArray, *, h: float) -> None:
        """Foresee how far nodes, at x (owned nodes, 3) m with v, go in a step h (s) against a frame with its twist."""
        arms = x[self.nodes] - self.p
        speeds = v[self.nodes] - frame_v - np.cross(frame_w, arms)
        self.stride = h * float(np.sqrt((speeds**2).sum(axis=1).max(initial=0.0)))

    def forget(self) -> None:
        """Forget where the nodes were."""
        self._before = None


class ShapeContacts:
    """The contacts of one body's surfaces with rigid shapes."""

    def __init__(
        self, body: NonlinearModel, memory: BodyMemory, masses: FloatArray, obstacles: Sequence[Obstacle], *, h: float,
        bonded: NDArray[np.integer],
    ) -> None:
        """Find the nodes. Collective.

        Args:
            body: the body.
            memory: how nodal values are gathered.
            masses: (owned nodes,) kg.
            obstacles: what its surfaces touch.
            h: s, the stable step of the undeformed body without contact.
            bonded: owned nodes that frames move.

        Raises:
            SceneError: on all ranks: such nodes are to stop where they meet a shape.
        """
        self._body, self._memory, self._masses = body, memory, masses
        n = len(masses)
        self.contacts: tuple[ShapeContact, ...] = tuple(
            ShapeContact(one, surface_nodes(body, one.surface), n, h=h) for one in obstacles
        )
        stopped = [one for one in self.contacts if not one.stiffness and np.isin(one.nodes, bonded).any()]
        error = None
        if stopped:
            error = SceneError(
                f"contact {stopped[0].obstacle.name!r}: some of its nodes move with a frame, which does not stop where "
                "one of them meets a shape: give it a penalty, as 0.5"
            )
        parallel.raise_collectively(body.comm, error)

    def begin(self, x: FloatArray, p: FloatArray, R: FloatArray, *, size: float) -> None:
        """Nothing has touched yet; nodes are at x (owned nodes, 3) m, frames at p (m, 3), R (m, 3, 3). Collective.

        ``size``: m, of the body, by which depths are told from round-off.

        Raises:
            SceneError: on all ranks: the body begins in a shape.
        """
        for k, one in enumerate(self.contacts):
            one.place(p[k], R[k])
            one.wrenches[:], one.stuck[:], one.stride = 0.0, 0.0, 0.0
            one.forget()
            one.walk(x)
            refuse_inside(self._body.comm, one.obstacle.name, one.distances(x)[1][:, 0], size=size)

    def place(self, p: FloatArray, R: FloatArray) -> None:
        """Put the frames to p (m, 3) m, turned by R (m, 3, 3)."""
        for one, origin, axes in zip(self.contacts, p, R, strict=True):
            one.place(origin, axes)

    def walk(self, x: FloatArray) -> None:
        """A step has ended with nodes at x (owned nodes, 3) m."""
        for one in self.contacts:
            one.walk(x)

    def resultants(self) -> dict[str, FloatArray]:
        """(3,) N by name, on the body. Collective."""
        forces = -self.wrenches()[:, :3]
        return {one.obstacle.name: force for one, force in zip(self.contacts, forces, strict=True)}

    def approach(self, x: FloatArray, v: FloatArray, frame_v: FloatArray, frame_w: FloatArray, *, h: float) -> None:
        """The first step is h (s): with nodes at x (owned nodes, 3) m, v m/s, frames with v, w (m, 3)."""
        for one, linear, angular in zip(self.contacts, frame_v, frame_w, strict=True):
            one.approach(x, v, linear, angular, h=h)

    def stiffness_bound(self, x: FloatArray) -> float:
        """1/s^2, a bound of the squared angular frequencies by contact alone, for some steps from now. Collective.

        Springs between nodes and frames have at most the largest frequency of the nodes on frames that are held plus
        that of the frames on nodes that are held.
        """
        if not self.contacts:
            return 0.0
        on_nodes, on_frames = np.zeros(len(x)), []
        strides = np.max(self._body.comm.allgather([one.stride for one in self.contacts]), axis=0)
        for one, stride in zip(self.contacts, strides, strict=True):
            margin = _AHEAD * float(stride)
            near, found = one.distances(x, margin=margin)
            near = near[found[:, 0] < margin]
            on_nodes[near] += one.stiffness
            arms = (x[near] - one.p) @ one.R
            on_frames.append(one.stiffness * mass_of_points(self._masses[near], arms))
        summed = sum(self._body.comm.allgather(np.array(on_frames)))
        most = max(self._body.comm.allgather(float(on_nodes.max(initial=0.0))))
        most = max(most, *(one.stiffness for one in self.contacts))
        rates = [
            float(scipy.linalg.eigh(part, one.obstacle.mass, eigvals_only=True)[-1])
            for one, part in zip(self.contacts, summed, strict=True)
            if one.obstacle.mass is not None
        ]
        return most + sum(rates)  # of shapes on one body the sum counts, of others the largest would do

    def work_on_frames(self, before: FloatArray, p: FloatArray, R: FloatArray) -> FloatArray:
        """(2,) J, this rank's part of what contact and friction did on frames that came from p (m, 3), R (m, 3, 3).

        ``before``: (m, 2, 6) their wrenches then.
        """
        work = np.zeros(2)
        for one, first, p_first, R_first in zip(self.contacts, before, p, R, strict=True):
            turn = Rotation.from_matrix(one.R @ R_first.T).as_rotvec()
            work += 0.5 * (first + one.wrenches) @ np.append(one.p - p_first, turn)
        return work

    @property
    def poses(self) -> tuple[FloatArray, FloatArray]:
        """(m, 3) m, (m, 3, 3): where the frames are."""
        m = len(self.contacts)
        p, R = (np.array([getattr(one, name) for one in self.contacts], dtype=float) for name in ("p", "R"))
        return p.reshape(m, 3), R.reshape(m, 3, 3)

    @property
    def parts(self) -> FloatArray:
        """(m, 2, 6) this rank's part of the wrenches."""
        return np.array([one.wrenches for one in self.contacts], dtype=float).reshape(-1, 2, 6)

    def wrenches(self) -> FloatArray:
        """(m, 6) on the frames, the same on all ranks. Collective."""
        if not self.contacts:
            return np.zeros((0, 6))
        return np.asarray(sum(self._body.comm.allgather(self.parts.sum(axis=1))))

    def snapshot(self) -> dict[str, FloatArray]:
        """Copies of all that tells how it goes on, of the whole body. Collective."""
        kept: dict[str, FloatArray] = {}
        comm = self._body.comm
        for k, one in enumerate(self.contacts):
            place = np.concatenate([one.p, one.R.ravel(), [max(comm.allgather(one.stride))]])
            kept[f"shape {k}"] = np.append(place, sum(comm.allgather(one.wrenches.ravel())))
            if one.has_bristles:
                kept[f"stuck {k}"] = self._memory.gather_nodes(one.stuck)
        return kept

    def restore(self, kept: dict[str, FloatArray], x: FloatArray) -> None:
        """Go back to a snapshot with nodes at x (owned nodes, 3) m, on any number of ranks. Collective."""
        for k, one in enumerate(self.contacts):
            values = np.array(kept[f"shape {k}"], dtype=float)
            one.place(values[:3], values[3:12].reshape(3, 3))
            one.stride = float(values[12])
            one.wrenches = values[13:].reshape(2, 6) * (self._body.comm.rank == 0)
            if one.has_bristles:
                one.stuck = self._memory.scatter_nodes(kept[f"stuck {k}"])[: len(self._masses)]
            one.forget()
            one.walk(x)


def surface_nodes(body: NonlinearModel, surface: str) -> IntArray:
    """(n,) owned nodes of a group of facets, ascending. Collective."""
    nodes = body.layout.nodes_on(body.mesh.dim - 1, body.mesh.facets(surface))
    return np.sort(nodes[nodes < body.layout.n_owned_nodes]).astype(np.int64)


def check_surface(body: NonlinearModel, surface: str, *, what: str) -> None:
    """Refuse a surface that a body has not, or that has no facets. Collective.

    Raises:
        SceneError: on all ranks: names those there are.
    """
    known = sorted(body.mesh.facet_groups)
    error = None
    if surface not in known:
        error = SceneError(f"{what}: its mesh has no group of facets {surface!r}; it has {', '.join(map(repr, known))}")
    parallel.raise_collectively(body.comm, error)


def refuse_inside(comm: MPI.Comm, name: str, distances: FloatArray, *, size: float) -> None:
    """Refuse a body of a size (m) whose nodes, at signed distances (n,) m, begin in what they touch. Collective.

    Raises:
        SceneError: on all ranks: names the contact and the depth.
    """
    deepest = max(comm.allgather(float((-distances).max(initial=0.0))))
    if deepest > SAME_PLACE * size:
        raise SceneError(f"contact {name!r}: the body begins {deepest:.4g} m inside what it touches; move one of them")
