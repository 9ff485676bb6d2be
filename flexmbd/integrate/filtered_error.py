"""The ratio of a filtered local error to the tolerance, for methods of order 2."""

from __future__ import annotations

import numpy as np

from flexmbd.integrate import state as st
from flexmbd.integrate.data_loads import SAMPLED, STRAIGHT
from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base.compiling import kernel

DRIFTING = (0.0, 0.0)  # shares of own rates that are a vibration's, where nothing is


@kernel
def filtered_ratio(plan, state, groups, error_x, error_v, own_rates, rates_before, h, machine_rate, noise, lasting):
    """Largest ratio of the local error (free,) to the tolerance: rtol per radian of the motion that causes it.

    A vibration faster than the machine that lasts is measured per radian of its own, and its velocity by
    its displacement, for its error swings and does not drift.  ``own_rates``, ``rates_before``: (nv,) each coordinate's
    own rate (1/s) as the step shows it, and as the steps before did.  ``noise``: the share of scales that is round-off.
    ``lasting``: (2,) the share of own rates that is a vibration's, of modes and of joints; 0 for what drifts.
    """
    largest = 0.0
    for j in range(plan.free.shape[0]):
        k = plan.free[j]
        g = groups.of[k]
        size = groups.position[g]
        lenient = st.vibrating_share(groups, k, lasting[0], lasting[1])
        own = lenient * st.own_rate(own_rates[k], rates_before[k], machine_rate, h)
        # what changes within the step is one radian at least
        share = min(1.0, h * max(machine_rate, own, lenient * own_rates[k]))
        limit = max(state.numbers[st.TOLERANCE] * share, noise)
        speed = max(st.group_speed(groups, g, machine_rate), own * size)
        # modes that hardly move are differences of the whole motion, with its round-off
        least = st.ROUND_OFF * groups.full[g]
        part = abs(error_v[j]) / max(limit * speed, least * machine_rate)
        # of a vibration the velocity's error suffices, and a state is a velocity
        if groups.kind[g] != kinds.GROUP_MODAL and groups.kind[g] != kinds.GROUP_STATE:
            part = max(part, abs(error_x[j]) / max(limit * size, least))
        if not part <= largest:
            largest = part
            state.counts[st.WORST] = k
    return largest


@kernel
def vibration_rate(groups, k, curve):
    """Coordinate k's own rate (1/s), a vibration's frequency, by half the second derivative of its acceleration."""
    size = groups.acceleration[groups.of[k]]
    return np.sqrt(2.0 * abs(curve) / size) if size > 0.0 else 0.0


@kernel
def _without_loads(plan, groups, own_rates, load, h):
    """Take out of the own rates (nv,) what curvature of loads made of the accelerations.

    ``load``: (1, n) accelerations of the free coordinates by the loads' defects, see ``data_loads.find_defects``.
    """
    for j in range(plan.free.shape[0]):
        k = plan.free[j]
        bent = vibration_rate(groups, k, 6.0 / (h * h) * load[0, j])
        own_rates[k] = np.sqrt(max(0.0, own_rates[k] ** 2 - bent**2))


@kernel
def _missed_impulse(plan, load, h, error_x, error_v):
    """Write the errors (free,) that a step makes by missing these accelerations, see ``_without_loads``."""
    for j in range(plan.free.shape[0]):
        error_v[j] = h * load[0, j]
        error_x[j] = 0.5 * h * h * load[0, j]


@kernel
def misses_no_load(plan, state, groups, error_x, error_v, own_rates, rates_before, h, machine_rate, noise, found):
    """Whether loads that are data change nothing of a ratio, as ``data_loads.find_defects`` has ``found``.

    Arguments as of ``filtered_ratio``.  Where loads are samples that rtol does not ask for, own rates are let go.
    """
    if found == SAMPLED:
        errors = error_x, error_v, own_rates, rates_before
        if filtered_ratio(plan, state, groups, *errors, h, machine_rate, noise, DRIFTING) <= 1.0:
            for k in range(own_rates.shape[0]):
                own_rates[k] = 0.0  # nothing asks whether it vibrates
            return True
    return found == STRAIGHT


@kernel
def ratio_with_loads(
    plan, state, groups, error_x, error_v, own_rates, rates_before, h, machine_rate, noise, lasting, load
):  # fmt: skip
    """The ratio where loads act in the step: what they do is no vibration, and what is missed of them drifts.

    Arguments as of ``filtered_ratio``, whose errors it overwrites; ``load``: see ``_without_loads``.
    """
    errors = error_x, error_v, own_rates, rates_before
    _without_loads(plan, groups, own_rates, load, h)
    seen = filtered_ratio(plan, state, groups, *errors, h, machine_rate, noise, lasting)
    _missed_impulse(plan, load, h, error_x, error_v)
    return max(seen, filtered_ratio(plan, state, groups, *errors, h, machine_rate, noise, DRIFTING))
