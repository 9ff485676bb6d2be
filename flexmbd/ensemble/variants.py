"""Runs of variants, by whoever does the work: the outputs of each, or why it failed."""

from __future__ import annotations

import pickle
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from itertools import repeat
from typing import Any, NamedTuple, Protocol, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.ensemble.batch import BatchRuns
from flexmbd.errors import FlexmbdError, SceneError, told_once
from flexmbd.multibody.kernels.base.compiling import pickled_function
from flexmbd.run.trajectory import Trajectory

FloatArray = NDArray[np.float64]
#: What is asked of each variant's trajectory: a number, or an array of the same shape for all variants.
VariantOutput: TypeAlias = Callable[[Trajectory], ArrayLike]
#: A variant's number, its outputs, and why it failed if it did.
VariantOutcome: TypeAlias = tuple[int, dict[str, FloatArray], str]
#: Variants' numbers and the values of their parameters.
NumberedVariants: TypeAlias = Sequence[tuple[int, Mapping[str, Any]]]


def refuse_outputs(outputs: object) -> None:
    """Raise SceneError unless these are functions by names that a file can have."""
    if not (isinstance(outputs, Mapping) and outputs and all(map(callable, outputs.values()))):
        raise SceneError("outputs must be functions of a trajectory by their names, {'peak': lambda run: ...}")
    for name in outputs:
        if not isinstance(name, str) or not name.strip(".") or "/" in name:
            raise SceneError(f"an output cannot be called {name!r}: the file has it by that name")


class TaskOutcome(NamedTuple):
    """The result of a task: the outcomes of its variants, and the seconds that its worker was busy with them."""

    outcomes: list[VariantOutcome]
    seconds: float


class Tasks(Protocol):
    """The callable that an executor gets, with variants to run."""

    def __call__(self, rows: NumberedVariants) -> TaskOutcome:
        """Run variants."""

    def stop(self) -> None:
        """Begin no further variant, where that can be reached."""


@dataclass(frozen=True, eq=False)
class Study:
    """The run and the outputs of each variant.

    Attributes:
        simulate: from the values of parameters to a trajectory, or to what else outputs are asked of.
        outputs: what is asked of it, by name.
        shared: whether threads may run it side by side; else they take turns.
        batch: runs variants without trajectories; None where outputs or machine need these.
        told: subjects of warnings, of which one is enough for all variants; grows.
    """

    simulate: Callable[..., Any]
    outputs: Mapping[str, Callable[[Any], ArrayLike]]
    shared: bool
    batch: BatchRuns | None = None
    told: set[str] = field(default_factory=set)

    def run(
        self, rows: NumberedVariants, turn: AbstractContextManager[Any], goes_on: Callable[[], bool] = lambda: True
    ) -> TaskOutcome:
        """Run variants one after the other, each in its ``turn``, while ``goes_on``."""
        began = time.perf_counter()
        found: list[VariantOutcome] = []
        sampled = self.batch.run([values for _, values in rows]) if self.batch is not None else repeat(None)
        for k, values in rows:
            if not goes_on():
                break
            with turn, told_once(self.told):
                outputs = next(sampled)
                found.append(self._outcome(k, values) if outputs is None else (k, outputs, ""))
        return TaskOutcome(found, time.perf_counter() - began)

    def _outcome(self, k: int, values: Mapping[str, Any]) -> VariantOutcome:
        doing = "the simulation"
        try:
            run = self.simulate(**values)
            answers: dict[str, FloatArray] = {}
            for name, ask in self.outputs.items():
                doing = f"output {name!r}"
                answers[name] = _answer(ask(run))
        except FlexmbdError as reason:
            return k, {}, f"{doing}: {reason}"
        except Exception as reason:  # noqa: BLE001  (of the user's functions; the other variants go on)
            return k, {}, f"{doing}: {type(reason).__name__}: {reason}"
        return k, answers, ""


def _answer(value: ArrayLike) -> FloatArray:
    """An output as an array.

    Raises:
        SceneError: it is nothing of real numbers, as what a function without ``return`` gives.
    """
    array = np.asarray(value)
    if array.dtype.kind not in "biuf":
        raise SceneError(f"an output must be a number or an array of numbers, got {value!r:.60}")
    return array.astype(np.float64)


class ThreadTasks:
    """Tasks for threads of this process, which share the machine."""

    def __init__(self, study: Study) -> None:
        self._study = study
        self._turn: AbstractContextManager[Any] = nullcontext() if study.shared else threading.Lock()
        self._stopped = threading.Event()

    def __call__(self, rows: NumberedVariants) -> TaskOutcome:
        """Run variants."""
        return self._study.run(rows, self._turn, lambda: not self._stopped.is_set())

    def stop(self) -> None:
        """Begin no further variant."""
        self._stopped.set()


class ProcessTasks:
    """Tasks for other processes, each of which unpacks the machine once.

    Raises:
        SceneError: something of the machine or of the outputs cannot be sent to another process.
    """

    def __init__(self, study: Study) -> None:
        try:
            # by value, with what outputs refer to, so that these find their frames in the copied machine
            self._packed = pickled_function(study)  # type: ignore[arg-type]
        except Exception as reason:  # whatever stands in the way, it is what the user gave
            raise SceneError(
                f"the machine or an output cannot be sent to another process ({type(reason).__name__}: {reason}); run "
                "the ensemble on threads, or let outputs use what can be pickled"
            ) from reason

    def __call__(self, rows: NumberedVariants) -> TaskOutcome:
        """Run variants, in the process that unpickled this."""
        return _unpacked(self._packed).run(rows, nullcontext())

    def stop(self) -> None:
        """Stop handing out variants; those begun in other processes are ended."""


_last: tuple[bytes, Study] | None = None


def _unpacked(packed: bytes) -> Study:
    """The study of the last task of this process if it is the same, else unpacked anew."""
    global _last
    if _last is None or _last[0] != packed:
        study: Study = pickle.loads(packed)
        _last = packed, study
    return _last[1]
