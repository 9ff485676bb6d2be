"""Functions of time at an instant: the prescribed motions, loads and other inputs of a machine."""

from __future__ import annotations

import numpy as np

from flexmbd.errors import SceneError
from flexmbd.multibody.kernels.base.arrays import Work
from flexmbd.multibody.kernels.physics.time_functions import evaluate_times
from flexmbd.multibody.plan.compiled_scene import CompiledScene


def evaluate_inputs(scene: CompiledScene, work: Work, t: float) -> None:
    """Bring ``work.time`` up to date for time t (s).  Collective over the team.

    Raises:
        SceneError: a function of time failed or gives no finite number; the message names it.
    """
    scene.callbacks.reset()
    evaluate_times(scene.plan, t, work.time)
    if scene.callbacks.error is not None:
        scene.refuse_failed(work)
    if np.isfinite(work.time).all():
        return
    for name, values in zip(scene.time_names, work.time, strict=False):  # one row at least
        if not np.isfinite(values).all():
            raise SceneError(f"{name}: at t = {t:g} s it gives {values}, not finite")
