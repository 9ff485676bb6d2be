"""Where a part is to be cut: the region that yields, from the history of a linear run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import SceneError
from flexmbd.given import checked, numbers, shaped_numbers
from flexmbd.monitors.yield_history import YieldHistory

FloatArray = NDArray[np.float64]

# Across the axis, in which the extent of a section is taken.
_DIRECTIONS = 180


@checked("axis")
@dataclass(frozen=True)
class Slab:
    """The region between two planes across an axis; a function of points, as groups of a mesh are chosen.

    Attributes:
        axis: (3,) in the mesh's axes, normal to the planes; made a unit vector.
        start: m along the axis, from the mesh's origin; -inf for no plane there.
        end: likewise, or inf.

    Raises:
        SceneError: the axis has no direction, or the end is not after the start.
    """

    axis: Sequence[float]
    start: float
    end: float

    def __post_init__(self) -> None:
        axis = np.asarray(self.axis, dtype=np.float64)
        if axis.shape != (3,) or not np.isfinite(axis).all() or not axis.any():
            raise SceneError(f"slab: axis must be three finite numbers, not all zero, got {self.axis!r}")
        start, end = numbers(self.start), numbers(self.end)
        if start.shape or end.shape or not start < end:
            raise SceneError(f"slab: its end must lie after its start, got {self.start!r} to {self.end!r} m")
        axis = axis / abs(axis).max()  # the square of what is huge is no number
        object.__setattr__(self, "axis", tuple(float(value) for value in axis / np.linalg.norm(axis)))

    def __call__(self, x: FloatArray) -> NDArray[np.bool_]:
        """Which of points (3, n), m in the mesh's axes, lie in it (n,).

        Raises:
            SceneError: they are no such points.
        """
        along = np.asarray(self.axis) @ shaped_numbers(x, (3, -1), "points x")
        inside: NDArray[np.bool_] = (along > self.start) & (along < self.end)
        return inside

    @property
    def cuts(self) -> tuple[float, ...]:
        """Where the planes are, m along the axis: one or two, or none."""
        return tuple(place for place in (self.start, self.end) if np.isfinite(place))

    def __str__(self) -> str:
        axis = ", ".join(f"{value:.4g}" for value in self.axis)
        return f"{self.start:.4g} to {self.end:.4g} m along ({axis})"


@checked("history", "threshold", "depth")
def yielding_slabs(
    history: YieldHistory,
    *,
    threshold: float = 0.9,
    axis: Sequence[float] | None = None,
    depth: float | None = None,
) -> tuple[Slab, ...]:
    """The slabs of a part in which it may yield, each one section depth wider on either side.

    The disturbance of the stress by a rigid or averaged cut decays within about a section's depth (Saint-Venant), so
    that farther off it changes neither what yields nor the way the part bends.  Slabs closer than a depth are
    one, and none ends closer than a depth from the part's end: it goes through to the end.

    Args:
        history: of all nodes that may yield.  Nodes left out by the monitor's clearance are taken for elastic.
        threshold: of the utilisation; below 1, for stresses averaged over cells are below their largest.
        axis: (3,) in the mesh's axes, along the part; default: that of its least moment of inertia.
        depth: m, by how much to widen; default: the section's largest extent (of a rectangle the diagonal) where it
            yields.

    Returns:
        Slabs in the order of the axis, for `flexmbd.continuum.cut_mesh`; none where nothing exceeds the threshold.

    Raises:
        SceneError: a threshold or depth that is not positive.
    """
    for name, value in (("threshold", threshold), ("depth", depth)):
        if value is not None and not (np.isfinite(value) and value > 0.0):
            raise SceneError(f"yielding slabs of {history.body!r}: {name} must be positive, got {value!r}")
    along = _axis(history) if axis is None else np.asarray(Slab(axis, 0.0, 1.0).axis)
    places = _all_places(history)
    s = places @ along
    high = np.sort((history.watched_x @ along)[history.peak > threshold])
    if len(high) == 0:
        return ()
    whole = _depth(places, along) if depth is None else depth
    slabs: list[tuple[float, float]] = []
    # where the gap cannot be an elastic piece, what yields is one range
    breaks = np.flatnonzero(np.diff(high) > 2.0 * whole) + 1
    for group in np.split(high, breaks):
        near = (s > group[0] - whole) & (s < group[-1] + whole)
        wide = _depth(places[near], along) if depth is None else depth
        start, end = group[0] - wide, group[-1] + wide
        start = start if start - s.min() >= wide else -np.inf
        end = end if s.max() - end >= wide else np.inf
        if slabs and start - slabs[-1][1] < wide:
            start = slabs.pop()[0]
        slabs.append((float(start), float(end)))
    return tuple(Slab([float(value) for value in along], *ends) for ends in slabs)


def _all_places(history: YieldHistory) -> FloatArray:
    """(k, 3) all nodes, those not watched as well, in the mesh's axes."""
    record = history.record
    if record.stress is None:
        return history.watched_x
    return record.stress.x @ record.R_MB.T + record.p_MB_M


def _axis(history: YieldHistory) -> FloatArray:
    """Principal axis of the least moment of inertia, in the mesh's axes; its largest component positive."""
    record = history.record
    axis = record.R_MB @ np.linalg.eigh(record.inertia)[1][:, 0]
    axis[abs(axis) < 1e-9] = 0.0
    return axis * np.sign(axis[abs(axis).argmax()])


def _depth(places: FloatArray, along: FloatArray) -> float:
    """The largest extent (m) of points (k, 3) across an axis, in any direction."""
    one = np.cross(along, np.eye(3)[abs(along).argmin()])
    one /= np.linalg.norm(one)
    angles = np.linspace(0.0, np.pi, _DIRECTIONS, endpoint=False)
    fan = np.outer(one, np.cos(angles)) + np.outer(np.cross(along, one), np.sin(angles))
    return float(np.ptp(places @ fan, axis=0).max())
