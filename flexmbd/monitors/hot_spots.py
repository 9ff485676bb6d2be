"""Where and when the largest stress of a run is, found exactly without the stress of every node at every instant.

Stress is linear in the strain coordinates s of the record, sigma = sum_j S_j s_j. A measure f of it, the von Mises
stress or a principal stress, is convex, and changes by no more than a norm |.| of a change of stress: the von Mises
stress of the difference, or its Frobenius norm (Weyl). With e the departure of s from the straight line between the
instants a and b, f is between them at most

    max(f(a), f(b)) + sum_j |S_j| max |e_j|,

which closes in with the square of b - a. Stretches of time whose bound lies below what was found already are left
alone, the others are halved, for the nodes in question alone: branch and bound, the highest bound first. The
coordinates are turned to the principal directions of the motion, so that few of them are large.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass
from enum import Enum
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.brief import brief
from flexmbd.errors import SceneError
from flexmbd.given import checked
from flexmbd.monitors.watched_nodes import PointFilter, places, stress_modes, watched_nodes
from flexmbd.multibody.bodies.body import FlexibleBody
from flexmbd.round_off import EQUAL
from flexmbd.run.trajectory import Trajectory

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# Instants of the first stretches, and what a bound is raised by against round-off.
_STRETCH = 32
# Of a tensor's rows the six components xx yy zz xy xz yz.
_PLACES = np.array([[0, 3, 4], [3, 1, 5], [4, 5, 2]])


class StressMeasure(Enum):
    """What of a stress is to be largest."""

    VON_MISES = "von Mises stress"
    TENSION = "largest principal stress"
    COMPRESSION = "least principal stress"


@dataclass(frozen=True, eq=False)
class HotSpot:
    """A place and an instant.

    Attributes:
        t: s.
        node: its number, as in the record's stress modes.
        x: (3,) m, undeformed, in the mesh's axes.
        stress: Pa, of the measure that was asked for; a least principal stress is mostly below zero.
        measure: what it is.
    """

    t: float
    node: int
    x: FloatArray
    stress: float
    measure: StressMeasure

    __repr__ = brief

    def __str__(self) -> str:
        place = ", ".join(f"{value:.4g}" for value in np.where(abs(self.x) < EQUAL, 0.0, self.x))
        return f"{self.measure.value} {self.stress:.4g} Pa at t = {self.t:.6g} s, node {self.node} at ({place}) m"


@checked("run", "clearance", "t")
def hot_spots(
    run: Trajectory,
    body: FlexibleBody,
    *,
    measure: StressMeasure = StressMeasure.VON_MISES,
    count: int = 1,
    clearance: float | None = 0.0,
    where: PointFilter | None = None,
    t: ArrayLike | None = None,
) -> tuple[HotSpot, ...]:
    """The nodes with the largest stress of a run, each with its instant, the worst first. Not collective.

    The stress is that of the record's stress modes, at the mesh's nodes, averaged over the cells that share them, as
    `YieldMonitor` has it; the search is exact at the instants that are looked at.

    Args:
        run: of a scene with this body.
        body: its record holds stress modes (`keep=Keep(stress=True)`).
        measure: von Mises, or the largest or least principal stress.
        count: how many nodes.
        clearance: m; nodes no farther than this from a node of an interface are left out, by default those on
            interfaces; None: none are.
        where: of points (3, n), m, undeformed in the mesh's axes: which of them (n,) to look at; default: all.
        t: (nt,) s, the instants to look at; default: the ends of all steps.

    Raises:
        SceneError: the body is no reduced one, has no stress modes or is not in the run; arguments that are not well
            formed; no node or instant is left.
    """
    if not isinstance(body, FlexibleBody):
        raise SceneError(f"hot_spots looks at a FlexibleBody, got {body!r:.100}")
    name = f"hot spots of {body.name or 'a body'!r}"
    if not isinstance(measure, StressMeasure):
        raise SceneError(f"{name}: measure must be a StressMeasure, as StressMeasure.VON_MISES, got {measure!r:.100}")
    if isinstance(count, bool) or not isinstance(count, int) or count < 1:
        raise SceneError(f"{name}: count must be a whole number from 1 on, got {count!r:.100}")
    if clearance is not None and not clearance >= 0.0:
        raise SceneError(f"{name}: clearance must be a distance (m) or None, got {clearance!r:.100}")
    modes = stress_modes(body, name=name)
    rows = watched_nodes(body, modes, clearance=clearance, where=where, name=name)
    times = run.t if t is None else np.atleast_1d(np.asarray(t, dtype=np.float64))
    if len(rows) == 0 or len(times) == 0:
        raise SceneError(f"{name}: no {'node' if len(rows) == 0 else 'instant'} is left to look at")
    strained = body.record.strained(run.q(body, t=None if t is None else times))
    value, at, node = _search(modes.sigma[rows], strained, measure, count)
    x = places(body, modes)[rows]
    sign = -1.0 if measure is StressMeasure.COMPRESSION else 1.0
    return tuple(
        HotSpot(float(times[i]), int(modes.node[rows[k]]), x[k], sign * float(one), measure)
        for one, i, k in zip(value, at, node, strict=True)
    )


def _search(
    sigma: FloatArray, strained: FloatArray, measure: StressMeasure, count: int
) -> tuple[FloatArray, IntArray, IntArray]:
    """Largest measures, and the instant and row of each, descending; `sigma` (k, 6, n), `strained` (nt, n)."""
    sigma, s = _principal(sigma, strained)
    reach, count = _reach(sigma, measure), min(count, len(sigma))
    grid = np.unique([*range(0, len(s), _STRETCH), len(s) - 1])
    blocks = [grid[i : i + 8] for i in range(0, len(grid), 8)]
    values = np.concatenate([_measured(_stresses(sigma, s[block]), measure) for block in blocks], axis=1)
    best, when = values.max(axis=1), grid[values.argmax(axis=1)]
    heap: list[tuple[float, int, int, IntArray, FloatArray, FloatArray, FloatArray]] = []

    def level() -> float:
        return float(np.partition(best, -count)[-count])

    def bound(a: int, b: int, nodes: IntArray, at_a: FloatArray, at_b: FloatArray) -> None:
        if b - a < 2:
            return
        part = np.linspace(0.0, 1.0, b - a + 1)[1:-1, None]
        departure = abs(s[a + 1 : b] - (1.0 - part) * s[a] - part * s[b]).max(axis=0)
        bounds = np.maximum(at_a, at_b) + reach[nodes] @ departure
        bounds += EQUAL * abs(bounds)
        kept = bounds > lowest
        if kept.any():
            # no two entries have the same a and b, so that arrays are never compared
            entry = (-float(bounds.max()), a, b, nodes[kept], at_a[kept], at_b[kept], bounds[kept])
            heapq.heappush(heap, entry)

    lowest, every = level(), np.arange(len(sigma))
    for i, (a, b) in enumerate(pairwise(grid.tolist())):
        bound(a, b, every, values[:, i], values[:, i + 1])
    while heap and -heap[0][0] > lowest:
        _, a, b, nodes, at_a, at_b, bounds = heapq.heappop(heap)
        kept = bounds > lowest
        nodes, at_a, at_b, middle = nodes[kept], at_a[kept], at_b[kept], (a + b) // 2
        found = _measured(_stresses(sigma[nodes], s[middle : middle + 1]), measure)[:, 0]
        better = found > best[nodes]
        best[nodes[better]], when[nodes[better]] = found[better], middle
        if better.any():
            lowest = level()
        bound(a, middle, nodes, at_a, found)
        bound(middle, b, nodes, found, at_b)
    order = np.argsort(-best, kind="stable")[:count]
    return best[order], when[order], order


def _principal(sigma: FloatArray, strained: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The same stresses (k, 6, r) and motion (nt, r) in its principal directions, weighed by stress."""
    sizes = np.sqrt(np.mean(sigma**2, axis=(0, 1)))
    sizes[sizes == 0.0] = 1.0
    weighed = strained * sizes
    directions = np.linalg.eigh(weighed.T @ weighed)[1]
    turned = (sigma / sizes).reshape(-1, len(sizes)) @ directions
    return turned.reshape(sigma.shape), weighed @ directions


