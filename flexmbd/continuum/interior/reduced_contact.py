"""Contact of the nodes on a body's surface with facets of a reduced body, for central differences.

Nodes that come through a facet are pushed out of it as by a rigid shape.  The place at which one touches hangs on the
facet's corners, and these on the body's frame and modes, on which the forces act by their virtual work.  The frame
carries a place as far behind the facet as the node is, so that friction keeps angular momentum.  All is looked for
in the body's axes, in which its rotation moves nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from flexmbd.continuum.history.nonlinear_model import NonlinearModel
from flexmbd.continuum.interior.facet_push import push_out
from flexmbd.continuum.interior.facet_search import FacetMesh, NearFacets
from flexmbd.continuum.interior.nodal_push import penalty_stiffness
from flexmbd.continuum.interior.shape_contacts import surface_nodes
from flexmbd.continuum.interior.touched_frames import Pushed
from flexmbd.multibody.interiors.touching_interior import ReducedFacets

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


class MovedFacets:
    """The surface of a reduced body where its frames say.

    Attributes:
        given: the surface.
        mesh: its facets.
        p, R: (c, 3) m, (c, 3, 3) of its frames.
        y: (3 (c - 1),) m, displacements of the frames of modes.
        points: (k, 3) m, of the surface, in the body's axes.
    """

    def __init__(self, given: ReducedFacets) -> None:
        """Nowhere yet."""
        self.given, self.mesh = given, FacetMesh(given.facets, len(given.points))
        c = len(given.frames)
        self.place(np.zeros((c, 3)), np.tile(np.eye(3), (c, 1, 1)))

    def place(self, p: FloatArray, R: FloatArray) -> None:
        """Put the frames to p (c, 3) m, turned by R (c, 3, 3)."""
        self.p, self.R = p.copy(), R.copy()
        self.y: FloatArray = ((p[1:] - p[0]) @ R[0]).reshape(-1)
        self.points: FloatArray = self.given.points + self.given.shapes @ self.y

    def seen(self, x: FloatArray) -> FloatArray:
        """(n, 3) m, points x in the body's axes."""
        return np.asarray((x - self.p[0]) @ self.R[0])

    def turned(self, vectors: FloatArray) -> FloatArray:
        """(n, 3) vectors in the body's axes, in inertial ones."""
        return np.asarray(vectors @ self.R[0].T)

    def reaction(self, found: NearFacets, seen: FloatArray, forces: FloatArray) -> FloatArray:
        """(k + 1, 3) N, N m on the points of the surface, and a couple on the body, all in its axes.

        Args:
            found: where.
            seen: (n, 3) m, the nodes that touch there.
            forces: (n, 3) N, on the nodes.
        """
        out = np.zeros((len(self.points) + 1, 3))
        np.add.at(out, found.nodes, -found.weights[:, :, None] * forces[:, None, :])
        place = np.einsum("nk,nka->na", found.weights, self.points[found.nodes])
        out[-1] = -np.cross(seen - place, forces).sum(axis=0)
        return out

    def wrenches(self, reaction: FloatArray) -> FloatArray:
        """(c, 6) N, N m on the frames, about them, by a reaction (k + 1, 3), all in the body's axes."""
        forces = reaction[:-1]
        modal = np.einsum("kai,ka->i", self.given.shapes, forces)
        moment = np.cross(self.points, forces).sum(axis=0) + reaction[-1]
        return frame_wrenches(forces.sum(axis=0), moment, modal, self.y)

    def ways(self, found: NearFacets, seen: FloatArray) -> FloatArray:
        """(n, 3, 3 + 3 c) m: of places behind facets, ``seen`` (n, 3) m, per unit motion of the frame and of y.

        All in the body's axes.
        """
        rigid = np.tile(np.eye(3, 6), (len(seen), 1, 1))
        x, y, z = seen.T
        rigid[:, 0, 4], rigid[:, 0, 5], rigid[:, 1, 3] = z, -y, -z
        rigid[:, 1, 5], rigid[:, 2, 3], rigid[:, 2, 4] = x, y, -x
        return np.concatenate([rigid, np.einsum("nk,nkai->nai", found.weights, self.given.shapes[found.nodes])], axis=2)


