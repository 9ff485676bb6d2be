"""Limits of what measures turns: beyond half a revolution of a beam's element or a bushing the other way is shorter."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import RangeWarning, warn
from flexmbd.multibody.bodies.body import Body
from flexmbd.multibody.force.beam_element import BeamElement
from flexmbd.multibody.force.bushing import Bushing
from flexmbd.multibody.joint.free import Free
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.results.state_rows import StateRows
from flexmbd.rotation import to_quaternion

FloatArray = NDArray[np.float64]

_SEEN = np.pi / 4.0  # rad


@dataclass(frozen=True, eq=False)
class _Element:
    """An element across a free joint.

    Attributes:
        what: its name in messages.
        place: where in x the joint's quaternion begins.
        begin, end: (4,) quaternions of the element's frames on the joint's inner and outer body.
    """

    what: str
    place: int
    begin: FloatArray
    end: FloatArray

    def cosines(self, x: FloatArray) -> FloatArray:
        """(k,) of half the angle between the sections, or their opposites: the scalar part of begin^-1 q end."""
        q = x[:, self.place : self.place + 4]
        scalar = q[:, 0] * self.end[0] - q[:, 1:] @ self.end[1:]
        vector = np.outer(q[:, 0], self.end[1:]) + q[:, 1:] * self.end[0] + np.cross(q[:, 1:], self.end[1:])
        found: FloatArray = scalar * self.begin[0] + vector @ self.begin[1:]
        return found


@dataclass(frozen=True, eq=False)
class _Winding:
    """Elements of exact beams.

    Quaternions change smoothly from row to row, and so do the cosines, whose sign is another one beyond half a
    revolution than at the first row.
    """

    elements: tuple[_Element, ...]

    def tells(self, rows: StateRows) -> bool:
        """As `Limit`."""
        signs = [np.sign(one.cosines(rows.first)) * one.cosines(rows.x) < 0.0 for one in self.elements]
        beyond = np.argwhere(np.stack(signs).T)
        if not len(beyond):
            return False
        row, which = beyond[0]
        what = self.elements[which].what
        warn(
            f"{what}: its sections are half a revolution apart at t = {rows.t[row]:.6g} s, and from there on it bends "
            "the other way round: give the beam more divisions",
            RangeWarning,
            subject=f"turn of {what}",
        )
        return True


@dataclass(frozen=True, eq=False)
class _TurnedBushing:
    """A bushing with moments by its turn, which is known up to half a revolution."""

    bushing: Bushing

    def tells(self, rows: StateRows) -> bool:
        """As `Limit`."""
        which = rows.some
        rates, turned = self._relative(rows, which)
        spans = np.diff(rows.t[which])
        # between two rows that are looked at it must not turn so far that nothing is seen of it
        if len(spans) and (np.maximum(rates[1:], rates[:-1]) * spans).max() > _SEEN:
            which = np.arange(len(rows.t))
            _, turned = self._relative(rows, which)
        # the rotation vector jumps to the opposite one
        jumps = np.flatnonzero(np.einsum("ka,ka->k", turned[1:], turned[:-1]) < 0.0)
        if not len(jumps):
            return False
        what = self.bushing.what
        warn(
            f"{what}: its ends are turned by half a revolution at t = {rows.t[which[jumps[0] + 1]]:.6g} s, and from "
            "there on its moments point the other way, for it measures the shorter turn: what winds up further wants a "
            "JointSpring on the joint's coordinate, which counts turns",
            RangeWarning,
            subject=f"turn of {what}",
        )
        return True

    def _relative(self, rows: StateRows, which: NDArray[np.int64]) -> tuple[FloatArray, FloatArray]:
        """How fast (rad/s) its ends turn against each other, and the quaternions (rows, 4), the scalar not negative."""
        from scipy.spatial.transform import Rotation  # on need: few scenes have bushings

        motions = rows.motions if which is rows.some else rows.motions_of(which)
        turns, spins = [], []
        for frame in self.bushing.frames:
            link = rows.scene.index.bodies[frame.body]
            of_ground = np.zeros((len(which), 21))
            of_ground[:, 3:12] = np.eye(3).ravel()
            own = motions[:, link] if link >= 0 else of_ground
            turns.append(own[:, 3:12].reshape(-1, 3, 3) @ frame.R_BF)
            spins.append(own[:, 15:18])
        found = Rotation.from_matrix(np.einsum("kba,kbc->kac", turns[0], turns[1])).as_quat()
        return np.linalg.norm(spins[1] - spins[0], axis=1), found * np.where(found[:, 3:] < 0.0, -1.0, 1.0)


def turn_limits(scene: CompiledScene, bodies: Iterable[Body]) -> Iterator[_Winding | _TurnedBushing]:
    """Of the elements and bushings that hang on these bodies."""
    chosen = {id(body) for body in bodies}
    elements = _elements(scene, chosen)
    if elements:
        yield _Winding(elements)
    for one in scene.index.forces:
        if isinstance(one, Bushing) and one.resists_turns and any(id(end.body) in chosen for end in one.frames):
            yield _TurnedBushing(one)


def _elements(scene: CompiledScene, bodies: set[int]) -> tuple[_Element, ...]:
    """The elements between bodies, given by their ids, of which one hangs on the other."""
    elements = [one for one in scene.index.forces if isinstance(one, BeamElement) and id(one.frame_F.body) in bodies]
    if not elements:
        return ()
    places = {
        (id(joint.parent.body), id(joint.child.body)): slots.x.start + 3
        for joint, slots in scene.index.joints.items()
        if isinstance(joint.joint, Free)
    }
    found = []
    for one in elements:
        for inner, outer in (one.frames, one.frames[::-1]):
            place = places.get((id(inner.body), id(outer.body)))
            if place is not None:
                found.append(_Element(one.what, place, *(to_quaternion(frame.R_BF) for frame in (inner, outer))))
    return tuple(found)
