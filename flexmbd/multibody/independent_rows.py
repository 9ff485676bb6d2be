"""Which constraint rows hold anything that the others do not, found where the mechanism is regular."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from flexmbd.errors import AssemblyError
from flexmbd.multibody.kernels.joints import retract
from flexmbd.multibody.kernels.layout import Work
from flexmbd.multibody.loop_closing import CLOSED, close_loops
from flexmbd.multibody.plan import CompiledScene
from flexmbd.multibody.scene_matrices import constraint_jacobian, constraint_values, coordinate_sizes, row_sizes

FloatArray = NDArray[np.float64]

_BLUR = 10.0  # slopes are off by this many times what is open, at most
_ROUND_OFF = 1e-12  # and by this share at least
_CLEAR = 1e3  # singular values that are not round-off stand this far above it
_BESIDE = 0.05  # of each coordinate's size: where regular positions are looked for, first
_PLACES = 2  # how many are enough
_TRIALS = 8


@dataclass(frozen=True, eq=False)
class Place:
    """The rows' slopes at a configuration with closed loops, all in shares of the machine's size.

    Attributes:
        slopes: (m, free) of the rows, per full size of each free coordinate.
        left: (m, m) left singular vectors.
        sigma: (m,) singular values over the largest, falling; 0 beyond the free coordinates.
        blur: what of them is not known, for the loops are closed to some tolerance.
    """

    slopes: FloatArray
    left: FloatArray
    sigma: FloatArray
    blur: float

    @property
    def rank(self) -> int:
        """How many rows are independent here."""
        return int(np.sum(self.sigma > self.blur))

    @property
    def is_clear(self) -> bool:
        """Whether what counts for the rank stands well above what does not."""
        return self.rank == 0 or self.sigma[self.rank - 1] > _CLEAR * self.blur

    def independent(self) -> list[int]:
        """``rank`` rows that carry all others, the best-conditioned that pivoting finds."""
        order = scipy.linalg.qr(self.slopes.T, mode="economic", pivoting=True)[2]
        return sorted(int(k) for k in order[: self.rank])


def look(scene: CompiledScene, work: Work, x: FloatArray) -> Place:
    """The slopes of the scene's rows at x (nx,), with closed loops."""
    free, m = scene.plan.free, len(scene.plan.rows)
    rows = row_sizes(scene)
    slopes = constraint_jacobian(scene, work, x)[:, free] * coordinate_sizes(scene)[free] / rows[:, None]
    left, found, _ = scipy.linalg.svd(slopes)
    largest = max(float(found.max(initial=0.0)), 1e-300)
    sigma = np.zeros(m)
    sigma[: len(found)] = found / largest
    phi = constraint_values(scene, work, x, np.zeros(scene.nv))[0] / rows
    blur = max(_BLUR * float(np.abs(phi).max(initial=0.0)), _ROUND_OFF)
    # The terms of slopes are of size 1 or less: where all slopes are rounding of these, none is known.
    return Place(slopes, left, sigma, blur / min(largest, 1.0))


def independent_rows(scene: CompiledScene, work: Work, x: FloatArray) -> list[int]:
    """Rows that hold anything new: as many as are independent at regular positions, and those that are so best.

    Redundancy is a property of the mechanism, not of one position: at singular ones fewer rows are independent, and
    where loops are closed roughly more seem to be.  So the rank counts where it is clear, and the largest one does;
    looked at are the start and, unless all rows are independent there, positions beside it on the loops.

    Args:
        scene: with all its rows.
        work: scratch; ``work.time`` holds the functions of time.
        x: (nx,) a configuration with closed loops.
    """
    m = len(scene.plan.rows)
    if m == 0 or len(scene.plan.free) == 0:
        return list(range(m))
    here = look(scene, work, x)
    places = [here]
    if not (here.is_clear and here.rank == m):
        places += _beside(scene, work, x)
    clear = [place for place in places if place.is_clear]
    if not clear:
        return min(places, key=lambda place: place.blur).independent()
    return max(clear, key=lambda place: (place.rank, place.sigma[max(place.rank, 1) - 1])).independent()


def _beside(scene: CompiledScene, work: Work, x: FloatArray) -> list[Place]:
    """Regular positions on the loops near x."""
    generator = np.random.default_rng(0)
    size = np.zeros(scene.nv)
    size[scene.plan.free] = coordinate_sizes(scene)[scene.plan.free]
    for slots in scene.modal_slots.values():
        size[slots.v] = 0.0
    found: list[Place] = []
    for trial in range(_TRIALS):
        near = np.empty_like(x)
        retract(scene.plan, x, (1 + trial) * _BESIDE * size * generator.uniform(-1.0, 1.0, scene.nv), near)
        try:
            closing = close_loops(scene, work, near, np.zeros(scene.nv, bool))
        except AssemblyError:
            continue
        place = look(scene, work, closing.x)
        if closing.left_open <= CLOSED and place.is_clear:
            found.append(place)
        if len(found) == _PLACES:
            break
    return found
