"""Ctrl-C while something must not be torn apart: it waits until that is done; and none is lost."""

from __future__ import annotations

import _thread
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType
from typing import Any

from flexmbd.unraisable import taken_by

#: How long a Ctrl-C that came in a finaliser waits to come again, s: the finaliser is over then.
_AGAIN_AFTER = 0.05


@dataclass
class Noted:
    """Whether there was a Ctrl-C during a block."""

    seen: bool = False


@contextmanager
def interrupt_ends() -> Iterator[Noted]:
    """Ctrl-C ends the block, and what follows it goes on."""
    noted = Noted()
    handler = signal.getsignal(signal.SIGINT)
    try:
        with interrupts_handled(handler if callable(handler) else signal.default_int_handler):
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

    A KeyboardInterrupt that Python cannot pass on, as out of a finaliser, comes again: at the block's end at the
    latest, and never after it.
    """
    if not may_handle():
        yield
        return
    taken_by(_come_again, at_last=True)  # what left a compiled step's call stops that step
    block = _HandledBlock()
    before = signal.signal(signal.SIGINT, handler)
    _blocks.append(block)
    try:
        yield
        if block.may_send():
            signal.raise_signal(signal.SIGINT)
    finally:
        block.may_send()  # another exception ends the block: nothing is to come after it
        _blocks.remove(block)
        signal.signal(signal.SIGINT, before)


def may_handle() -> bool:
    """Whether this thread may say what Ctrl-C does, and somebody hears of it.

    Where it ends the process on the spot, it may: gmsh's own ``initialize()`` leaves Ctrl-C so, for good.
    """
    is_main = threading.current_thread() is threading.main_thread()
    return is_main and signal.getsignal(signal.SIGINT) not in (signal.SIG_IGN, None)


class _HandledBlock:
    """A block in which Ctrl-C calls a handler, and the Ctrl-C that is to come again there, if any."""

    def __init__(self) -> None:
        self._waits = threading.Lock()  # held while one waits to come again

    def come_again(self) -> None:
        """Send the main thread another Ctrl-C soon, unless the block is over by then."""
        if not self._waits.acquire(blocking=False):
            return  # one waits already
        left = threading.Event()
        threading.Thread(target=self._send, args=(threading.main_thread().ident, left), daemon=True).start()
        left.set()  # last: what comes before the hook has returned would be lost like the first

    def may_send(self) -> bool:
        """Whether a Ctrl-C waited, which is now the caller's to send."""
        try:
            self._waits.release()
        except RuntimeError:  # none did, or the other thread was first
            return False
        return True

    def _send(self, main: int, left: threading.Event) -> None:
        left.wait()
        time.sleep(_AGAIN_AFTER)
        if self.may_send():
            if sys.platform == "win32":
                _thread.interrupt_main()
            else:
                signal.pthread_kill(main, signal.SIGINT)


_blocks: list[_HandledBlock] = []  # the innermost last


def _come_again(unraisable: Any) -> bool:
    """Have a Ctrl-C that was raised where nothing can catch it come again in the block that it belongs to."""
    if not (_blocks and may_handle() and issubclass(unraisable.exc_type, KeyboardInterrupt)):
        return False
    _blocks[-1].come_again()
    return True
