"""Contacts that touch at instants of a step, which may let go, and the coordinates that move against them."""

from __future__ import annotations

from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.deferred import deferred_kernel
from flexmbd.multibody.kernels.elements.table import frame_touches, may_touch
from flexmbd.multibody.kernels.inverse_dynamics.force_elements import relative_rates
from flexmbd.multibody.kernels.inverse_dynamics.recursion import forward_kinematics

BEARS, CROSSES = 1.0, 2.0  #: A contact touches throughout the step; it sets in or lets go within it.


@deferred_kernel()
def count_touching(plan, work, x, v, touched):
    """Add one to ``touched`` (ne,) of each contact that touches at x (nx,); v (nv,) are any velocities."""
    forward_kinematics(plan, work, x, v, v)
    for i in range(touched.shape[0]):
        row = plan.elements[i]
        if may_touch(row[at.EL_KIND]):
            d, R, _, _ = relative_rates(plan, work, row[at.EL_F], row[at.EL_G])
            if frame_touches(plan, row, d, R):
                touched[i] += 1.0


@kernel
def _mark_joint(plan, b, mark, held):
    """Mark the velocities of the inboard joint of link b; the link's parent."""
    link = plan.tree[b]
    for k in range(link[at.JOINT_V], link[at.JOINT_V] + link[at.JOINT_SIZE]):
        held[k] = max(held[k], mark)
    return link[at.PARENT]


@deferred_kernel()
def mark_held(plan, touched, instants, held):
    """Write into ``held`` (nv,) BEARS where a coordinate moves a contact that has ``touched`` (ne,), 0 elsewhere.

    CROSSES where the contact has not touched at all of the ``instants``.  Coordinates of the joints between both bodies
    along the tree; all where loops link them.
    """
    for k in range(held.shape[0]):
        held[k] = 0.0
    for i in range(touched.shape[0]):
        if touched[i] == 0.0:
            continue
        mark = BEARS if touched[i] == instants else CROSSES
        if plan.rows.shape[0] > 0:
            for k in range(held.shape[0]):
                held[k] = max(held[k], mark)
            continue
        row = plan.elements[i]
        b = plan.frame_of[row[at.EL_F], at.FRAME_BODY]
        c = plan.frame_of[row[at.EL_G], at.FRAME_BODY]
        while b != c:  # parents come before children, the ground is -1
            if b > c:
                b = _mark_joint(plan, b, mark, held)
            else:
                c = _mark_joint(plan, c, mark, held)