def _stresses(sigma: FloatArray, s: FloatArray) -> FloatArray:
    """(k, 6, nt) from sigma (k, 6, n) and s (nt, n), as one product."""
    k, six, n = sigma.shape
    return np.asarray((sigma.reshape(k * six, n) @ s.T).reshape(k, six, len(s)))


def _measured(sigma: FloatArray, measure: StressMeasure) -> FloatArray:
    """(k, ...) of stresses (k, 6, ...); of compression less than zero, so that the largest is sought in any case."""
    if measure is StressMeasure.VON_MISES:
        xx, yy, zz, xy, xz, yz = np.moveaxis(sigma, 1, 0)
        squares = 0.5 * ((xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2) + 3.0 * (xy**2 + xz**2 + yz**2)
        return np.asarray(np.sqrt(squares))
    principal = np.linalg.eigvalsh(np.moveaxis(sigma, 1, -1)[..., _PLACES])
    return np.asarray(principal[..., 2] if measure is StressMeasure.TENSION else -principal[..., 0])


def _reach(sigma: FloatArray, measure: StressMeasure) -> FloatArray:
    """(k, n) by how much the measure changes at most per unit of each coordinate, from sigma (k, 6, n)."""
    if measure is StressMeasure.VON_MISES:
        return _measured(sigma, measure)
    return np.asarray(np.sqrt((sigma[:, :3] ** 2).sum(axis=1) + 2.0 * (sigma[:, 3:] ** 2).sum(axis=1)))
