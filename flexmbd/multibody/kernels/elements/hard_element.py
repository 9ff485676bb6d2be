"""A sphere or a point that a shape lets in nowhere: no force, but impulses, which a method solves for.

Numbers: the shape's (``contact.signed_distance``), then those whose places have names below.
"""

from __future__ import annotations

from flexmbd.multibody.kernels.algebra.so3 import add3, cross3, load3, rotate
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.contact.contact_law import time_to_pass
from flexmbd.multibody.kernels.contact.signed_distance import SHAPE_NUMBERS, distance
from flexmbd.multibody.kernels.elements.element import Behaviour, FrameElement

#: Places of the numbers: the sphere's radius (m); the coefficients of restitution and of friction, and 1 where the law
#: of impact is Poisson's, else 0; the sphere's centre in the axes of its own frame G (3, m).
RADIUS, RESTITUTION, FRICTION, POISSON, CENTRE = range(SHAPE_NUMBERS, SHAPE_NUMBERS + 5)
#: Columns of a law.
LAW_RESTITUTION, LAW_FRICTION, LAW_POISSON, N_LAW = range(4)


@kernel
def _no_wrench(plan, work, row, d, R, rate, spin):
    return (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)


@kernel
def _bound_step(plan, work, row, d, R, rate, spin):
    """No wrench; it bounds the next step by the time in which the sphere cannot pass through the shape."""
    o = row[at.EL_DATA]
    arm = rotate(R, load3(plan.data, o + CENTRE))
    gap, n = distance(plan.data, o, add3(d, arm))
    longest = time_to_pass(plan.data, o, gap - plan.data[o + RADIUS], n, add3(rate, cross3(spin, arm)))
    plan.horizon[0] = min(plan.horizon[0], longest)
    return _no_wrench(plan, work, row, d, R, rate, spin)


#: What it means where a contact, smooth or hard, has no direction.
CENTRED = (
    "the centre of what touches is in the middle of the shape, from where no side is nearer than the others, so that "
    "no force has a direction: begin with them apart, or take a stiffer law if they were pressed together"
)

HARD_CONTACT = FrameElement(Behaviour("hard contacts", hard=True, lets_go=True, undefined=CENTRED), _bound_step)

#: The same of groups of shapes, whose points are found in each step.  Numbers: its law, the row of ``Plan.frames``
#: of each of its shapes, of which there are EL_COUNT, and what tells the shapes.
HARD_GROUP = FrameElement(Behaviour("groups of hard contacts", hard=True, lets_go=True), _no_wrench)
GROUP_FRAMES = N_LAW
