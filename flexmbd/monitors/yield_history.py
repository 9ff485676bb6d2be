"""YieldHistory: how far a reduced body was from yield over a run, and where."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.brief import brief
from flexmbd.record.reduced_body import ReducedBody

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class YieldPoint:
    """A moment and a place.

    Attributes:
        t: s.
        node: its number, as in the record's stress modes.
        x: (3,) m, undeformed, in the mesh's axes.
        utilisation: von Mises stress over yield stress.
    """

    t: float
    node: int
    x: FloatArray
    utilisation: float

    __repr__ = brief

    def __str__(self) -> str:
        place = ", ".join(f"{value:.4g}" for value in np.where(abs(self.x) < 1e-12, 0.0, self.x))
        return f"{self.utilisation:.3f} at t = {self.t:.6g} s, node {self.node} at ({place}) m"


@dataclass(frozen=True, eq=False)
class YieldHistory:
    """The results of `YieldMonitor.over`; positions are undeformed, in the mesh's axes; `print` shows it.

    Attributes:
        body: name.
        record: of the body.
        yield_stress: Pa.
        t: (nt,) s, the instants looked at.
        utilisation: (nt,) largest von Mises stress over the yield stress.
        node: (nt,) number of the node where it is.
        x: (nt, 3) m, where that is.
        watched: (k,) numbers of the nodes watched.
        watched_x: (k, 3) m, their positions.
        peak: (k,) the largest utilisation of each of them over the run.
        first: where and when the body first yields, or None.
    """

    body: str
    record: ReducedBody
    yield_stress: float
    t: FloatArray
    utilisation: FloatArray
    node: IntArray
    x: FloatArray
    watched: IntArray
    watched_x: FloatArray
    peak: FloatArray
    first: YieldPoint | None

    __repr__ = brief

    @property
    def largest(self) -> YieldPoint:
        """Where and when the utilisation is largest."""
        i = int(self.utilisation.argmax())
        return YieldPoint(float(self.t[i]), int(self.node[i]), self.x[i], float(self.utilisation[i]))

    def __str__(self) -> str:
        all_nodes = len(self.record.stress.node) if self.record.stress is not None else len(self.watched)
        lines = [
            f"{self.body}: von Mises stress over the yield stress of {self.yield_stress / 1e6:g} MPa, "
            f"{self.t[0]:.6g} to {self.t[-1]:.6g} s",
            f"  watched           {len(self.watched)} of {all_nodes} nodes",
            f"  largest           {self.largest}",
        ]
        if self.first is None:
            return "\n".join([*lines, "  yields            nowhere"])
        high = self.peak >= 1.0
        low, top = self.watched_x[high].min(axis=0, initial=np.inf), self.watched_x[high].max(axis=0, initial=-np.inf)
        extent = ", ".join(f"{axis} {a:.4g} to {b:.4g}" for axis, a, b in zip("xyz", low, top, strict=True))
        lines.append(f"  first yields      {self.first}")
        lines.append(f"  yields            {high.sum()} nodes, {extent} m (mesh's axes)")
        return "\n".join(lines)
