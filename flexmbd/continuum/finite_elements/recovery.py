"""From modal coordinates back to fields on the mesh."""

from __future__ import annotations

from typing import Protocol

from mpi4py import MPI

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum import parallel
from flexmbd.continuum.finite_elements.discretisation import Discretisation
from flexmbd.continuum.finite_elements.nodes import dof_numbers, further_dofs, node_numbers
from flexmbd.errors import RecordError
from flexmbd.record.reduced_body import ReducedBody

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


class ReductionModel(Discretisation, Protocol):
    """What fields are recovered on: what bodies are reduced from, a `LinearModel`."""

    @property
    def form_name(self) -> str:
        """Names of the formulations' modules."""

    @property
    def mesh_fingerprint(self) -> str:
        """`TaggedMesh.fingerprint` of the mesh."""

    @property
    def displacement_dofs(self) -> NDArray[np.int32]:
        """(local nodes including ghosts, 3) local dofs of the displacement's components at each node."""

    @property
    def node_x(self) -> FloatArray:
        """(local nodes including ghosts, 3) m, positions of the displacement nodes in the mesh's axes."""


def nodal_modes(body: ReducedBody, model: ReductionModel) -> FloatArray:
    """The modes of a reduced body as fields on its mesh, from the record's groups. Collective.

    Args:
        body: reduced from this mesh with this formulation, with `Keep(modes=True)`.
        model: the same on any number of ranks.

    Returns:
        (local dofs including ghosts, n), in the order of `model.space` and in the mesh's axes: the
        displacement relative to the body frame, and what else the unknown holds, per unit of each modal coordinate.

    Raises:
        RecordError: on all ranks: the record has no modes, or is of another mesh; it has only the
            displacement of a formulation with further unknowns.
    """
    if body.modes is None:
        raise RecordError(
            "the record holds no nodal modes: reduce the body with keep=Keep(modes=True), of flexmbd.reduction"
        )
    if body.provenance.get("mesh") != model.mesh_fingerprint:
        raise RecordError(
            "the record is of another mesh than the model: its nodal modes do not fit; build the "
            "model on the mesh that the body was reduced from"
        )
    modes = _rows(
        model, node_numbers(model), known=body.modes.node, values=np.einsum("ab,kbn->kan", body.R_MB, body.modes.phi)
    )
    fields = np.empty((model.layout.n_local, modes.shape[2]), order="F")
    fields[model.displacement_dofs] = modes
    others = further_dofs(model)
    if model.comm.allreduce(len(others), op=MPI.SUM) > 0:
        if body.unknowns is None:
            raise RecordError(
                f"the record's nodal modes are displacements alone, and {model.form_name} has further "
                "unknowns: reduce the body again with this flexmbd and keep=Keep(modes=True)"
            )
        fields[others] = _rows(
            model, dof_numbers(model, others), known=body.unknowns.dof, values=body.unknowns.phi
        )
    return fields


def _rows(model: ReductionModel, numbers: IntArray, *, known: IntArray, values: FloatArray) -> FloatArray:
    """The rows of `values`, which have the numbers `known`, ascending, of nodes or dofs. Collective."""
    place = np.searchsorted(known, numbers)
    error = None
    if not (len(known) > 0 and np.array_equal(known[np.minimum(place, len(known) - 1)], numbers)):
        error = RecordError(
            "the record's nodal modes lack nodes of the model: it was reduced with another degree "
            f"than {model.layout.displacement_degree}; use the same"
        )
    parallel.raise_collectively(model.comm, error)
    return values[place]
