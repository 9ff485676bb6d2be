"""Readers of single rows of a plan's tables, for the kernels of integrators; inlined, so that they cost nothing.

``row`` is one of ``plan.rows``, ``link`` one of ``plan.tree``, ``flex`` one of ``plan.flex``, ``driven`` one of
``plan.driven``, ``time`` one of ``plan.times``.
"""

from __future__ import annotations

from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import kernel


@kernel
def holds_position(row):
    """Whether a constraint row holds a position; else velocities alone."""
    return row[at.ROW_LEVEL] == kinds.LEVEL_POSITION


@kernel
def is_augmented(row):
    """Whether an augmented Lagrangian enforces a constraint row."""
    return row[at.ROW_ENFORCEMENT] > 0


@kernel
def augmented_stiffness(data, row):
    """Stiffness and damping of an augmented row, in its own unit."""
    o = row[at.ROW_ENFORCEMENT]
    return data[o + at.ENFORCEMENT_STIFFNESS], data[o + at.ENFORCEMENT_DAMPING]


@kernel
def augmented_gap(data, row):
    """The largest gap of an augmented row that counts as closed, in its own unit (m, rad, m/s or rad/s)."""
    return data[row[at.ROW_ENFORCEMENT] + at.ENFORCEMENT_GAP]


@kernel
def augmented_tolerance(data, row):
    """`augmented_gap` divided by the machine's extent, or by 1 rad."""
    return data[row[at.ROW_ENFORCEMENT] + at.ENFORCEMENT_TOLERANCE]


@kernel
def time_of_row(row):
    """Row of ``plan.times`` of the function that a constraint row follows; -1: none."""
    return row[at.ROW_TIME]


@kernel
def joint_of(link):
    """How many coordinates of a link's inboard joint add, and its first entries in x and in v."""
    return link[at.JOINT_ADDS], link[at.JOINT_X], link[at.JOINT_V]


@kernel
def modes_of(link, table):
    """Number of modes of a link, 0 of a rigid one, and their first entries in x and in v; ``table``: plan.flex."""
    n = table[link[at.FLEX], at.N_MODES] if link[at.FLEX] >= 0 else 0
    return n, link[at.MODAL_X], link[at.MODAL_V]


@kernel
def flexible_of(link):
    """Row of ``plan.flex`` of a link; -1 of a rigid one."""
    return link[at.FLEX]


@kernel
def membrane_strains_of(flex):
    """How many membrane strains a flexible body has."""
    return flex[at.N_STRETCH]


@kernel
def has_polynomial(flex):
    """Whether the strain energy of a flexible body has cubic and quartic terms."""
    return flex[at.POLYNOMIAL] >= 0


@kernel
def driven_place(driven):
    """Entries in x and in v of a prescribed coordinate."""
    return driven[at.DRIVEN_X], driven[at.DRIVEN_V]


@kernel
def driven_time(driven):
    """Row of ``plan.times`` of the function that a prescribed coordinate follows."""
    return driven[at.DRIVEN_TIME]


@kernel
def data_place(time):
    """Offset in ``plan.time_data`` and pieces of a piecewise polynomial; 0 pieces of any other function of time.

    One polynomial that holds for all times counts as other.
    """
    pieces = time[at.TIME_COUNT] if time[at.TIME_KIND] == kinds.TIME_PIECEWISE else 0
    return time[at.TIME_OFFSET], (pieces if pieces > 1 else 0)
