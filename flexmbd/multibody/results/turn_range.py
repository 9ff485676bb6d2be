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
        t, axis, cosine, rate = self._turns(rows, rows.some)
        # between two rows that are looked at it must not turn so far that nothing is seen of it
        if len(t) > 1 and (np.maximum(rate[1:], rate[:-1]) * np.diff(t)).max() > _SEEN:
            t, axis, cosine, rate = self._turns(rows, slice(None))
        # sin(angle) changes its sign where cos(angle) is negative: the rotation vector jumps to the opposite one
        flips = np.einsum("ka,ka->k", axis[1:], axis[:-1]) < 0.0
        jumps = np.flatnonzero(flips & (cosine[1:] < 0.0) & (cosine[:-1] < 0.0))
        if not len(jumps):
            return False
        what, when = self.bushing.what, t[jumps[0] + 1]
        warn(
            f"{what}: its ends are turned by half a revolution at t = {when:.6g} s, and from there on its moments "
            "point the other way, for it measures the shorter turn: what winds up further wants a JointSpring on the "
            "joint's coordinate, which counts turns",
            RangeWarning,
            subject=f"turn of {what}",
        )
        return True

    def _turns(self, rows: StateRows, which: slice) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Of rows and the one before: times (k,), sin(angle) times its axis (k, 3), cos(angle), and rates (rad/s)."""
        motions = rows.motions if which == rows.some else rows.motions_of(rows.x[which], rows.v[which])
        t = rows.t[which]
        if rows.before is not None:
            motions = np.concatenate([rows.motions_of(rows.before.x, rows.before.v), motions])
            t = np.concatenate([rows.before.t, t])
        turns, spins = [], []
        for frame in self.bushing.frames:
            link = rows.scene.index.bodies[frame.body]
            R = motions[:, link, 3:12].reshape(-1, 3, 3) if link >= 0 else np.eye(3)
            turns.append(R @ frame.R_BF)
            spins.append(motions[:, link, 15:18] if link >= 0 else np.zeros(3))
        R = np.swapaxes(turns[0], -1, -2) @ turns[1]
        axis = 0.5 * np.stack([R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]], axis=1)
        cosine = 0.5 * (np.einsum("kaa->k", R) - 1.0)
        return t, axis, cosine, np.sqrt(np.sum((spins[1] - spins[0]) ** 2, axis=-1))


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
