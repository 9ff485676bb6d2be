"""A digest that tells plans of other numbers, other structure or other functions of the user apart."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.arrays import Plan

FloatArray = NDArray[np.float64]

# What differs from process to process, as addresses, or from step to step, as wrenches.
_LEFT_OUT = {"lapack", "flag", "times", "elements", "wrenches", "horizon"}


def plan_digest(plan: Plan, codes: Iterable[str] | None, breaks: FloatArray, *, is_rounded: bool) -> str:
    """The digest of a plan, of the codes of the user's functions unless None, and of declared breaks (k,) s.

    ``is_rounded``: the numbers of frames and rigid bodies count to eight digits.  Bodies with history sum up the masses
    of their frames over their ranks; so a scene is the same on any number of ranks.
    """
    if is_rounded:
        plan = plan.replace(rigid=_rounded(plan.rigid), frames=_rounded(plan.frames))
    digest = hashlib.sha256(plan.times[:, : at.TIME_ADDRESS].tobytes())
    digest.update(plan.elements[:, : at.EL_ADDRESS].tobytes())
    if codes is not None:
        digest.update(" ".join(codes).encode())
    for name, part in plan.fields().items():
        if name not in _LEFT_OUT and (name != "shafts" or len(part)):
            digest.update(f"{name} {part.shape}".encode() + part.tobytes())
    digest.update(breaks.tobytes())
    return digest.hexdigest()


def _rounded(table: FloatArray) -> FloatArray:
    """A table (n, m) rounded to some eight digits of the largest number in each column."""
    largest = abs(table).max(axis=0, initial=0.0)
    # a column of round-off alone has no digits, and what is nearly a power of two no edge
    scale = 1.4 * np.maximum(largest, 1e-6 * largest.max(initial=0.0) + np.finfo(float).tiny)
    grid = 1e-9 * 2.0 ** np.ceil(np.log2(scale))
    return np.asarray(np.rint(table / grid) + 0.0)  # no minus zero
