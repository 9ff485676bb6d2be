"""Independent constraint rows, found where the mechanism is regular, block by block.

Of a block's rows C = U S V^T, per full size of coordinates and rows, a choice of as many as the rank holds as firmly
as the smallest singular value of its part of U says: 1 where the others add nothing, 0 where it alone has lost its
rank.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from flexmbd.errors import SceneError
from flexmbd.multibody.kernels.base.arrays import Work
from flexmbd.multibody.kernels.base.row_blocks import RowBlock
from flexmbd.multibody.kernels.physics.joints import retract
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.plan.scene_matrices import constraint_slopes, constraint_values, coordinate_sizes, row_sizes
from flexmbd.multibody.start.loop_closing import CLOSED, close_as_far
from flexmbd.round_off import EQUAL, ROUND_OFF

FloatArray = NDArray[np.float64]

LEADS_ON = 1e-6  #: of rates' squares: what may stay open of second derivatives that no acceleration changes
_BLUR = 10.0  # the slopes' error over the gaps, at most
_CLEAR = 1e3  # singular values that are not round-off stand this far above it
_BESIDE = 0.05  # of each coordinate's size: where regular positions are looked for, first
_PLACES = 2  # how many are enough
_TRIALS = 8


@dataclass(frozen=True, eq=False)
class RowDecomposition:
    """Singular value decomposition of the rows' slopes at a configuration with closed loops, over the machine's size.

    Attributes:
        slopes: (m, free) of the rows, per full size of each free coordinate.
        driven: (m, driven) as ``slopes``, of the coordinates that motions drive.
        holds: (m,) which rows hold positions; the others, of rolling, hold velocities alone.
        left: (m, m) left singular vectors.
        sigma: (m,) singular values over the largest, falling; 0 beyond the free coordinates.
        blur: error of ``sigma``, for the loops are closed to some tolerance.
    """

    slopes: FloatArray
    driven: FloatArray
    holds: NDArray[np.bool_]
    left: FloatArray
    sigma: FloatArray
    blur: float

    @cached_property
    def rank(self) -> int:
        """How many rows are independent here."""
        return int(np.count_nonzero(self.sigma > self.blur))

    @cached_property
    def is_clear(self) -> bool:
        """Whether the singular values of the rank are well above the others, and above what their place leaves unknown.

        A gap tells a configuration to itself over the smallest singular value, and slopes change as it does: where
        loops close in a singular position alone, those of places that nearly close them are as large as this.
        """
        if self.rank == 0:
            return True
        smallest = self.sigma[self.rank - 1]
        return bool(smallest > _CLEAR * self.blur and smallest > _BLUR * self.blur / smallest)

    def independent(self) -> list[int]:
        """``rank`` rows that carry all others, the best-conditioned that pivoting finds."""
        if self.rank == 0:
            return []
        return self._pivoted(self.slopes, self.rank, self.blur * float(np.linalg.norm(self.slopes, 2)))

    @property
    def known_to(self) -> float:
        """Error of the spaces that the first ``rank`` and the other left singular vectors span."""
        return self.blur / float(self.sigma[self.rank - 1]) if self.rank else 0.0

    def unmoved(self) -> FloatArray:
        """(m, k) orthonormal combinations of rows that neither free nor driven coordinates change.

        What drives change and nothing free does is for the motions to keep: their accelerations need not be known as
        well as their values.
        """
        across = self.left[:, self.rank :]
        left, sigma, _ = np.linalg.svd(across.T @ self.driven)
        moved = int(np.sum(sigma > CLOSED))  # the terms of slopes are of size 1
        return np.asarray(across @ left[:, moved:])

    def best_conditioned(self, rank: int) -> list[int]:
        """``rank`` well-conditioned rows, as pivoting finds them."""
        known = self.blur / max(float(self.sigma[rank - 1]), self.blur) if rank else 1.0
        return self._pivoted(self.left[:, :rank], rank, known)

    def _pivoted(self, rows: FloatArray, rank: int, blur: float) -> list[int]:
        """``rank`` of the rows (m, n), known to ``blur``, by pivoting: those of positions first.

        A row on velocities says nothing of positions: in place of one on positions it would hold the same velocities,
        and let a configuration pass, or drift off, that the loops forbid.
        """
        held = np.flatnonzero(self.holds)
        positions = int(np.sum(scipy.linalg.svdvals(rows[held]) > blur)) if len(held) else 0
        first, base = _first_pivots(rows[held], min(positions, rank))
        rolling = np.flatnonzero(~self.holds)
        rest = rows[rolling] - (rows[rolling] @ base) @ base.T
        more, _ = _first_pivots(rest, rank - len(first))
        return sorted(int(k) for k in (*held[first], *rolling[more]))

    def conditioning(self, rows: Sequence[int]) -> float:
        """How firmly these rows hold what all rows hold together, from 0 to 1."""
        part = self.left[list(rows), : len(rows)]
        return float(np.linalg.svd(part, compute_uv=False).min(initial=1.0))

    def carries(self, other: RowDecomposition) -> bool:
        """Whether the rows are as independent here as at another configuration, within the error of both."""
        if self.rank != other.rank or self.rank == 0:
            return self.rank == other.rank
        kept, there = self.left[:, : self.rank], other.left[:, : self.rank]
        return float(np.abs(kept @ kept.T - there @ there.T).max()) <= _CLEAR * (self.known_to + other.known_to)


def _first_pivots(rows: FloatArray, count: int) -> tuple[NDArray[np.int64], FloatArray]:
    """The first ``count`` rows (m, n) as pivoting takes them, and an orthonormal basis (n, count) of their span."""
    if count == 0:
        return np.zeros(0, np.int64), np.zeros((rows.shape[1], 0))
    base, _, order = scipy.linalg.qr(rows.T, mode="economic", pivoting=True)
    return order[:count], base[:, :count]


class BlockChoice(NamedTuple):
    """Independent rows of a block, by their places in it.

    Attributes:
        rows: those that are kept.
        for_good: whether they are independent at every position at which all rows together are.
        place: the position that they were found at.
    """

    rows: list[int]
    for_good: bool
    place: RowDecomposition


class RowChoice(NamedTuple):
    """Independent rows.

    Attributes:
        rows: those that are kept.
        for_good: whether they are independent at every position at which all rows together are.
        blocks: of each block of rows its own.
    """

    rows: list[int]
    for_good: bool
    blocks: tuple[BlockChoice, ...] = ()


def better_rows(
    scene: CompiledScene, work: Work, x: FloatArray, kept: Sequence[int], *, worth: float
) -> list[int] | None:
    """As many rows as are ``kept`` that hold more than ``worth`` times as firmly at x (nx,); None if these do not.

    Args:
        scene: with all its rows.
        work: scratch; ``work.time`` holds the functions of time.
        x: a configuration with closed loops.
        kept: (m,) rows.
        worth: the least gain that counts.
    """
    found: list[int] = []
    for block, place in zip(scene.row_blocks, decompose_rows(scene, work, x), strict=True):
        own = [k for k, row in enumerate(block.rows) if row in kept]
        others = place.best_conditioned(len(own))
        better = place.conditioning(others) > worth * place.conditioning(own)
        found += [int(block.rows[k]) for k in (others if better else own)]
    return sorted(found) if set(found) != set(kept) else None


def decompose_rows(scene: CompiledScene, work: Work, x: FloatArray) -> list[RowDecomposition]:
    """The slopes of each block of the scene's rows at x (nx,), with closed loops."""
    if len(scene.plan.rows) == 0:
        return []
    rows, sizes = row_sizes(scene), coordinate_sizes(scene)
    phi = constraint_values(scene, work, x, np.zeros(scene.nv))[0] / rows
    holds = scene.row_structure.table.holds_position
    found = []
    for block, part in constraint_slopes(scene, work, x).over(rows):
        slopes, driven = np.hsplit(part * sizes[np.concatenate([block.free, block.driven])], [len(block.free)])
        blur = max(_BLUR * float(np.abs(phi[block.rows]).max()), EQUAL)
        found.append(_decomposed(slopes, driven, holds[block.rows], blur))
    return found


