"""What an impact loses: D of the normal force, stated, or by the speed at which the surfaces met.

By the speed v at which they met D is that of 1 m/s over v, so that all impacts leave the same share of their speed.  v
is found where the depth, the cubic that has both ends' values and rates, is zero within the step; it is remembered
until they part.
"""

from __future__ import annotations

from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.contact.bristle import DEPTH, DEPTH_RATE, ONSET
from flexmbd.multibody.kernels.contact.normal_force import DISSIPATION

_HALVINGS = 52


@kernel
def speed_at_touch(kept, depth):
    """The speed (m/s) at which the surfaces met that now are ``depth`` (m, and its rate) deep; 0: they do not touch.

    ``kept``: the memory, where the contact's begins, the time (s).  0 also of what was pressed from the start.
    """
    memory, m, t = kept
    if not depth[0] > 0.0:
        return 0.0
    o = m + at.N_MEMORY_HEAD
    begin, duration = memory[o + DEPTH], t - memory[m + at.MEMORY_TIME]
    if begin > 0.0:
        return memory[o + ONSET]
    if not duration > 0.0:
        return max(depth[1], 0.0)
    first, last, grown = duration * memory[o + DEPTH_RATE], duration * depth[1], depth[0] - begin
    second, third = 3.0 * grown - 2.0 * first - last, first + last - 2.0 * grown
    outside, inside = 0.0, 1.0
    for _ in range(_HALVINGS):
        u = 0.5 * (outside + inside)
        if begin + u * (first + u * (second + u * third)) > 0.0:
            inside = u
        else:
            outside = u
    return max((first + inside * (2.0 * second + inside * 3.0 * third)) / duration, 0.0)


@kernel
def dissipation(data, o, kept, depth):
    """D (s/m): the stated one; where that is negative its size is D of 1 m/s, over the speed at which they met."""
    stated = data[o + DISSIPATION]
    if stated >= 0.0:
        return stated
    met = speed_at_touch(kept, depth)
    return -stated / met if met > 0.0 else 0.0
