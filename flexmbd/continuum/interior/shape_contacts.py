"""Contact of the nodes on a body's surface with a rigid shape of its machine, for central differences.

Nodes are pushed as by planes (`nodal_push`), by forces that act on the shapes' frames the other way round.  What is
stored and lost is counted on the way of a node against the shape, so that work that a shape does on the body is none of
it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from flexmbd.continuum import parallel
from flexmbd.continuum.history.nonlinear_model import NonlinearModel
from flexmbd.continuum.interior.machine_frames import mass_of_points
from flexmbd.continuum.interior.nodal_push import penalty_stiffness, push
from flexmbd.continuum.interior.touched_frames import Pushed
from flexmbd.errors import SceneError
from flexmbd.multibody.interiors.touching_interior import Obstacle

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


class ShapeContact:
    """One obstacle before the owned nodes of a surface.

    Attributes:
        obstacle: with its shape.
        name: of the contact.
        nodes: (n,) owned nodes of the surface.
        stiffness: 1/s^2, of the penalty.
        p, R: (3,) m, (3, 3): the shape's frame in inertial axes.
        forces: (2, 6) wrenches on the frame, N and N m about its origin, by normal forces and by friction: this rank's
            part.
        memory: (owned nodes, 4) m, where nodes stick, in the frame's axes, and 1 where they do.
        stride: m, the longest way of a node against the shape in the last step.
    """

    frames, own_rate = 1, 0.0

    def __init__(self, obstacle: Obstacle, nodes: IntArray, n_owned: int, *, h: float) -> None:
        """Nothing touches yet; h: s, the stable step of the undeformed body."""
        self.obstacle, self.nodes, self.name = obstacle, nodes, obstacle.name
        self.stiffness = penalty_stiffness(obstacle.penalty, h)
        self.p: FloatArray = np.zeros(3)
        self.R: FloatArray = np.eye(3)
        self.forces: FloatArray = np.zeros((2, 6))
        self.memory: FloatArray = np.zeros((n_owned, 4))
        self.stride = 0.0
        self._before: FloatArray | None = None

    @property
    def has_bristles(self) -> bool:
        """Whether what sticks does so by bristles."""
        return self.stiffness > 0.0 and self.obstacle.friction > 0.0

    def begin(self, x: FloatArray, p: FloatArray, R: FloatArray) -> None:
        """Nothing has touched yet."""
        self.place(p, R)
        self.forces[:], self.memory[:], self.stride = 0.0, 0.0, 0.0
        self.forget()
        self.walk(x)

    def place(self, p: FloatArray, R: FloatArray) -> None:
        """Put the shape's frame to p (1, 3) m, turned by R (1, 3, 3)."""
        self.p, self.R = p[0].copy(), R[0].copy()

    def gaps(self, x: FloatArray) -> FloatArray:
        """(n,) m, of nodes near the shape, at x (owned nodes, 3) m."""
        return self.distances(x)[1][:, 0]

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
        """Accelerations of nodes at x (owned nodes, 3) m; arguments as of `FrameContact.push`."""
        near, found = self.distances(x, margin=0.0 if self.stiffness else np.inf)
        law: dict[str, Any] = {"stiffness": self.stiffness, "friction": self.obstacle.friction}
        if self.stiffness:
            touch = found[:, 0] < 0.0
            near, found = near[touch], found[touch]
        normal = found[:, 1:] @ self.R.T
        if not self.has_bristles:
            return Pushed(near, *push(-found[:, 0], normal, v[near], a[near], h=h, reach=reach, **law))
        held = self.memory[near, 3:] > 0.0
        anchors = np.where(held, self.p + self.memory[near, :3] @ self.R.T, x[near])
        stretch = x[near] - anchors
        met, rubbed = push(-found[:, 0], normal, v[near], a[near], h=h, reach=reach, stretch=stretch, **law)
        self.memory[:] = 0.0
        # where bristles slide they are stretched as far as friction bears
        self.memory[near, :3] = (x[near] + rubbed / self.stiffness - self.p) @ self.R
        self.memory[near, 3] = 1.0
        return Pushed(near, met, rubbed)

    def take(self, x: FloatArray, met: FloatArray, rubbed: FloatArray) -> None:
        """Keep, at a step's end, the wrenches of forces (k, 3) N on the nodes pushed last, at x (k, 3) m."""
        for k, force in enumerate((met, rubbed)):
            self.forces[k] = -np.append(force.sum(axis=0), np.cross(x - self.p, force).sum(axis=0))

    def walk(self, x: FloatArray) -> None:
        """Note how far nodes, at x (owned nodes, 3) m, went against the shape since this was asked last."""
        y = (x[self.nodes] - self.p) @ self.R
        if self._before is not None:
            self.stride = float(np.sqrt(((y - self._before) ** 2).sum(axis=1).max(initial=0.0)))
        self._before = y

    def approach(self, x: FloatArray, v: FloatArray, frame_v: FloatArray, frame_w: FloatArray, *, h: float) -> None:
        """Foresee how far nodes, at x (owned nodes, 3) m with v, go in a step h (s) against a frame with its twist."""
        arms = x[self.nodes] - self.p
        speeds = v[self.nodes] - frame_v[0] - np.cross(frame_w[0], arms)
        self.stride = h * float(np.sqrt((speeds**2).sum(axis=1).max(initial=0.0)))

    def forget(self) -> None:
        """Forget where the nodes were."""
        self._before = None

    def springs(self, x: FloatArray, masses: FloatArray, *, margin: float) -> tuple[IntArray, FloatArray]:
        """Owned nodes that are less than a margin (m) before the shape, and their springs' stiffness on the frame."""
        near, found = self.distances(x, margin=margin)
        near = near[found[:, 0] < margin]
        return near, self.stiffness * mass_of_points(masses[near], (x[near] - self.p) @ self.R)

    def rate(self, springs: FloatArray) -> float:
        """1/s^2, the largest squared angular frequency of the shape's body on springs; none of the ground."""
        mass = self.obstacle.mass
        return 0.0 if mass is None else float(scipy.linalg.eigh(springs, mass, eigvals_only=True)[-1])

    def remembered(self) -> tuple[FloatArray, ...]:
        """What `worked` needs of the state before a step."""
        return self.forces.copy(), self.p, self.R

    def worked(self, before: tuple[FloatArray, ...]) -> FloatArray:
        """(2,) J, work of normal and friction forces on the shape since `remembered`: this rank's part."""
        forces, p, R = before
        turn = Rotation.from_matrix(self.R @ R.T).as_rotvec()
        return np.asarray(0.5 * (forces + self.forces) @ np.append(self.p - p, turn))

    def wrenches(self) -> FloatArray:
        """(1, 6) on the frame: this rank's part."""
        return np.asarray(self.forces.sum(axis=0)[None])

    def resultant(self, wrenches: FloatArray) -> FloatArray:
        """(3,) N on the nodes, with these wrenches (1, 6) on the frame."""
        return np.asarray(-wrenches[0, :3])

    def poses(self) -> FloatArray:
        """(12,) of the frame, for `place_by`."""
        return np.concatenate([self.p, self.R.ravel()])

    def place_by(self, poses: FloatArray) -> None:
        """Put the frame where `poses` had it."""
        self.place(poses[None, :3], poses[3:].reshape(1, 3, 3))


