"""Runs an ensemble: hands variants to an executor, and streams their outputs to a file."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ThreadPoolExecutor,
    wait,
)
from contextlib import AbstractContextManager, closing, nullcontext
from itertools import islice
from pathlib import Path
from typing import Any

from flexmbd.ensemble.results import Ensemble
from flexmbd.ensemble.results_file import WAITING, ResultsFile, new_file, opened_file
from flexmbd.ensemble.samples import Samples
from flexmbd.ensemble.variants import (
    NumberedVariants,
    ProcessTasks,
    Study,
    TaskOutcome,
    Tasks,
    ThreadTasks,
    VariantOutcome,
)
from flexmbd.errors import EnsembleError, FlexmbdError, SceneError
from flexmbd.given import is_truth, refuse_other

_TASK = 0.1  # s that a task is to take: to hand one over costs a thousandth of that
_MOST = 1000  # variants of a task
_AHEAD = 2  # tasks of each worker that are handed over at a time
_NAMED = 12  # variants of a lost worker that a message names


def refuse_executor(executor: object, workers: object) -> None:
    """Raise SceneError unless there is a pool, or none, of a positive number of workers, or of as many as it has."""
    if workers is not None and (is_truth(workers) or not isinstance(workers, int) or workers < 1):
        raise SceneError(f"workers must be a positive number, got {workers!r}")
    if executor is not None:
        refuse_other(executor, Executor, "executor", wanted="a concurrent.futures.Executor")


def run_ensemble(
    study: Study,
    samples: Samples,
    digest: str,
    *,
    executor: Executor | None,
    workers: int | None,
    file: str | Path | None,
    progress: bool,
) -> Ensemble:
    """Run all variants that the file does not hold yet; see ``CompiledMachine.ensemble``."""
    path = None if file is None else Path(file)
    count = workers or os.cpu_count() or 1
    with _bar(progress, len(samples)) as bar:
        if path is not None and path.exists():
            results = opened_file(path, len(samples), digest)
        else:
            results = _begun(study, samples, digest, path)
        waiting = [int(k) for k in (results.state == WAITING).nonzero()[0]]
        bar.update(len(samples) - len(waiting))
        try:
            if waiting:
                own = ThreadPoolExecutor(count) if executor is None else nullcontext(executor)
                with own as pool:
                    on_threads = isinstance(pool, ThreadPoolExecutor)
                    tasks: Tasks = ThreadTasks(study) if on_threads else ProcessTasks(study, count)
                    handed = _Handed(pool, tasks, _Queue(samples, waiting, count))
                    with closing(_outcomes(handed)) as outcomes:
                        for some in outcomes:
                            _keep(results, some)
                            bar.update(len(some))
                results.write()
        except BaseException:
            with contextlib.suppress(FlexmbdError):  # the first error tells what happened
                results.write()
            results.close()
            raise
    return Ensemble(samples, results)


def _begun(study: Study, samples: Samples, digest: str, path: Path | None) -> ResultsFile:
    """A file with the outcomes of the first variants up to one that does not fail, which tells the outputs' shapes.

    Raises:
        SceneError: all variants failed.
    """
    first: list[VariantOutcome] = []
    for k in range(len(samples)):
        first += study.run([(k, samples[k])], nullcontext()).outcomes
        if not first[-1][2]:
            shapes = {name: value.shape for name, value in first[-1][1].items()}
            results = new_file(path, len(samples), shapes, samples.arrays, digest)
            _keep(results, first)
            results.write()
            return results
    raise SceneError(f"all {len(samples)} variants failed; the first: {first[0][2]}")


def _keep(results: ResultsFile, outcomes: Sequence[VariantOutcome]) -> None:
    """Keep the outcomes of a task; an output of another shape than the first variant's is a failure."""
    for k, values, fault in outcomes:
        other = [name for name, value in values.items() if value.shape != results.shapes[name]]
        if fault:
            results.fail(k, fault)
        elif other:
            shape, there = values[other[0]].shape, results.shapes[other[0]]
            results.fail(k, f"output {other[0]!r} has the shape {shape}, that of the first variant {there}")
        else:
            results.keep(k, values)


