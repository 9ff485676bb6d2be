"""What the interior of a body with history exerts on one of its frames: a row of Plan.wrenches, in F's axes.

F is the inertial frame.  The interior's stiffness enters the equations by its own tangent, not here.
"""

from __future__ import annotations

from flexmbd.multibody.kernels.algebra.so3 import load3
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.elements.element import Behaviour, FrameElement


@kernel
def _wrench(plan, work, row, d, R, rate, spin):
    wrench = plan.wrenches[row[at.EL_COUNT]]
    return load3(wrench, 0), load3(wrench, 3)


INTERIOR_WRENCH = FrameElement(Behaviour("interiors"), _wrench)
