"""Exceptions that Python cannot pass on where they occur, handed to whoever knows what to do with them.

A signal's handler may raise between any two of the interpreter's instructions: in a function that C called, in a
finaliser, in what a dying weak reference calls. Python then tells ``sys.unraisablehook`` and goes on as if nothing had
been. One hook serves the process; anybody may import it.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

#: Takes what ``sys.unraisablehook`` is told, and returns whether it was its own to take.
Taker = Callable[[Any], bool]

_takers: list[Taker] = []
_last_takers: list[Taker] = []  # those that take whatever nobody else did
_before = sys.unraisablehook  # the hook for what nobody takes


def taken_by(taker: Taker, *, at_last: bool = False) -> None:
    """Have a taker asked from now on, once whatever the number of calls; after all others, where so told."""
    global _before
    if sys.unraisablehook is not _hand_on:
        _before, sys.unraisablehook = sys.unraisablehook, _hand_on
    takers = _last_takers if at_last else _takers
    if taker not in takers:
        takers.append(taker)


def _hand_on(unraisable: Any) -> None:
    if not any(taker(unraisable) for taker in (*_takers, *_last_takers)) and _before is not _hand_on:
        _before(unraisable)
