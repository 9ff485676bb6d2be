"""The loop around the compiled integrator: inputs, output buffers, progress, failures."""

from __future__ import annotations

import time
from collections.abc import Mapping
from contextlib import AbstractContextManager, nullcontext
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import SceneError, SimulationError
from flexmbd.integrate import state as st
from flexmbd.integrate.protocol import Integrator
from flexmbd.multibody.body import Body
from flexmbd.multibody.initial import Start
from flexmbd.multibody.kernels import layout as at
from flexmbd.multibody.kernels.compiling import mark_compiled
from flexmbd.multibody.kernels.layout import Work, new_work
from flexmbd.multibody.kernels.series import largest_residual
from flexmbd.multibody.kernels.time_functions import evaluate_times
from flexmbd.multibody.plan import CompiledScene
from flexmbd.multibody.team import Team
from flexmbd.trajectory import Stats, Trajectory

FloatArray = NDArray[np.float64]

_BUFFER = 1024  # rows of the output buffer: how often compiled stepping returns


def evaluate_inputs(scene: CompiledScene, work: Work, t: float) -> None:
    """Bring ``work.time`` up to date for time t (s).  Collective over the team.

    Raises:
        SceneError: a function of time failed or gives no finite number; the message names it.
    """
    scene.callbacks.reset()
    evaluate_times(scene.plan, t, work.time)
    if scene.callbacks.error is not None:
        raise scene.callbacks.error
    for name, values in zip(scene.time_names, work.time, strict=False):  # one row at least
        if not np.isfinite(values).all():
            raise SceneError(f"{name}: at t = {t:g} s it gives {values}, not finite")


def run(
    start: Start,
    bodies: Mapping[str, Body],
    team: Team,
    *,
    t_start: float,
    t_end: float,
    rtol: float,
    h: float | None,
    method: Integrator,
    progress: bool,
) -> Trajectory:
    """Integrate from a consistent start; see ``System.simulate``."""
    _check(t_start, t_end, rtol, h)
    scene = start.scene
    method.check(scene)
    state = _new_state(start, t_start, t_end, rtol, h, method)
    output = _Output(scene, start, t_start)
    work = new_work(scene.plan)
    scene.callbacks.reset()
    stepper, _ = method.stepper(scene, state, _new_groups(scene), work)
    began = time.perf_counter()
    compiled = began
    code = st.OUTPUT
    with _progress_bar(progress and team.is_root, t_end - t_start) as bar:
        while code == st.OUTPUT:
            code = stepper(output.record)
            if compiled == began:
                compiled = time.perf_counter()
            bar.update(output.flush(state))
    mark_compiled()
    seconds = time.perf_counter() - began
    trajectory = _finish(start, bodies, team, output, state, seconds, compiled - began)
    if code == st.CALLBACK_FAILED:
        raise _callback_failure(scene, work, trajectory)
    if code != st.DONE:
        raise SimulationError(_failure(scene, state, code), trajectory)
    return trajectory


def _callback_failure(scene: CompiledScene, work: Work, trajectory: Trajectory) -> BaseException:
    """The error of a user's function, with the time and what was computed; an interrupt as it is."""
    flag, error = int(scene.plan.flag[0]), scene.callbacks.error
    if error is not None and not isinstance(error, Exception):
        return error
    t = float(work.time[-1, 0])
    if error is None:
        compiled = flag >= at.FLAG_ELEMENT
        names = scene.element_names if compiled else scene.time_names
        which = flag - at.FLAG_ELEMENT if compiled else at.FLAG_TIME - flag
        error = SceneError(f"{names[which]}: at t = {t:g} s the compiled function gave no finite number")
    failure = SimulationError(f"at t = {t:g} s a user's function failed: {error}", trajectory)
    failure.__cause__ = error
    return failure


def _check(t_start: float, t_end: float, rtol: float, h: float | None) -> None:
    if not (np.isfinite(t_start) and np.isfinite(t_end) and t_end > t_start):
        raise SceneError(f"t_end = {t_end} s must lie after the start, {t_start} s")
    if not 0.0 < rtol < 1.0:
        raise SceneError(f"rtol = {rtol} must lie between 0 and 1")
    if h is not None and not 0.0 < h:
        raise SceneError(f"the step h = {h} s must be positive")


def _new_state(
    start: Start, t_start: float, t_end: float, rtol: float, h: float | None,
    method: Integrator,
) -> st.State:
    number = np.zeros(st.N_NUMBER)
    span = t_end - t_start
    number[st.TIME], number[st.TIME_END] = t_start, t_end
    number[st.STEP] = h if h is not None else _first_step(start, rtol, span, method.order)
    number[st.STEP_FLOOR_SIZE] = max(1e-12 * span, 16.0 * np.spacing(max(abs(t_start), abs(t_end))))
    number[st.STEP_CEILING] = 0.1 * span
    number[st.SLOWEST] = 1.0 / span
    number[st.TOLERANCE] = rtol
    count = np.zeros(st.N_COUNT, np.int64)
    count[st.FIXED_STEP] = h is not None
    return st.State(
        start.x.copy(),
        start.v.copy(),
        start.a.copy(),
        start.multipliers.copy(),
        np.zeros((method.memory_rows, start.scene.nv)),
        number,
        count,
    )


