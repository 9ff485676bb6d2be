"""The cost of a simulation, and the accuracy of its constraints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.integrate import state as st


@dataclass(frozen=True)
class Stats:
    """Cost of a simulation, and how well it kept its constraints.

    Attributes:
        integrator: the method's name and options.
        steps, rejected: accepted and rejected steps.
        iterations: Newton iterations.
        factorisations: of the iteration matrix.
        evaluations: of the residual.
        seconds: wall time of the stepping, compiling or loading its loop included.
        compile_seconds: from the start of the integrator to the end of its first steps: compiling or loading
            from the cache.
        start_moved: (coordinate, from, to) that the consistent start changed; those of a ball or a free body are the
            parts of its rotation vector (rad).
        start_residual: largest constraint residual at the start (m or rad).
        constraint_residual: largest constraint residual over the run, redundant rows included.
        start_elastic: elastic energy of the start (J).
        jumps: jumps of accelerations that nobody declared, each passed by a short step of order 1.
        switches: changes of side of laws that jump with the state (``flexmbd.Switched``).
    """

    integrator: str
    steps: int
    rejected: int
    iterations: int
    factorisations: int
    evaluations: int
    seconds: float
    compile_seconds: float
    start_moved: tuple[tuple[str, float, float], ...]
    start_residual: float
    constraint_residual: float
    start_elastic: float = 0.0
    jumps: int = 0
    switches: int = 0


NOTHING_SPENT = Stats("", 0, 0, 0, 0, 0, 0.0, 0.0, (), 0.0, 0.0)


def spent(integrator: str, counts: NDArray[np.int64], *, seconds: float, compile_seconds: float) -> Stats:
    """The cost of an integration by ``State.counts``; what its start and its loops were like is not known."""
    return Stats(
        integrator=integrator,
        steps=int(counts[st.STEPS]),
        rejected=int(counts[st.REJECTED]),
        iterations=int(counts[st.ITERATIONS]),
        factorisations=int(counts[st.FACTORISATIONS]),
        evaluations=int(counts[st.EVALUATIONS]),
        seconds=seconds,
        compile_seconds=compile_seconds,
        start_moved=(),
        start_residual=0.0,
        constraint_residual=0.0,
        jumps=int(counts[st.JUMPS]),
        switches=int(counts[st.SWITCHES]),
    )