class ReducedContact:
    """One surface of a reduced body before the owned nodes of a surface.

    Attributes:
        name: of the contact.
        nodes: (n,) owned nodes of the surface.
        stiffness: 1/s^2, of the penalty.
        facets: of the other body.
        memory: (owned nodes, 4) m, the stretch of the nodes' bristles, in the other body's axes; 1 of those that touch.
        forces: (2, k + 1, 3) `MovedFacets.reaction` to normal and friction forces, in inertial axes: this rank's part.
        stride: m, the longest way of a node against the facets in the last step.
    """

    has_bristles = True

    def __init__(self, given: ReducedFacets, nodes: IntArray, n_owned: int, *, h: float, size: float) -> None:
        """Nothing touches yet; h: s, the stable step of the undeformed body; size: m, of it."""
        self.name, self.nodes = given.name, nodes
        self.stiffness = penalty_stiffness(given.penalty, h)
        self.facets = MovedFacets(given)
        self.memory: FloatArray = np.zeros((n_owned, 4))
        self.forces: FloatArray = np.zeros((2, len(given.points) + 1, 3))
        self.stride = 0.0
        self._size = size
        values, vectors = np.linalg.eigh(given.mobility)
        self._root: FloatArray = vectors * np.sqrt(np.maximum(values, 0.0))
        self._found: NearFacets | None = None
        self._before: tuple[FloatArray, FloatArray] | None = None

    @property
    def frames(self) -> int:
        """How many frames it exerts wrenches on."""
        return len(self.facets.p)

    @property
    def own_rate(self) -> float:
        """1/s^2, the largest squared angular frequency of the other body by itself."""
        return self.facets.given.rate

    def begin(self, x: FloatArray, p: FloatArray, R: FloatArray) -> None:
        """Nothing has touched yet."""
        self.place(p, R)
        self.forces[:], self.memory[:], self.stride = 0.0, 0.0, 0.0
        self.forget()
        self.walk(x)

    def place(self, p: FloatArray, R: FloatArray) -> None:
        """Put the frames to p (c, 3) m, turned by R (c, 3, 3)."""
        self.facets.place(p, R)

    def gaps(self, x: FloatArray) -> FloatArray:
        """(n,) m, of nodes near the facets, at x (owned nodes, 3) m, but those beyond a rim."""
        found = self._find(x)
        return -found.depth[~found.beside]

    def push(self, x: FloatArray, v: FloatArray, a: FloatArray, *, h: float, reach: float) -> Pushed:
        """Accelerations of nodes at x (owned nodes, 3) m; arguments as of `FrameContact.push`."""
        found, facets = self._find(x), self.facets
        before, points = self._before or (facets.seen(x[self.nodes]), facets.points)
        own, other = facets.seen(x[self.nodes]) - before, facets.points - points
        went = own[found.points] - np.einsum("nk,nka->na", found.weights, other[found.nodes])
        told: dict[str, Any] = {"friction": facets.given.friction, "size": self._size}
        pushed = push_out(found, went, self.memory[self.nodes], **told)
        self.memory[self.nodes] = pushed.memory
        self._found = pushed.found
        met, rubbed = (facets.turned(self.stiffness * one) for one in (pushed.met, pushed.rubbed))
        return Pushed(self.nodes[pushed.found.points], met, rubbed)

    def take(self, x: FloatArray, met: FloatArray, rubbed: FloatArray) -> None:
        """Keep, at a step's end, the reaction to forces (n, 3) N on the nodes pushed last, at x (n, 3) m."""
        if self._found is not None:
            facets = self.facets
            for k, force in enumerate((met, rubbed)):
                self.forces[k] = facets.turned(facets.reaction(self._found, facets.seen(x), force @ facets.R[0]))

    def walk(self, x: FloatArray) -> None:
        """Note how far nodes, at x (owned nodes, 3) m, went against the facets since this was asked last."""
        now = self.facets.seen(x[self.nodes]), self.facets.points
        if self._before is not None:
            self.stride = sum(_longest(after - before) for after, before in zip(now, self._before, strict=True))
        self._before = now

    def approach(self, x: FloatArray, v: FloatArray, frame_v: FloatArray, frame_w: FloatArray, *, h: float) -> None:
        """Foresee how far nodes, at x (owned nodes, 3) m with v, go in a step h (s) against frames with twists."""
        origin, facets = frame_v[0], self.facets
        own = v[self.nodes] - origin - np.cross(frame_w[0], x[self.nodes] - facets.p[0])
        modal = (frame_v[1:] - origin - np.cross(frame_w[0], facets.p[1:] - facets.p[0])) @ facets.R[0]
        self.stride = h * (_longest(own) + _longest(facets.given.shapes @ modal.reshape(-1)))

    def forget(self) -> None:
        """Forget where the nodes were."""
        self._before = self._found = None

    def springs(self, x: FloatArray, masses: FloatArray, *, margin: float) -> tuple[IntArray, FloatArray]:
        """Owned nodes that are less than a margin (m) before the facets, and their springs' stiffness on the frames."""
        found = self._find(x, margin=margin)
        near = self.nodes[found.points]
        way = self.facets.ways(found, self.facets.seen(x[near]))
        return near, np.einsum("n,nai,naj->ij", self.stiffness * masses[near], way, way)

    def rate(self, springs: FloatArray) -> float:
        """1/s^2, the largest squared angular frequency of the body on springs."""
        return float(np.linalg.eigvalsh(self._root.T @ springs @ self._root)[-1])

    def remembered(self) -> tuple[FloatArray, ...]:
        """What `worked` needs of the state before a step."""
        return self.forces.copy(), self._inertial(), self.facets.R[0]

    def worked(self, before: tuple[FloatArray, ...]) -> FloatArray:
        """(2,) J, work of normal and friction forces on the body since `remembered`: this rank's part."""
        forces, points, R = before
        turn = Rotation.from_matrix(self.facets.R[0] @ R.T).as_rotvec()
        way = np.vstack([self._inertial() - points, turn])
        return np.asarray(0.5 * ((forces + self.forces) * way).sum(axis=(1, 2)))

    def wrenches(self) -> FloatArray:
        """(c, 6) on the frames: this rank's part."""
        facets = self.facets
        found = facets.wrenches(self.forces.sum(axis=0) @ facets.R[0])
        return np.asarray((found.reshape(-1, 3) @ facets.R[0].T).reshape(-1, 6))

    def resultant(self, wrenches: FloatArray) -> FloatArray:
        """(3,) N on the nodes, with these wrenches (c, 6) on the frames."""
        return np.asarray(-wrenches[:, :3].sum(axis=0))

    def poses(self) -> FloatArray:
        """(12 c,) of the frames, for `place_by`."""
        return np.concatenate([self.facets.p.ravel(), self.facets.R.ravel()])

    def place_by(self, poses: FloatArray) -> None:
        """Put the frames where `poses` had them."""
        c = self.frames
        self.place(poses[: 3 * c].reshape(c, 3), poses[3 * c :].reshape(c, 3, 3))

    def _find(self, x: FloatArray, *, margin: float = 0.0) -> NearFacets:
        facets = self.facets
        return facets.mesh.find(facets.seen(x[self.nodes]), facets.points, margin=margin)

    def _inertial(self) -> FloatArray:
        return np.asarray(self.facets.p[0] + self.facets.turned(self.facets.points))


