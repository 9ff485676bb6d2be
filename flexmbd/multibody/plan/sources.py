"""Where the numbers of a plan come from, place by place: what another set of numbers has to be written to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import hypot, sqrt
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.bodies.body import Body, Frame
from flexmbd.multibody.force.beam_element import BeamElement
from flexmbd.multibody.force.protocol import Force
from flexmbd.multibody.plan.forces import ForceSpan
from flexmbd.multibody.plan.numbering import Marker
from flexmbd.multibody.plan.rows import ScaledRow
from flexmbd.multibody.scene_index import IdentityMap
from flexmbd.multibody.topology import Topology

FloatArray = NDArray[np.float64]
Reaching: TypeAlias = Body | Frame | Force  # what the machine's extent is asked of


@dataclass(frozen=True, eq=False)
class Sources:
    """Where the numbers of a plan come from.

    Attributes:
        markers: of each row of ``Plan.frames``; None of those that no marker gives.
        reach: (m) of all bodies, of the frames of all joints and of beams, what the machine's extent is the largest of.
        scaled: numbers that the extent scales.
        forces: rows and parameters of each force element.
        axes: about which each link turns (see ``turning``).
        is_awaited: whether functions of the state keep the compiled scene.
    """

    markers: tuple[Marker | None, ...]
    reach: tuple[tuple[Reaching, float], ...]
    scaled: tuple[ScaledRow, ...]
    forces: IdentityMap[Force, ForceSpan]
    axes: tuple[FloatArray | None, ...]
    is_awaited: bool

    @cached_property
    def rows_of(self) -> IdentityMap[Frame, list[int]]:
        """Rows of ``Plan.frames`` of each marker."""
        found: IdentityMap[Frame, list[int]] = IdentityMap()
        for row, marker in enumerate(self.markers):
            if marker is not None:
                found.setdefault(marker.frame, []).append(row)
        return found

    def extent_with(self, moved: IdentityMap[object, float]) -> float:
        """The machine's size (m) where some bodies and frames have another reach (m)."""
        still = (far for thing, far in self.reach if thing not in moved)
        known = [far for thing, far in moved.items() if thing in self._reaching]
        return max([*still, *known], default=0.0) or 1.0

    def extents_with(self, moved: IdentityMap[object, list[float]], count: int) -> list[float]:
        """As ``extent_with`` of ``count`` variants."""
        still = max((far for thing, far in self.reach if thing not in moved), default=0.0)
        known = [far for thing, far in moved.items() if thing in self._reaching]
        return [max(still, *far) or 1.0 for far in zip(*known, strict=True)] if known else [still or 1.0] * count

    @cached_property
    def _reaching(self) -> IdentityMap[Reaching, None]:
        """What the extent is asked of: frames of forces alone are not."""
        return IdentityMap((thing, None) for thing, _ in self.reach)

    def frames_of(self, body: Body) -> list[Frame]:
        """The interface frames of a body among the markers."""
        return [frame for frame in self.rows_of if frame.body is body and frame.interface is not None]


def frame_reach(frame: Frame) -> float:
    """How far (m) a frame lies from its body's origin."""
    return place_reach(frame.p_BF_B)


def place_reach(p: FloatArray) -> float:
    """How far (m) a place (3,) lies from a body's origin."""
    return hypot(*map(float, p))


def row_reach(rigid: Sequence[float]) -> float:
    """How far (m) a body's mass lies from its origin: its centre's distance, or its radius of gyration.

    ``rigid`` is the body's row of ``Plan.rigid``.
    """
    mass, x, y, z, xx, _, _, yy, _, zz = rigid
    return max(hypot(x, y, z) / mass, sqrt((xx + yy + zz) / mass))


def reaches(
    topology: Topology, masses: Sequence[Sequence[float]], forces: Sequence[Force]
) -> tuple[tuple[Reaching, float], ...]:
    """The reach (m) of the frames of all joints, of all bodies by their rows of ``Plan.rigid``, and of beams.

    The sections of an exact beam are small bodies of their own: how long it is its elements know.
    """
    frames = [f for b in topology.branches for f in (b.inner, b.outer)]
    frames += [f for c in topology.closures for f in (c.parent, c.child)]
    bodies = [(b.outer.body, row_reach(row)) for b, row in zip(topology.branches, masses, strict=True)]
    beams = [(force, force.reach) for force in forces if isinstance(force, BeamElement)]
    return (*((frame, frame_reach(frame)) for frame in frames), *bodies, *beams)


def extent_of(reach: tuple[tuple[Reaching, float], ...]) -> float:
    """The machine's size (m): the farthest reach of any frame or centre of mass in its body, or of a beam."""
    return max((far for _, far in reach), default=0.0) or 1.0
