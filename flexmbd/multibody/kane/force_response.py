"""How a machine answers forces: its accelerations and reactions at a state, and what unit forces add to them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.kernels.base.arrays import Plan, new_work
from flexmbd.multibody.kernels.forward_dynamics.articulated import forward_dynamics, solve_mass
from flexmbd.multibody.kernels.forward_dynamics.articulated_layout import new_articulated_work
from flexmbd.multibody.kernels.inverse_dynamics.closure import constraints
from flexmbd.multibody.kernels.inverse_dynamics.recursion import forward_kinematics
from flexmbd.multibody.kernels.physics.time_functions import evaluate_times
from flexmbd.multibody.kernels.reading.constraint_tables import constraint_rows
from flexmbd.multibody.kernels.sampling.series import constraint_rates
from flexmbd.round_off import WORTHLESS_PIVOT

FloatArray = NDArray[np.float64]



class UnitResponses(NamedTuple):
    """Accelerations and multipliers: those of the machine as it is, and what each of k forces adds per unit.

    Attributes:
        a, multipliers: (nv,), (m,).
        a_slopes, multiplier_slopes: (k, nv), (k, m).
    """

    a: FloatArray
    multipliers: FloatArray
    a_slopes: FloatArray
    multiplier_slopes: FloatArray


class ForceResponse:
    """The equations of motion of a plan at a state, solved: M a + C^T nu = f, with C a as the loops want it.

    Of loops with redundant rows the smallest multipliers are taken, in the norm of forces and of moments over the
    machine's ``extent`` (m), as for reactions (``redundancy``).
    """

    def __init__(self, plan: Plan, extent: float) -> None:
        self.plan = plan
        self._sizes = np.where(constraint_rows(plan).in_rad, extent, 1.0)  # times a row, all are of one unit
        self.work = new_work(plan)
        self._articulated = new_articulated_work(plan)
        self._nv = len(plan.free) + len(plan.driven)
        self._still, self._each = np.zeros(self._nv), np.eye(self._nv)

    def evaluate(self, t: float, x: FloatArray, v: FloatArray, forces: FloatArray) -> UnitResponses:
        """The answer at time t (s), x (nx,), v (nv,); ``forces`` (k, nv): generalised forces of unit size."""
        plan, m = self.plan, len(self.plan.rows)
        evaluate_times(plan, t, self.work.time)
        a, slopes = np.zeros(self._nv), np.zeros_like(forces)
        forward_dynamics(plan, self.work, self._articulated, x, v, a, np.zeros(m))
        solve_mass(plan, self.work, self._articulated, np.ascontiguousarray(forces), slopes)
        if m == 0:
            return UnitResponses(a, np.zeros(0), slopes, np.zeros((len(forces), 0)))
        rates, yielding = np.zeros((1, self._nv, m)), np.zeros((m, self._nv))
        constraint_rates(plan, self.work, x[None], self._each, self._still, np.zeros((4, m)), rates)
        jacobian = np.ascontiguousarray(rates[0].T)
        solve_mass(plan, self.work, self._articulated, jacobian, yielding)
        values = np.zeros((3, m))
        forward_kinematics(plan, self.work, x, v, a)
        constraints(plan, self.work, *values)
        opening = np.vstack([values[2], slopes @ jacobian.T])
        sizes = self._sizes
        alike = sizes[:, None] * (jacobian @ yielding.T) * sizes
        multipliers = (sizes[:, None] * np.linalg.lstsq(alike, (opening * sizes).T, rcond=WORTHLESS_PIVOT)[0]).T
        return UnitResponses(
            a - multipliers[0] @ yielding, multipliers[0], slopes - multipliers[1:] @ yielding, multipliers[1:]
        )
