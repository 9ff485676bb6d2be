"""Predictors of an energy-momentum step's velocities and reactions, by what the last steps were.

``s`` is an ``EnergyMomentumWorkspace``.
"""

from __future__ import annotations

import numpy as np

from flexmbd.integrate import state as st
from flexmbd.integrate.discrete_gradient.workspace import KNOWN_STEPS, PREDICTOR, REACTION, REMEMBERED, SPEED
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.reading.plan_entries import driven_place

# Predictors of a step's velocities: zero; those at its start, changed by half a step's acceleration; the last step's,
# changed by a step's acceleration, unchanged, on a line, and on a parabola.
ZERO, ACCELERATED, LEAP, UNCHANGED, LINE, PARABOLA = range(6)


@kernel
def _predict(state, k, h, predictor):
    """Velocity k of the next step by one of the predictors named above."""
    memory = state.memory
    if predictor == ZERO:
        return 0.0
    if predictor == ACCELERATED:
        return state.v[k] + 0.5 * h * state.a[k]
    guess = memory[SPEED, k]
    if predictor == LEAP:
        return guess + h * state.a[k]
    if predictor == LINE or predictor == PARABOLA:
        guess += memory[SPEED, k] - memory[SPEED + 1, k]
    if predictor == PARABOLA:
        guess += memory[SPEED, k] - 2.0 * memory[SPEED + 1, k] + memory[SPEED + 2, k]
    return guess


@kernel
def first_guess(plan, state, s, h, start):
    """Write the predictor: the best one for the last step, then in turn those for unresolved vibrations.

    Returns whether it is near enough for the energy's correction.
    """
    free = plan.free.shape[0]
    known = state.counts[KNOWN_STEPS]
    equal = known > 0 and state.numbers[st.STEP_BEFORE] == h
    predictor = ACCELERATED
    if start == 0 and equal:
        predictor = state.counts[PREDICTOR]
    elif start == 1 and known > 0:
        predictor = UNCHANGED
    elif start == 3:
        predictor = ZERO
    for j in range(free):
        s.unknown[j] = _predict(state, plan.free[j], h, predictor)
    for i in range(s.nu.shape[0]):
        nu = state.multipliers[i]
        if start == 0 and equal and known > 2:
            memory = state.memory
            nu = 3.0 * (memory[REACTION, i] - memory[REACTION + 1, i]) + memory[REACTION + 2, i]
        s.unknown[free + i] = 0.5 * h * nu
    for i in range(plan.driven.shape[0]):
        in_x, in_v = driven_place(plan.driven[i])
        s.u[in_v] = (s.driven[i, 0] - state.x[in_x]) / h
    for k in range(s.v_end.shape[0]):
        s.v_end[k] = state.v[k]
    for j in range(free):
        k = plan.free[j]
        s.v_end[k] = 2.0 * s.unknown[j] - state.v[k]
    return start == 0 and equal


@kernel
def remember(plan, state, s, h):
    """Keep the step's velocities and multipliers as the latest, and the predictor that would have been best for them.

    Those of steps of another length are dropped.  ``state`` must still be the step's start.
    """
    memory = state.memory
    count = state.counts
    if state.numbers[st.STEP_BEFORE] != h:
        count[KNOWN_STEPS] = 0
    least = np.inf
    for predictor in range(ACCELERATED, UNCHANGED + count[KNOWN_STEPS] if count[KNOWN_STEPS] > 0 else LEAP):
        error = 0.0
        for j in range(plan.free.shape[0]):
            k = plan.free[j]
            part = (_predict(state, k, h, predictor) - s.u[k]) / s.scale_v[k]
            error += part * part
        if error < least:
            least = error
            count[PREDICTOR] = predictor
    count[KNOWN_STEPS] = min(REMEMBERED, count[KNOWN_STEPS] + 1)
    for row in range(REMEMBERED - 1, 0, -1):
        for k in range(s.u.shape[0]):
            memory[SPEED + row, k] = memory[SPEED + row - 1, k]
        for i in range(s.nu.shape[0]):
            memory[REACTION + row, i] = memory[REACTION + row - 1, i]
    for k in range(s.u.shape[0]):
        memory[SPEED, k] = s.u[k]
    for i in range(s.nu.shape[0]):
        memory[REACTION, i] = s.nu[i]
