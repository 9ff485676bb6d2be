"""Least changes: the step of some coordinates that closes gaps and, of all such steps, costs least."""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

from flexmbd.multibody.plan.row_slopes import RowSlopes
from flexmbd.round_off import ROUND_OFF

FloatArray = NDArray[np.float64]
Mask = NDArray[np.bool_]

_RANK = 1e-10  # singular values below this share of the largest are round-off of the kinematics
_FAR = 0.05  # slopes of gaps are trusted as of gaps of this share of the machine's size


def least_change(
    slopes: RowSlopes,
    gap: FloatArray,
    *,
    size: FloatArray,
    movable: Mask,
    cost: FloatArray,
    before: FloatArray,
    blurred: float | None = None,
) -> FloatArray:
    """The step s (nv,) by which slopes s = - gap, by least squares, and |cost (before + s)| is least; last |s / size|.

    Each block of rows has its own.  What no row holds moves back by what it has cost, to where it costs nothing.

    Slopes change by some share of the gap until it is closed, so of directions in which they are smaller than that
    nothing is known: a step there counts no more than the gap (Levenberg and Marquardt's damping, which vanishes with
    the gap's square).  Redundant rows, whose slopes are dependent where loops are closed alone, would else send the
    step anywhere.

    Args:
        slopes: of m rows per unit of each of nv coordinates, of shares of the machine's size.
        gap: (m,) such shares, or their rates.
        size: (nv,) full size of each coordinate, its own unit.
        movable: (nv,) which may change, free ones alone.
        cost: (nv,) root of what the square of a unit costs; 0: nothing.
        before: (nv,) what they have changed already.
        blurred: how far slopes are off, as a share; by default the gap, for these are slopes of positions.

    Returns:
        (nv,), zero where not movable.
    """
    step = np.where(movable & (cost > 0.0), -before, 0.0)
    for block, part in slopes:
        moves = movable[block.free]
        k = block.free[moves]
        if len(k):
            scaled = part[:, : len(block.free)][:, moves] * size[k]
            step[k] = size[k] * _shares(scaled, gap[block.rows], cost[k] * size[k], before[k] / size[k], blurred)
    return step


def _shares(
    scaled: FloatArray, gap: FloatArray, price: FloatArray, before: FloatArray, blurred: float | None
) -> FloatArray:
    """The step (n,) of a block, as shares of full size; ``scaled`` (k, n), ``price`` and ``before`` are per such."""
    priced = price > 0.0
    told = np.linalg.norm(scaled, axis=1)
    told = told > ROUND_OFF * told.max(initial=0.0)  # what out of a plane says nothing need not be decomposed
    if not told.all():
        scaled, gap = scaled[told], gap[told]
    u, sigma, vt = scipy.linalg.svd(scaled, full_matrices=bool(priced.any()))
    rank = int(np.sum(sigma > _RANK * max(sigma.max(initial=0.0), 1e-300)))
    if blurred is None:
        doubt = min(float(np.linalg.norm(gap)), _FAR)
        shares = sigma[:rank] / (sigma[:rank] ** 2 + doubt**2)
    else:
        doubt = 10.0 * blurred
        rank = int(np.sum(sigma[:rank] > doubt))
        shares = 1.0 / sigma[:rank]
    part = -vt[:rank].T @ (shares * (u[:, :rank].T @ gap))
    if priced.any():
        idle = vt[int(np.sum(sigma > max(doubt, _RANK * sigma.max(initial=0.0)))) :].T
        wanted = -(before + part)[priced] * price[priced]
        part = part + idle @ scipy.linalg.lstsq(price[priced, None] * idle[priced], wanted, cond=1e-12)[0]
    return np.asarray(part, dtype=np.float64)
