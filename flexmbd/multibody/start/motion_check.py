"""Whether the rates and accelerations of prescribed motions are those of their values."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import SceneError
from flexmbd.multibody.joint.connection import Connection, motion_name
from flexmbd.multibody.kernels.physics.time_functions import evaluate_times
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.round_off import ROUND_OFF

FloatArray = NDArray[np.float64]

_PLACES = (0.3819660, 0.6180340, 0.8541020)  # shares of the simulated time; no round numbers, where functions may bend
_STEPS = tuple(10.0**-k for k in range(3, 8))  # shares of it, for difference quotients
_CONVERGED = 1e-3  # by which two quotients of steps a tenth apart may differ
_FALSE = 1e-2  # by which a derivative must then differ to be a false one


def refuse_false_rates(scene: CompiledScene, t_start: float, t_end: float) -> None:
    """Compare what users' functions give as rate and acceleration with difference quotients.  Collective.

    A quotient counts where it converges as the step shrinks: functions that are too fast or bend there pass.

    Raises:
        SceneError: a rate or an acceleration of a prescribed motion is another than that of its values.
    """
    names = {motion_name(c) for c in _connections(scene) if c.motion is not None}
    rows = [k for k, row in enumerate(scene.time_rows) if row.is_users and scene.time_names[k] in names]
    if not rows:
        return
    plan = scene.plan.replace(times=np.ascontiguousarray(scene.plan.times[rows]))
    span, out = t_end - t_start, np.zeros((len(rows) + 1, 3))

    def ask(t: float) -> FloatArray:
        evaluate_times(plan, t, out)
        return out[:-1].copy()

    for t in (t_start + share * span for share in _PLACES):
        here = ask(t)
        steps = [share * span for share in _STEPS]
        around = [(ask(t + step), ask(t - step)) for step in steps]
        if scene.callbacks.flag[0]:  # where it fails, the run tells of it
            scene.callbacks.reset()
            return
        for k, row in enumerate(rows):
            for order, what in ((0, "rate"), (1, "acceleration")):
                values = [(up[k, order], down[k, order]) for up, down in around]
                told = here[k, order + 1]
                quotient = _converged_quotient(values, steps, size=abs(told))
                if quotient is not None and abs(quotient - told) > _FALSE * max(abs(quotient), abs(told)):
                    raise SceneError(
                        f"{scene.time_names[row]}: at t = {t:.6g} s it gives {told:.6g} as its {what}, but its "
                        f"{('values change', 'rate changes')[order]} by {quotient:.6g} a second; give the derivative"
                    )


def _connections(scene: CompiledScene) -> list[Connection]:
    branches = [b.connection for b in scene.topology.branches if b.connection is not None]
    return [*branches, *scene.topology.closures]


def _converged_quotient(values: list[tuple[float, float]], steps: list[float], *, size: float) -> float | None:
    """The difference quotient where it stops changing as the step shrinks, and is not round-off; None if nowhere.

    ``size`` is that of the derivative it is compared with.
    """
    before: float | None = None
    for (up, down), step in zip(values, steps, strict=True):
        quotient = (up - down) / (2.0 * step)
        if not np.isfinite(quotient):
            return None
        noise = ROUND_OFF * max(abs(up), abs(down)) / step
        small = _CONVERGED * max(size, abs(quotient))
        if before is not None and abs(quotient - before) <= small and noise < small:
            return quotient
        before = quotient
    return None
