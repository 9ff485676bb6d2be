"""Ctrl-C in the command `flexmbd`: one line, exit code 130, and computed results are kept.

Loads nothing heavy: the command's first lines enter here.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from flexmbd.command.launch import launched_rank
from flexmbd.run.interrupts import interrupts_handled, may_handle

#: The exit code of a process that Ctrl-C ended, as shells have it.
INTERRUPTED = 130
_TOLD = "flexmbd: stopped by Ctrl-C"


def say_stopped() -> None:
    """Tell in one line that Ctrl-C ended the process."""
    if launched_rank() == 0:
        print(_TOLD, file=sys.stderr)


@contextmanager
def exits_at_once() -> Iterator[None]:
    """Ctrl-C ends the process on the spot: for times at which nothing is kept or held, as while modules load.

    An exception could be lost there: libraries that load turn it into errors of their own.
    """

    def leave(*_: Any) -> None:
        if launched_rank() == 0:  # past buffers, which may be half written
            os.write(2, f"{_TOLD}\n".encode())
        os._exit(INTERRUPTED)

    with interrupts_handled(leave):
        yield


@contextmanager
def interrupts_once() -> Iterator[None]:
    """The first Ctrl-C raises KeyboardInterrupt; the clean-up after it is not disturbed by another one."""
    seen = False

    def stop_once(*_: Any) -> None:
        nonlocal seen
        if not seen:
            seen = True
            raise KeyboardInterrupt

    with interrupts_handled(stop_once):
        yield


def ignore_interrupts() -> None:
    """Ctrl-C has no effect any more."""
    if may_handle():
        signal.signal(signal.SIGINT, signal.SIG_IGN)