def _decomposed(slopes: FloatArray, driven: FloatArray, holds: NDArray[np.bool_], blur: float) -> RowDecomposition:
    """The decomposition of slopes (m, free) known to ``blur``."""
    m, free = slopes.shape
    left, found = _left_vectors(slopes) if free else (np.eye(m), np.zeros(0))
    largest = max(float(found.max(initial=0.0)), 1e-300)
    sigma = np.zeros(m)
    sigma[: len(found)] = found / largest
    # The terms of slopes are of size 1 or less: where all slopes are rounding of these, none is known.
    return RowDecomposition(slopes, driven, holds, left, sigma, blur / min(largest, 1.0))


def _left_vectors(slopes: FloatArray) -> tuple[FloatArray, FloatArray]:
    """All left singular vectors of slopes (m, n), and the singular values; rows that are round-off have none."""
    norms = np.linalg.norm(slopes, axis=1)
    told = np.flatnonzero(norms > ROUND_OFF * norms.max(initial=0.0))
    m, count = len(slopes), len(told)
    if count == m:
        return _left_svd(slopes)
    inner, found = _left_svd(slopes[told])
    left = np.zeros((m, m))
    left[told, :count] = inner
    left[np.setdiff1d(np.arange(m), told), np.arange(count, m)] = 1.0
    return left, found


