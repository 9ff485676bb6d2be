"""Rows of users' state equations, and which loads their outputs set."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

from flexmbd.errors import SceneError
from flexmbd.multibody.force.protocol import StateEquations, SwitchValue
from flexmbd.multibody.functions.signal import Signal
from flexmbd.multibody.functions.switched import Switched
from flexmbd.multibody.functions.time_function import TimeRow
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.elements.state_rates import OF_TIME
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


def set_loads(
    states: StateEquations, times: Sequence[TimeRow], forces: Sequence[Sequence[int]],
    elements: Sequence[Sequence[int]], followed: frozenset[int],
) -> list[tuple[int, int]]:  # fmt: skip
    """Of each load that the outputs set the output and the row of ``Plan.times``.

    Raises:
        SceneError: states follow what they set, or a signal does not load a joint's coordinate.
    """
    loads, loading = [], {row[at.FORCE_TIME] for row in forces}
    for j, signal in enumerate(states.inputs):
        places = [k for k, row in enumerate(times) if row.signal is signal]
        for k in places:
            if k in followed:
                raise SceneError(
                    f"{states.what}: states follow the signal {signal.name!r}, which they set; write the equations of "
                    "both as one"
                )
            if k not in loading or any(row[at.EL_TIME] == k for row in elements):
                raise SceneError(
                    f"{states.what}: the signal {signal.name!r} can only be the value of a JointTorque or "
                    "JointForce on a joint that has a coordinate (way=fm.Way.COORDINATES)"
                )
        if not places:
            raise SceneError(f"{states.what}: no load of the scene has the signal {signal.name!r}")
        loads += [(j, k) for k in places]
    return loads
