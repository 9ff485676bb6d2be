"""Runs an ensemble: hands variants to an executor, and streams what comes back to a file."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ThreadPoolExecutor, wait
from contextlib import AbstractContextManager, nullcontext
from itertools import islice
from pathlib import Path
from typing import Any

from flexmbd.ensemble.results import Ensemble
from flexmbd.ensemble.results_file import WAITING, ResultsFile, new_file, opened_file
from flexmbd.ensemble.samples import Samples
from flexmbd.ensemble.variants import NumberedVariants, ProcessTasks, Study, ThreadTasks, VariantOutcome
from flexmbd.errors import SceneError

_AT_ONCE = 8  # variants of a task, at most: short ones would else cost as much to hand over as to run
_AHEAD = 2  # tasks that wait for each worker


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
            results = opened_file(path, digest)
        else:
            results = _begun(study, samples, digest, path)
        bar.update(len(samples) - int((results.state == WAITING).sum()))
        try:
            own = ThreadPoolExecutor(count) if executor is None else nullcontext(executor)
            with own as pool:
                tasks = ThreadTasks(study) if isinstance(pool, ThreadPoolExecutor) else ProcessTasks(study)
                for outcomes in _outcomes(pool, tasks, _waiting(results, samples, count), ahead=_AHEAD * count):
                    _keep(results, outcomes)
                    bar.update(len(outcomes))
        except BaseException:
            results.file.close()
            raise
    return Ensemble(samples, results)


def _begun(study: Study, samples: Samples, digest: str, path: Path | None) -> ResultsFile:
    """A file with the outcomes of the first variants up to one that does not fail, which tells the outputs' shapes.

    Raises:
        SceneError: all variants failed.
    """
    first: list[VariantOutcome] = []
    for k in range(len(samples)):
        first += study.run([(k, samples[k])], nullcontext())
        if not first[-1][2]:
            shapes = {name: value.shape for name, value in first[-1][1].items()}
            results = new_file(path, len(samples), shapes, samples.arrays, digest)
            _keep(results, first)
            return results
    raise SceneError(f"all {len(samples)} variants failed; the first: {first[0][2]}")


def _keep(results: ResultsFile, outcomes: Sequence[VariantOutcome]) -> None:
    """Write the outcomes of a task; an output of another shape than the first variant's is a failure."""
    outputs, failures = {}, {}
    for k, values, fault in outcomes:
        other = [name for name, value in values.items() if value.shape != results.shape(name)]
        if fault:
            failures[k] = fault
        elif other:
            shape = values[other[0]].shape
            there = results.shape(other[0])
            failures[k] = f"output {other[0]!r} has the shape {shape}, that of the first variant {there}"
        else:
            outputs[k] = values
    results.write(outputs, failures)


def _waiting(results: ResultsFile, samples: Samples, workers: int) -> Iterator[NumberedVariants]:
    """Tasks: the variants that have not been run, some at a time, in order."""
    waiting = [int(k) for k in (results.state == WAITING).nonzero()[0]]
    at_once = max(1, min(_AT_ONCE, len(waiting) // (4 * workers)))
    for first in range(0, len(waiting), at_once):
        yield [(k, samples[k]) for k in waiting[first : first + at_once]]


def _outcomes(
    pool: Executor,
    tasks: Callable[[NumberedVariants], list[VariantOutcome]],
    rows: Iterator[NumberedVariants],
    *,
    ahead: int,
) -> Iterator[list[VariantOutcome]]:
    """The outcomes task by task as they come; no more than ``ahead`` tasks are handed over at a time."""
    running: set[Future[list[VariantOutcome]]] = {pool.submit(tasks, some) for some in islice(rows, ahead)}
    try:
        while running:
            finished, running = wait(running, return_when=FIRST_COMPLETED)
            running |= {pool.submit(tasks, some) for some in islice(rows, len(finished))}
            for future in finished:
                yield future.result()
    finally:
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