def _left_svd(slopes: FloatArray) -> tuple[FloatArray, FloatArray]:
    """All left singular vectors (m, m) and the singular values, without right ones that nobody asks for."""
    m, n = slopes.shape
    left, found, _ = scipy.linalg.svd(slopes, full_matrices=m > n)
    return left, found


def independent_rows(
    scene: CompiledScene,
    work: Work,
    x: FloatArray,
    here: Sequence[RowDecomposition],
    *,
    known: RowChoice | None = None,
) -> RowChoice:
    """Rows that hold anything new: as many as are independent at regular positions, and those that are so best.

    Redundancy is a property of the mechanism, not of one position: at singular ones fewer rows are independent, and
    where loops are closed roughly more seem to be.  So the rank counts where it is clear, and the largest one does;
    looked at are the start and, unless all rows are independent there, positions beside it on the loops.  Each block
    of rows is a mechanism by itself.

    Args:
        scene: with all its rows.
        work: scratch; ``work.time`` holds the functions of time.
        x: (nx,) a configuration with closed loops.
        here: ``decompose_rows`` at x.
        known: the choice of a machine of the same rows with other numbers; see ``_still_good``.

    Raises:
        SceneError: the start is a singular position that no motion leaves.
    """
    if len(scene.plan.rows) == 0 or len(scene.plan.free) == 0:
        return RowChoice([], True)  # what motions drive altogether needs no row, nor can one hold it
    blocks = scene.row_blocks
    before = known.blocks if known is not None and len(known.blocks) == len(blocks) else [None] * len(blocks)
    found: list[BlockChoice | None] = [
        old if old is not None and _still_good(scene, work, x, block, place, old) else None
        for block, place, old in zip(blocks, here, before, strict=True)
    ]
    open_ = [k for k, choice in enumerate(found) if choice is None]
    unclear = [k for k in open_ if not (here[k].is_clear and here[k].rank == len(blocks[k].rows))]
    beside = _regular_positions(scene, work, x, {k: here[k] for k in unclear})
    for k in unclear:
        if not beside[k]:
            _refuse_locked(scene, work, x, blocks[k], here[k])
    choices = [
        _choice([place, *beside.get(k, ())]) if choice is None else choice
        for k, (place, choice) in enumerate(zip(here, found, strict=True))
    ]
    rows = [int(block.rows[k]) for block, choice in zip(blocks, choices, strict=True) for k in choice.rows]
    return RowChoice(sorted(rows), all(choice.for_good for choice in choices), tuple(choices))


def _still_good(
    scene: CompiledScene, work: Work, x: FloatArray, block: RowBlock, place: RowDecomposition, old: BlockChoice
) -> bool:
    """Whether the choice of a block's rows in a machine with other numbers holds here, so that none need be looked for.

    Here as there the rows span the same space, in which the kept ones hold as firmly as they do there; and those left
    out stay redundant beside the position, by their second derivatives: else it is singular.
    """
    if not (old.for_good and place.is_clear and place.rank == len(old.rows) and old.place.carries(place)):
        return False
    return float(np.linalg.norm(_opening(scene, work, x, block, place))) <= LEADS_ON + place.known_to


