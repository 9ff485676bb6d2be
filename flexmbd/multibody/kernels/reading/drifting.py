"""Which coordinates of a plan nothing asks for: a step is not bounded by how fast these change."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.arrays import Plan
from flexmbd.multibody.kernels.contact.signed_distance import BOX, CAPSULE, CYLINDER, HALF_SPACE, SPHERE
from flexmbd.multibody.kernels.elements.contact_wrench import HEAD
from flexmbd.multibody.kernels.elements.element import Behaviour
from flexmbd.multibody.kernels.elements.surface_forces import ELASTIC_SURFACE, ROUGH_SURFACE
from flexmbd.multibody.kernels.elements.surface_layout import SHAPE
from flexmbd.multibody.kernels.elements.table import behaviours, kind_of

IntArray = NDArray[np.int64]

_CONVEX = (SPHERE, CAPSULE, CYLINDER, BOX, HALF_SPACE)


def drifting_velocities(plan: Plan) -> IntArray:
    """(k,) velocities of joints on the ground, where no row and no force but those of time and of contacts acts.

    The equations are the same wherever along such a coordinate that adds the machine is, but for contacts, which bound
    a step by their gap.  Of shapes that are not convex the nearest point does not say what lies ahead: then there are
    none.
    """
    asks = len(plan.rows) + len(plan.penalties) > 0
    for row, one in zip(plan.elements, behaviours(plan), strict=True):
        asks = asks or not (one.given or _is_convex_contact(plan, row, one))
    roots = plan.tree[plan.tree[:, at.PARENT] < 0] if not asks else plan.tree[:0]
    found = [np.arange(link[at.JOINT_V], link[at.JOINT_V] + link[at.JOINT_ADDS]) for link in roots]
    velocities = np.concatenate([np.zeros(0, np.int64), *found])
    return velocities[~np.isin(velocities, plan.driven[:, at.DRIVEN_V])]


def _is_convex_contact(plan: Plan, row: IntArray, behaviour: Behaviour) -> bool:
    if not behaviour.lets_go or behaviour.hard:
        return False
    o = int(row[at.EL_DATA])
    if row[at.EL_KIND] in (kind_of(ELASTIC_SURFACE), kind_of(ROUGH_SURFACE)):
        return int(plan.data[o + SHAPE]) in _CONVEX
    return int(plan.data[o + HEAD + int(plan.data[o]) + int(plan.data[o + 1]) + 1]) in _CONVEX
