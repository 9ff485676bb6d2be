"""Readers of the elements of exact beams: their strains, and a plan in which these are slack elsewhere."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmbd.beams.pose_logarithm import pose_logarithm
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.arrays import Plan, Work
from flexmbd.multibody.kernels.elements.beam_wrench import BEAM_ELEMENT, REST
from flexmbd.multibody.kernels.elements.table import are_of
from flexmbd.multibody.kernels.reading.evaluated_motion import world_motion
from flexmbd.multibody.kernels.reading.force_tables import without_loads

FloatArray = NDArray[np.float64]


def beam_elements_alone(plan: Plan) -> Plan:
    """The plan with no other force elements than those of exact beams, and without gravity."""
    kept = plan.elements[are_of(plan, BEAM_ELEMENT)]
    return without_loads(plan).replace(elements=kept)


def beam_strains(plan: Plan, work: Work) -> FloatArray:
    """(k, 6) m and rad: logarithm of the pose of the second section in the first, of each element.

    ``plan`` is of ``beam_elements_alone``, ``work`` has its kinematics.
    """
    places, turns = [], []
    for row in plan.elements:
        first, second = (world_motion(plan, work, int(row[end])) for end in (at.EL_F, at.EL_G))
        places.append(first.R.T @ (second.p - first.p))
        turns.append(first.R.T @ second.R)
    return pose_logarithm(np.array(places).reshape(-1, 3), np.array(turns).reshape(-1, 3, 3))


def slack_elsewhere(plan: Plan, shift: FloatArray) -> Plan:
    """The plan with each element slack at other strains, those at hand plus a shift (k, 6)."""
    data = plan.data.copy()
    for row, by in zip(plan.elements, shift, strict=True):
        first = int(row[at.EL_DATA]) + REST
        data[first : first + 6] += by
    return plan.replace(data=data)