def _first_step(start: Start, rtol: float, span: float, order: int) -> float:
    """A step that the method's starting error does not show in: the rate is the machine's."""
    scene = start.scene
    rate = 1.0 / span
    for k in scene.plan.free:
        floor = scene.group_full[scene.group_of[k]]
        rate = max(rate, abs(start.v[k]) / floor, np.sqrt(abs(start.a[k]) / floor))
    return float(0.1 * rtol ** (1.0 / order) / rate)


def _new_groups(scene: CompiledScene) -> st.Groups:
    zeros = np.zeros((3, len(scene.group_floor)))
    return st.Groups(
        scene.group_of, scene.group_kind, scene.group_full, scene.group_floor, *zeros.copy()
    )


class _Output:
    """The buffer that ``advance`` fills and the blocks taken from it."""

    def __init__(self, scene: CompiledScene, start: Start, t_start: float) -> None:
        m = len(scene.plan.rows)
        self.record = st.Record(
            np.zeros(_BUFFER),
            np.zeros((_BUFFER, scene.nx)),
            np.zeros((_BUFFER, scene.nv)),
            np.zeros((_BUFFER, scene.nv)),
            np.zeros((_BUFFER, m)),
        )
        first = (np.array([t_start]), start.x, start.v, start.a, start.multipliers)
        self.blocks = [tuple(np.atleast_2d(part).copy() for part in first)]
        self._time = t_start

    def flush(self, state: st.State) -> float:
        """Take the filled rows; return the time (s) they advanced."""
        stored = int(state.counts[st.STORED])
        state.counts[st.STORED] = 0
        t = np.atleast_2d(self.record.t[:stored])
        self.blocks.append((t.copy(), *(part[:stored].copy() for part in self.record[1:])))
        gained = float(state.numbers[st.TIME]) - self._time
        self._time += gained
        return gained

    def series(self) -> tuple[FloatArray, ...]:
        """t (nt,), x, v, a, multipliers over the whole run."""
        t = np.concatenate([block[0].ravel() for block in self.blocks])
        return (t, *(np.vstack([b[k] for b in self.blocks]) for k in range(1, 5)))


def _finish(
    start: Start,
    bodies: Mapping[str, Body],
    team: Team,
    output: _Output,
    state: st.State,
    seconds: float,
    compile_seconds: float,
) -> Trajectory:
    t, x, v, a, multipliers = output.series()
    count = state.counts
    stats = Stats(
        steps=int(count[st.STEPS]),
        rejected=int(count[st.REJECTED]),
        iterations=int(count[st.ITERATIONS]),
        factorisations=int(count[st.FACTORISATIONS]),
        evaluations=int(count[st.EVALUATIONS]),
        seconds=seconds,
        compile_seconds=compile_seconds,
        start_moved=start.moved,
        start_residual=start.residual,
        constraint_residual=_largest_residual(start, x),
    )
    return Trajectory(start.scene, t, x, v, a, multipliers, stats, bodies, team)


def _largest_residual(start: Start, x: FloatArray) -> float:
    """Largest residual (m or rad) of all rows, those left out as redundant included."""
    full = start.unreduced
    if len(full.plan.rows) == 0:
        return 0.0
    scratch = np.zeros((3, len(full.plan.rows)))
    return float(
        largest_residual(full.plan, new_work(full.plan), x, np.zeros(full.nv), scratch)
    )


def _failure(scene: CompiledScene, state: st.State, code: int) -> str:
    """Where, when and on what a simulation stopped."""
    t, h = state.numbers[st.TIME], state.numbers[st.STEP]
    worst = scene.velocity_names[int(state.counts[st.WORST])] if scene.nv else "nothing"
    if code == st.STEP_FLOOR:
        why = f"the step reached its floor, {h:.2e} s"
        remedy = "look for a singular position, a jump in a function of time, or a force without bound"
    else:
        why = f"Newton's iteration did not converge with the fixed step {h:.2e} s"
        remedy = "take a smaller h, or give rtol instead of h"
    return (
        f"the simulation stopped at t = {t:.6g} s: {why}; the worst coordinate was {worst!r}; "
        f"{remedy}; what was computed up to then is in the error's trajectory"
    )


def _progress_bar(shown: bool, total: float) -> AbstractContextManager[Any]:
    if not shown:
        return nullcontext(_Silent())
    try:
        from tqdm import tqdm  # only where a bar is asked for
    except ImportError as reason:
        raise SceneError("a progress bar needs tqdm: pip install 'flexmbd[pictures]'") from reason
    form = "{l_bar}{bar}| {n:.4g}/{total:.4g} s [{elapsed}<{remaining}]"
    return tqdm(total=total, bar_format=form)


class _Silent:
    """A progress bar that shows nothing."""

    def update(self, amount: float) -> None:
        """Take the time (s) that passed."""
