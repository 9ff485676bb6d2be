"""A user's law between two frames behind an address, with its derivative behind another one, or by differences.

Its numbers: the share of the rates that the law is given, 1, or 0 where only what it stores counts; then the user's.
The functions behind the addresses: ``user_functions.frame_function``.
"""

from __future__ import annotations

import math

import numpy as np

from flexmbd.multibody.kernels.algebra.so3 import add3, compose, exp_rotation, scale3, sub3
from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.native import call_frame_law
from flexmbd.multibody.kernels.elements.element import Behaviour, FrameElement, Stiffness


@kernel
def _ask(plan, row, address, motion):
    """Force, torque and energy by the function at an address; NaN where the motion is not finite."""
    place = plan.data.ctypes.data + 8 * (row[at.EL_DATA] + 1)
    nothing = (np.nan, np.nan, np.nan)
    total = 0.0
    for one in motion:
        total += one
    if plan.flag[0] != 0 or not math.isfinite(total):
        return nothing, nothing, np.nan
    f0, f1, f2, t0, t1, t2, energy = call_frame_law(address, row[at.EL_COUNT], place, motion)
    if plan.flag[0] == 0 and not math.isfinite(f0 + f1 + f2 + t0 + t1 + t2 + energy):
        plan.flag[0] = kinds.FLAG_ELEMENT + row[at.EL_NUMBER]
    return (f0, f1, f2), (t0, t1, t2), energy


@kernel
def _evaluate(plan, row, d, R, rate, spin):
    share = plan.data[row[at.EL_DATA]]
    u, w = scale3(share, rate), scale3(share, spin)
    motion = d + R + u + w
    return _ask(plan, row, row[at.EL_ADDRESS], motion)


@kernel
def _wrench(plan, work, row, d, R, rate, spin):
    force, torque, _ = _evaluate(plan, row, d, R, rate, spin)
    return force, torque


@kernel
def _variation(plan, work, row, d, R, rate, spin, dd, dtheta, drate, dspin, step):
    if row[at.EL_ADDRESS + 1] != 0:
        share = plan.data[row[at.EL_DATA]]
        u, w = scale3(share, rate), scale3(share, spin)
        du, dw = scale3(share, drate), scale3(share, dspin)
        motion = d + R + u + w + dd + dtheta + du + dw
        force, torque, _ = _ask(plan, row, row[at.EL_ADDRESS + 1], motion)
        return force, torque
    if step == 0.0:
        return (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    turn = exp_rotation(scale3(step, dtheta))
    back = exp_rotation(scale3(-step, dtheta))
    su, sw, sd = scale3(step, drate), scale3(step, dspin), scale3(step, dd)
    force, torque, _ = _evaluate(plan, row, add3(d, sd), compose(turn, R), add3(rate, su), add3(spin, sw))
    before, twist, _ = _evaluate(plan, row, sub3(d, sd), compose(back, R), sub3(rate, su), sub3(spin, sw))
    over = 0.5 / step
    return scale3(over, sub3(force, before)), scale3(over, sub3(torque, twist))


@kernel
def _energy(plan, work, row, d, R, rate, spin):
    _, _, energy = _evaluate(plan, row, d, R, rate, spin)
    return energy


_NAME = "forces of the state, which may be stiff"
FRAME_LAW = FrameElement(Behaviour(_NAME, Stiffness.UNSEEN, calls_user=True), _wrench, _variation)
#: The same of a law that gives its energy: without rates it stores all that it takes.
STORING_FRAME_LAW = FrameElement(
    Behaviour(_NAME, Stiffness.UNSEEN, calls_user=True, damper=(0, 1)), _wrench, _variation, _energy
)
