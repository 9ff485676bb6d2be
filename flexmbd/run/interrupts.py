"""Ctrl-C while something must not be torn apart: it waits until that is done; and none is lost."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType
from typing import Any

from flexmbd.unraisable import taken_by

#: How long a Ctrl-C that came in a finaliser waits to come again, s: the finaliser is over then.
_AGAIN_AFTER = 0.01


@dataclass
class Noted:
    """Whether there was a Ctrl-C during a block."""

    seen: bool = False


@contextmanager
def interrupt_ends() -> Iterator[Noted]:
    """Ctrl-C ends the block, and what follows it goes on."""
    noted = Noted()
    try:
        yield noted
    except KeyboardInterrupt:
        noted.seen = True


@contextmanager
def interrupts_wait() -> Iterator[Noted]:
    """Within the block a first Ctrl-C is noted alone, and a second one raises KeyboardInterrupt."""
    noted = Noted()

    def note(*_: Any) -> None:
        if noted.seen:
            raise KeyboardInterrupt
        noted.seen = True

    with interrupts_handled(note):
        yield noted


@contextmanager
def interrupts_handled(handler: Callable[[int, FrameType | None], Any]) -> Iterator[None]:
    """Within the block Ctrl-C calls a handler: in the main thread, and where it is Python's to handle.

    A KeyboardInterrupt that Python cannot pass on, as out of a finaliser, comes again.
    """
    if not may_handle():
        yield
        return
    taken_by(_come_again, at_last=True)  # what left a compiled step's call stops that step
    before = signal.signal(signal.SIGINT, handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def may_handle() -> bool:
    """Whether this thread may say what Ctrl-C does, and Python is who hears of it."""
    is_main = threading.current_thread() is threading.main_thread()
    return is_main and callable(signal.getsignal(signal.SIGINT))


def _come_again(unraisable: Any) -> bool:
    """Send the main thread another Ctrl-C for one that was raised where nothing can catch it."""
    if not issubclass(unraisable.exc_type, KeyboardInterrupt) or not may_handle():
        return False
    main = threading.main_thread().ident
    again = threading.Timer(_AGAIN_AFTER, signal.pthread_kill, (main, signal.SIGINT))
    again.daemon = True
    again.start()
    return True