def frame_wrenches(force: FloatArray, moment: FloatArray, modal: FloatArray, y: FloatArray) -> FloatArray:
    """(c, 6) N, N m on the frames of a reduced body, each about its origin, that do the work of forces on the body.

    All in the body's axes.

    Args:
        force: (3,) N, their sum.
        moment: (3,) N m, about the body's frame.
        modal: (3 (c - 1),) N, their work per displacement of the frames of modes.
        y: (3 (c - 1),) m, these displacements.
    """
    arms, on_modes = y.reshape(-1, 3), modal.reshape(-1, 3)
    first = np.append(force - on_modes.sum(axis=0), moment - np.cross(arms, on_modes).sum(axis=0))
    return np.vstack([first, np.hstack([on_modes, np.zeros_like(on_modes)])])


def reduced_contacts(
    body: NonlinearModel, masses: FloatArray, surfaces: Sequence[ReducedFacets], *, h: float, size: float
) -> list[ReducedContact]:
    """The contacts of a body's surfaces with those of reduced bodies; see `shape_contacts`. Collective."""
    return [
        ReducedContact(one, surface_nodes(body, one.surface), len(masses), h=h, size=size) for one in surfaces
    ]


def _longest(ways: FloatArray) -> float:
    return float(np.sqrt((ways**2).sum(axis=1).max(initial=0.0)))
