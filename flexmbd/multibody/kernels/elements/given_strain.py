"""What an element of a beam exerts because a strain at which it is slack is a function of time.

Its resultants are K (xi - rest - r e) + C (xi' - r' e), with r(t) along the unit vector e: those of ``beam_wrench``
less r K e + r' C e, which stand here as a load of their own.  Its numbers: K e (6), C e (6).
"""

from __future__ import annotations

from flexmbd.multibody.kernels.algebra.so3 import add3, left_jacobian_inverse, load3, rotation_vector, scale3
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.elements.beam_wrench import transmitted, transmitted_change
from flexmbd.multibody.kernels.elements.element import Behaviour, FrameElement

_C = 6
_NONE = (0.0, 0.0, 0.0)


@kernel
def _resultants(plan, work, row):
    """r K e + r' C e, as two vectors."""
    o = row[at.EL_DATA]
    value, rate = work.time[row[at.EL_TIME], 0], work.time[row[at.EL_TIME], 1]
    return (
        add3(scale3(value, load3(plan.data, o)), scale3(rate, load3(plan.data, o + _C))),
        add3(scale3(value, load3(plan.data, o + 3)), scale3(rate, load3(plan.data, o + _C + 3))),
    )


@kernel
def _wrench(plan, work, row, d, R, rate, spin):
    n, m = _resultants(plan, work, row)
    return transmitted(rotation_vector(R), d, n, m)


@kernel
def _variation(plan, work, row, d, R, rate, spin, dd, dtheta, drate, dspin, step):
    n, m = _resultants(plan, work, row)
    theta = rotation_vector(R)
    return transmitted_change(theta, left_jacobian_inverse(theta, dtheta), d, dd, n, m, _NONE, _NONE)


GIVEN_STRAIN = FrameElement(Behaviour("given strains of beams"), _wrench, _variation)
