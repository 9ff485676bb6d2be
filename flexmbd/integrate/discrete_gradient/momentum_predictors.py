"""Predictors of an energy-momentum step's velocities and reactions, by what the last steps were.

``scratch`` is an ``EnergyMomentumWorkspace``.
"""

from __future__ import annotations

import numpy as np

from flexmbd.integrate import state as st
from flexmbd.integrate.discrete_gradient.workspace import REMEMBERED
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.reading.plan_entries import driven_place

# Predictors of a step's velocities: zero; those at its start, changed by half a step's acceleration; the last step's,
# changed by a step's acceleration, unchanged, on a line, and on a parabola.
ZERO, ACCELERATED, LEAP, UNCHANGED, LINE, PARABOLA = range(6)


@kernel
def _predict(state, memory, k, h, predictor):
    """Velocity k of the next step by one of the predictors named above."""
    if predictor == ZERO:
        return 0.0
    if predictor == ACCELERATED:
        return state.v[k] + 0.5 * h * state.a[k]
    guess = memory.speed[0, k]
    if predictor == LEAP:
        return guess + h * state.a[k]
    if predictor == LINE or predictor == PARABOLA:
        guess += memory.speed[0, k] - memory.speed[1, k]
    if predictor == PARABOLA:
        guess += memory.speed[0, k] - 2.0 * memory.speed[1, k] + memory.speed[2, k]
    return guess


@kernel
def first_guess(plan, state, scratch, h, start):
    """Write the predictor: the best one for the last step, then in turn those for unresolved vibrations.

    Returns whether it is near enough for the energy's correction.
    """
    free = plan.free.shape[0]
    known = scratch.memory.known_steps[0]
    equal = known > 0 and state.numbers[st.STEP_BEFORE] == h
    predictor = ACCELERATED
    if start == 0 and equal:
        predictor = scratch.memory.predictor[0]
    elif start == 1 and known > 0:
        predictor = UNCHANGED
    elif start == 3:
        predictor = ZERO
    for j in range(free):
        scratch.unknown[j] = _predict(state, scratch.memory, plan.free[j], h, predictor)
    for i in range(scratch.nu.shape[0]):
        nu = state.multipliers[i]
        if start == 0 and equal and known > 2:
            memory = scratch.memory
            nu = 3.0 * (memory.reaction[0, i] - memory.reaction[1, i]) + memory.reaction[2, i]
        scratch.unknown[free + i] = 0.5 * h * nu
    for i in range(plan.driven.shape[0]):
        in_x, in_v = driven_place(plan.driven[i])
        scratch.u[in_v] = (scratch.driven[i, 0] - state.x[in_x]) / h
    for k in range(scratch.v_end.shape[0]):
        scratch.v_end[k] = state.v[k]
    for j in range(free):
        k = plan.free[j]
        scratch.v_end[k] = 2.0 * scratch.unknown[j] - state.v[k]
    return start == 0 and equal


@kernel
def remember(plan, state, scratch, h):
    """Keep the step's velocities and multipliers as the latest, and the predictor that would have been best for them.

    Those of steps of another length are dropped.  ``state`` must still be the step's start.
    """
    memory = scratch.memory
    if state.numbers[st.STEP_BEFORE] != h:
        memory.known_steps[0] = 0
    least = np.inf
    for predictor in range(ACCELERATED, UNCHANGED + memory.known_steps[0] if memory.known_steps[0] > 0 else LEAP):
        error = 0.0
        for j in range(plan.free.shape[0]):
            k = plan.free[j]
            part = (_predict(state, memory, k, h, predictor) - scratch.u[k]) / scratch.scale_v[k]
            error += part * part
        if error < least:
            least = error
            memory.predictor[0] = predictor
    memory.known_steps[0] = min(REMEMBERED, memory.known_steps[0] + 1)
    for row in range(REMEMBERED - 1, 0, -1):
        for k in range(scratch.u.shape[0]):
            memory.speed[row, k] = memory.speed[row - 1, k]
        for i in range(scratch.nu.shape[0]):
            memory.reaction[row, i] = memory.reaction[row - 1, i]
    for k in range(scratch.u.shape[0]):
        memory.speed[0, k] = scratch.u[k]
    for i in range(scratch.nu.shape[0]):
        memory.reaction[0, i] = scratch.nu[i]
