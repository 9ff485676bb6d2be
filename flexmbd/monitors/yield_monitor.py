"""YieldMonitor: whether, when and where a reduced body of a run would yield, from its record's stress modes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.brief import brief
from flexmbd.errors import SceneError
from flexmbd.given import checked
from flexmbd.monitors.watched_nodes import PointFilter, places, stress_modes, watched_nodes
from flexmbd.monitors.yield_history import YieldHistory, YieldPoint
from flexmbd.multibody.bodies.body import FlexibleBody
from flexmbd.record.groups import StressModes
from flexmbd.run.event import Direction, Event, Moment
from flexmbd.run.trajectory import Trajectory

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# Nodes and instants at a time, so that what is written stays in the processor's cache.
_NODES, _INSTANTS = 256, 128
# Utilisations that are looked at closely: so near to one that round-off may decide.
_NEAR = 1e-6
_EPSILON = float(np.finfo(np.float64).eps)


@checked("yield_stress", "clearance")
@dataclass(frozen=True, eq=False)
class YieldMonitor:
    """Watches the von Mises stress of a reduced body against a yield stress.

    The stress is that of the record's stress modes: linear, averaged over the cells at each node, at the
    mesh's nodes.  It goes with the strain of the modes, to second order where the record has `ModalStretch`,
    so that the shortening of a bent body is no stress.  It says where linear reduction ends, not what comes
    after: beyond yield the stress is that of a body that does not yield.

    A rigid interface hinders its section to contract and to warp, and its edge is a notch: the stress there is
    the mesh's rather than the part's.

    Attributes:
        body: its record holds stress modes (`keep=Keep(stress=True)`).
        yield_stress: Pa.
        clearance: m; nodes no farther than this from a node of an interface are not watched. By default those on
            interfaces; None: all are.
        where: of points (3, n), m, undeformed in the mesh's axes: which of them (n,) to watch; default all.

    Raises:
        SceneError: the body is not a reduced one or has no stress modes, the yield stress or the clearance is no
            such number, `where` fails, or no node is left.
    """

    body: FlexibleBody
    yield_stress: float
    clearance: float | None = 0.0
    where: PointFilter | None = None

    __repr__ = brief

    def __post_init__(self) -> None:
        if not isinstance(self.body, FlexibleBody):
            raise SceneError(f"YieldMonitor watches a FlexibleBody, got {self.body!r}")
        if not (np.isfinite(self.yield_stress) and self.yield_stress > 0.0):
            raise SceneError(f"{self._name}: the yield stress must be positive (Pa), got {self.yield_stress!r}")
        if self.clearance is not None and not self.clearance >= 0.0:
            raise SceneError(f"{self._name}: clearance must be a distance (m) or None, got {self.clearance!r}")
        if len(self._watched) == 0:
            raise SceneError(
                f"{self._name}: none of its {len(self._modes.node)} nodes is left to watch; take a smaller clearance "
                "or another region"
            )

    @property
    def node(self) -> IntArray:
        """(k,) numbers of the nodes watched, ascending, as in `StressModes`."""
        return self._modes.node[self._watched]

    @cached_property
    def x(self) -> FloatArray:
        """(k, 3) m, their undeformed positions in the mesh's axes."""
        return self._places[self._watched]

    @checked()
    def utilisation(self, q: ArrayLike) -> FloatArray:
        """Largest von Mises stress of the nodes watched over the yield stress.

        Args:
            q: (n,) or (nt, n) modal coordinates of a motion. With `ModalStretch` these hold the shortening of a bent
                body; those of linear statics do not, and its lack would be taken for a tension.

        Returns:
            A number, or (nt,).
        """
        coordinates = np.asarray(q, dtype=np.float64)
        return self._scan(np.atleast_2d(coordinates))[0].reshape(coordinates.shape[:-1])

    @checked()
    def over(self, run: Trajectory, *, t: ArrayLike | None = None) -> YieldHistory:
        """Watch a finished run.

        The instant of first yield is found between two of the instants looked at; a peak that rises and falls
        between two of them goes unseen.

        Args:
            run: of a scene with this body.
            t: (nt,) s, ascending, the instants to look at; default: the ends of all steps.

        Raises:
            SceneError: the body is not in the run, or the instants are not in it or not ascending.
        """
        times = run.t if t is None else np.atleast_1d(np.asarray(t, dtype=np.float64))
        if len(times) == 0 or not (np.diff(times) >= 0.0).all():
            raise SceneError(f"{self._name}: the instants to look at must ascend, got {t!r}")
        q = run.q(self.body, t=None if t is None else times)
        largest, at, peak = self._scan(q)
        noise = self._noise(times, q, largest)
        # within round-off of yield counts as yield, as where the run was stopped by it
        largest[abs(largest - 1.0) <= noise] = 1.0
        peak[abs(peak - 1.0) <= noise[largest == 1.0].max(initial=0.0)] = 1.0
        for passed in run.events:  # found to the method's own accuracy, which may end below
            if isinstance(passed.event.function, _Excess) and passed.event.function.monitor is self:
                here = np.flatnonzero(times == passed.t)
                largest[here] = np.maximum(largest[here], passed.event.function.level)
                peak[at[here]] = np.maximum(peak[at[here]], largest[here])
        return YieldHistory(
            body=self.body.name,
            record=self.body.record,
            yield_stress=self.yield_stress,
            t=times,
            utilisation=largest,
            node=self.node[at],
            x=self.x[at],
            watched=self.node,
            watched_x=self.x,
            peak=peak,
            first=self._first(run, times, largest),
        )

    @checked("level", "stop")
    def event(
        self, *, level: float = 1.0, stop: bool = False, action: Callable[[Moment], None] | None = None
    ) -> Event:
        """An event for `System.simulate` where the utilisation rises through a level.

        A body that is above it from the start does not pass it; `over` tells.

        Args:
            level: of the utilisation.
            stop: end the simulation there.
            action: as in `Event`.
        """
        return Event(
            _Excess(self, level),
            direction=Direction.RISING,
            stop=stop,
            action=action,
            name=f"yield of {self.body.name}",
        )

    @property
    def _name(self) -> str:
        return f"yield monitor of {self.body.name or 'a body'!r}"

    @property
    def _modes(self) -> StressModes:
        return stress_modes(self.body, name=self._name)

    @cached_property
    def _places(self) -> FloatArray:
        """All nodes in the mesh's axes."""
        return places(self.body, self._modes)

    @cached_property
    def _watched(self) -> IntArray:
        """Rows of the stress modes."""
        return watched_nodes(
            self.body, self._modes, clearance=self.clearance, where=self.where, name=self._name
        )

    @cached_property
    def _rows(self) -> tuple[FloatArray, ...]:
        """Blocks (5, k, n) of nodes: five numbers whose squares add up to that of the utilisation."""
        xx, yy, zz, xy, xz, yz = self._modes.sigma[self._watched].transpose(1, 0, 2) / self.yield_stress
        shear = np.sqrt(3.0)
        five = np.stack([xx - 0.5 * (yy + zz), 0.5 * shear * (yy - zz), shear * xy, shear * xz, shear * yz])
        return tuple(
            np.ascontiguousarray(five[:, k : k + _NODES]) for k in range(0, five.shape[1], _NODES)
        )

    def _scan(self, q: FloatArray) -> tuple[FloatArray, IntArray, FloatArray]:
        """Largest utilisation (nt,), the place in `node` of each (nt,), and the largest of each node (k,)."""
        n = self.body.record.n_modes
        if q.ndim != 2 or q.shape[1] != n:
            raise SceneError(f"{self._name}: it has {n} modal coordinates, got {q.shape}")
        strained = self.body.record.strained(q).T
        largest, at = np.full(len(q), -1.0), np.zeros(len(q), dtype=np.int64)
        peak = np.zeros(len(self._watched))
        for first in range(0, len(q), _INSTANTS):
            now = slice(first, first + _INSTANTS)
            some = np.ascontiguousarray(strained[:, now])
            for block, rows in enumerate(self._rows):
                squares = _squares(rows, some)
                nodes = slice(block * _NODES, block * _NODES + len(squares))
                np.maximum(peak[nodes], squares.max(axis=1), out=peak[nodes])
                highest = squares.max(axis=0)
                better = np.flatnonzero(highest > largest[now])
                largest[first + better] = highest[better]
                at[first + better] = nodes.start + squares[:, better].argmax(axis=0)
        return np.sqrt(largest), at, np.sqrt(peak)

    def _noise(self, times: FloatArray, q: FloatArray, largest: FloatArray) -> FloatArray:
        """How well a utilisation near one is known, (nt,): to the round-off of its sum and of its instant."""
        noise = np.zeros(len(times))
        near = np.flatnonzero(abs(largest - 1.0) < _NEAR)
        if len(near) == 0:
            return noise
        q = np.ascontiguousarray(abs(self.body.record.strained(q[near])).T)
        terms = np.max([_squares(abs(rows), q).max(axis=0) for rows in self._rows], axis=0)
        noise[near] = len(q) * _EPSILON * np.sqrt(terms)
        steps = np.diff(times)
        rates = np.divide(abs(np.diff(largest)), steps, out=np.zeros(len(steps)), where=steps > 0.0)
        fastest = np.maximum(np.append(rates, 0.0), np.append(0.0, rates))
        # an event's instant is found to four spacings of the numbers there
        noise[near] += 4.0 * (fastest * np.spacing(abs(times)))[near]
        return noise

    def _first(self, run: Trajectory, times: FloatArray, largest: FloatArray) -> YieldPoint | None:
        above = np.flatnonzero(largest >= 1.0)
        if len(above) == 0:
            return None
        i = int(above[0])
        t = float(times[i])
        if i > 0 and times[i] > times[i - 1]:
            t = self._passage(run, float(times[i - 1]), t)
        value, at, _ = self._scan(run.q(self.body, t=[t]))
        return YieldPoint(t, int(self.node[at[0]]), self.x[at[0]], float(value[0]))

    def _passage(self, run: Trajectory, before: float, after: float) -> float:
        """The instant (s) between two at which the utilisation is 1."""

        def excess(t: float) -> float:
            return float(self.utilisation(run.q(self.body, t=t))) - 1.0

        if excess(before) >= 0.0 or excess(after) <= 0.0:
            return after
        from scipy.optimize import brentq  # on need: 0.1 s

        return float(brentq(excess, before, after, xtol=1e-12 * max(abs(after), after - before)))


@dataclass(frozen=True)
class _Excess:
    """By how much a monitor's utilisation is above a level at a moment: an event's function."""

    monitor: YieldMonitor
    level: float

    def __call__(self, moment: Moment) -> float:
        return float(self.monitor.utilisation(moment.q(self.monitor.body))) - self.level


def _squares(rows: FloatArray, q: FloatArray) -> FloatArray:
    """(k, nt) sum of the squares of the five numbers (5, k, n) at q (n, nt)."""
    five, k, n = rows.shape
    values = (rows.reshape(five * k, n) @ q).reshape(five, k, -1)
    np.square(values, out=values)
    return np.add.reduce(values, axis=0)
