"""The state in which a body with history was made: undeformed, cold, with the first history."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from mpi4py import MPI

import numpy as np

from flexmbd.continuum.history.nonlinear_model import NonlinearModel


def is_fresh(body: NonlinearModel) -> bool:
    """Whether the body is in that state, and not deformed, warmed or given voltages since. Collective."""
    now, fresh = body.snapshot(), body.fresh_snapshot()
    pairs = [
        (now.displacement, fresh.displacement),
        (now.temperature, fresh.temperature),
        (now.ports.efforts, fresh.ports.efforts),
        *zip(now.history, fresh.history, strict=True),
    ]
    same = all(np.array_equal(one, other) for one, other in pairs)
    return bool(body.comm.allreduce(same, op=MPI.LAND))


@contextmanager
def as_fresh(body: NonlinearModel) -> Iterator[None]:
    """The body in that state within a `with` block, and then as it was; not collective."""
    kept = body.snapshot()
    body.restore(body.fresh_snapshot())
    try:
        yield
    finally:
        body.restore(kept)
