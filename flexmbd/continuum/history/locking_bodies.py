"""Whether the cells of a body with history are too stiff in bending, told before it moves."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.finite_elements.elastic_sums import poissons_ratio, uniform_stiffness
from flexmbd.continuum.finite_elements.locking import tell_locking_cells
from flexmbd.continuum.history.fresh_body import is_fresh
from flexmbd.continuum.history.nonlinear_model import NonlinearModel
from flexmbd.round_off import EPSILON

FloatArray = NDArray[np.float64]

_STRAIN = 1e-7  # no material yields, and logarithms keep digits


def tell_locking_body(body: NonlinearModel, held: NDArray[np.bool_] | None = None) -> None:
    """Say on rank 0 where the cells of a body that is about to move may be much too stiff. Collective.

    A body that has moved before is passed over.

    Args:
        body: the body, whose trial is forgotten.
        held: (owned nodes, 3) components that something holds; None: none.

    Warns:
        LockingWarning: as `tell_locking_cells`.
    """
    if body.mesh.dim != 3 or not is_fresh(body):
        return
    n = body.layout.n_owned_nodes
    tell_locking_cells(
        body, held=np.zeros((n, 3), bool) if held is None else held, poisson=lambda: _poisson(body),
        means=body.has_cell_means,
    )  # fmt: skip


def _poisson(body: NonlinearModel) -> float:
    """Of uniform strains. Collective."""
    # in so short a time (s) nothing flows; in none a form whose viscosity is zero would divide 0 by 0
    own = body.layout.displacement_dofs[: body.layout.n_owned_nodes]
    trial = body.vector()

    def work(field: FloatArray) -> float:
        trial.array[own] = _STRAIN * field
        trial.scatter_forward()
        force = body.force(trial.array.copy(), dt=EPSILON)
        return float(body.comm.allreduce(float(force[own].reshape(-1) @ field.reshape(-1)))) / _STRAIN

    shear, bulk = uniform_stiffness(body.layout, work)
    body.revert()
    return poissons_ratio(shear, bulk)
