"""Where the states and the numbers of a law between two frames stand, and contact, which is one of them.

A row's numbers: see ``frame_states``.  Contact's answer stands at the beginning of ``work.generalized``: the force on
the sphere, the torque about G's origin, and with friction the rates of its states, how far the surfaces have slid, and
where it resists rolling and spinning how far the sphere has turned, times its radius.
"""

from __future__ import annotations

import math

from flexmbd.multibody.kernels.algebra.so3 import add3, cross3, dot3, load3
from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.contact.bristle import DEPTH, ONSET
from flexmbd.multibody.kernels.contact.contact_law import (
    contact,
    contact_energy,
    contact_variation,
    remember_contact,
)
from flexmbd.multibody.kernels.contact.lowest_point import centre_arm, centre_arm_variation
from flexmbd.multibody.kernels.contact.normal_force import DISSIPATION, RADIUS
from flexmbd.multibody.kernels.contact.resistance import remember_turn, resist, resist_variation, turn_energy
from flexmbd.multibody.kernels.contact.signed_distance import distance
from flexmbd.multibody.kernels.elements.element import Behaviour, FloatArray, FrameElement, Stiffness
from flexmbd.multibody.kernels.elements.hard_element import CENTRED

HEAD = 3  #: Numbers before the scales.
_WRENCH = 6
_RESISTS = 6  # states of a contact that resists rolling and spinning
_ZERO = (0.0, 0.0, 0.0)


@kernel
def state_count(plan, row):
    """How many states the law of a row has."""
    return int(plan.data[row[at.EL_DATA]])


@kernel
def law_numbers(plan, row):
    """Where in ``plan.data`` the numbers of a row's law begin."""
    o = row[at.EL_DATA]
    return o + HEAD + int(plan.data[o]) + int(plan.data[o + 1]) + 1


@kernel
def state_value(plan, work, row, i):
    """State i, of the velocity of its link."""
    o = row[at.EL_DATA]
    return plan.data[o + HEAD + i] * work.body[int(plan.data[o + 2]) + i, at.B_W + 2]


@kernel
def is_contact(row):
    """Whether a row's law is contact."""
    return row[at.EL_ADDRESS] == 0


@kernel
def centre_motion(plan, numbers, d, R, rate, spin):
    """Of a contact the sphere's centre from G's origin, its place and G's rate there, in F's axes."""
    arm = centre_arm(plan.data, numbers, R)
    return arm, add3(d, arm), add3(rate, cross3(spin, arm))


@kernel
def _way(plan, work, row):
    """Whether it is rough; and then what it remembers, where, the time (s), and how far the surfaces have slid (m)."""
    t = work.time[plan.times.shape[0], 0]
    if state_count(plan, row) == 0:
        return False, (work.memory, row[at.EL_MEMORY], t, _ZERO)
    y = state_value(plan, work, row, 0), state_value(plan, work, row, 1), state_value(plan, work, row, 2)
    return True, (work.memory, row[at.EL_MEMORY], t, y)


@kernel
def _turn(plan, work, row):
    """Of a contact that resists rolling and spinning what it remembers, where, the time, how far it has turned (m)."""
    y = state_value(plan, work, row, 3), state_value(plan, work, row, 4), state_value(plan, work, row, 5)
    return work.memory, row[at.EL_MEMORY], work.time[plan.times.shape[0], 0], y


@kernel
def _wrench(plan, work, row, d, R, rate, spin):
    out = work.generalized[: _WRENCH + state_count(plan, row)]
    numbers = law_numbers(plan, row)
    rough, way = _way(plan, work, row)
    arm, place, speed = centre_motion(plan, numbers, d, R, rate, spin)
    longest, bends = contact(plan.data, numbers, rough, way, place, speed, spin, out)
    force = load3(out, 0)
    torque = add3(load3(out, 3), cross3(arm, force))
    if state_count(plan, row) == _RESISTS:
        moment, turns = resist(plan.data, numbers, _turn(plan, work, row), place, speed, spin, out[_WRENCH + 3 :])
        torque, bends = add3(torque, moment), bends or turns
    plan.horizon[0] = min(plan.horizon[0], longest)
    if bends:
        plan.horizon[1] = 1.0
    total, given = force[0] + force[1] + force[2] + torque[0] + torque[1] + torque[2], 0.0
    for k in range(3):
        given += place[k] + speed[k] + spin[k] + way[3][k]
    if plan.flag[0] == 0 and math.isfinite(given) and not math.isfinite(total):
        plan.flag[0] = kinds.FLAG_ELEMENT + row[at.EL_NUMBER]
    return force, torque


