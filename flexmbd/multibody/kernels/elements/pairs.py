"""Forces along the lines between all pairs of a group of frames.

Their numbers: the share of the distance's rate that the law is given, 1, or 0 where only what it stores counts; how
many common numbers there are, m, and how many of each frame, k; then the m, the k of each frame in turn, and the
frames' rows in ``Plan.frames``.  EL_COUNT says how many frames.
"""

from __future__ import annotations

import math

import numpy as np

from flexmbd.multibody.kernels.algebra.so3 import add3, dot3, scale3, sub3
from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.native import call_frame_law
from flexmbd.multibody.kernels.elements.differences import STEP
from flexmbd.multibody.kernels.elements.element import Behaviour, PairsElement, Stiffness

_LEAST = 1e-150  # a length that is none
HEAD = 3  # numbers before the common ones


@kernel
def frame_of_pair(plan, row, i):
    """Row of ``Plan.frames`` of the group's frame i."""
    o = row[at.EL_DATA]
    before = int(plan.data[o + 1]) + row[at.EL_COUNT] * int(plan.data[o + 2])
    return int(plan.data[o + HEAD + before + i])


@kernel
def follows_rates(plan, row):
    """Whether the law is given the rates of distances."""
    return plan.data[row[at.EL_DATA]] != 0.0


@kernel
def _attraction(plan, row, i, j, r):
    """Newton's attraction of two bodies (N)."""
    one = plan.frame_of[frame_of_pair(plan, row, i), at.FRAME_BODY]
    other = plan.frame_of[frame_of_pair(plan, row, j), at.FRAME_BODY]
    constant = plan.data[row[at.EL_DATA] + HEAD]
    return constant * plan.rigid[one, at.MASS] / r * plan.rigid[other, at.MASS] / r


@kernel
def _gravity(plan, work, row, i, j, r, rate):
    pull = _attraction(plan, row, i, j, r)
    return -pull, -pull * r


@kernel
def _gravity_slope(plan, work, row, i, j, r):
    return 2.0 * _attraction(plan, row, i, j, r) / r


@kernel
def _users_push(plan, work, row, i, j, r, rate):
    """Of the user's function behind the address (``user_functions.pair_function``); NaN where r is not finite."""
    o = row[at.EL_DATA]
    if plan.flag[0] != 0 or not math.isfinite(r + rate):
        return np.nan, np.nan
    place = plan.data.ctypes.data + 8 * (o + HEAD)
    common, own = plan.data[o + 1], plan.data[o + 2]
    t = work.time[plan.times.shape[0], 0]
    motion = (t, r, plan.data[o] * rate, common + i * own, common + j * own, own)
    push, _, _, _, _, _, energy = call_frame_law(row[at.EL_ADDRESS], int(common), place, motion)
    if plan.flag[0] == 0 and not math.isfinite(push + energy):
        plan.flag[0] = kinds.FLAG_ELEMENT + row[at.EL_NUMBER]
    return push, energy


@kernel
def line(d, rate):
    """Length of d (3,) m, its direction, and the length's rate (m/s)."""
    r = max(math.sqrt(dot3(d, d)), _LEAST)
    n = scale3(1.0 / r, d)
    return r, n, dot3(n, rate)


@kernel
def force_variation(push, slope, r, n, dd):
    """Change of the force ``push`` along n for d + dd, where push changes by ``slope`` with r."""
    along = dot3(n, dd)
    across = scale3(push / r, sub3(dd, scale3(along, n)))
    return add3(scale3(slope * along, n), across)


@kernel
def step_along(step, r, dd):
    """A step of a difference along dd that is short against the distance r, too."""
    size = math.sqrt(dot3(dd, dd))
    return min(step, STEP * r / size) if size > 0.0 else step


GRAVITATION = PairsElement(
    Behaviour("gravitation between bodies", Stiffness.SEEN), _gravity, _gravity_slope, stores=True
)
_NAME = "forces of the state, which may be stiff"
PAIRS_LAW = PairsElement(Behaviour(_NAME, Stiffness.UNSEEN, calls_user=True), _users_push)
#: The same of a law that gives its energy: without rates it stores all that it takes.
STORING_PAIRS_LAW = PairsElement(
    Behaviour(_NAME, Stiffness.UNSEEN, calls_user=True, damper=(0, 1)), _users_push, stores=True
)
