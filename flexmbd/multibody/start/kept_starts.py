"""What the starts of one compiled machine have in common: found once, for its own numbers, and kept with it."""

from __future__ import annotations

from collections.abc import Callable

from flexmbd.errors import FlexmbdError
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.start.consistent_start import Start


def can_be_kept(scene: CompiledScene) -> bool:
    """Whether a start follows from the scene's numbers alone: no Python function is asked, and no body remembers."""
    return not scene.is_shared and not scene.sources.is_awaited and not scene.switches and scene.parts.team.size == 1


class KeptStarts:
    """The start of a machine with the numbers that it was compiled with, at the time last asked for.

    Variants begin their search for a start with it.  It is of those numbers whichever variants ran before, so that a
    variant has one start, whoever runs it and in what order.  Threads may share it.
    """

    def __init__(self) -> None:
        self._found: tuple[float, Start | None] | None = None

    def __reduce__(self) -> tuple[type[KeptStarts], tuple[()]]:
        """Copies and pickles have none."""
        return KeptStarts, ()

    def at(self, t: float, find: Callable[[], Start]) -> Start | None:
        """The start at time t (s); None where ``find`` raises that there is none."""
        kept = self._found
        if kept is None or kept[0] != t:
            try:
                kept = (t, find())
            except FlexmbdError:
                kept = (t, None)
            self._found = kept
        return kept[1]
