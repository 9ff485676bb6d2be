"""The contacts of a body's surfaces with what frames of its machine carry, for central differences."""

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
    """What a contact does to some nodes.

    Attributes:
        nodes: (n,) owned nodes.
        met, rubbed: (n, 3) m/s^2, accelerations out of what they touch and across.
    """

    nodes: IntArray
    met: FloatArray
    rubbed: FloatArray


class FrameContact(Protocol):
    """A contact of some nodes with what c frames carry.

    Attributes:
        name: of it.
        nodes: (n,) owned nodes of the surface.
        stiffness: 1/s^2, of the penalty, per mass of a node.
        forces: (2, ...) on what is touched, of what pushes and of friction, at a step's end: this rank's part.
        memory: (owned nodes, k) of bristles.
        stride: m, the longest way of a node against it in the last step.
    """

    name: str
    nodes: IntArray
    stiffness: float
    forces: FloatArray
    memory: FloatArray
    stride: float

    @property
    def frames(self) -> int:
        """How many frames it exerts wrenches on: c."""

    @property
    def own_rate(self) -> float:
        """1/s^2, the largest squared angular frequency of what is touched, by itself."""

    @property
    def has_bristles(self) -> bool:
        """Whether what sticks does so by bristles."""

    def begin(self, x: FloatArray, p: FloatArray, R: FloatArray) -> None:
        """Nothing has touched yet, with nodes at x (owned nodes, 3) m, and frames at p (c, 3) m, R (c, 3, 3)."""

    def place(self, p: FloatArray, R: FloatArray) -> None:
        """Put the frames to p (c, 3) m, turned by R (c, 3, 3)."""

    def gaps(self, x: FloatArray) -> FloatArray:
        """(n,) m, of the nodes that are near."""

    def push(self, x: FloatArray, v: FloatArray, a: FloatArray, *, h: float, reach: float) -> Pushed:
        """What it does to nodes at x (owned nodes, 3) m; the rest as of `nodal_push.push`."""

    def take(self, x: FloatArray, met: FloatArray, rubbed: FloatArray) -> None:
        """Note the forces (n, 3) N, of both kinds, on the nodes pushed last, at x (n, 3) m; a step ends."""

    def walk(self, x: FloatArray) -> None:
        """A step has ended with nodes at x (owned nodes, 3) m."""

    def approach(self, x: FloatArray, v: FloatArray, frame_v: FloatArray, frame_w: FloatArray, *, h: float) -> None:
        """Foresee the stride of a first step h (s), with the frames' twists (c, 3)."""

    def forget(self) -> None:
        """Forget where the nodes were."""

    def springs(self, x: FloatArray, masses: FloatArray, *, margin: float) -> tuple[IntArray, FloatArray]:
        """Nodes that are less than a margin (m) before it; the stiffness of their springs on what it is carried by."""

    def rate(self, springs: FloatArray) -> float:
        """1/s^2, the largest squared angular frequency of that on springs."""

    def remembered(self) -> tuple[FloatArray, ...]:
        """What `worked` wants to know of before a step."""

    def worked(self, before: tuple[FloatArray, ...]) -> FloatArray:
        """(2,) J, this rank's part of what contact and friction did on what is touched since then."""

    def wrenches(self) -> FloatArray:
        """(c, 6) on the frames: this rank's part."""

    def resultant(self, wrenches: FloatArray) -> FloatArray:
        """(3,) N on the nodes, with these wrenches."""

    def poses(self) -> FloatArray:
        """The frames' places, in a row."""

    def place_by(self, poses: FloatArray) -> None:
        """Put the frames there."""


class FrameContacts:
    """The contacts of one body's surfaces with what frames carry, whose frames follow each other.

    Attributes:
        contacts: them.
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
        """A step has ended with nodes at x (owned nodes, 3) m."""
        for one in self.contacts:
            one.walk(x)

    def resultants(self) -> dict[str, FloatArray]:
        """(3,) N by name, on the body. Collective."""
        parts = self._each(self.wrenches())
        return {one.name: one.resultant(wrenches) for one, wrenches in parts}

    def approach(self, x: FloatArray, v: FloatArray, frame_v: FloatArray, frame_w: FloatArray, *, h: float) -> None:
        """The first step is h (s): with nodes at x (owned nodes, 3) m, v m/s, frames with v, w (c, 3)."""
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
        """What `worked` wants to know of before a step."""
        return [one.remembered() for one in self.contacts]

    def worked(self, before: Sequence[tuple[FloatArray, ...]]) -> FloatArray:
        """(2,) J, this rank's part of what contact and friction did on what is touched since then."""
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
