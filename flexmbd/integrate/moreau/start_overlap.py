"""Hard shapes that overlap where a run begins, which is told: nothing can be inside of what is hard."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import StartWarning, warn
from flexmbd.integrate.moreau.shape_groups import group_shapes, groups_of
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.round_off import SEVEN_DIGITS

FloatArray = NDArray[np.float64]


def tell_overlap(scene: CompiledScene, begun: FloatArray) -> None:
    """Tell the deepest overlap of a start once; ``begun``: of ``MoreauWorkspace``, whose gap is zero afterwards.

    What is less than a millionth of the machine's extent is the digits of the values given.

    Warns:
        StartWarning: there is one; with the pair, how deep, and what to do.
    """
    gap, begun[0] = float(begun[0]), 0.0
    if not (gap < -SEVEN_DIGITS * scene.extent and scene.parts.team.is_root):
        return
    what = scene.element_names[int(begun[1])]
    if begun[2] >= 0.0:
        shapes = group_shapes(groups_of(scene))
        ends = (shapes[int(k)] for k in begun[2:])
        what += ": " + " and ".join(f"{type(one).__name__} {one.frame.label}" for one in ends)
    warn(
        f"{what} overlap by {-gap:.3g} m at the start, where nothing can be inside of what is hard: the first steps "
        "move them apart without a force, which is no motion of the machine; begin with them apart or touching",
        StartWarning,
        subject=f"overlap of {what}",
    )
