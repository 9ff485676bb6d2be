"""The largest eigenvalue of a symmetric operator by Lanczos' method, for the stable step of explicit methods."""

from __future__ import annotations

from collections.abc import Callable

from mpi4py import MPI

import numpy as np
import scipy.linalg

from flexmbd.continuum.matrices.blocks import FloatArray

# Residual over the eigenvalue, whose own error is far smaller, and most vectors.
_RESIDUAL, _VECTORS = 1e-4, 150


def largest_eigenvalue(
    comm: MPI.Comm,
    apply: Callable[[FloatArray], FloatArray],
    n: int,
    *,
    shared: int = 0,
    begin: FloatArray | None = None,
) -> float:
    """An upper estimate of the largest eigenvalue, within the residual of a Lanczos step above it. Collective.

    After 1e-4 of the eigenvalue or 150 vectors, kept orthogonal (Lanczos 1950, doi:10.6028/jres.045.026).

    Args:
        comm: the ranks that the vectors are spread over.
        apply: the operator on a vector (n + shared,) of this rank; collective.
        n: number of this rank's own entries.
        shared: number of entries after them that are the same on all ranks.
        begin: (n,) of all frequencies, not the same on any two ranks; random numbers if None.
    """
    weight = np.ones(n + shared)
    weight[n:] = 1.0 / comm.size
    size = comm.allreduce(n) + shared
    # the same on all ranks where it is shared, and of all frequencies
    start = np.random.default_rng(comm.rank).standard_normal(n) if begin is None else begin
    v = np.concatenate([start, np.random.default_rng(comm.size).standard_normal(shared)])
    v /= np.sqrt(comm.allreduce(v @ (weight * v)))
    basis = np.zeros((len(v), min(size, _VECTORS)))
    diagonal: list[float] = []
    beside: list[float] = []
    for i in range(basis.shape[1]):
        basis[:, i] = v
        w = apply(v)
        seen = basis[:, : i + 1]
        # twice is enough
        for repeat in range(2):
            parts = seen.T @ (weight * w)
            comm.Allreduce(MPI.IN_PLACE, parts, op=MPI.SUM)
            w = w - seen @ parts
            if repeat == 0:
                diagonal.append(float(parts[i]))
        rest = float(np.sqrt(comm.allreduce(w @ (weight * w))))
        values, vectors = scipy.linalg.eigh_tridiagonal(np.array(diagonal), np.array(beside))
        residual = rest * abs(vectors[-1, -1])
        if residual <= _RESIDUAL * values[-1] or i + 1 == size:
            break
        beside.append(rest)
        v = w / rest
    return float(values[-1] + residual)
