"""Runs of variants, by whoever does the work: the outputs of each, or why it failed."""

from __future__ import annotations

import hashlib
import os
import pickle
import platform
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor, Future
from contextlib import AbstractContextManager, closing, nullcontext
from dataclasses import dataclass, field
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
    """The result of a task.

    Attributes:
        outcomes: of its variants; of none where the worker has not got the study.
        seconds: that the worker was busy with them.
        worker: which one it was.
        lacks_study: whether it is to be handed over again, with the study.
    """

    outcomes: list[VariantOutcome]
    seconds: float
    worker: str
    lacks_study: bool = False


class Tasks(Protocol):
    """Hands variants to an executor."""

    def submit(self, pool: Executor, rows: NumberedVariants, *, again: bool = False) -> Future[TaskOutcome]:
        """Hand variants over; ``again``: for the worker that had them lacked the study."""

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

    def turn(self) -> AbstractContextManager[Any]:
        """What threads that share this copy of the study take in turns, if they have to."""
        return nullcontext() if self.shared else threading.Lock()

    def run(
        self, rows: NumberedVariants, turn: AbstractContextManager[Any], goes_on: Callable[[], bool] = lambda: True
    ) -> TaskOutcome:
        """Run variants one after the other, each in its ``turn``, while ``goes_on``."""
        began = time.perf_counter()
        found: list[VariantOutcome] = []
        sampled = (None for _ in rows) if self.batch is None else self.batch.run([values for _, values in rows])
        with closing(sampled):
            for k, values in rows:
                if not goes_on():
                    break
                with turn, told_once(self.told):
                    outputs = next(sampled)
                    found.append(self._outcome(k, values) if outputs is None else (k, outputs, ""))
        return TaskOutcome(found, time.perf_counter() - began, _worker())

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
        self._turn = study.turn()
        self._stopped = threading.Event()

    def submit(self, pool: Executor, rows: NumberedVariants, *, again: bool = False) -> Future[TaskOutcome]:
        """Hand over variants."""
        return pool.submit(self._study.run, rows, self._turn, lambda: not self._stopped.is_set())

    def stop(self) -> None:
        """Begin no further variant."""
        self._stopped.set()


class ProcessTasks:
    """Tasks for other processes, on this computer or on others, each of which gets the study once.

    An executor does not say which of its workers takes a task.  So the first tasks bring the study, as many as there
    are workers; the others bring its digest, and a worker that has not met it gives the task back.
    """

    def __init__(self, study: Study, workers: int) -> None:
        """Pack the study for so many workers.

        Raises:
            SceneError: something of the machine or of the outputs cannot be sent to another process.
        """
        try:
            # by value, with what outputs refer to, so that these find their frames in the copied machine
            self._packed = pickled_function(study)  # type: ignore[arg-type]
        except Exception as reason:  # whatever stands in the way, it is what the user gave
            raise SceneError(
                f"the machine or an output cannot be sent to another process ({type(reason).__name__}: {reason}); run "
                "the ensemble on threads, or let outputs use what can be pickled"
            ) from reason
        self._digest = hashlib.sha256(self._packed).hexdigest()
        self._bringing = workers

    def submit(self, pool: Executor, rows: NumberedVariants, *, again: bool = False) -> Future[TaskOutcome]:
        """Hand over variants, with the study where it is due or where a worker gave them back."""
        brings = again or self._bringing > 0
        self._bringing -= not again
        # as bytes, for some executors look into what they are given for tasks and results of their own
        return pool.submit(_run_packed, self._digest, self._packed if brings else None, pickle.dumps(rows))

    def stop(self) -> None:
        """Stop handing out variants; those begun in other processes are ended."""


# The studies that came to this process last, by digest, with the turns that its threads take.
_met: dict[str, tuple[Study, AbstractContextManager[Any]]] = {}
_meeting = threading.Lock()
_MOST_MET = 2


def _run_packed(digest: str, packed: bytes | None, rows: bytes) -> TaskOutcome:
    """Run variants in this process, by the study of that digest if it is here or comes along."""
    with _meeting:
        if digest not in _met and packed is not None:
            study: Study = pickle.loads(packed)
            while len(_met) >= _MOST_MET:
                del _met[next(iter(_met))]
            _met[digest] = study, study.turn()
        met = _met.get(digest)
    if met is None:
        return TaskOutcome([], 0.0, _worker(), lacks_study=True)
    return met[0].run(pickle.loads(rows), met[1])


def _worker() -> str:
    """A name that no other worker has, in this process or in another one."""
    return f"{platform.node()} {os.getpid()} {threading.get_ident()}"
