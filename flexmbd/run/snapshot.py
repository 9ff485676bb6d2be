"""Where an integration stands: its state, the scales of its error, its method's memory; at the start, and in copies."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmbd.integrate import state as st
from flexmbd.integrate.protocol import Integrator
from flexmbd.multibody.interiors.scene_interiors import NO_INTERIORS, InteriorSnapshot
from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.reading.drifting import drifting_velocities
from flexmbd.multibody.kernels.reading.force_tables import can_vibrate, has_smooth_contacts, stiffness_may_change
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.start.consistent_start import Start
from flexmbd.run.event import NO_EVENTS, EventMemory
from flexmbd.run.limits import MOST_ROWS
from flexmbd.run.sampling import NO_SAMPLING, SamplingMemory

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_LEAST_TURN = 1e-5  # rad of the machine's motion that a fixed step is taken to make at least


@dataclass(frozen=True, eq=False)
class Snapshot:
    """Copies of all that a method remembers, but for the factors of its iteration matrix.

    Attributes:
        state, groups: the copies.
        memory: the method's own arrays (``controller.arrays_of``); none where it has not begun.
        first_step: the step (s) that the integration began with.
        rows: (m,) which of all constraint rows are kept.
        interiors: what bodies with history remember.
        sampling: what controllers remember.
        events: what the search for events remembers.
    """

    state: st.State
    groups: st.Groups
    memory: Mapping[str, NDArray[Any]]
    first_step: float
    rows: IntArray
    interiors: InteriorSnapshot = NO_INTERIORS
    sampling: SamplingMemory = NO_SAMPLING
    events: EventMemory = NO_EVENTS


def new_snapshot(
    start: Start, method: Integrator, *, t_start: float, t_end: float, rtol: float, h: float | None
) -> Snapshot:
    """The state at a consistent start: error control with ``rtol``, or fixed steps ``h`` (s)."""
    scene = start.scene
    number = np.zeros(st.N_NUMBER)
    number[st.TIME], number[st.TIME_END] = t_start, t_end
    bound_by_span(number, t_start=t_start, t_end=t_end, h=h)
    number[st.STABLE_STEP] = np.inf
    number[st.TOLERANCE] = rtol
    number[st.LATEST] = np.inf
    number[st.STEP] = h if h is not None else first_step(scene, number, start.v, start.a, method.order)
    count = np.zeros(st.N_COUNT, np.int64)
    count[st.FIXED_STEP] = h is not None
    count[st.MOST_STORED] = MOST_ROWS
    parts = (start.x.copy(), start.v.copy(), start.a.copy(), start.multipliers.copy())
    number[[st.LASTING, st.LASTING_BEFORE, st.LASTING_AT_END, st.STEP_LASTING]] = float(_vibrates(scene))
    groups = new_groups(scene)
    rows = np.array(start.choice.rows, np.int64)
    return Snapshot(st.State(*parts, number, count), groups, {}, float(number[st.STEP]), rows, kept_interiors(scene))


def bound_by_span(number: FloatArray, *, t_start: float, t_end: float, h: float | None) -> None:
    """Set the longest and the shortest step (s) of a state, which follow from the whole time of a simulation.

    A restart may go on to another end than that of the simulation before it.  With a fixed step h (s) the least rate
    follows from that alone, so that no step depends on where the simulation ends.
    """
    span = t_end - t_start
    number[st.STEP_FLOOR_SIZE] = max(1e-12 * span, 16.0 * math.ulp(max(abs(t_start), abs(t_end))))
    number[st.STEP_CEILING] = 0.1 * span
    number[st.LEAST_RATE] = 1.0 / span if h is None else _LEAST_TURN / h


def new_groups(scene: CompiledScene) -> st.Groups:
    """The scales of a scene's error, of which nothing has been met yet."""
    n = len(scene.group_floor)
    elastic = len(scene.plan.flex) > 0 or scene.interiors is not None
    ne = len(scene.plan.elements) if _vibrates(scene) and stiffness_may_change(scene.plan) and not elastic else 0
    met = (*np.zeros((4, n)), *np.zeros((2, n, 2)))
    softest = np.full((2, ne, 2), np.inf)
    lets_go = has_smooth_contacts(scene.plan) and not elastic
    contacts = len(scene.plan.elements) if lets_go else 0
    gaps = np.zeros((2, contacts, 2))
    held = [np.zeros(contacts), *gaps, np.zeros(scene.nv if lets_go else 0), _drifts(scene)]
    return st.Groups(scene.group_of, scene.group_kind, scene.group_full, scene.group_floor, *met, *softest, *held)


def _drifts(scene: CompiledScene) -> FloatArray:
    """(ng,) 1 of the groups of lengths whose coordinates all drift."""
    drifting = np.isin(np.arange(scene.nv), drifting_velocities(scene.plan))
    held = np.zeros(len(scene.group_full), bool)
    held[scene.group_of[~drifting]] = True
    return (~held & (scene.group_kind == kinds.GROUP_LENGTH)).astype(float)


def _vibrates(scene: CompiledScene) -> bool:
    # joints of elastic bodies vibrate with these, which lasts whatever an element does
    return len(scene.plan.flex) > 0 or scene.interiors is not None or can_vibrate(scene.plan)


def first_step(scene: CompiledScene, numbers: FloatArray, v: FloatArray, a: FloatArray, order: int) -> float:
    """A step (s) that the method's starting error does not show in: the rate is the machine's."""
    free, least = scene.plan.free, float(numbers[st.LEAST_RATE])
    rate = float(st.starting_rate(free, scene.group_of, scene.group_full, v, a, least))
    return float(0.1 * float(numbers[st.TOLERANCE]) ** (1.0 / order) / rate)


def kept_interiors(scene: CompiledScene) -> InteriorSnapshot:
    """The states of bodies with history."""
    return NO_INTERIORS if scene.interiors is None else scene.interiors.snapshot(scene.plan)


def copied_state(state: st.State) -> st.State:
    """Its arrays copied."""
    return state.replace(**{name: part.copy() for name, part in state.fields().items()})


def copied_groups(groups: st.Groups) -> st.Groups:
    """Their arrays copied."""
    return groups.replace(**{name: part.copy() for name, part in groups.fields().items()})
