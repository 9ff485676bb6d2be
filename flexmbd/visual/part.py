"""Parts of a picture: surfaces that move, each rigidly or deforming, with a colour or with values."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.bodies.body import Body, Frame
from flexmbd.multibody.bodies.point_mass import is_point
from flexmbd.visual.recorded_motion import RecordedMotion

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


class Part(Protocol):
    """A surface of ``v`` vertices at ``nt`` instants."""

    @property
    def label(self) -> str:
        """The body or joint that it shows."""

    @property
    def covers(self) -> tuple[Body, ...]:
        """The bodies that need no symbols where it is drawn."""

    @property
    def colour(self) -> str | None:
        """As "#rrggbb"; None: coloured by its values."""

    @property
    def quantity(self) -> tuple[str, str]:
        """The quantity of the values and its SI unit."""

    @property
    def x(self) -> FloatArray:
        """(v, 3) m, undeformed vertices."""

    @property
    def triangle(self) -> IntArray:
        """(t, 3) vertices, oriented outwards."""

    @property
    def pose(self) -> FloatArray:
        """(nt, 4, 4) from its axes to inertial ones."""

    @property
    def turns(self) -> bool:
        """Whether it deforms so much that its normals must be found anew."""

    @property
    def bounds(self) -> FloatArray:
        """(2, 3) m, least and largest coordinates of the drawn vertices, in its axes, over all instants."""

    @property
    def largest(self) -> float:
        """The largest value over all instants."""

    def at(self, k: int) -> tuple[FloatArray, FloatArray]:
        """The drawn vertices (v, 3) m, in its axes, and their values (v,) at instant k."""

    def displacement(self, k: int) -> FloatArray:
        """(v, 3) m, of the vertices by deformation at instant k, in its axes, not amplified."""


@dataclass(frozen=True, eq=False)
class RigidPart:
    """A surface that does not deform.

    Attributes:
        label: the body or joint that it shows.
        colour: as "#rrggbb".
        x: (v, 3) m in its axes, before the scaling that ``pose`` may have.
        triangle: (t, 3) vertices, oriented outwards.
        pose: (nt, 4, 4) from its axes to inertial ones.
        covers: the bodies that it is the shape of.
    """

    label: str
    colour: str
    x: FloatArray
    triangle: IntArray
    pose: FloatArray
    covers: tuple[Body, ...] = ()
    quantity = ("", "")
    turns = False
    largest = 0.0

    @property
    def bounds(self) -> FloatArray:
        """(2, 3) m, in its axes."""
        return bounds_of([self.x])

    def at(self, k: int) -> tuple[FloatArray, FloatArray]:
        """The vertices, and zeros."""
        return self.x, np.zeros(len(self.x))

    def displacement(self, k: int) -> FloatArray:
        """None."""
        return np.zeros_like(self.x)


def reach(part: Part) -> FloatArray:
    """(k, 3) m, points in the inertial frame between which a part stays at all instants."""
    corners = np.array(np.meshgrid(*part.bounds.T, [1.0])).reshape(4, -1)
    return np.asarray((part.pose @ corners)[:, :3].transpose(0, 2, 1).reshape(-1, 3))


def placed(part: Part, k: int) -> tuple[FloatArray, FloatArray]:
    """The drawn vertices (v, 3) m in the inertial frame, and their values (v,), at instant k."""
    places, values = part.at(k)
    return places @ part.pose[k, :3, :3].T + part.pose[k, :3, 3], values


def bounds_of(places: list[FloatArray]) -> FloatArray:
    """(2, 3) least and largest coordinates of several sets of points (v, 3)."""
    lowest = np.min([p.min(axis=0) for p in places], axis=0)
    return np.array([lowest, np.max([p.max(axis=0) for p in places], axis=0)], dtype=np.float64)


def pose_matrix(p: FloatArray, columns: FloatArray) -> FloatArray:
    """(nt, 4, 4) of origins (nt, 3) m and axes (nt, 3, 3), which may be scaled."""
    matrix = np.zeros((len(p), 4, 4))
    matrix[:, :3, :3] = columns
    matrix[:, :3, 3] = p
    matrix[:, 3, 3] = 1.0
    return matrix


def body_pose(motion: RecordedMotion, body: Body, times: FloatArray) -> FloatArray:
    """(nt, 4, 4) of a body's axes at times (nt,) s."""
    frame = Frame(body, np.zeros(3), np.eye(3), None, body.name)
    return pose_matrix(motion.position(frame, t=times), frame_axes(motion, frame, times))


def frame_axes(motion: RecordedMotion, frame: Frame, times: FloatArray) -> FloatArray:
    """(nt, 3, 3) axes of a frame at times (nt,) s; of one on a point mass those of what carries the point."""
    if not is_point(frame.body):
        return motion.rotation(frame, t=times)
    rows = motion.body_motion(t=times)[:, motion.scene.index.bodies[frame.body], 3:12]
    return np.asarray(rows.reshape(-1, 3, 3) @ frame.R_BF)
