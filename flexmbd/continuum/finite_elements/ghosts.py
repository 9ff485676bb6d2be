"""Blocks of owned dofs with the rows of ghosts."""

from __future__ import annotations

import numpy as np
from dolfinx import fem

from flexmbd.continuum.finite_elements.linear_model import LinearModel
from flexmbd.continuum.matrices.blocks import FloatArray


def with_ghosts(model: LinearModel, block: FloatArray) -> FloatArray:
    """A block (owned dofs, k) with the rows of this rank's ghosts below its own. Collective.

    Of unknowns of a body; what follows others is written in, by conditions of the model (`FieldConditions.completed`)
    or by ties.
    """
    if model.conditions is not None:
        block = model.conditions.completed(model.comm, block, first=int(model.K.getOwnershipRange()[0]))
    if model.ties is not None:
        block = model.complete(block.copy(order="F"))
    field = fem.Function(model.space)
    whole = np.empty((len(field.x.array), block.shape[1]), order="F")
    for i in range(block.shape[1]):
        field.x.array[: model.n_owned] = block[:, i]
        field.x.scatter_forward()
        whole[:, i] = field.x.array
    return whole
