"""A spur gear with involute teeth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from mpi4py import MPI

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.grid.mesh_input import MeshInput, from_root
from flexmbd.continuum.grid.tagged_mesh import TaggedMesh, spread
from flexmbd.errors import MeshError
from flexmbd.meshes.dimension import (
    check_arguments,
    checked_part,
    require_counts,
    require_degree,
    require_positive,
    require_room,
)
from flexmbd.meshes.extrusion import ExtrudedLayer, Profile, Wall, extrude, grid_quads

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# Of the module: tip and root beyond the pitch circle, where the fillet begins above the root (ISO 53, profile A).
_ADDENDUM, _DEDENDUM, _FILLET = 1.0, 1.25, 0.4
# Cells along half a gap, of which the first is on the fillet; and along a flank that is not fine.
_GAP, _COARSE = 2, 3
# By how much each cell below the root is longer than that above it.
_GROWTH = 1.5


@checked_part
def spur_gear(
    teeth: int,
    module: float,
    width: float,
    *,
    bore: float,
    divisions: tuple[int, int, int, int],
    fine: Sequence[int] | None = None,
    pressure_angle: float = np.pi / 9.0,
    backlash: float = 0.0,
    degree: int = 2,
    comm: MPI.Comm = MPI.COMM_WORLD,
) -> TaggedMesh:
    """Mesh a spur gear about the z axis, from z = 0 to z = width, tooth 0 on the x axis. Collective.

    Flanks are involutes from the tips, a module beyond the pitch circle, to 0.4 modules above the root circle, which
    lies 1.25 modules within the pitch circle; below the base circle they are radial. Fillets lead to the root. The
    cells are hexahedra.

    Facet groups: "tooth_0", "tooth_1", ... counted by the angle about z, both flanks of each without the tip and the
    fillets; "hub", the bore. Cell group "gear".

    Args:
        teeth: their number, at least 8.
        module: m, pitch diameter over the number of teeth.
        width: along z, m.
        bore: radius of the hub, m.
        divisions: number of cells across a tooth, along a flank from its tip to the fillet, from the root to the bore,
            and along z.
        fine: the teeth that have as many cells along their flanks; others have three. None: all of them.
        pressure_angle: rad, of the flank on the pitch circle.
        backlash: m, by which each tooth is thinner on the pitch circle than half a pitch.
        degree: degree of the geometry: 1 makes prisms of the flanks, 2 curves the cells.
        comm: the communicator of the mesh.

    Raises:
        MeshError: on all ranks; an argument is out of range, or not the same on all ranks.
    """
    arguments = dict(locals())

    def check() -> None:
        require_positive(module=module, width=width, bore=bore)
        require_counts("divisions", divisions, number=4)
        require_degree(degree)
        if teeth < 8:
            raise MeshError(f"a spur gear has 8 teeth at least, got {teeth}")
        across, flank, below, along = divisions
        require_room(f"{teeth} teeth", teeth * ((across + 2 * _GAP) * below + across * flank) * along)
        if not 0.0 < pressure_angle < 0.25 * np.pi:
            raise MeshError(f"pressure_angle must be between 0 and pi/4 rad, got {pressure_angle:g}")
        if not 0.0 <= backlash < 0.5 * np.pi * module:
            raise MeshError(f"backlash must be from 0 to half a pitch, {0.5 * np.pi * module:g} m, got {backlash:g}")
        shape = Outline(teeth, module, pressure_angle, backlash)
        if not bore < shape.root - module:
            raise MeshError(f"bore must be a module below the root circle, {shape.root - module:g} m, got {bore:g}")
        unknown = sorted(k for k in set(fine or ()) if not 0 <= k < teeth)
        if unknown:
            raise MeshError(f"fine has the teeth {unknown}, and they are counted from 0 to {teeth - 1}")
        if not shape.half_angle(np.array(shape.tip)) > 0.0:
            raise MeshError("the flanks of a tooth meet below its tip; give a smaller pressure_angle or backlash")
        if not shape.fillet(np.array(1.0))[1] < np.pi / teeth:
            raise MeshError("the fillets of neighbouring teeth meet; give a larger pressure_angle or backlash")

    check_arguments(comm, arguments, check)

    def build() -> MeshInput:
        shape = Outline(teeth, module, pressure_angle, backlash)
        chosen = frozenset(range(teeth) if fine is None else fine)
        profile = _profile(shape, bore, divisions=divisions[:3], fine=chosen, degree=degree)
        walls = [Wall("hub" if tag == 0 else f"tooth_{tag - 1}", [tag], [0]) for tag in profile.curves]
        return extrude(profile, [ExtrudedLayer(width, divisions[3], {1})], z=0.0, walls=walls, name="gear")

    return spread(comm, from_root(comm, build))


@dataclass(frozen=True)
class Outline:
    """Half a tooth in polar coordinates (m, rad) about the gear's centre, the angle counted from the tooth's middle."""

    teeth: int
    module: float
    pressure_angle: float
    backlash: float

    @property
    def pitch(self) -> float:
        """m, radius."""
        return 0.5 * self.teeth * self.module

    @property
    def base(self) -> float:
        """m, radius of the circle that the flanks' normals touch."""
        return self.pitch * float(np.cos(self.pressure_angle))

    @property
    def tip(self) -> float:
        """m, radius."""
        return self.pitch + _ADDENDUM * self.module

    @property
    def root(self) -> float:
        """m, radius."""
        return self.pitch - _DEDENDUM * self.module

    @property
    def foot(self) -> float:
        """m, radius where the fillet begins."""
        return self.root + _FILLET * self.module

    @property
    def _ends(self) -> tuple[float, float]:
        return self.foot, self.tip

    def half_angle(self, radius: FloatArray) -> FloatArray:
        """rad, between the middle of a tooth and its flank."""
        at_pitch = (0.5 * np.pi * self.module - self.backlash) / (2.0 * self.pitch)
        return at_pitch + _involute(self.pressure_angle) - _involute(self._slant(radius))

    def along_flank(self, share: FloatArray) -> FloatArray:
        """m, radii of points from the fillet (0) to the tip (1), by shares of the flank's length."""
        low, high = (r - self.base if r < self.base else 0.5 * (r / self.base * r - self.base) for r in self._ends)
        length = low + (high - low) * share
        radius = np.where(length < 0.0, self.base + length, self.base * np.sqrt(1.0 + 2.0 * abs(length) / self.base))
        radius[[0, -1]] = self._ends
        return radius

    def fillet(self, share: FloatArray) -> tuple[FloatArray, FloatArray]:
        """m and rad, of points from the flank (0) to the root circle (1): a parabola that is tangent to both."""
        begin = self.half_angle(np.array(self.foot))
        end = begin + (self.foot - self.root) / self.root
        slant = float(self._slant(np.array(self.foot)))
        start, stop = self.foot * _unit(begin), self.root * _unit(end)
        # flanks grow wider inwards by tan(slant)
        down = -np.cos(slant) * _unit(begin) + np.sin(slant) * _unit(begin + 0.5 * np.pi)
        corner = start + down * np.linalg.solve(np.column_stack([down, _unit(end + 0.5 * np.pi)]), stop - start)[0]
        t = np.asarray(share)[..., None]
        x = (1.0 - t) ** 2 * start + 2.0 * t * (1.0 - t) * corner + t**2 * stop
        return np.linalg.norm(x, axis=-1), np.arctan2(x[..., 1], x[..., 0])

    def _slant(self, radius: FloatArray) -> FloatArray:
        """rad, between the flank and the radius; 0 below the base circle."""
        slant: FloatArray = np.arccos(np.minimum(self.base / radius, 1.0))
        return slant


