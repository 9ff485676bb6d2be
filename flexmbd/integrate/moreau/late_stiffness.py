"""Steps that what is met later makes too long: stiffness of contacts and stops is not seen where a run begins.

It is looked for where the accelerations by smooth forces grow beyond those before, in the rows of each turn of steps.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import StepsWarning, warn
from flexmbd.integrate import state as st
from flexmbd.integrate.explicit.explicit_machine import ExplicitMachine, move
from flexmbd.integrate.explicit.fixed_step import beyond_stability
from flexmbd.integrate.explicit.step_growth import StepGrowth
from flexmbd.multibody.kernels.base.compiling import entry_kernel
from flexmbd.multibody.kernels.elements.table import behaviours
from flexmbd.multibody.kernels.physics.time_functions import evaluate_times
from flexmbd.multibody.plan.compiled_scene import CompiledScene

FloatArray = NDArray[np.float64]

# Times the largest acceleration that was looked at before, on the way and in the end: to look costs as much as steps.
_FURTHER, _MORE = 2.0, 1.1


@entry_kernel
def _moved(machine, x, way, out):  # type: ignore[no-untyped-def]
    move(machine, x, way, out)


class LateStiffness:
    """Looks through the rows of a run of a scene with forces, and tells once."""

    def __init__(
        self, scene: CompiledScene, machine: Callable[[], ExplicitMachine], state: st.State, groups: st.Groups,
        *, growth: StepGrowth,
    ) -> None:  # fmt: skip
        """Watch a run from a state; ``machine`` gives arrays, whose work is written to, between turns of steps."""
        self._scene, self._machine, self._groups, self._growth = scene, machine, groups, growth
        self._begin, self._end = float(state.numbers[st.TIME]), float(state.numbers[st.TIME_END])
        plan = scene.plan
        self._open = len(plan.forces) > 0 or any(not one.hard for one in behaviours(plan))
        self._largest = 0.0

    def look(self, state: st.State, record: st.Record, smooth: FloatArray) -> None:
        """Look where accelerations grow beyond those before, of the rows that were stored.

        Args:
            state: after them.
            record: the rows.
            smooth: (rows,) 1/s^2, the accelerations, of ``step.smooth_size``; impulses are none of them.

        Warns:
            StepsWarning: there the step is beyond the stability of the method.
        """
        stored = int(state.counts[st.STORED])
        if not self._open or stored == 0:
            return
        sizes = smooth[:stored]
        so_far = np.maximum.accumulate(np.append(self._largest, np.where(np.isfinite(sizes), sizes, 0.0)))
        records = np.flatnonzero(np.diff(so_far))
        rows = [k for k in records if self._grows(sizes[k], _FURTHER)]
        rows += [k for k in records[-1:] if self._grows(sizes[k], _MORE)]
        for row in rows:
            told = self._told(state, record, row)
            if told is not None:
                self._open = False
                if self._scene.parts.team.is_root:
                    what = f"as the machine is at t = {record.t[row]:.6g} s, {told}"
                    warn(what, StepsWarning, subject="step beyond stability")
                return

    def _grows(self, size: float, times: float) -> bool:
        """Whether an acceleration is so many times the largest before, which it then is."""
        if not times * self._largest < size:
            return False
        self._largest = float(size)
        return True

    def _told(self, state: st.State, record: st.Record, row: int) -> str | None:
        """What to tell of the middle of the step that ends at a row."""
        numbers, half = state.numbers.copy(), 0.5 * float(state.numbers[st.STEP])
        t = float(record.t[row]) - half
        # a run that is stepped from outside does not know its end: it goes on for as long as it has lasted, at least
        numbers[st.TIME], numbers[st.TIME_END] = t, t + max(self._end - t, t - self._begin)
        x, v, machine = np.zeros(len(state.x)), record.v[row].copy(), self._machine()
        _moved(machine, record.x[row], -half * v, x)
        there = state.replace(x=x, v=v, a=record.a[row].copy(), numbers=numbers)
        evaluate_times(self._scene.plan, t, machine.work.time)
        told = beyond_stability(self._scene, machine, there, self._groups, method=self._growth)
        evaluate_times(self._scene.plan, float(min(state.numbers[[st.TIME, st.LATEST]])), machine.work.time)
        return told
