"""Ctrl-C while something must not be torn apart: it waits until that is done."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType
from typing import Any


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
    """Within the block Ctrl-C calls a handler: in the main thread, and where it is Python's to handle."""
    if not may_handle():
        yield
        return
    before = signal.signal(signal.SIGINT, handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def may_handle() -> bool:
    """Whether this thread may say what Ctrl-C does, and Python is who hears of it."""
    is_main = threading.current_thread() is threading.main_thread()
    return is_main and callable(signal.getsignal(signal.SIGINT))
