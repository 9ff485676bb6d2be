"""One watch of the rows of a run against what the records of its bodies know, and what its elements can measure.

Each kind of limit is a file of its own: `compared_range`, `spin_range`, `bend_range`, `turn_range`,
`depth_range`.  It is told once a run, with body, time, what is missing and about how much, and a remedy; of an
ensemble once of each subject (`told_once`).
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.bodies.body import Body
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.results.bend_range import bend_limits
from flexmbd.multibody.results.compared_range import compared_limits
from flexmbd.multibody.results.dent_range import dent_limits
from flexmbd.multibody.results.depth_range import depth_limits
from flexmbd.multibody.results.spin_range import spin_limits
from flexmbd.multibody.results.state_rows import Before, Limit, StateRows
from flexmbd.multibody.results.stretch_watch import StoredRows
from flexmbd.multibody.results.turn_range import turn_limits

FloatArray = NDArray[np.float64]

# Rows that are waited for: to look costs some 100 us however few there are.
_AT_ONCE = 1024


class RangeWatch:
    """Looks through the rows of a simulation as they come, and warns once of each limit."""

    def __init__(self, scene: CompiledScene, bodies: Iterable[Body]) -> None:
        self._scene, watched = scene, tuple(bodies)
        made = (compared_limits, spin_limits, bend_limits, turn_limits, depth_limits, dent_limits)
        self._limits: tuple[Limit, ...] = tuple(chain.from_iterable(make(scene, watched) for make in made))
        self._open = self._limits
        self._rows = 0
        self._work = new_work(scene.plan) if self._limits else None
        self._before: Before | None = None

    def look(self, stored: StoredRows, *, last: bool = False) -> None:
        """Look at the rows that came since; each begins with time (s), configuration and velocities.

        Args:
            stored: the run's rows.
            last: whether no more will come, so that few are looked at as well.

        Warns:
            RangeWarning: a limit is passed.
        """
        if not self._open or stored.count - self._rows < (1 if last else _AT_ONCE):
            return
        t, x, v, *_ = stored.since(self._rows)
        self._rows = stored.count
        rows = StateRows(self._scene, t, x, v, work=self._work, before=self._before)
        self._open = tuple(limit for limit in self._open if not limit.tells(rows))
        self._before = rows.after()

    def begin_anew(self) -> None:
        """Let the rows that come not be those after the last ones."""
        self._before = None

    def judge(self, t: FloatArray, x: FloatArray, v: FloatArray | None = None) -> None:
        """The same of other states, as equilibria, paths of them, or the rows of a whole run.

        Args:
            t: (k,) times, s, or load factors.
            x: (k, nx) configurations.
            v: (k, nv) velocities; none: at rest.

        Warns:
            RangeWarning: a limit is passed.
        """
        if not self._limits or not len(t):
            return
        rows = StateRows(self._scene, t, x, np.zeros((len(t), self._scene.nv)) if v is None else v, work=self._work)
        for limit in self._limits:
            limit.tells(rows)
