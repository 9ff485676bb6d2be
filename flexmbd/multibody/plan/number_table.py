"""Numbers of many variants of a scene at once: rows of the plan's arrays, computed for all, written one by one.

What is written for a variant is to the bit what ``vary`` writes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.bodies.body import Body, Frame, RigidBody, moments_about_frame
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.plan.numbering import rigid_rows
from flexmbd.multibody.plan.variation import group_sizes
from flexmbd.multibody.scene_index import IdentityMap

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class BodyNumbers:
    """Mass (n,), kg, and centre of mass (n, 3), m, of a rigid body in n variants; None where it stays."""

    mass: FloatArray | None = None
    com: FloatArray | None = None


class NumberTable:
    """Masses, centres of mass and places of markers in n variants of a scene without constraint rows.

    Attributes:
        possible: (n,) whether bodies can have these numbers; of others ``vary`` tells the fault.
    """

    def __init__(
        self,
        scene: CompiledScene,
        count: int,
        bodies: Mapping[RigidBody, BodyNumbers],
        places: Mapping[Frame, FloatArray],
    ) -> None:
        self.possible = np.ones(count, bool)
        self._places = places
        self._rigid: list[tuple[int, FloatArray]] = []
        self._frames = [(row, p) for frame, p in places.items() for row in scene.sources.rows_of[frame]]
        numbered: IdentityMap[Body, FloatArray] = IdentityMap()
        for body, numbers in bodies.items():
            row, rows = scene.index.bodies[body], self._rows(scene.index.now(body), numbers, count)
            self._rigid.append((row, rows))
            numbered[body] = rows
        for p in places.values():
            self.possible &= np.isfinite(p).all(axis=1)
        extents = scene.sources.extents_with(numbered, IdentityMap(places.items()), count)
        by_extent = {extent: group_sizes(scene, scene.index, extent) for extent in set(extents)}
        self._sizes = [by_extent[extent] for extent in extents]

    def _rows(self, body: RigidBody, numbers: BodyNumbers, count: int) -> FloatArray:
        """(n, N_RIGID) the body's row of ``Plan.rigid``."""
        com, tensor = body.inertias()
        mass = np.full(count, body.mass) if numbers.mass is None else numbers.mass
        com = np.tile(com, (count, 1)) if numbers.com is None else numbers.com
        self.possible &= (mass > 0.0) & np.isfinite(mass) & np.isfinite(com).all(axis=1)
        return rigid_rows(mass, *moments_about_frame(mass, com, tensor))

    def write(self, k: int, arrays: Mapping[str, NDArray[Any]], full: FloatArray, floor: FloatArray) -> None:
        """Write variant k into arrays of a plan by their names, and into the sizes of the error norm's groups."""
        for row, rows in self._rigid:
            arrays["rigid"][row] = rows[k]
        for row, p in self._frames:
            arrays["frames"][row, at.FRAME_P : at.FRAME_R] = p[k]
        full[:], floor[:] = self._sizes[k]

    def place(self, frame: Frame, k: int, p: FloatArray) -> FloatArray:
        """(3,) m, where a marker lies in its body in variant k; ``p`` where it is not in the table."""
        places = self._places.get(frame)
        return p if places is None else places[k]
