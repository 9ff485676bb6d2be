"""Where the numbers of a plan come from, place by place: what another set of numbers has to be written to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import dist, hypot, isfinite, sqrt

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.bodies.body import Body, Frame
from flexmbd.multibody.force.beam_element import BeamElement
from flexmbd.multibody.force.protocol import Force
from flexmbd.multibody.plan.force_places import ForceSpan
from flexmbd.multibody.plan.numbering import Marker
from flexmbd.multibody.plan.rows import ScaledRow
from flexmbd.multibody.scene_index import IdentityMap, RunMap
from flexmbd.multibody.topology import Topology
from flexmbd.round_off import ROUND_OFF

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Reach:
    """What tells how large a body is: its row of ``Plan.rigid`` (N_RIGID,), and its frames that joints hold.

    Attributes:
        size: m, as it was when the scene was compiled.
    """

    body: Body
    rigid: tuple[float, ...]
    frames: tuple[Frame, ...]
    size: float


@dataclass(frozen=True, eq=False)
class Sources:
    """Where the numbers of a plan come from.

    Attributes:
        markers: of each row of ``Plan.frames``; None of those that no marker gives.
        reach: of bodies that can move, and beams: (m), the largest beam, or how far point masses lie apart: what the
            machine's extent is the largest of.
        scaled: numbers that the extent scales.
        forces: rows and parameters of each force element.
        is_awaited: whether functions of the state keep the compiled scene.
    """

    markers: tuple[Marker | None, ...]
    reach: tuple[Reach, ...]
    beams: float
    scaled: tuple[ScaledRow, ...]
    forces: RunMap[Force, ForceSpan]
    is_awaited: bool

    @cached_property
    def rows_of(self) -> IdentityMap[Frame, list[int]]:
        """Rows of ``Plan.frames`` of each marker."""
        found: IdentityMap[Frame, list[int]] = IdentityMap()
        for row, marker in enumerate(self.markers):
            if marker is not None:
                found.setdefault(marker.frame, []).append(row)
        return found

    def extents_with(
        self, rigid: IdentityMap[Body, FloatArray], places: IdentityMap[Frame, FloatArray], count: int
    ) -> list[float]:
        """The machine's size (m) in ``count`` variants, of which some have other numbers.

        Args:
            rigid: (count, N_RIGID) rows of ``Plan.rigid`` of bodies.
            places: (count, 3) m, of frames.
            count: of variants.
        """
        largest = np.full(count, self.beams)
        for reach in self.reach:
            if not (reach.body in rigid or any(frame in places for frame in reach.frames)):
                np.maximum(largest, reach.size, out=largest)
                continue
            for k in range(count):
                row = rigid[reach.body][k] if reach.body in rigid else reach.rigid
                at = [places[frame][k] if frame in places else frame.p_BF_B for frame in reach.frames]
                largest[k] = max(largest[k], body_size(row, at))
        return [float(one) or 1.0 for one in largest]

    def frames_of(self, body: Body) -> list[Frame]:
        """The interface frames of a body among the markers."""
        return [frame for frame in self.rows_of if frame.body is body and frame.interface is not None]


def body_size(rigid: Sequence[float] | FloatArray, places: Sequence[FloatArray]) -> float:
    """How large (m) a body is: how far its mass, by its radius of gyration, and its frames lie from each other.

    Wherever the body's own origin may be.  ``rigid`` is its row of ``Plan.rigid``, ``places`` (3,) m of its frames.
    """
    mass, x, y, z, xx, _, _, yy, _, zz = map(float, rigid)
    if not (mass > 0.0 and isfinite(mass)):
        return 0.0
    centre = (x / mass, y / mass, z / mass)
    beside = (xx + yy + zz) / mass - hypot(*centre) ** 2
    if not beside > ROUND_OFF * hypot(*centre) ** 2:  # a mass at a point far from the origin
        beside = 0.0
    points = [centre, *(tuple(map(float, p)) for p in places)]
    farthest = max(points, key=lambda p: dist(p, centre))
    return max(hypot(sqrt(beside), dist(farthest, centre)), max(dist(p, farthest) for p in points))


def reaches(topology: Topology, masses: Sequence[Sequence[float]]) -> tuple[Reach, ...]:
    """Of all bodies that can move, by their rows of ``Plan.rigid``, what the machine's extent is asked of.

    Frames of joints alone; of the ground, and of what is fixed to it, they say nothing of what moves.
    """
    frames: dict[int, list[Frame]] = {}
    ends = [frame for branch in topology.branches for frame in (branch.inner, branch.outer)]
    ends += [frame for joint in topology.closures for frame in (joint.parent, joint.child)]
    for frame in ends:
        frames.setdefault(id(frame.body), []).append(frame)
    moving: set[int] = set()
    sizes: dict[object, float] = {}  # those of bodies alike are found once
    joints = topology.joints
    found: list[Reach] = []
    for branch, mass in zip(topology.branches, masses, strict=True):
        body, joint = branch.outer.body, branch.connection
        if id(branch.inner.body) in moving or joint is None or joints.of(joint.joint).velocity_names:
            moving.add(id(body))
            rigid, held = tuple(mass), tuple(frames[id(body)])
            places = tuple([frame.p_BF_B.tobytes() for frame in held])
            size = sizes.get((rigid, places))
            if size is None:
                size = sizes[rigid, places] = body_size(rigid, [frame.p_BF_B for frame in held])
            found.append(Reach(body, rigid, held, size))
    return tuple(found)


def beam_reach(forces: Sequence[Force]) -> float:
    """How far (m) the longest beam reaches.

    The sections of an exact beam are small bodies of their own: how long it is its elements know.
    """
    return max((force.reach for force in forces if isinstance(force, BeamElement)), default=0.0)