@kernel
def _vary(plan, work, row, motion, change, dway, dturn):
    d, R, rate, spin = motion
    dd, dtheta, drate, dspin = change
    out = work.generalized[: _WRENCH + state_count(plan, row)]
    numbers = law_numbers(plan, row)
    rough, way = _way(plan, work, row)
    arm, place, speed = centre_motion(plan, numbers, d, R, rate, spin)
    turned = centre_arm_variation(plan.data, numbers, R, arm, dtheta)
    quicker = add3(drate, add3(cross3(dspin, arm), cross3(spin, turned)))
    motion, moved = (place, speed, spin), add3(dd, turned)
    force = contact_variation(plan.data, numbers, rough, way, motion, (moved, quicker, dspin, dway), out)
    dforce = load3(out, 0)
    dtorque = add3(load3(out, 3), add3(cross3(turned, force), cross3(arm, dforce)))
    if state_count(plan, row) == _RESISTS:
        way, change = _turn(plan, work, row), (moved, quicker, dspin, dturn)
        dtorque = add3(dtorque, resist_variation(plan.data, numbers, way, motion, change, out[_WRENCH + 3 :]))
    return dforce, dtorque


@kernel
def _variation(plan, work, row, d, R, rate, spin, dd, dtheta, drate, dspin, step):
    return _vary(plan, work, row, (d, R, rate, spin), (dd, dtheta, drate, dspin), _ZERO, _ZERO)


@kernel
def contact_by_way(plan, work, row, d, R, rate, spin, i):
    """Change of force and torque by the velocity of state i's link."""
    scale = plan.data[row[at.EL_DATA] + HEAD + i]
    dway = (scale if i == 0 else 0.0, scale if i == 1 else 0.0, scale if i == 2 else 0.0)
    dturn = (scale if i == 3 else 0.0, scale if i == 4 else 0.0, scale if i == 5 else 0.0)
    return _vary(plan, work, row, (d, R, rate, spin), (_ZERO, _ZERO, _ZERO, _ZERO), dway, dturn)


@kernel
def _energy(plan, work, row, d, R, rate, spin):
    numbers = law_numbers(plan, row)
    rough, way = _way(plan, work, row)
    _, place, _ = centre_motion(plan, numbers, d, R, rate, spin)
    energy = contact_energy(plan.data, numbers, rough, way, place)
    if state_count(plan, row) == _RESISTS:
        energy += turn_energy(plan.data, numbers, way, place)
    return energy


@kernel
def _gap(plan, row, d, R, rate, spin):
    numbers = law_numbers(plan, row)
    _, place, speed = centre_motion(plan, numbers, d, R, rate, spin)
    away, n = distance(plan.data, numbers, place)
    return away - plan.data[numbers + RADIUS], dot3(n, speed)


@kernel
def _remember(plan, work, row, x, d, R, rate, spin, t):
    numbers = law_numbers(plan, row)
    rough, (memory, m, _, y) = _way(plan, work, row)
    _, place, speed = centre_motion(plan, numbers, d, R, rate, spin)
    if state_count(plan, row) == _RESISTS:
        _, _, _, turned = _turn(plan, work, row)
        remember_turn(plan.data, numbers, (memory, m, t, turned), place, speed, spin, x)
    remember_contact(plan.data, numbers, rough, (memory, m, t, y), place, speed, spin, x)


def _misplaced(numbers: FloatArray, memory: FloatArray) -> str:
    """A complaint where the loss follows the speed at which the surfaces meet, and they touch without having met."""
    law = numbers[HEAD + int(numbers[0]) + int(numbers[1]) + 1 :]
    depth, met = memory[at.N_MEMORY_HEAD + DEPTH], memory[at.N_MEMORY_HEAD + ONSET]
    if law[DISSIPATION] >= 0.0 or not depth > 0.0 or met > 0.0:
        return ""
    return (
        f"the surfaces overlap by {depth:.3g} m at the start, but a restitution without a speed takes its loss from "
        "that at which they meet: begin apart, or give the law a speed=... (m/s)"
    )


# without states and signals the law's numbers follow the head and their count
_NAME = "contacts, which are stiffer than at the start"
CONTACT = FrameElement(
    Behaviour(
        _NAME, Stiffness.UNSEEN, damper=(HEAD + 1 + DISSIPATION, 1), lets_go=True, undefined=CENTRED
    ), _wrench, _variation, _energy, gap=_gap,
)  # fmt: skip
#: One that remembers: with friction, whose bristle is no potential, or the speed at which the surfaces met.
ROUGH_CONTACT = FrameElement(
    Behaviour(_NAME, Stiffness.UNSEEN, remembers=True, lets_go=True, undefined=CENTRED), _wrench, _variation,
    _energy, _remember, _misplaced, _gap,
)  # fmt: skip