def _involute(angle: float | FloatArray) -> FloatArray:
    found: FloatArray = np.tan(angle) - angle
    return found


def _shares(first: float, last: float, intervals: int) -> FloatArray:
    return np.linspace(first, last, intervals + 1, dtype=np.float64)


def _unit(angle: FloatArray) -> FloatArray:
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def _profile(
    shape: Outline, bore: float, *, divisions: tuple[int, ...], fine: frozenset[int], degree: int
) -> Profile:
    """The section; curve 0 is the bore, curve k + 1 both flanks of tooth k.

    A rim of radial columns from the bore to the root and, below the teeth, to the middles of the fillets; on it the
    teeth, each with rows of its own.
    """
    across, along, inwards = divisions
    gap = degree * _GAP
    columns = degree * across + 2 * gap
    # half the top of the rim: the root from the gap's middle, then the lower half of the fillet
    end = shape.fillet(np.array(1.0))[1]
    land = np.linspace(np.pi / shape.teeth, end, gap - degree + 1)[:-1]
    low, low_angle = shape.fillet(_shares(1.0, 0.5, degree))
    side, side_angle = np.concatenate([np.full(len(land), shape.root), low]), np.concatenate([land, low_angle])
    middle = np.linspace(-1.0, 1.0, degree * across + 1) * low_angle[-1]
    top = np.concatenate([side, np.full(len(middle) - 2, low[-1]), side[:0:-1]])
    angle = np.concatenate([-side_angle, middle[1:-1], side_angle[:0:-1]])
    depth = np.concatenate([[0.0], np.cumsum(_GROWTH ** np.arange(inwards))])
    shares = np.interp(np.arange(degree * inwards + 1) / degree, np.arange(inwards + 1), depth / depth[-1])[::-1]
    radii = top + shares[:, None] * (bore - top)
    turns = 2.0 * np.pi / shape.teeth * np.arange(shape.teeth)
    ring = len(shares), shape.teeth * columns
    numbers = np.arange(ring[0] * ring[1]).reshape(ring)
    points = [(np.tile(radii, shape.teeth)[..., None] * _unit((turns[:, None] + angle).ravel())).reshape(-1, 2)]
    quads = [grid_quads(np.hstack([numbers, numbers[:, :1]]), degree)]
    bored = np.arange(0, ring[1] + 1, degree) % ring[1]
    curves = {0: np.column_stack([bored[:-1], bored[1:]])}
    first = numbers.size
    for tooth, turn in enumerate(turns):
        rows = along if tooth in fine else min(along, _COARSE)
        heights = shape.along_flank(_shares(0.0, 1.0, degree * rows))
        r, half = shape.fillet(_shares(0.5, 0.0, degree)[1:])
        r, half = np.concatenate([r, heights[1:]]), np.concatenate([half, shape.half_angle(heights[1:])])
        spread_angles = half[:, None] * np.linspace(-1.0, 1.0, len(middle))
        points.append((r[:, None, None] * _unit(turn + spread_angles)).reshape(-1, 2))
        own = first + np.arange(len(r) * len(middle)).reshape(len(r), -1)
        first += own.size
        standing = numbers[-1, tooth * columns + gap : tooth * columns + gap + len(middle)]
        quads.append(grid_quads(np.vstack([standing, own]), degree))
        flank = own[degree - 1 :: degree]
        curves[tooth + 1] = np.vstack([np.column_stack([flank[:-1, k], flank[1:, k]]) for k in (0, -1)])
    cells = np.vstack(quads)
    return Profile(degree, np.vstack(points), cells, np.ones(len(cells), dtype=np.int64), curves)
