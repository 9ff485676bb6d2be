"""The stages of a reduction, as a progress bar on the first rank, or nothing."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from mpi4py import MPI

from flexmbd.continuum import parallel
from flexmbd.errors import ReductionError

#: In the order they are gone through.
STAGES = ("factor", "static shapes", "responses to loads", "modes", "stretch modes", "modal derivatives", "projection")

# Dofs up to which two ranks reduce a part no quicker than one does, on cores that do nothing else (docs/scaling.md).
_SMALL = 5_000


def ranks_note(ranks: int, dofs: int) -> str:
    """A note for users who reduce few dofs on several ranks; empty for others."""
    return f"; so small a part takes one rank no longer than {ranks}" if ranks > 1 and dofs < _SMALL else ""


class Stages:
    """Which stage a reduction has come to; made by `stages`."""

    def __init__(self, bar: Any) -> None:
        """With a bar of tqdm, or None to show nothing; not collective."""
        self._bar = bar
        self._begun = 0

    def begin(self, name: str) -> None:
        """Say that a stage of `STAGES` begins; those before it are done. Not collective."""
        if self._bar is not None:
            number = STAGES.index(name)
            self._bar.update(number - self._begun)
            self._begun = number
            self._bar.set_description(name)

    def note(self, text: str) -> None:
        """Put a text behind the bar; not collective."""
        if self._bar is not None:
            self._bar.set_postfix_str(text)


@contextmanager
def stages(comm: MPI.Comm, *, shown: bool) -> Iterator[Stages]:
    """A bar for a `with` block, closed at its end. Collective.

    Raises:
        ReductionError: on all ranks: a bar is wanted, and there is no tqdm.
    """

    def check() -> None:
        if shown and importlib.util.find_spec("tqdm") is None:
            raise ReductionError("a progress bar needs tqdm: pip install 'flexmbd[pictures]'")

    parallel.on_root(comm, check)
    if not shown or comm.rank != 0:
        yield Stages(None)
        return
    from tqdm import tqdm  # only where a bar is asked for

    with tqdm(total=len(STAGES), unit="stage", bar_format="{desc}{n}/{total} [{elapsed}]{postfix}") as bar:
        yield Stages(bar)
        bar.update(bar.total - bar.n)
