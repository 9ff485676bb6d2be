"""What a second of a machine costs by each method that the automatic choice weighs: steps needed times cost a step.

Steps are limited by accuracy, as the machine's rates and a method's order say (``machine_rates``), and where a method
is explicit by stability.  The cost of a step follows from counts of what the machine is made of.  The coefficients
were fitted by hand to runs of ``benchmarks/choice.py`` on 23 November 2026, on one core of a Xeon: what counts is their
ratios.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from flexmbd.integrate.machine_rates import MachineRates
from flexmbd.integrate.matrix_choice import radau_matrix
from flexmbd.multibody.kernels.base.arrays import Plan
from flexmbd.multibody.kernels.reading.tree import modal_places, parents


@dataclass(frozen=True)
class StepModel:
    """How the steps of a method follow from rates and rtol, and what one takes.

    Attributes:
        order: by which steps shorten with rtol: an error of (rate h)^order a radian.
        vibration, motion: steps over those for an error of rtol a radian of a vibration, or of the motion.
        contact: steps over the rate of a contact, which no method steps over, however short it is.
        care: the tolerance at which it errs as the others at rtol, over rtol.
        reach: the longest stable step times the fastest rate; infinite where it is implicit.
        dynamics, residuals, factors: evaluations of forward dynamics and of residuals, and factorisations, a step.
        projections: of a step onto the loops.
    """

    order: float
    vibration: float
    motion: float
    contact: float
    care: float
    reach: float
    dynamics: float = 0.0
    residuals: float = 0.0
    factors: float = 0.0
    projections: float = 0.0

    def steps(self, rates: MachineRates, rtol: float) -> float:
        """Steps (1/s) that accuracy and stability ask for."""
        tolerance = self.care * rtol
        seen = rates.amplitudes > tolerance if np.isinf(self.reach) else np.ones(len(rates.amplitudes), bool)
        swings = rates.vibrations[seen] * (rates.amplitudes[seen] / tolerance) ** (1.0 / self.order)
        reversals = _REVERSAL * rates.gripped * rates.motion
        motion = max(self.motion * rates.motion, reversals, self.contact * rates.contact) * rtol ** (-1.0 / self.order)
        return max(motion, self.vibration * float(swings.max(initial=0.0)), rates.fastest / self.reach)


_REVERSAL = 1.5  # steps a radian of the motion, of any method, for each coordinate with a stop or friction

CENTRAL = StepModel(2.0, 0.45, 0.45, 0.05, 0.25, 1.8, dynamics=1.0, projections=3.0)
ORDER_5 = StepModel(4.0, 0.5, 0.15, 0.08, 30.0, 1.0, dynamics=6.0, projections=1.0)
ORDER_8 = StepModel(7.0, 0.5, 0.25, 0.27, 30.0, 3.0, dynamics=12.0, projections=1.0)
RADAU = StepModel(5.0, 0.23, 0.35, 0.18, 1.0, np.inf, residuals=11.0, factors=0.5)
#: Of rigid bodies with stops or friction, where factors serve few steps and corrections, and steps are taken again.
RADAU_GRIPPED = replace(RADAU, residuals=30.0, factors=2.0)

_CUBE = 3.3e-4  # microseconds of LAPACK's real and complex LU, over the order cubed: large ones

@dataclass(frozen=True)
class Counts:
    """What a machine is made of.

    Attributes:
        bodies, modes, rows: how many there are; rows of closed loops.
        carrying: modes of bodies that carry others.
        factor: microseconds of a factorisation by Radau IIA, see ``MatrixChoice``.
    """

    bodies: int
    modes: int
    carrying: int
    rows: int
    factor: float

    def step(self, model: StepModel) -> float:
        """Microseconds of a step."""
        dynamics = 0.3 + 0.12 * self.bodies + 0.033 * self.modes + 0.08 * self.carrying
        closing = self.rows * (0.6 + 0.02 * self.modes)
        residual = 0.6 * dynamics + 0.2 * self.rows
        evaluations = model.dynamics * (dynamics + closing) + model.projections * closing
        return evaluations + model.residuals * residual + model.factors * self.factor


def counts(plan: Plan) -> Counts:
    """Of a compiled scene's plan."""
    carriers = set(parents(plan))
    modes = {place.row: place.v.stop - place.v.start for place in modal_places(plan)}
    carrying = sum(n for row, n in modes.items() if row in carriers)
    orders = radau_matrix(plan).orders
    factor = float(np.maximum(0.036 * orders**2, _CUBE * orders**3).sum())
    return Counts(len(plan.tree), sum(modes.values()), carrying, len(plan.rows), factor)
