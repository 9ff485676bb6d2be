"""Readers of the elements of exact beams: their strains, and a plan in which these are slack elsewhere."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.kernels.algebra.so3 import store3
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.arrays import Plan
from flexmbd.multibody.kernels.base.compiling import entry_kernel
from flexmbd.multibody.kernels.elements.beam_wrench import BEAM_ELEMENT, REST, strain_and_rate
from flexmbd.multibody.kernels.elements.table import are_of
from flexmbd.multibody.kernels.inverse_dynamics.closure import relative_rates
from flexmbd.multibody.kernels.inverse_dynamics.recursion import forward_kinematics
from flexmbd.multibody.kernels.reading.force_tables import without_loads

FloatArray = NDArray[np.float64]


def beam_elements_alone(plan: Plan) -> Plan:
    """The plan with no other force elements than those of exact beams, and without gravity."""
    kept = plan.elements[are_of(plan, BEAM_ELEMENT)]
    return without_loads(plan).replace(elements=kept)


@entry_kernel
def beam_strains(plan, work, x, v, rest, out):
    """Fill ``out`` (2, k, 6) with the strains of each element, m and rad, and their rates.

    ``plan`` is of ``beam_elements_alone``; ``rest`` (nv,) are zeros.

    Args:
        plan: Plan, the compiled scene.
        work: Work, its work arrays.
        x: (nx,) float64, configuration.
        v: (nv,) float64, velocities.
        rest: (nv,) float64, zeros.
        out: (2, k, 6) float64, output.
    """
    forward_kinematics(plan, work, x, v, rest)
    for i in range(plan.elements.shape[0]):
        row = plan.elements[i]
        motion = relative_rates(plan, work, row[at.EL_F], row[at.EL_G])
        found = strain_and_rate(row, plan.data, *motion)
        for part in range(2):
            store3(out[part, i], 0, found[2 * part])
            store3(out[part, i], 3, found[2 * part + 1])


def slack_elsewhere(plan: Plan, shift: FloatArray) -> Plan:
    """The plan with each element slack at other strains, those at hand plus a shift (k, 6)."""
    data = plan.data.copy()
    for row, by in zip(plan.elements, shift, strict=True):
        first = int(row[at.EL_DATA]) + REST
        data[first : first + 6] += by
    return plan.replace(data=data)
