"""Pressure of contacts at the nodes of a body, for series and pictures (`BodyObserver`)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

#: Its name among the fields of a body.
CONTACT_PRESSURE = "contact_pressure"


@dataclass(frozen=True, eq=False)
class PushedNodes:
    """Normal forces of contacts on nodes.

    Attributes:
        touches: (n,) 1 of nodes on surfaces that touch, else 0.
        force: (n,) N, normal to what is touched; where contacts of unlike normals press a node the sum of their sizes.
    """

    touches: FloatArray
    force: FloatArray

    @property
    def columns(self) -> FloatArray:
        """(n, 2)."""
        return np.stack([self.touches, self.force], axis=1)


def contact_pressure(pushed: PushedNodes, x: FloatArray, triangle: IntArray) -> FloatArray:
    """(k,) Pa at nodes x (k, 3) m of the undeformed body, whose boundary is triangles (t, 3).

    A node has a third of each triangle all of whose corners are on surfaces that touch.  So of a pressure that is
    linear in these triangles the integral is the sum of the nodes' forces.
    """
    on = triangle[(pushed.touches[triangle] > 0.0).all(axis=1)]
    sides = x[on[:, 1:]] - x[on[:, :1]]
    third = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1) / 6.0
    area = np.zeros(len(x))
    np.add.at(area, on, third[:, None])
    return np.asarray(pushed.force / np.where(area > 0.0, area, np.inf))
