"""The forces of elastic surfaces that touch, of one alone or of a group whose bodies give way under all of them.

Of a group the first row of ``Plan.elements`` does what all of its rows do; of a plan that has one of them alone, this
is alone.
"""

from __future__ import annotations

from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.block_view import matrix_view
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.deferred import INTEGER, deferred_kernel
from flexmbd.multibody.kernels.elements import surface_groups as sg
from flexmbd.multibody.kernels.elements import surface_layout as sl
from flexmbd.multibody.kernels.elements.surface_forces import (
    find_gaps,
    near_patches,
    set_forces,
    tell_undefined,
    write_directions,
)
from flexmbd.multibody.kernels.elements.table import is_of_surface
from flexmbd.multibody.kernels.inverse_dynamics.closure import relative_rates


@kernel
def _modes_of_body(plan, f):
    link = plan.tree[plan.frame_of[f, at.FRAME_BODY]]
    n = plan.flex[link[at.FLEX], at.N_MODES] if link[at.FLEX] >= 0 else 0
    return link[at.MODAL_X], link[at.MODAL_V], n


@kernel
def modes_of(plan, row):
    """Where the modes of a surface's body stand in x and in v, and how many there are."""
    if sl.table_of(plan, row)[2] == 0:  # a rigid sphere, on whatever body
        return 0, 0, 0
    return _modes_of_body(plan, row[at.EL_G])


@kernel
def other_modes_of(plan, row):
    """The same of the other surface's; none where there is none."""
    if plan.data[row[at.EL_DATA] + sl.OTHER] < 0.0:
        return 0, 0, 0
    return _modes_of_body(plan, row[at.EL_F])


@kernel
def is_of_group(plan, row, g):
    """Whether a row is a member of group g."""
    return is_of_surface(row[at.EL_KIND]) and sg.group_of(plan, row) == g


@kernel
def role(plan, row):
    """Of a row of a surface: 0 if it is alone in the plan, 1 if it is the first of its group, else 2."""
    g = sg.group_of(plan, row)
    if g < 0:
        return 0
    own = min(row[at.EL_NUMBER], plan.elements.shape[0] - 1)  # or before, of a plan that has but some of the rows
    while plan.elements[own, at.EL_NUMBER] != row[at.EL_NUMBER]:
        own -= 1
    for e in range(own - 1, -1, -1):
        if is_of_group(plan, plan.elements[e], g):
            return 2
    for e in range(own + 1, plan.elements.shape[0]):
        if is_of_group(plan, plan.elements[e], g):
            return 1
    return 0


#: What ``press_group`` returns where one member at most has patches that are near: ``press_patches`` does for each.
APART = -2


@kernel
def _near(plan, work, row, x, deep):
    """As ``near_patches``, and R."""
    d, R, _, _ = relative_rates(plan, work, row[at.EL_F], row[at.EL_G])
    qx, _, n = modes_of(plan, row)
    rx, _, k = other_modes_of(plan, row)
    slots, least = near_patches(plan, work, row, d, R, x[qx : qx + n], x[rx : rx + k], deep)
    return slots, least, R


@kernel
def _count_near(plan, work, g, x, deep):
    """How many members have near patches."""
    count = 0
    for e in range(plan.elements.shape[0]):
        if is_of_group(plan, plan.elements[e], g):
            slots, _, _ = _near(plan, work, plan.elements[e], x, deep)
            count += 1 if slots > 0 else 0
    return count


@deferred_kernel(INTEGER)
def press_group(plan, work, g, x):
    """Find the forces of all members at the configuration x, whose kinematics ``work`` has; how many bear.

    -1 where there are none, which is a fault; or ``APART``.
    """
    members, deep, m = sg.of_group(plan, g, sg.N_MEMBERS), 0.0, 0
    known = matrix_view(work.generalized, sg.of_group(plan, g, sg.MEMBERS), members + 1, sg.N_KNOWN)
    last = known[members]
    last[sg.BEARING] = -1.0
    for e in range(plan.elements.shape[0]):
        row = plan.elements[e]
        if is_of_group(plan, row, g):
            _, least, R = _near(plan, work, row, x, 0.0)
            for c in range(9):
                known[sg.number_in_group(plan, row), sg.ROTATION + c] = R[c]
            if least != least:
                return -1
            deep = max(deep, -least)
    last[sg.DEEP] = deep
    if not deep > 0.0 or _count_near(plan, work, g, x, deep) < 2:
        return APART
    overlap = False
    for e in range(plan.elements.shape[0]):
        row = plan.elements[e]
        if is_of_group(plan, row, g):
            d, R, _, _ = relative_rates(plan, work, row[at.EL_F], row[at.EL_G])
            slots, overlaps, _ = _gaps(plan, work, row, d, R, x, deep)
            overlap = overlap or overlaps
            m = sg.gather_contacts(plan, work, row, g, slots, m)
    count = sg.press_contacts(plan, work, g, m if overlap else 0)
    last[sg.BEARING] = count
    sg.count_bearing(plan, work, g, count)
    return count


@kernel
def _gaps(plan, work, row, d, R, x, deep):
    qx, _, n = modes_of(plan, row)
    rx, _, k = other_modes_of(plan, row)
    return find_gaps(plan, work, row, d, R, x[qx : qx + n], x[rx : rx + k], deep)


@kernel
def member_forces(plan, work, row, d, R, x):
    """As ``press_patches``, of a member whose group has been pressed."""
    g = sg.group_of(plan, row)
    _, p, _ = sl.table_of(plan, row)
    members = sg.of_group(plan, g, sg.N_MEMBERS)
    last = matrix_view(work.generalized, sg.of_group(plan, g, sg.MEMBERS), members + 1, sg.N_KNOWN)[members]
    m, _, least = _gaps(plan, work, row, d, R, x, last[sg.DEEP])
    if last[sg.BEARING] < 0.0:
        tell_undefined(plan, row)
        return m, -1, least
    count = sg.forces_of_member(plan, work, row, g, int(last[sg.BEARING]))
    set_forces(work, p, m, count)
    sg.residuals_of_member(plan, work, row, g, count)
    write_directions(plan, work, row, d, R, count)
    return m, count, least
