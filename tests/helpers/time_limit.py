"""The time limit of a test, in which the compilation of kernels and forms does not count: that has a limit of its own.

Whether a test has to wait for them depends on what ran before, and on what another worker compiles just now. Where more
processes run than the machine has cores, the limit is longer in proportion.
"""

from __future__ import annotations

import functools
import os
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

import pytest
import pytest_timeout
import sharing
from _pytest._io import TerminalWriter
from numba.core import event

# Seconds that the kernels and forms of one test may take to compile.
COMPILATION = 1500.0


class CompilationTime(event.Listener):
    """How long numba and FFCx have compiled in this process so far, by a clock."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._lock = threading.Lock()
        self._depth = 0
        self._began = self._spent = 0.0

    def on_start(self, event: event.Event | None = None) -> None:
        with self._lock:
            if self._depth == 0:
                self._began = self._clock()
            self._depth += 1

    def on_end(self, event: event.Event | None = None) -> None:
        with self._lock:
            self._depth -= 1
            if self._depth == 0:
                self._spent += self._clock() - self._began

    def seconds(self) -> float:
        with self._lock:
            return self._spent + (self._clock() - self._began if self._depth > 0 else 0.0)


COMPILED = CompilationTime()
# whoever compiles holds this lock
event.register("numba:compiler_lock", COMPILED)


def _crowd() -> float:
    """Processes that want to run (of the last minute), for each core; at least 1."""
    return max(1.0, os.getloadavg()[0] / (os.cpu_count() or 1))


def _count_forms() -> None:
    """Count what FFCx takes too, its waiting for another process's compiler included; once it is loaded."""
    jit = sys.modules.get("ffcx.codegeneration.jit")
    if jit is None or jit in _COUNTED:
        return
    _COUNTED.append(jit)
    for name in ("compile_forms", "compile_expressions"):
        setattr(jit, name, _counted(getattr(jit, name)))


_COUNTED: list[Any] = []


def _counted(compile_some: Callable[..., Any]) -> Callable[..., Any]:
    @functools.wraps(compile_some)
    def counted(*arguments: Any, **options: Any) -> Any:
        COMPILED.on_start()
        try:
            return compile_some(*arguments, **options)
        finally:
            COMPILED.on_end()

    return counted


@pytest.hookimpl(tryfirst=True)
def pytest_timeout_set_timer(item: pytest.Item, settings: Any) -> bool | None:
    """In the place of pytest-timeout's own timer, which knows of no compilation."""
    if settings.method != "thread":
        return None
    _count_forms()
    began, before, over = time.monotonic(), COMPILED.seconds(), threading.Event()

    def watch() -> None:
        while True:
            compiled = COMPILED.seconds() - before
            limit = settings.timeout * _crowd()
            left = min(limit - (time.monotonic() - began - compiled), COMPILATION - compiled)
            if left <= 0.0:
                _end(item, settings)
                return
            if over.wait(left):
                return

    thread = threading.Thread(target=watch, name=f"time limit of {item.nodeid}", daemon=True)

    def cancel() -> None:
        over.set()
        thread.join()

    item.cancel_timeout = cancel  # type: ignore[attr-defined]
    thread.start()
    return True


def _end(item: pytest.Item, settings: Any) -> None:
    """End this process, after what each of its threads does is told."""
    visible = TerminalWriter(sys.__stderr__)
    if sharing.is_worker():  # which has no terminal of its own
        item.config.get_terminal_writer = lambda: visible  # type: ignore[method-assign]
    visible.line(f"\n{item.nodeid} did not end within its time")
    pytest_timeout.timeout_timer(item, settings)
