"""From modal coordinates back to fields on the mesh."""

from __future__ import annotations

from typing import Protocol

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
from dolfinx import fem
from numpy.typing import NDArray

from flexmbd.continuum import parallel
from flexmbd.continuum.finite_elements.cell_group import CellGroup
from flexmbd.continuum.finite_elements.condensed_stiffness import CondensedStiffness
from flexmbd.continuum.finite_elements.discrete_forms import DiscreteForms
from flexmbd.continuum.finite_elements.discretisation import Discretisation
from flexmbd.continuum.finite_elements.field_conditions import FieldConditions
from flexmbd.continuum.finite_elements.nodes import dof_numbers, further_dofs, node_numbers
from flexmbd.continuum.matrices.blocks import inner, multiply
from flexmbd.errors import RecordError
from flexmbd.record.reduced_body import ReducedBody
from flexmbd.round_off import ROUND_OFF

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


#: In a record's provenance: how much of its modes' stiffness is the model's, where that is not all of it.
SHARE = "share of the model in the stiffness"

# Far above what other ranks and processors make of the same sums, far below what another material does.
_SAME = 1e-8


class ReductionModel(Discretisation, Protocol):
    """The model on which fields are recovered and from which bodies are reduced: a `LinearModel`."""

    @property
    def K(self) -> PETSc.Mat:
        """Stiffness, over all dofs."""

    @property
    def M(self) -> PETSc.Mat:
        """Consistent mass, the same layout."""

    @property
    def conditions(self) -> FieldConditions | None:
        """What holds a potential, built into K."""

    @property
    def unknown_space(self) -> fem.FunctionSpace:
        """The space of the formulations' own unknown, with the fields of one cell."""

    def unknown_columns(self, columns: FloatArray) -> FloatArray:
        """Small motions (local dofs including ghosts, k) as fields on `unknown_space`."""

    @property
    def warm_groups(self) -> tuple[CellGroup, ...]:
        """The cell groups with their formulations at the temperature of the state."""

    @property
    def forms(self) -> DiscreteForms:
        """The formulations on the mesh."""

    @property
    def condensed(self) -> CondensedStiffness | None:
        """Matrices of the fields of one cell; None: there are none."""

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
        body: reduced from this mesh with this formulation and these parameters, with `Keep(modes=True)`.
        model: the same on any number of ranks.

    Returns:
        (local dofs including ghosts, n), in the order of `model.space` and in the mesh's axes: the
        displacement relative to the body frame, and what else the unknown holds, per unit of each modal coordinate.

    Raises:
        RecordError: on all ranks: the record has no modes, or is of another mesh; the model has another stiffness or
            mass than the body; the record has only the displacement of a formulation with further unknowns.
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
    modes = node_rows(
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
        fields[others] = node_rows(
            model, dof_numbers(model, others), known=body.unknowns.dof, values=body.unknowns.phi
        )
    _refuse_other_body(body, model, fields)
    return fields


def _refuse_other_body(body: ReducedBody, model: ReductionModel, fields: FloatArray) -> None:
    """Refuse a model by whose stiffness or mass the modes are not in normal form. Collective.

    All modes are looked at together, each with the same strain energy.
    """
    if body.n_modes == 0:
        return
    found, bound = model_share(model, fields[: model.layout.n_owned], body.stiffness)
    stiffer = found / _share(body, unknown=found)
    q = body.stiffness**-0.5
    u = _all_modes(fields[: model.layout.n_owned], q)
    heavier = float(inner(model.comm, u, multiply(model.M, u))[0, 0]) / float(q @ q)
    if not abs(stiffer - 1.0) <= bound or not abs(heavier - 1.0) <= _SAME:
        raise RecordError(
            f"the record is of another body than the model: with the model's matrices its modes have {stiffer:.4g} "
            f"times the stiffness and {heavier:.4g} times the mass that the record states: give the model the "
            "formulation, the parameters, the springs on facets and the loaded state with which the body was reduced, "
            "or reduce it again"
        )


def model_share(model: ReductionModel, modes: FloatArray, stiffness: FloatArray) -> tuple[float, float]:
    """How much of the strain energy of all modes together is that of the model's stiffness. Collective.

    The rest is what rigid interfaces add to the stiffness of a loaded body, or of one of large displacements.

    Args:
        model: the body.
        modes: (owned dofs, n) in normal form.
        stiffness: (n,) 1/s^2, the diagonal of K_qq.

    Returns:
        That, and how much of it is round-off at most.
    """
    if model.conditions is not None:
        modes = model.conditions.free(model.comm, modes, first=int(model.K.getOwnershipRange()[0]))
    u = _all_modes(modes, stiffness**-0.5)
    strain = float(inner(model.comm, u, multiply(model.K, u))[0, 0])
    diagonal = model.K.getDiagonal()
    # of the terms that are summed, by whose size round-off goes
    largest = float(inner(model.comm, u**2, abs(diagonal.array_r)[:, None])[0, 0])
    diagonal.destroy()
    n = len(stiffness)
    return strain / n, _SAME + ROUND_OFF * largest / n


def _all_modes(modes: FloatArray, q: FloatArray) -> FloatArray:
    return np.asfortranarray((modes @ q)[:, None])


def _share(body: ReducedBody, *, unknown: float) -> float:
    """What the record says of it, or ``unknown`` where older ones do not."""
    text = body.provenance.get(SHARE)
    if text is None:
        return 1.0 if body.nonlinear is None and "prestress" not in body.provenance else unknown
    try:
        return float(text)
    except ValueError:
        raise RecordError(f"the record's provenance has {text!r:.100} as {SHARE!r}; reduce the body again") from None


def node_rows(model: ReductionModel, numbers: IntArray, *, known: IntArray, values: FloatArray) -> FloatArray:
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
