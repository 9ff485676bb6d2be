"""From modal coordinates back to fields on the mesh."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mpi4py import MPI

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum import parallel
from flexmbd.continuum.finite_elements.nodes import node_numbers
from flexmbd.errors import RecordError
from flexmbd.record.reduced_body import NodalModes, ReducedBody

if TYPE_CHECKING:
    from flexmbd.continuum.finite_elements.model import ContinuumModel

FloatArray = NDArray[np.float64]


def nodal_modes(body: ReducedBody, model: ContinuumModel) -> FloatArray:
    """The modes of a reduced body as displacement fields on its mesh. Collective.

    They come from the memory of the model, if the body was reduced from it in this process, and else
    from the record's group `modes/`.

    Args:
        body: reduced from this mesh with this formulation.
        model: the same on any number of ranks.

    Returns:
        (local dofs including ghosts, n), in the order of `model.space` and in the mesh's axes: the
        displacement relative to the body frame per unit of each modal coordinate.

    Raises:
        RecordError: on all ranks: the record has no modes, or is of another mesh; it has only the
            displacement of a formulation with further unknowns.
    """
    kept = model.bases.get(body.fingerprint())
    if kept is not None:
        return kept
    if body.modes is None:
        raise RecordError(
            "the record holds no nodal modes, and the body was not reduced from this model in this "
            "process: reduce it with keep_modes=True, or reduce it again here"
        )
    others = model.layout.n_local > model.displacement_dofs.size
    if model.comm.allreduce(others, op=MPI.LOR):
        raise RecordError(
            f"the record's nodal modes are displacements alone, and {model.form_name} has further "
            "unknowns: reduce the body again from this model, in this process"
        )
    if body.provenance.get("mesh") != model.mesh_fingerprint:
        raise RecordError(
            "the record is of another mesh than the model: its nodal modes do not fit; build the "
            "model on the mesh that the body was reduced from"
        )
    return _from_group(body, body.modes, model)


def _from_group(body: ReducedBody, group: NodalModes, model: ContinuumModel) -> FloatArray:
    numbers = node_numbers(model)
    place = np.searchsorted(group.node, numbers)
    fits = len(group.node) > 0 and np.array_equal(
        group.node[np.minimum(place, len(group.node) - 1)], numbers
    )
    error = None
    if not fits:
        error = RecordError(
            "the record's nodal modes lack nodes of the model: it was reduced with another degree "
            f"than {model.layout.displacement_degree}; use the same"
        )
    parallel.raise_collectively(model.comm, error)
    # (nodes, 3, n) in B's axes to the mesh's
    modes = np.einsum("ab,kbn->kan", body.R_MB, group.phi[place])
    fields = np.empty((model.layout.n_local, modes.shape[2]), order="F")
    fields[model.displacement_dofs] = modes
    return fields
