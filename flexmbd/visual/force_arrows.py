"""Forces as arrows, whose lengths go with their sizes: the largest over all instants is as long as is said."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import PictureError
from flexmbd.given import numbers, shown
from flexmbd.multibody.bodies.body import Body
from flexmbd.visual.part import bounds_of, pose_matrix

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

#: Of times (nt,) s the places (nt, n, 3) m at which forces act, and the forces (nt, n, 3) N, in inertial axes.
ForcesAt: TypeAlias = Callable[[FloatArray], tuple[FloatArray, FloatArray]]

_SIDES = 10  # of an arrow's round parts
_HEAD = 0.35  # of its length
_THICKNESS = 0.12  # of its length, at most; of the head's radius the share that is the shaft's
_SHAFT = 0.45


def forces_at(forces: ForcesAt, times: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Places (nt, n, 3) m and forces (nt, n, 3) N at times (nt,) s.

    Raises:
        PictureError: it is no function, or gives something else.
    """
    if isinstance(forces, type) or not callable(forces):
        raise PictureError(f"forces must be a function of times (k,) s, as contacts= makes it, got {shown(forces)}")
    found = forces(times)
    parts = [numbers(one) for one in found] if isinstance(found, tuple | list) else []
    shapes = [one.shape for one in parts]
    if len(parts) != 2 or shapes[0] != shapes[1] or shapes[0] != (len(times), *shapes[0][1:2], 3):
        raise PictureError(
            f"forces must give places (m) and forces (N), each ({len(times)}, n, 3) at {len(times)} times, got "
            f"{shapes or shown(found)}"
        )
    return parts[0], parts[1]


@dataclass(frozen=True, eq=False)
class ForceArrows:
    """Arrows of n forces at nt instants; a `Part` that is coloured by the forces' sizes.

    Attributes:
        tails: (nt, n, 3) m, where they act.
        forces: (nt, n, 3) N.
        longest: m, of the largest force.
        thick: m, the largest radius of a head.
    """

    tails: FloatArray
    forces: FloatArray
    longest: float
    thick: float

    label = "contact forces"
    quantity = ("contact force", "N")
    covers: tuple[Body, ...] = ()
    colour = None
    turns = True

    @cached_property
    def _sizes(self) -> FloatArray:
        """(nt, n) N."""
        return np.linalg.norm(self.forces, axis=2)

    @cached_property
    def largest(self) -> float:
        """N, over all instants."""
        return float(self._sizes.max(initial=0.0))

    @property
    def x(self) -> FloatArray:
        """(v, 3) m, all arrows upright and as long as the longest."""
        count = self.forces.shape[1]
        upright = np.tile(_outline(self.longest, self.thick), (count, 1))
        return np.asarray(upright)

    @cached_property
    def triangle(self) -> IntArray:
        """(t, 3)."""
        one, points = _faces(), 3 * _SIDES + 2
        return np.concatenate([one + k * points for k in range(self.forces.shape[1])] or [one[:0]])

    @property
    def pose(self) -> FloatArray:
        """(nt, 4, 4), of inertial axes."""
        count = len(self.tails)
        return pose_matrix(np.zeros((count, 3)), np.broadcast_to(np.eye(3), (count, 3, 3)))

    @property
    def bounds(self) -> FloatArray:
        """(2, 3) m; of what pushes at no instant the place does not count."""
        pushes = self._sizes > 0.0
        tails = self.tails[pushes]
        tips = tails + self.longest / self.largest * self.forces[pushes]
        low, high = bounds_of([tails, tips])
        return np.array([low - self.thick, high + self.thick])

    def at(self, k: int) -> tuple[FloatArray, FloatArray]:
        """The arrows' vertices (v, 3) m and their forces (v,) N at instant k; those without force are points."""
        size = self._sizes[k]
        along = self.forces[k] / np.where(size > 0.0, size, 1.0)[:, None]
        helper = np.eye(3)[np.argmin(np.abs(along), axis=1)]
        side = np.cross(helper, along)
        norm = np.linalg.norm(side, axis=1)
        side /= np.where(norm > 0.0, norm, 1.0)[:, None]
        axes = np.stack([side, np.cross(along, side), along], axis=2)
        outlines = np.array([_outline(self.longest * one / self.largest, self.thick) for one in size])
        places = self.tails[k][:, None] + np.einsum("nij,nvj->nvi", axes, outlines.reshape(len(size), -1, 3))
        return places.reshape(-1, 3), np.repeat(size, 3 * _SIDES + 2)

    def displacement(self, k: int) -> FloatArray:
        """None."""
        return np.zeros_like(self.x)


def _outline(length: float, thick: float) -> FloatArray:
    """(v, 3) m of an arrow along z from 0: rings of its shaft and its head, its tip, the middle of its end."""
    head = min(thick, _THICKNESS * length)
    angle = 2.0 * np.pi * np.arange(_SIDES) / _SIDES
    ring = np.stack([np.cos(angle), np.sin(angle), np.zeros(_SIDES)], axis=1)
    rise = np.array([0.0, 0.0, (1.0 - _HEAD) * length])
    rings = [_SHAFT * head * ring, _SHAFT * head * ring + rise, head * ring + rise]
    return np.concatenate([*rings, [[0.0, 0.0, length], [0.0, 0.0, 0.0]]])


def _faces() -> IntArray:
    """(t, 3) of an arrow, outwards."""
    n = _SIDES
    here, there = np.arange(n), (np.arange(n) + 1) % n
    found = []
    for low, high in ((0, n), (n, 2 * n)):  # the shaft's side, and what the head is broader by
        found.append(np.stack([low + here, low + there, high + there], 1))
        found.append(np.stack([low + here, high + there, high + here], 1))
    found.append(np.stack([2 * n + here, 2 * n + there, np.full(n, 3 * n)], 1))
    found.append(np.stack([there, here, np.full(n, 3 * n + 1)], 1))
    return np.concatenate(found)
