"""Instants at which functions of time jump: how close beside them counts, and what bodies with history take there."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import SceneError
from flexmbd.integrate import state as st
from flexmbd.multibody.plan.compiled_scene import CompiledScene

FloatArray = NDArray[np.float64]


def beside(t: float, numbers: FloatArray) -> float:
    """How far (s) from a break at t is beside it: more than the rounding of a product or a quotient there.

    ``numbers`` are the integration's, of which the least rate of the machine bounds the span.
    """
    span = min(1.0 / float(numbers[st.LEAST_RATE]), np.finfo(float).max)
    return 8.0 * math.ulp(max(abs(t), span))


def refuse_impulse_on_history(scene: CompiledScene, jump: FloatArray, numbers: FloatArray) -> None:
    """Refuse velocities (nv,) that jump in a machine with bodies with history, whose masses are not all its own.

    Raises:
        SceneError: the rate of a prescribed motion jumps by more than the tolerance.
    """
    rates = np.abs(jump) / scene.group_full[scene.group_of]
    if rates.max(initial=0.0) > numbers[st.TOLERANCE] * max(numbers[st.RATE], numbers[st.LEAST_RATE]):
        worst = int(np.argmax(rates))
        raise SceneError(
            f"the rate of a prescribed motion jumps at t = {numbers[st.TIME]:.6g} s, that of "
            f"{scene.velocity_names[worst]!r} by {jump[worst]:.3e} (m/s or rad/s): bodies with history take no "
            "impulse; let the motion begin and end at rest, or change its rate in a time that is not zero"
        )