def shape_contacts(
    body: NonlinearModel, masses: FloatArray, obstacles: Sequence[Obstacle], *, h: float, bonded: NDArray[np.integer]
) -> list[ShapeContact]:
    """The contacts of a body's surfaces with rigid shapes. Collective.

    Args:
        body: the body.
        masses: (owned nodes,) kg.
        obstacles: what its surfaces touch.
        h: s, the stable step of the undeformed body without contact.
        bonded: owned nodes that frames move.

    Raises:
        SceneError: on all ranks: such nodes are to stop where they meet a shape.
    """
    found = [ShapeContact(one, surface_nodes(body, one.surface), len(masses), h=h) for one in obstacles]
    stopped = [one for one in found if not one.stiffness and np.isin(one.nodes, bonded).any()]
    error = None
    if stopped:
        error = SceneError(
            f"contact {stopped[0].name!r}: some of its nodes move with a frame, which does not stop where one of them "
            "meets a shape: give it a penalty, as 0.5"
        )
    parallel.raise_collectively(body.comm, error)
    return found


def surface_nodes(body: NonlinearModel, surface: str) -> IntArray:
    """(n,) owned nodes of a group of facets, ascending. Collective."""
    nodes = body.layout.nodes_on(body.mesh.dim - 1, body.mesh.facets(surface))
    return np.sort(nodes[nodes < body.layout.n_owned_nodes]).astype(np.int64)


def check_surface(body: NonlinearModel, surface: str, *, what: str) -> None:
    """Refuse a surface that a body has not, or that has no facets, and all of beams and plates. Collective.

    Raises:
        SceneError: on all ranks: names those there are.
    """
    known = sorted(body.mesh.facet_groups)
    error = None
    if body.turns and body.mesh.dim < 3:
        error = SceneError(
            f"{what}: {body.form_name} is a beam or a plate, whose mesh has the edges of a surface alone and no "
            "thickness; put shapes on its frames (fm.contact.Sphere(body.frame(...), radius)), or mesh it with solid "
            "cells (solid_shell for plates)"
        )
    elif surface not in known:
        error = SceneError(f"{what}: its mesh has no group of facets {surface!r}; it has {', '.join(map(repr, known))}")
    parallel.raise_collectively(body.comm, error)
