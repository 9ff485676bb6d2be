"""Processes that work for the command, and that Ctrl-C ends without a word of theirs."""

from __future__ import annotations

import multiprocessing
import signal
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing.context import SpawnContext, SpawnProcess

from flexmbd.run.interrupts import interrupts_handled


class _DeafProcess(SpawnProcess):
    """A process that Ctrl-C does not reach, which the terminal sends to all: its parent ends it."""

    def start(self) -> None:
        """Begin with SIGINT blocked, which the process inherits; what another thread hears of meanwhile comes then."""
        if sys.platform == "win32":  # which has nothing that a process inherits
            super().start()
            return
        heard = []
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            with interrupts_handled(lambda *_: heard.append(True)):  # half begun it would tell of its end
                super().start()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
        if heard:
            signal.raise_signal(signal.SIGINT)


class _DeafContext(SpawnContext):
    Process = _DeafProcess


@contextmanager
def worker_processes(count: int) -> Iterator[ProcessPoolExecutor]:
    """An executor of new processes, which begin with the first task. However the block ends, none is left behind."""
    before = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(count, mp_context=_DeafContext())
    try:
        yield pool
    except BaseException:
        pool.shutdown(wait=False, cancel_futures=True)
        for child in set(multiprocessing.active_children()) - before:
            child.terminate()
            child.join()
        raise
    else:
        pool.shutdown()
