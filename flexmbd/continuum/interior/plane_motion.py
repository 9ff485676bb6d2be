"""Plane bodies in motion: the plane in which they begin, which their nodes and frames are not to leave."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.history.nonlinear_model import NonlinearModel
from flexmbd.errors import SceneError
from flexmbd.multibody.bodies.continuum_body import FrameMotion
from flexmbd.round_off import SIX_DIGITS

FloatArray = NDArray[np.float64]


class PlaneMotion:
    """The plane of one body, fixed in inertial axes once it has begun; of other bodies nothing."""

    def __init__(self, body: NonlinearModel) -> None:
        """Nothing has begun. Collective."""
        self._axis = body.plane_axis
        self._names = [found.name for found in body.interfaces]
        #: (3,) unit normal in inertial axes; zero of bodies that are not plane
        self.normal: FloatArray = np.zeros(3)
        self._tilted: FloatArray = np.zeros((0, 3))
        self._height: FloatArray = np.zeros(0)
        x = body.layout.node_x[: body.layout.n_owned_nodes]
        ends = body.comm.allgather((x.min(axis=0, initial=np.inf), x.max(axis=0, initial=-np.inf)))
        low, high = (np.array([end[k] for end in ends]) for k in (0, 1))
        self._size = float(np.linalg.norm(high.max(axis=0) - low.min(axis=0)))

    @property
    def is_plane(self) -> bool:
        """Whether the body is a plane one."""
        return self._axis is not None

    def begin(self, R: FloatArray, motion: FrameMotion | None = None) -> None:
        """Note the plane of a body whose axes R turns to inertial ones; with frames, where these stand.

        Raises:
            SceneError: a frame begins to move out of it.
        """
        if self._axis is None:
            return
        self.normal = R[:, self._axis].copy()
        if motion is None:
            return
        k = len(self._names)  # frames of shapes that touch the body follow, and move as they like
        v, w = motion.v[:k], motion.w[:k]
        self._tilted = np.einsum("kba,b->ka", motion.R[:k], self.normal)
        self._height = motion.p[:k] @ self.normal
        speed = abs(v @ self.normal) + self._size * np.linalg.norm(np.cross(w, self.normal), axis=1)
        along = np.linalg.norm(v, axis=1) + self._size * np.linalg.norm(w, axis=1)
        self._refuse(speed > SIX_DIGITS * along, "begins to move out of")

    def check(self, motion: FrameMotion) -> None:
        """Refuse frames that have left the plane.

        Raises:
            SceneError: one has.
        """
        if self._axis is None:
            return
        k = len(self._names)
        tilt = np.linalg.norm(np.einsum("kba,b->ka", motion.R[:k], self.normal) - self._tilted, axis=1)
        height = abs(motion.p[:k] @ self.normal - self._height)
        self._refuse(tilt + height / self._size > SIX_DIGITS, "leaves")

    def in_plane(self, vectors: FloatArray) -> FloatArray:
        """Vectors (n, 3) in inertial axes without what is normal to the plane; of other bodies all."""
        return vectors if self._axis is None else vectors - np.outer(vectors @ self.normal, self.normal)

    def _refuse(self, found: NDArray[np.bool_], does: str) -> None:
        if found.any():
            normal = ", ".join(f"{x:.3g}" for x in self.normal)
            raise SceneError(
                f"frame {self._names[int(np.argmax(found))]!r} {does} the plane of its plane body, whose normal is "
                f"({normal}): joints must hold it there (Revolute or Planar about that normal, Prismatic in the "
                "plane); what moves in space is to be of solid cells"
            )
