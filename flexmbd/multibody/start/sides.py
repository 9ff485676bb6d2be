"""Switches of laws: the sides on which a machine begins, and how their numbers change along its motion."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import SceneError, described
from flexmbd.multibody.functions.switched import Switch
from flexmbd.multibody.functions.time_function import answered
from flexmbd.multibody.kernels.base.arrays import Work
from flexmbd.multibody.kernels.physics.joints import retract
from flexmbd.multibody.plan.compiled_scene import CompiledScene

FloatArray = NDArray[np.float64]

_SHORT = 1e-7  # of a radian of the machine's motion, over which a switch's number is seen to change


def switch_numbers(
    scene: CompiledScene, switches: Sequence[Switch], t: float, x: FloatArray, v: FloatArray
) -> FloatArray:
    """(k,) numbers of some switches at t (s).  Collective over the team.

    Raises:
        SceneError: a function failed, or gave no finite number.
    """
    error: Exception | None = None
    found = np.zeros(len(switches))
    try:
        for k, switch in enumerate(switches):
            found[k] = _number(switch, t, x, v)
    except SceneError as reason:
        error = reason
    team = scene.callbacks.team  # of a run on rank 0 alone none but this rank
    team.fail(error)
    return np.asarray(team.agree(found))


def _number(switch: Switch, t: float, x: FloatArray, v: FloatArray) -> float:
    try:
        # copies: a user's function may write into what it is given, or keep it
        return float(answered(switch.value(float(x[switch.place]), t, x.copy(), v.copy()), ()))
    except Exception as reason:
        raise SceneError(f"the switch of {switch.name} at t = {t:g} s: {described(reason)}") from reason


def changes_of_switches(scene: CompiledScene, t: float, x: FloatArray, v: FloatArray, a: FloatArray) -> FloatArray:
    """(k,) by how much the switches' numbers change in an instant of the motion v, a (nv,), from x (nx,) on."""
    full = scene.group_full[scene.group_of]
    pace = max(np.abs(v / full).max(initial=0.0), np.sqrt(np.abs(a / full).max(initial=0.0)))
    if not pace > 0.0:
        return np.zeros(len(scene.switches))
    short, there = _SHORT / pace, np.empty_like(x)
    retract(scene.plan, x, short * v, there)
    after = switch_numbers(scene, scene.switches, t + short, there, v + short * a)
    return after - switch_numbers(scene, scene.switches, t, x, v)


def begin_sides(
    scene: CompiledScene, work: Work, x: FloatArray, v: FloatArray, accelerations: Callable[..., tuple[FloatArray, Any]]
) -> None:
    """Write into x (nx,) the side of each switch at v (nv,); at zero that which the machine moves to.  Collective."""
    if not scene.switches:
        return
    t, places = float(work.time[-1, 0]), [switch.place for switch in scene.switches]
    x[places] = 1.0
    numbers = switch_numbers(scene, scene.switches, t, x, v)
    x[places] = np.where(numbers < 0.0, -1.0, 1.0)
    if (numbers == 0.0).any() and scene.interiors is None:
        a, _ = accelerations(scene, work, x, v)
        change = changes_of_switches(scene, t, x, v, a)
        x[places] = np.where((numbers == 0.0) & (change < 0.0), -1.0, x[places])


def refuse_other_sides(scene: CompiledScene, t: float, x: FloatArray, v: FloatArray) -> None:
    """Raise SceneError where x (nx,), v (nv,) lie beyond a switch for the side that x tells.  Collective."""
    if not scene.switches:
        return
    numbers = switch_numbers(scene, scene.switches, t, x, v)
    for switch, number in zip(scene.switches, numbers, strict=True):
        if number * x[switch.place] < 0.0:
            raise SceneError(
                f"the equilibrium found lies beyond the switch of {switch.name}, where its law is another; there may "
                "be one on the other side: start there"
            )
