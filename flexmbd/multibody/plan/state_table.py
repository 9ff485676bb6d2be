"""Rows of what has states: users' equations, and forces with states of their own."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.errors import SceneError
from flexmbd.multibody.bodies.body import Frame
from flexmbd.multibody.force.protocol import Force, StateEquations, SwitchValue, WithStates
from flexmbd.multibody.force.states import state_sizes
from flexmbd.multibody.functions.callback import StateRates
from flexmbd.multibody.functions.compiled_function import Compiled, Signature
from flexmbd.multibody.functions.switched import Switched
from flexmbd.multibody.functions.time_function import TimeFunction
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.contact.bristle import N_KEPT, N_KEPT_TURNING, TURN
from flexmbd.multibody.kernels.elements.contact_wrench import CONTACT, ROUGH_CONTACT
from flexmbd.multibody.kernels.elements.frame_states import FRAME_STATES, frame_states_scratch
from flexmbd.multibody.kernels.elements.hard_element import HARD_CONTACT, HARD_GROUP
from flexmbd.multibody.kernels.elements.state_rates import OF_TIME, STATES
from flexmbd.multibody.plan.numbering import Numbering
from flexmbd.multibody.plan.state_loads import (
    Quantities,
    StateEquationRows,
    followed_times,
    loads_on_frames,
    loads_on_modes,
    refuse_set_twice,
    set_loads,
)
from flexmbd.multibody.scene_index import StatePlaces

FloatArray = NDArray[np.float64]

_SLID, _TURNED = ("slid x", "slid y", "slid z"), ("turned x", "turned y", "turned z")
# what a rough contact remembers (``kernels.contact.bristle``); names with an underscore are not told
_KEPT = ("stretch x", "stretch y", "stretch z", *(f"_{k}" for k in range(3, N_KEPT)))
_KEPT_TURNING = (*_KEPT, "turn x", "turn y", "turn z", *(f"_{k}" for k in range(TURN + 3, N_KEPT_TURNING)))


class StateTable(ABC):
    """The part of ``ForceTable`` that has to do with states; ``force`` is the one at hand."""

    forces: list[list[int]]
    elements: list[list[int]]
    _numbering: Numbering

    def __init__(self) -> None:
        self._states: list[StateEquationRows] = []
        self._links: list[tuple[int, int]] = []
        self._followed: list[Quantities] = []
        self._force: Force | None = None

    @abstractmethod
    def _note_breaks(self, function: Any, what: str) -> Any: ...

    @abstractmethod
    def numbers(self, *given: Any, **named: Any) -> int:
        """As of ``ElementTable``, and so are those that follow."""

    @abstractmethod
    def time(self, *given: Any, **named: Any) -> int:
        """Row of ``Plan.times``."""

    @abstractmethod
    def frame(self, *given: Any, **named: Any) -> int:
        """Row of ``Plan.frames``."""

    @abstractmethod
    def side(self, *given: Any, **named: Any) -> int:
        """Place in x of the side of a switch."""

    @abstractmethod
    def late_memory(self, names: Sequence[str]) -> int:
        """Place in x of a memory of zeros of the row that comes next; -1: not known before all states are."""

    @abstractmethod
    def element(self, *given: Any, **named: Any) -> None:
        """Append a row of ``Plan.elements``."""

    def frame_states(
        self,
        law: Compiled,
        what: str,
        frame_F: Frame,
        frame_G: Frame,
        *,
        states: Mapping[str, float],
        scale: ArrayLike = 1.0,
        numbers: ArrayLike = (),
        inputs: Sequence[TimeFunction] = (),
    ) -> None:
        """Let a law of one's own with states act between two frames."""
        names = "t, data, z, u, d, R, rate, spin, out"
        law = checked_law(self._note_breaks(law, what), what, Signature.FRAME_STATES, names)
        sizes, initial = state_sizes(scale, states, what)
        times = [self.time(one, f"input {k} of {what}") for k, one in enumerate(inputs)]
        self.follow(times)
        first, link = self._add_links(what, tuple(states), initial, sizes)
        n, values = len(initial), flat(numbers)
        data = self.numbers([n, len(times), link, *sizes, *times, len(values), *values])
        self.element(
            FRAME_STATES, what, f=self.frame(frame_F), g=self.frame(frame_G), v=first, data=data,
            count=frame_states_scratch(n, len(times)), address=self._numbering.add_compiled(law),
        )  # fmt: skip

    def contact(
        self, what: str, frame_F: Frame, frame_G: Frame, *, numbers: ArrayLike, bristle: float | None,
        turn: float | None = None, remembers: bool = False,
    ) -> None:
        """Let a shape on F and a sphere that G carries touch."""
        values = flat(numbers)
        names = () if bristle is None else _SLID if turn is None else (*_SLID, *_TURNED)
        scales = [bristle or 1.0] * len(_SLID) + [turn or 1.0] * len(_TURNED)
        sizes, initial = state_sizes(scales[: len(names)] or 1.0, dict.fromkeys(names, 0.0), what)
        first, link = self._add_links(what, names, initial, sizes)
        n = len(initial)
        data = self.numbers([n, 0, link, *sizes, len(values), *values])
        remembers = remembers or bristle is not None
        kept = () if not remembers else _KEPT if turn is None else _KEPT_TURNING
        kind = ROUGH_CONTACT if remembers else CONTACT
        f, g = self.frame(frame_F), self.frame(frame_G)
        count = N_KEPT if turn is None else N_KEPT_TURNING
        self.element(kind, what, f=f, g=g, v=first, data=data, count=count, memory=self.late_memory(kept))

    def hard_contact(self, what: str, frame_F: Frame, frame_G: Frame, *, numbers: ArrayLike) -> None:
        """Let a shape on F and a sphere that G carries touch without entering each other."""
        f, g = self.frame(frame_F), self.frame(frame_G)
        self.element(HARD_CONTACT, what, f=f, g=g, data=self.numbers(flat(numbers)))

    def hard_group(self, what: str, frames: Sequence[Frame], *, law: ArrayLike, numbers: ArrayLike) -> None:
        """Let shapes on many frames touch without entering each other."""
        rows = [self.frame(frame) for frame in frames]
        data = self.numbers([*flat(law), *rows, *flat(numbers)])
        self.element(HARD_GROUP, what, f=rows[0], g=rows[-1], data=data, count=len(rows))

    def follow(self, times: Sequence[int]) -> None:
        """Note that states follow functions of time, by their rows."""
        self._followed.append([(OF_TIME, time, 0) for time in times])

    def _add_links(self, what: str, names: tuple[str, ...], initial: FloatArray, scale: FloatArray) -> tuple[int, int]:
        """Links of the states of the force at hand: the first velocity and the first row of ``Plan.tree``; -1: none."""
        if not names:
            return -1, -1
        force = self._force
        if not isinstance(force, WithStates) or force in self._numbering.index.states:
            raise SceneError(
                f"{what}: a force with states of its own is a fm.force.WithStates, and enters them once: {list(names)}"
            )
        link = len(self._numbering.tree)
        called, count = what, 1  # of two alike the second has a number
        while f"{called}.{names[0]}" in self._numbering.names:
            count += 1
            called = f"{what} {count}"
        slots = self._numbering.add_states([f"{called}.{name}" for name in names])
        self._numbering.index.states[force] = StatePlaces(slots, scale, initial, what, ())
        self._links = [(slots.start, link)]
        return slots.start, link

    def compiled_states(self, rates: Compiled, outputs: Compiled | None, n: int, k: int) -> int:
        """Address of compiled state equations of n states and k outputs."""
        from flexmbd.multibody.kernels.base.user_functions import states_function  # and numba

        made = states_function(rates.source, None if outputs is None else outputs.source, n, k)
        self._numbering.callbacks.keep.append(made)
        return int(made.address)

    def python_states(self, equations: StateRates, what: str, size: int) -> int:
        """Address of state equations in Python, which give rates and outputs (size,) in one."""
        return self._numbering.callbacks.of_states(equations, what, size)

    def states(
        self, states: StateEquations, addresses: tuple[int, int], quantities: Quantities, *, whole: bool,
        switch: tuple[Switched, SwitchValue] | None = None,
    ) -> slice:
        """Add a link for each state; the row of their equations comes last, when all loads are known."""
        self._numbering.callbacks.codes.append(states.code)
        slots = self._numbering.add_states(states.state_names)
        self._numbering.index.states[states] = StatePlaces(
            slots, states.scales, states.first, states.what, tuple(states.inputs)
        )
        self._states.append(StateEquationRows(states, slots.start, addresses, tuple(quantities), whole, switch))
        return slots

    def _finish_states(self) -> None:
        """Append the rows of state equations, with the functions of time that their outputs are put in the place of.

        Raises:
            SceneError: two set one signal, one follows what states set, or a signal loads neither a joint's coordinate
                nor frames.
        """
        refuse_set_twice(one.states for one in self._states)
        followed = followed_times([*(one.quantities for one in self._states), *self._followed])
        set_by_states: set[int] = set()
        for one in self._states:
            states, rows = one.states, one.quantities
            loads = set_loads(states, self._numbering.times, self.forces, self.elements, followed)
            n, m, k = len(states.scales), len(rows), len(states.inputs)
            times = {time for _, time in loads}
            set_by_states |= times
            on_modes = loads_on_modes(self.elements, loads)
            on_frames = bool(loads_on_frames(self.elements, times))
            head = [n, m, k, one.whole, len(loads), on_frames, len(on_modes), *states.scales]
            data = self.numbers([*map(float, head), *np.ravel(rows), *np.ravel(loads), *np.ravel(on_modes)])
            side = -1 if one.switch is None else self.side(*one.switch, one.states.what)
            self.element(
                STATES, states.what, v=one.first, data=data, count=2 * n + m + k, address=one.addresses[0],
                derivative=one.addresses[1], side=side,
            )  # fmt: skip
        for number, row in enumerate(loads_on_frames(self.elements, set_by_states)):
            self.elements[row][at.EL_X] = number


def flat(numbers: ArrayLike) -> list[float]:
    """Numbers of any shape in one list."""
    return [*map(float, np.asarray(numbers, dtype=np.float64).ravel())]


def checked_law(function: Any, what: str, signature: Signature, arguments: str) -> Compiled:
    """A compiled function of a signature, or SceneError with the arguments that it should take."""
    if not isinstance(function, Compiled) or function.signature is not signature:
        kind = function.name if isinstance(function, Compiled) else type(function).__name__
        raise SceneError(f"{what}: {kind} must be made by flexmbd.compiled of a function of ({arguments})")
    return function
