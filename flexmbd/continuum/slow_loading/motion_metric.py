"""How large the motions of a body are: displacements in its extent, rotations in rad, whatever the mesh."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.history.nonlinear_model import NonlinearModel

FloatArray = NDArray[np.float64]


def motion_metric(body: NonlinearModel) -> tuple[FloatArray, FloatArray]:
    """(owned dofs,) what counts as large, infinite where nothing does; and the weights of a mean square. Collective."""
    layout, n = body.layout, body.n_owned
    x = layout.node_x[: layout.n_owned_nodes]
    low = np.array([body.comm.allreduce(float(part.min(initial=np.inf)), op=MPI.MIN) for part in x.T])
    high = np.array([body.comm.allreduce(float(part.max(initial=-np.inf)), op=MPI.MAX) for part in x.T])
    kinematic = layout.kinematic[:n]
    size = np.where(kinematic, 1.0, np.inf)
    displaced = np.zeros(n, dtype=bool)
    own = layout.displacement_dofs[: layout.n_owned_nodes].reshape(-1)
    displaced[own[own < n]] = True
    size[displaced] = float(np.linalg.norm(high - low))
    weights = np.zeros(n)
    for part in (displaced, kinematic & ~displaced):
        count = int(body.comm.allreduce(int(part.sum())))
        weights[part] = 3.0 / max(count, 1) / size[part] ** 2
    return size, weights
