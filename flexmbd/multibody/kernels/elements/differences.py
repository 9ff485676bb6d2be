"""Central differences, where nobody gives a derivative: their step, and states moved by it.

A difference quotient (f(h) - f(-h)) / 2 h of values known to half a rounding misses h^2 f''' / 6 of the derivative and
eps f / 2 h of the values (Nocedal & Wright 2006, section 8.1).  Of a function that changes by its own size over a
length L, f''' = f / L^3, both together are least for h^3 = 3 eps L^3 / 2.
"""

from __future__ import annotations

import sys

from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.physics.joints import retract

#: Of the length over which a function changes.
STEP = (1.5 * sys.float_info.epsilon) ** (1.0 / 3.0)


@kernel
def difference_step(per_x, per_v, size_x, size_v):
    """How far along (per_x, per_v) the larger of the changes is `STEP` of its size; 0 where there is no direction."""
    share = 0.0
    if per_x != 0.0:
        share = abs(per_x) / size_x
    if per_v != 0.0:
        share = max(share, abs(per_v) / size_v)
    return STEP / share if share > 0.0 else 0.0


@kernel
def put_moved_state(plan, tw, x, v, k, along_x, along_v):
    """Write into ``tw.moved_x`` and ``tw.moved_v`` the state with unknown k moved: its place and its rate."""
    for j in range(v.shape[0]):
        tw.moved_v[j] = v[j]
        tw.move[j] = 0.0
    tw.moved_v[k] += along_v
    tw.move[k] = along_x
    retract(plan, x, tw.move, tw.moved_x)
