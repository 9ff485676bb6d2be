"""The contacts of a body's surfaces with shapes and reduced bodies of its machine, for central differences."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from mpi4py import MPI

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.history.body_memory import BodyMemory
from flexmbd.continuum.history.nonlinear_model import NonlinearModel
from flexmbd.errors import SceneError
from flexmbd.round_off import SAME_PLACE

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# Steps for which the stable one is to hold: what may touch within them, at the speed of the last, counts as touching.
_AHEAD = 20.0


@dataclass(frozen=True, eq=False)
class Pushed:
    """Accelerations of nodes by one contact.

    Attributes:
        nodes: (n,) owned nodes that touch.
        met, rubbed: (n, 3) m/s^2, normal to what they touch, and across by friction.
    """

    nodes: IntArray
    met: FloatArray
    rubbed: FloatArray


class FrameContact(Protocol):
    """The contact of a surface's nodes with one shape or reduced body, the touched, which moves with c frames.

    Attributes:
        name: of the contact.
        nodes: (n,) owned nodes of the surface.
        stiffness: 1/s^2, of the penalty, per mass of a node.
        forces: (2, ...) N, N m, normal and friction forces on the touched at a step's end: this rank's part.
        memory: (owned nodes, k) m, where bristles stick or how they are stretched, and 1 of nodes that have one.
        stride: m, the longest way of a node against the touched in the last step.
    """

    name: str
    nodes: IntArray
    stiffness: float
    forces: FloatArray
    memory: FloatArray
    stride: float

    @property
    def frames(self) -> int:
        """How many frames the touched moves with: c."""

    @property
    def own_rate(self) -> float:
        """1/s^2, the largest squared angular frequency of the touched by itself; 0 of a rigid one."""

    @property
    def has_bristles(self) -> bool:
        """Whether nodes stick by bristles."""

    def begin(self, x: FloatArray, p: FloatArray, R: FloatArray) -> None:
        """Nothing has touched yet, with nodes at x (owned nodes, 3) m, and frames at p (c, 3) m, R (c, 3, 3)."""

    def place(self, p: FloatArray, R: FloatArray) -> None:
        """Put the frames to p (c, 3) m, turned by R (c, 3, 3)."""

    def gaps(self, x: FloatArray) -> FloatArray:
        """(k,) m, signed distances of the nodes near the touched, at x (owned nodes, 3) m; negative inside."""

    def push(self, x: FloatArray, v: FloatArray, a: FloatArray, *, h: float, reach: float) -> Pushed:
        """Accelerations by the contact, with nodes at x (owned nodes, 3) m.

        Args:
            x: of the nodes.
            v: (owned nodes, 3) m/s, with which the step is made before a and contact act.
            a: (owned nodes, 3) m/s^2, without this contact.
            h: s, the step.
            reach: s^2, as of `nodal_push.push`.
        """

    def take(self, x: FloatArray, met: FloatArray, rubbed: FloatArray) -> None:
        """Keep, at a step's end, the forces (n, 3) N on the nodes pushed last, at x (n, 3) m."""

    def walk(self, x: FloatArray) -> None:
        """Find the stride of a step that ends with nodes at x (owned nodes, 3) m."""

    def approach(self, x: FloatArray, v: FloatArray, frame_v: FloatArray, frame_w: FloatArray, *, h: float) -> None:
        """Estimate the stride of a first step h (s), of nodes at x m with v m/s (owned nodes, 3), and of frames.

        ``frame_v`` (m/s), ``frame_w`` (rad/s): (c, 3) velocities of the frames.
        """

    def forget(self) -> None:
        """Forget where the nodes were."""

    def springs(self, x: FloatArray, masses: FloatArray, *, margin: float) -> tuple[IntArray, FloatArray]:
        """The owned nodes less than a margin (m) before the touched, and its stiffness on their springs.

        Args:
            x: (owned nodes, 3) m.
            masses: (owned nodes,) kg.
            margin: m.

        Returns:
            (k,) nodes; the matrix (N/m, N, N m) for the velocities of the touched that `rate` takes.
        """

    def rate(self, springs: FloatArray) -> float:
        """1/s^2, the largest squared angular frequency of the touched on springs of all ranks, nodes held."""

    def remembered(self) -> tuple[FloatArray, ...]:
        """What `worked` needs of the state before a step."""

    def worked(self, before: tuple[FloatArray, ...]) -> FloatArray:
        """(2,) J, work of normal and friction forces on the touched since `remembered`: this rank's part."""

    def wrenches(self) -> FloatArray:
        """(c, 6) on the frames: this rank's part."""

    def resultant(self, wrenches: FloatArray) -> FloatArray:
        """(3,) N on the nodes, from the wrenches (c, 6) on the frames."""

    def poses(self) -> FloatArray:
        """(12 c,) places (m) and rotations of the frames."""

    def place_by(self, poses: FloatArray) -> None:
        """Put the frames where `poses` had them."""


