"""Runs an ensemble: hands variants to an executor, and streams their outputs to a file."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, ThreadPoolExecutor, wait
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
_AHEAD = 2  # tasks that wait for each worker


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
                    tasks: Tasks = ThreadTasks(study) if isinstance(pool, ThreadPoolExecutor) else ProcessTasks(study)
                    queue = _Queue(samples, waiting, count)
                    with closing(_outcomes(pool, tasks, queue, ahead=_AHEAD * count)) as outcomes:
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
    """

    def __init__(self, samples: Samples, waiting: Sequence[int], workers: int) -> None:
        self._samples, self._waiting, self._workers = samples, waiting, workers
        self._first, self._done, self._seconds = 0, 0, 0.0

    def took(self, variants: int, seconds: float) -> None:
        """Note how long (s) a worker was busy with a task."""
        self._done, self._seconds = self._done + variants, self._seconds + seconds

    def __iter__(self) -> Iterator[NumberedVariants]:
        """Tasks, each as large as it should be when it is asked for."""
        while self._first < len(self._waiting):
            at_once = int(_TASK * self._done / max(self._seconds, 1e-9))
            left = len(self._waiting) - self._first
            size = max(1, min(at_once, _MOST, left // (4 * self._workers)))
            some = self._waiting[self._first : self._first + size]
            self._first += size
            yield [(k, self._samples[k]) for k in some]


def _outcomes(pool: Executor, tasks: Tasks, queue: _Queue, *, ahead: int) -> Generator[list[VariantOutcome]]:
    """The outcomes task by task as they come; no more than ``ahead`` tasks are handed over at a time.

    Raises:
        EnsembleError: a worker died, or could not begin.
    """
    rows = iter(queue)
    running: set[Future[TaskOutcome]] = set()
    try:
        running |= {pool.submit(tasks, some) for some in islice(rows, ahead)}
        while running:
            finished, running = wait(running, return_when=FIRST_COMPLETED)
            done = [future.result() for future in finished]
            for one in done:
                queue.took(len(one.outcomes), one.seconds)
            running |= {pool.submit(tasks, some) for some in islice(rows, len(finished))}
            for one in done:
                yield one.outcomes
    except BrokenExecutor as reason:
        raise EnsembleError(
            f"a worker of the executor died ({reason}); with file=... the same call goes on where the ensemble stopped"
        ) from reason
    except Exception as reason:
        raise EnsembleError(f"a worker of the executor failed ({type(reason).__name__}: {reason})") from reason
    finally:
        tasks.stop()
        for future in running:
            future.cancel()


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
