"""Which shorter ways the articulated-body recursion takes through a plan, told from the table that it reads."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexmbd.multibody.kernels.base.arrays import Plan
from flexmbd.multibody.kernels.forward_dynamics import articulated_layout as to


@dataclass(frozen=True)
class Shortcuts:
    """Shorter ways of forward dynamics.

    Attributes:
        planar: whether all hinges are parallel, so that the recursion runs in their plane.
        aligned: number of joints whose axes are those of a rigid parent, so that nothing is turned between them.
        joints: number of all joints of the tree, those within a joint of several steps included.
    """

    planar: bool
    aligned: int
    joints: int


def shortcuts(plan: Plan) -> Shortcuts:
    """The ways that ``new_articulated_work(plan)`` chooses."""
    aw = to.new_articulated_work(plan)
    return Shortcuts(
        planar=bool(aw.planar[0]),
        aligned=int(np.sum(aw.link[:, to.FORM] <= to.ALIGNED)),
        joints=len(aw.link),
    )
