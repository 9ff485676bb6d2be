"""The state behind a break: accelerations found anew, loops closed by other rows, what bodies with history take."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import AssemblyError, SceneError
from flexmbd.integrate import state as st
from flexmbd.multibody.kernels.base.arrays import Work
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.start.consistent_start import accelerations, match_motion
from flexmbd.multibody.start.interior_start import resume_interiors
from flexmbd.multibody.start.loop_closing import close_loops

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


def resumed_accelerations(
    scene: CompiledScene, work: Work, x: FloatArray, v: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Accelerations (nv,) and multipliers (m,) at x (nx,) and v (nv,); ``work.time`` is up to date.  Collective.

    Bodies with history go on from the state that they keep.
    """
    if scene.interiors is None:
        return accelerations(scene, work, x, v)
    return resume_interiors(scene, scene.interiors, work, x, v, accelerations)


def closed_state(
    scene: CompiledScene, work: Work, x: FloatArray, v: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray] | None:
    """x, v, a and multipliers next to x (nx,) and v (nv,) at which all rows hold; None where the loops do not close."""
    nothing = np.zeros(scene.nv, bool)
    try:
        closed = close_loops(scene, work, x, nothing).x
        return closed, *match_motion(scene, work, closed, v, held=nothing)
    except AssemblyError:
        return None
