"""Watches when an element of an exact beam turns by half a revolution: beyond, the other way round is the shorter."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import RangeWarning, warn
from flexmbd.multibody.bodies.body import Body
from flexmbd.multibody.force.beam_element import BeamElement
from flexmbd.multibody.joint.free import Free
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.results.stretch_watch import StoredRows
from flexmbd.rotation import to_quaternion

FloatArray = NDArray[np.float64]


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


class TurnWatch:
    """Looks through the rows of a simulation as they come, and warns of the first element that turns too far.

    Quaternions change smoothly from row to row, and so do the cosines, whose sign is another one beyond half a
    revolution than at the first row.
    """

    def __init__(self, scene: CompiledScene, bodies: Iterable[Body]) -> None:
        self._elements = _elements(scene, {id(body) for body in bodies})
        self._first: FloatArray | None = None
        self._rows = 0

    def look(self, stored: StoredRows) -> None:
        """Look at the rows that came since; each begins with its time (s) and its configuration.

        Warns:
            RangeWarning: an element has turned by half a revolution.
        """
        if not self._elements:
            return
        t, x, *_ = stored.since(self._rows)
        self._rows += len(t)
        if not len(t):
            return
        if self._first is None:
            self._first = x[:1].copy()
        if self._tells(t, x, self._first):
            self._elements = ()

    def judge(self, t: FloatArray, x: FloatArray, v: FloatArray) -> None:
        """The same of all rows of another run: times (k,), configurations and velocities.

        Warns:
            RangeWarning: as `look`.
        """
        del v
        if self._elements:
            self._tells(t, x, x[:1])

    def _tells(self, t: FloatArray, x: FloatArray, first: FloatArray) -> bool:
        """Whether one has turned since the first row (1, nx), which is told."""
        beyond = np.argwhere(np.stack([np.sign(one.cosines(first)) * one.cosines(x) < 0.0 for one in self._elements]).T)
        if not len(beyond):
            return False
        row, which = beyond[0]
        what = self._elements[which].what
        warn(
            f"{what}: its sections are half a revolution apart at t = {t[row]:.6g} s, and from there on it bends "
            "the other way round: give the beam more divisions",
            RangeWarning,
            subject=f"turn of {what}",
        )
        return True


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
