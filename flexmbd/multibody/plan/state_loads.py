"""Rows of users' state equations, and which loads their outputs set."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

from flexmbd.errors import SceneError
from flexmbd.multibody.force.protocol import StateEquations, SwitchValue
from flexmbd.multibody.functions.signal import Signal
from flexmbd.multibody.functions.switched import Switched
from flexmbd.multibody.functions.time_function import TimeRow
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.elements.given_on_line import GIVEN_ON_LINE
from flexmbd.multibody.kernels.elements.given_wrench import GIVEN_IN_F, GIVEN_IN_G
from flexmbd.multibody.kernels.elements.modal_force import MODAL_FORCE
from flexmbd.multibody.kernels.elements.state_rates import OF_TIME
from flexmbd.multibody.kernels.elements.table import kind_of
from flexmbd.multibody.scene_index import IdentityMap

Quantities: TypeAlias = Sequence[tuple[int, int, int]]


@dataclass(frozen=True)
class StateEquationRows:
    """State equations, as ``ForceTable.states`` takes them; ``first``: their first place in v."""

    states: StateEquations
    first: int
    addresses: tuple[int, int]
    quantities: Quantities
    whole: bool
    switch: tuple[Switched, SwitchValue] | None


def refuse_set_twice(every: Iterable[StateEquations]) -> None:
    """Raise SceneError where two state equations set one signal."""
    set_by: IdentityMap[Signal, str] = IdentityMap()
    for states in every:
        for signal in states.inputs:
            if signal in set_by:
                raise SceneError(f"{states.what}: {set_by[signal]} set the signal {signal.name!r} already")
            set_by[signal] = states.what


def followed_times(every: Iterable[Quantities]) -> frozenset[int]:
    """Rows of ``Plan.times`` that states follow, by their quantities."""
    return frozenset(row[1] for rows in every for row in rows if row[0] == OF_TIME)


#: Kinds of given forces between frames, whose values functions of time scale.
_GIVEN = tuple(kind_of(one) for one in (GIVEN_IN_F, GIVEN_IN_G, GIVEN_ON_LINE))


def loads_on_frames(elements: Sequence[Sequence[int]], times: Collection[int]) -> list[int]:
    """The rows of ``Plan.elements`` of given forces on frames that are scaled by these functions of time."""
    return [k for k, row in enumerate(elements) if row[at.EL_TIME] in times and row[at.EL_KIND] in _GIVEN]


def loads_on_modes(
    elements: Sequence[Sequence[int]], loads: Sequence[tuple[int, int]]
) -> list[tuple[int, int, int, int, int]]:
    """Of each load on modes that outputs set what ``state_rates`` has."""
    of_modes = [row for row in elements if row[at.EL_KIND] == kind_of(MODAL_FORCE)]
    return [
        (output, row[at.EL_V], row[at.EL_COUNT], row[at.EL_DATA], row[at.EL_X])
        for output, time in loads
        for row in of_modes
        if row[at.EL_TIME] == time
    ]


def set_loads(
    states: StateEquations, times: Sequence[TimeRow], forces: Sequence[Sequence[int]],
    elements: Sequence[Sequence[int]], followed: frozenset[int],
) -> list[tuple[int, int]]:  # fmt: skip
    """Of each load that the outputs set the output and the row of ``Plan.times``.

    Raises:
        SceneError: states follow what they set, or a signal loads neither a joint's coordinate, nor frames, nor modes.
    """
    loads, loading = [], {row[at.FORCE_TIME] for row in forces}
    on_frames = loads_on_frames(elements, range(len(times)))
    loading |= {elements[k][at.EL_TIME] for k in on_frames}
    of_modes = {k for k, row in enumerate(elements) if row[at.EL_KIND] == kind_of(MODAL_FORCE)}
    loading |= {elements[k][at.EL_TIME] for k in of_modes}
    early = of_modes.union(on_frames)
    others = {row[at.EL_TIME] for k, row in enumerate(elements) if k not in early}
    for j, signal in enumerate(states.inputs):
        places = [k for k, row in enumerate(times) if row.signal is signal]
        for k in places:
            if k in followed:
                raise SceneError(
                    f"{states.what}: states follow the signal {signal.name!r}, which they set; write the equations of "
                    "both as one"
                )
            if k not in loading or k in others:
                raise SceneError(
                    f"{states.what}: the signal {signal.name!r} can only be the value of a JointTorque, a JointForce "
                    "or a LineForce, a component of a FrameForce, a DistributedLoad's factor, or a port's voltage"
                )
        if not places:
            raise SceneError(f"{states.what}: no load of the scene has the signal {signal.name!r}")
        loads += [(j, k) for k in places]
    return loads