class _Queue:
    """Variants that have not been run, in order, as tasks of some variants each.

    Short variants cost as much to hand over as to run: a task has as many as are done in ``_TASK``, by the time that
    variants took so far, but few enough at the end that no worker waits long for another.

    Attributes:
        samples: the values of all variants.
        workers: how many there are: what was told, or as many as have done something.
    """

    def __init__(self, samples: Samples, waiting: Sequence[int], workers: int) -> None:
        self.samples, self.workers, self._waiting = samples, workers, waiting
        self._first, self._done, self._seconds = 0, 0, 0.0
        self._seen: set[str] = set()

    def took(self, outcome: TaskOutcome) -> None:
        """Note how long a worker was busy with a task, and which one it was."""
        self._done, self._seconds = self._done + len(outcome.outcomes), self._seconds + outcome.seconds
        self._seen.add(outcome.worker)
        self.workers = max(self.workers, len(self._seen))

    def __iter__(self) -> Iterator[NumberedVariants]:
        """Tasks, each as large as it should be when it is asked for."""
        while self._first < len(self._waiting):
            at_once = int(_TASK * self._done / max(self._seconds, 1e-9))
            left = len(self._waiting) - self._first
            size = max(1, min(at_once, _MOST, left // (4 * self.workers)))
            some = self._waiting[self._first : self._first + size]
            self._first += size
            yield [(k, self.samples[k]) for k in some]


class _Handed:
    """The tasks that are with an executor, in the order in which they were handed over.

    Attributes:
        running: those that have not come back, and what they are to run.
        lost: those that ended in a fault, with that.
        refused: why the executor takes no more, if it does not.
    """

    def __init__(self, pool: Executor, tasks: Tasks, queue: _Queue) -> None:
        self._pool, self._tasks, self._queue, self._rows = pool, tasks, queue, iter(queue)
        self.running: dict[Future[TaskOutcome], NumberedVariants] = {}
        self.lost: list[tuple[NumberedVariants, BaseException]] = []
        self.refused: Exception | None = None

    def fill(self) -> None:
        """Hand over as many tasks as keep the workers busy, and as let further workers show up."""
        for some in islice(self._rows, max(0, _AHEAD * self._queue.workers - len(self.running))):
            self._submit(some)

    def _submit(self, some: NumberedVariants, *, again: bool = False) -> None:
        if self.refused is None:
            try:
                self.running[self._tasks.submit(self._pool, some, again=again)] = some
            except Exception as reason:  # noqa: BLE001  (of a broken or closed pool, whatever its library calls it)
                self.refused = reason

    def come_back(self) -> list[TaskOutcome]:
        """Wait for a task or more, and take what they brought, or note what became of them."""
        finished = wait(self.running, return_when=FIRST_COMPLETED).done
        found: list[TaskOutcome] = []
        for one in [one for one in self.running if one in finished]:
            some, fault = self.running.pop(one), _fault(one)
            if fault is not None:
                self.lost.append((some, fault))
                continue
            outcome = one.result()
            self._queue.took(outcome)
            if outcome.lacks_study:
                self._submit(some, again=True)
            else:
                found.append(outcome)
        return found

    def refuse_incomplete(self) -> None:
        """Raise what kept variants from being run.

        Raises:
            EnsembleError: a worker died or could not begin, or the executor took no more tasks.
        """
        if self.lost:
            raise self._told()
        if self.refused is not None:
            reason = self.refused
            raise EnsembleError(f"the executor takes no tasks ({type(reason).__name__}: {reason})") from reason

    def _told(self) -> BaseException:
        """What tells of lost workers, and of what was with them."""
        lost, fault = [some for some, _ in self.lost], self.lost[0][1]
        if not isinstance(fault, Exception):  # an interrupt
            return fault
        if isinstance(fault, BrokenExecutor):
            # it fails all tasks; workers begin them in their order
            lost, what = lost[: self._queue.workers], f"died ({fault})"
        else:
            what = f"was lost, or failed ({type(fault).__name__}: {fault})"
        variants = tuple(k for some in lost for k, _ in some)
        error = EnsembleError(
            f"a worker of the executor {what}, at {self._named(variants)}; with file=... the same call goes on where "
            "the ensemble stopped",
            variants,
        )
        error.__cause__ = fault
        return error

    def _named(self, variants: Sequence[int]) -> str:
        if len(variants) > 1:
            some = ", ".join(map(str, variants[:_NAMED])) + (", ..." if len(variants) > _NAMED else "")
            return f"one of the variants {some}"
        values = self._queue.samples[variants[0]]
        return f"variant {variants[0]} ({', '.join(f'{name} = {value!r:.60}' for name, value in values.items())})"

    def stop(self) -> None:
        """Begin no further task."""
        self._tasks.stop()
        for future in self.running:
            future.cancel()


def _fault(future: Future[TaskOutcome]) -> BaseException | None:
    """What a finished task ended with, if it was no outcome."""
    try:
        return future.exception()
    except CancelledError as reason:  # by its executor: the workers are gone
        return reason


def _outcomes(handed: _Handed) -> Generator[list[VariantOutcome]]:
    """The outcomes task by task as they come.

    Raises:
        EnsembleError: a worker died, or could not begin.
    """
    try:
        handed.fill()
        while handed.running:
            found = handed.come_back()
            if not handed.lost:  # else what other workers are at is waited for, and kept
                handed.fill()
            for one in found:
                yield one.outcomes
        handed.refuse_incomplete()
    finally:
        handed.stop()


def _bar(shown: bool, total: int) -> AbstractContextManager[Any]:
    if not shown:
        return nullcontext(_SilentBar())
    try:
        from tqdm import tqdm  # only where a bar is asked for
    except ImportError as reason:
        raise SceneError("a progress bar needs tqdm: pip install 'flexmbd[pictures]'") from reason
    return tqdm(total=total, unit=" variants")  # type: ignore[no-any-return]


class _SilentBar:
    """A progress bar that shows nothing."""

    def update(self, amount: int) -> None:
        """Take the number of variants that are done."""