class FrameContacts:
    """All such contacts of one body.

    Attributes:
        contacts: them; arrays over frames have those of the first one, then those of the next.
    """

    def __init__(
        self, body: NonlinearModel, memory: BodyMemory, masses: FloatArray, contacts: Sequence[FrameContact]
    ) -> None:
        """Take contacts; memory: how nodal values are gathered; masses: (owned nodes,) kg."""
        self._comm, self._memory, self._masses = body.comm, memory, masses
        self.contacts: tuple[FrameContact, ...] = tuple(contacts)

    @property
    def own_rate(self) -> float:
        """1/s^2, the largest squared angular frequency of the bodies that are touched, by themselves."""
        return max((one.own_rate for one in self.contacts), default=0.0)

    def begin(self, x: FloatArray, p: FloatArray, R: FloatArray, *, size: float) -> None:
        """Nothing has touched yet; nodes are at x (owned nodes, 3) m, frames at p (c, 3), R (c, 3, 3). Collective.

        ``size``: m, of the body, by which depths are told from round-off.

        Raises:
            SceneError: on all ranks: the body begins in what it touches.
        """
        for one, origins, axes in self._each(p, R):
            one.begin(x, origins, axes)
            refuse_inside(self._comm, one.name, one.gaps(x), size=size)

    def place(self, p: FloatArray, R: FloatArray) -> None:
        """Put the frames to p (c, 3) m, turned by R (c, 3, 3)."""
        for one, origins, axes in self._each(p, R):
            one.place(origins, axes)

    def walk(self, x: FloatArray) -> None:
        """Find the strides of a step that ends with nodes at x (owned nodes, 3) m."""
        for one in self.contacts:
            one.walk(x)

    def resultants(self) -> dict[str, FloatArray]:
        """(3,) N by name, on the body. Collective."""
        parts = self._each(self.wrenches())
        return {one.name: one.resultant(wrenches) for one, wrenches in parts}

    def approach(self, x: FloatArray, v: FloatArray, frame_v: FloatArray, frame_w: FloatArray, *, h: float) -> None:
        """Estimate the strides of a first step h (s); arguments as of `FrameContact.approach`."""
        for one, linear, angular in self._each(frame_v, frame_w):
            one.approach(x, v, linear, angular, h=h)

    def stiffness_bound(self, x: FloatArray) -> float:
        """1/s^2, a bound of the squared angular frequencies by contact alone, for some steps from now. Collective.

        Springs between nodes and bodies have at most the largest frequency of the nodes on bodies that are held plus
        that of the bodies on nodes that are held.
        """
        if not self.contacts:
            return 0.0
        on_nodes, on_frames = np.zeros(len(x)), []
        strides = np.max(self._comm.allgather([one.stride for one in self.contacts]), axis=0)
        for one, stride in zip(self.contacts, strides, strict=True):
            near, springs = one.springs(x, self._masses, margin=_AHEAD * float(stride))
            on_nodes[near] += one.stiffness
            on_frames.append(springs)
        ranks = self._comm.allgather(on_frames)
        most = max(self._comm.allgather(float(on_nodes.max(initial=0.0))))
        most = max(most, *(one.stiffness for one in self.contacts))
        # of what one body carries the sum counts, of others the largest would do
        rates = [one.rate(np.asarray(sum(of[k] for of in ranks))) for k, one in enumerate(self.contacts)]
        return most + sum(rates)

    def remembered(self) -> list[tuple[FloatArray, ...]]:
        """What `worked` needs of the state before a step."""
        return [one.remembered() for one in self.contacts]

    def worked(self, before: Sequence[tuple[FloatArray, ...]]) -> FloatArray:
        """(2,) J, work of normal and friction forces on all that is touched since `remembered`: this rank's part."""
        work = np.zeros(2)
        for one, first in zip(self.contacts, before, strict=True):
            work += one.worked(first)
        return work

    def wrenches(self) -> FloatArray:
        """(c, 6) on the frames, the same on all ranks. Collective."""
        if not self.contacts:
            return np.zeros((0, 6))
        return np.asarray(sum(self._comm.allgather(np.concatenate([one.wrenches() for one in self.contacts]))))

    def snapshot(self) -> dict[str, FloatArray]:
        """Copies of all that tells how it goes on, of the whole body. Collective."""
        kept: dict[str, FloatArray] = {}
        comm = self._comm
        for k, one in enumerate(self.contacts):
            kept[f"shape {k}"] = np.append(one.poses(), max(comm.allgather(one.stride)))
            kept[f"shape {k} forces"] = np.asarray(sum(comm.allgather(one.forces)))
            if one.has_bristles:
                kept[f"stuck {k}"] = self._memory.gather_nodes(one.memory)
        return kept

    def restore(self, kept: dict[str, FloatArray], x: FloatArray) -> None:
        """Go back to a snapshot with nodes at x (owned nodes, 3) m, on any number of ranks. Collective."""
        for k, one in enumerate(self.contacts):
            values = np.array(kept[f"shape {k}"], dtype=float)
            one.place_by(values[:-1])
            one.stride = float(values[-1])
            one.forces = kept[f"shape {k} forces"] * (self._comm.rank == 0)
            if one.has_bristles:
                one.memory = self._memory.scatter_nodes(kept[f"stuck {k}"])[: len(self._masses)]
            one.forget()
            one.walk(x)

    def _each(self, *values: FloatArray) -> Iterator[tuple[Any, ...]]:
        """Each contact, and its frames' part of values (c, ...)."""
        first = 0
        for one in self.contacts:
            yield one, *(part[first : first + one.frames] for part in values)
            first += one.frames


def refuse_inside(comm: MPI.Comm, name: str, distances: FloatArray, *, size: float) -> None:
    """Refuse a body of a size (m) whose nodes, at signed distances (n,) m, begin in what they touch. Collective.

    Raises:
        SceneError: on all ranks: names the contact and the depth.
    """
    deepest = max(comm.allgather(float((-distances).max(initial=0.0))))
    if deepest > SAME_PLACE * size:
        raise SceneError(f"contact {name!r}: the body begins {deepest:.4g} m inside what it touches; move one of them")
