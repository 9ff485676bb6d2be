"""Outputs of a machine that is stepped from outside: quantities measured after each step.

For the stepped machine alone.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.errors import SceneError
from flexmbd.given import refuse_other
from flexmbd.integrate import state as st
from flexmbd.multibody.bodies.body import Frame
from flexmbd.multibody.functions.signal import Signal
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.kernels.reading.force_tables import without_forces
from flexmbd.multibody.kernels.sampling.interface_frames import M_A, M_P, M_V, N_MOTION, frame_motions
from flexmbd.multibody.motion.instant import Instant, measure
from flexmbd.multibody.motion.quantity import ORDERS, Output
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.run.controller import refuse_no_measurement

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
#: What a stepped machine tells: a quantity, or a function of its Instant.
SteppedOutput: TypeAlias = Output | Callable[[Instant], ArrayLike]
#: The values of all outputs (ny,); by the names of a mapping, numbers where there is one and else (k,).
OutputValues: TypeAlias = Any

_FIRST = (M_P, M_V, M_A)  # of a frame's motion, by the order of the derivative


def refuse_no_outputs(given: Sequence[SteppedOutput] | Mapping[str, SteppedOutput]) -> None:
    """Raise SceneError unless all can be told."""
    refuse_other(given, (Sequence, Mapping), "outputs", wanted="a list of quantities, or a mapping of names to them")
    for one in given.values() if isinstance(given, Mapping) else given:
        if isinstance(one, Signal):
            raise SceneError(f"an output cannot be the signal {one.name!r}: give a quantity of the machine")
        refuse_no_measurement(one, "an output")


class SteppedOutputs:
    """The outputs of one stepped machine: coordinates in one go, frames in another, functions one by one."""

    def __init__(
        self, given: Sequence[SteppedOutput] | Mapping[str, SteppedOutput], scene: CompiledScene, now: Instant
    ) -> None:
        """Find them in a scene.

        Args:
            given: as of ``System.stepper``.
            scene: the machine.
            now: by which functions tell how many numbers they give.

        Raises:
            SceneError: one is not in the scene, or a function fails.
        """
        several = tuple(given.values() if isinstance(given, Mapping) else given)
        sizes = [len(measure(one, now)) for one in several]
        ends = np.cumsum([0, *sizes])
        self._places = [slice(int(a), int(b)) for a, b in pairwise(ends)]
        self._size = int(ends[-1])
        self._names = tuple(zip(given, self._places, strict=True)) if isinstance(given, Mapping) else None
        self._functions = [pair for pair in zip(self._places, several, strict=True) if not isinstance(pair[1], Output)]
        self._coordinates = self._of_coordinates(several, scene)
        self._of_frames(several, scene)

    def _of_coordinates(
        self, several: Sequence[SteppedOutput], scene: CompiledScene
    ) -> list[tuple[int, IntArray, IntArray]]:
        """Of x, v and a: which (0, 1, 2), where among the outputs, where in the array."""
        found: dict[int, tuple[list[int], list[int]]] = {}
        for place, one in zip(self._places, several, strict=True):
            if isinstance(one, Output) and not isinstance(one.of, Frame):
                order, of = ORDERS[type(one)], one.of
                slots = scene.index.joints.get(of) or scene.index.modal(of)  # type: ignore[arg-type]
                there = slots.x if order == 0 else slots.v
                out, at = found.setdefault(order, ([], []))
                out.extend(range(place.start, place.stop))
                at.extend(range(there.start, there.stop))
        return [(order, np.array(out, np.int64), np.array(at, np.int64)) for order, (out, at) in found.items()]

    def _of_frames(self, several: Sequence[SteppedOutput], scene: CompiledScene) -> None:
        """Add the frames to a plan of its own; where their motions go."""
        plan = without_forces(scene.plan)
        rows: list[int] = []
        out: list[int] = []
        at: list[int] = []
        for place, one in zip(self._places, several, strict=True):
            if isinstance(one, Output) and isinstance(one.of, Frame):
                plan = scene.index.with_probe(plan, one.of)
                first = len(rows) * N_MOTION + _FIRST[ORDERS[type(one)]]
                out.extend(range(place.start, place.stop))
                at.extend(range(first, first + 3))
                rows.append(len(plan.frames) - 1)
        self._rows = np.array(rows, np.int64)
        self._frames = np.array(out, np.int64), np.array(at, np.int64)
        self._plan, self._work = plan, new_work(plan)
        self._motions = np.zeros((len(rows), N_MOTION))

    def take(self, s: st.State, now: Callable[[], Instant]) -> OutputValues:
        """The outputs in a state; ``now`` gives functions their instant."""
        y = np.empty(self._size)
        for order, out, at in self._coordinates:
            y[out] = (s.x, s.v, s.a)[order][at]
        if len(self._rows):
            frame_motions(self._plan, self._work, self._rows, s.x, s.v, s.a, self._motions)
            out, at = self._frames
            y[out] = self._motions.ravel()[at]
        if self._functions:
            instant = now()
            for place, function in self._functions:
                values = measure(function, instant)
                if len(values) != place.stop - place.start:
                    raise SceneError(
                        f"an output's function gave {len(values)} numbers at t = {instant.t:g} s, and "
                        f"{place.stop - place.start} before"
                    )
                y[place] = values
        if self._names is None:
            return y
        return {name: float(y[at.start]) if at.stop - at.start == 1 else y[at] for name, at in self._names}