def _choice(places: Sequence[RowDecomposition]) -> BlockChoice:
    """Independent rows of a block by what they are at several positions, the start first."""
    clear = [place for place in places if place.is_clear]
    if not clear:
        least = min(places, key=lambda place: place.blur)
        return BlockChoice(least.independent(), False, least)
    best = max(clear, key=lambda place: (place.rank, place.sigma[max(place.rank, 1) - 1]))
    # what is so at two places taken at random is no matter of the position
    regular = [place for place in clear if place.rank == best.rank]
    whole = best.rank == len(best.sigma)
    for_good = whole or (len(regular) > 1 and all(map(best.carries, regular)))
    return BlockChoice(best.independent(), for_good, best)


def _refuse_locked(
    scene: CompiledScene, work: Work, x: FloatArray, block: RowBlock, place: RowDecomposition
) -> None:
    """Raise SceneError where a velocity that a block's rows allow at x leads out of them whatever the acceleration.

    With no regular position near a singular x the rows that would be left out hold the machine there.
    """
    lost = _opening(scene, work, x, block, place)
    if np.linalg.norm(lost) > LEADS_ON + place.known_to:
        worst = scene.row_names[block.rows[int(np.argmax(np.abs(lost)))]]
        raise SceneError(
            f"the machine starts where its loops lock: {worst} holds nothing there, and beside it no position closes "
            "the loops, as where bars lie stretched out in a line; no finite reactions hold such a machine: change "
            "lengths, or leave out a joint"
        )


def _opening(
    scene: CompiledScene, work: Work, x: FloatArray, block: RowBlock, place: RowDecomposition
) -> FloatArray:
    """(k,) what of a block's second derivatives no acceleration changes, by a velocity that its rows allow at x.

    Rows that are dependent at x are redundant if they stay so: then their second derivatives depend alike on any
    velocity that they allow.  Else x is singular (an infinitesimal mechanism: Pellegrino & Calladine 1986).
    """
    if place.rank == len(block.rows):
        return np.zeros(len(block.rows))
    size = coordinate_sizes(scene)
    allowed = scipy.linalg.svd(place.slopes)[2][place.rank :]
    v, across = np.zeros(scene.nv), place.unmoved()
    v[block.free] = np.random.default_rng(0).standard_normal(len(allowed)) @ allowed
    v *= size / max(float(np.abs(v).max(initial=0.0)), 1e-300)
    still, moving = (constraint_values(scene, work, x, rates)[2] for rates in (np.zeros(scene.nv), v))
    return np.asarray(across @ (across.T @ ((moving - still) / row_sizes(scene))[block.rows]))


def _regular_positions(
    scene: CompiledScene, work: Work, x: FloatArray, wanted: Mapping[int, RowDecomposition]
) -> dict[int, list[RowDecomposition]]:
    """Of blocks ``wanted``, with what they are at x, the decompositions at regular positions on the loops near x.

    Two, or one that is as x: a space of rows that changes with the position is another one at a place taken at random.
    """
    generator = np.random.default_rng(0)
    size = np.zeros(scene.nv)
    size[scene.plan.free] = coordinate_sizes(scene)[scene.plan.free]
    for slots in scene.index.modes.values():
        size[slots.v] = 0.0
    found: dict[int, list[RowDecomposition]] = {k: [] for k in wanted}
    for trial in range(_TRIALS if wanted else 0):
        near = np.empty_like(x)
        retract(scene.plan, x, (1 + trial) * _BESIDE * size * generator.uniform(-1.0, 1.0, scene.nv), near)
        closing, gap = close_as_far(scene, work, near, np.zeros(scene.nv, bool))
        if closing.left_open > CLOSED:
            continue
        places = decompose_rows(scene, work, closing.x)
        for k, of_block in found.items():
            closed = np.abs(gap[scene.row_blocks[k].rows]).max() <= CLOSED
            if closed and places[k].is_clear and not _are_enough(of_block, wanted[k]):
                of_block.append(places[k])
        if all(_are_enough(of_block, wanted[k]) for k, of_block in found.items()):
            break
    return found


def _are_enough(places: Sequence[RowDecomposition], here: RowDecomposition) -> bool:
    """Whether places beside a start tell what its rows are at regular positions."""
    alike = len(places) == 1 and here.is_clear and here.carries(places[0])
    return alike or len(places) == _PLACES
