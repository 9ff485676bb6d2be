"""Conditions on a field whose uniform shift costs no energy, built into the stiffness of a body.

With w_k, one unit of the field (1 V) on the k-th electrode and zero elsewhere, the unknown is z + sum_k w_k V_k; z
vanishes on electrodes that are given or grounded and has one value on each that floats. The electric enthalpy is then
z^T K z / 2 - z^T f V - V^T C V / 2 with

    f_k = -K w_k on what is free,    C_kl = -w_k^T K w_l,

so that K z = f V, and the charges are -dH/dV = f^T z + C V. K becomes that of z alone: rows and columns of what is
given are taken out but for the diagonal, and those of an electrode that floats are added up in the row of one of its
dofs. All that follows, modes, static shapes, counts, needs to know no more of it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from dataclasses import field as dataclass_field

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
from dolfinx import fem
from numpy.typing import NDArray

from flexmbd.continuum.contract.dof_layout import DofLayout
from flexmbd.continuum.contract.entries import optional_entries
from flexmbd.continuum.finite_elements.cell_group import CellGroup
from flexmbd.continuum.finite_elements.condition_places import (
    FloatingGroup,
    checked_conditions,
    condense,
    find_places,
    free_dof,
    is_broken,
    mean_of,
    owned,
)
from flexmbd.continuum.finite_elements.discrete_forms import DiscreteForms
from flexmbd.continuum.finite_elements.electrode import Condition
from flexmbd.continuum.matrices.blocks import FloatArray, inner, multiply, total
from flexmbd.errors import FormulationError, ReductionError
from flexmbd.given import numbers
from flexmbd.round_off import EQUAL

BoolArray = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class UniformShift:
    """A shift of a field that costs no energy.

    Attributes:
        values: (owned dofs,) of one unit of it.
        mean: (owned dofs,) whose product with an unknown, over all ranks, is the mean of the field in these units,
            where the field is held in the mean; else None.
        pin: (1,) the dof that is zero in the stiffness there, of the rank that owns it; (0,) of others, or elsewhere.
    """

    values: FloatArray
    mean: FloatArray | None = None
    pin: NDArray[np.int64] = dataclass_field(default_factory=lambda: np.zeros(0, np.int64))


@dataclass(frozen=True, eq=False)
class FieldConditions:
    """Conditions found on a mesh, and what they make of a body's statics.

    Attributes:
        ports: those whose value is given, k of them.
        others: those that are grounded or float.
        forces: (owned dofs, k) f: generalised forces per unit of each port's effort.
        capacity: (k, k) C, with what is free held at zero; symmetric, flow per effort.
        held: (owned dofs,) what is zero in all shapes, or follows another dof.
        floating: dofs of one value each.
        shifts: by their names.
    """

    ports: tuple[Condition, ...]
    others: tuple[Condition, ...]
    forces: FloatArray
    capacity: FloatArray
    held: BoolArray
    floating: tuple[FloatingGroup, ...]
    shifts: Mapping[str, UniformShift]

    def completed(self, comm: MPI.Comm, block: FloatArray, *, first: int) -> FloatArray:
        """Fields (owned dofs, k) with what follows other dofs, and of a mean of zero where that is held. Collective.

        Args:
            comm: of the body.
            block: fields in which dofs that follow are zero.
            first: global number of this rank's first dof.
        """
        means = [(shift.values, shift.mean) for shift in self.shifts.values() if shift.mean is not None]
        if not (self.floating or means):
            return block
        whole = block.copy(order="F")
        for group in self.floating:
            place = group.leader - first
            own = block[place] if 0 <= place < len(block) else np.zeros(block.shape[1])
            whole[group.dofs] = total(comm, own)
        for values, mean in means:
            whole -= np.outer(values, total(comm, mean @ whole))
        return whole

    def condense(self, comm: MPI.Comm, forces: FloatArray, *, first: int) -> None:
        """As `condition_places.condense`. Collective."""
        condense(comm, forces, held=self.held, floating=self.floating, first=first)

    def free(self, comm: MPI.Comm, block: FloatArray, *, first: int) -> FloatArray:
        """The way back from `completed` (owned dofs, k): what follows is zero, and what is pinned. Collective."""
        whole = np.array(block, order="F")
        for shift in self.shifts.values():
            if shift.mean is not None:
                own = (whole[shift.pin] / shift.values[shift.pin, None]).sum(axis=0)
                whole -= np.outer(shift.values, total(comm, own))
        for group in self.floating:
            follow = group.dofs[group.dofs != group.leader - first]
            whole[follow] = 0.0
        return whole


def uniform_shifts(groups: Sequence[CellGroup], layout: DofLayout) -> dict[str, UniformShift]:
    """The shifts that the formulations name; not collective.

    Raises:
        FormulationError: the formulations of a body name different ones.
    """
    named: dict[str, FloatArray] = {}
    for k, group in enumerate(groups):
        gauge = optional_entries(group.formulation).gauge
        found = {} if gauge is None else {name: numbers(values) for name, values in gauge(group.parameters).items()}
        if k == 0:
            named = found
        same = found.keys() == named.keys() and all(np.array_equal(found[name], named[name]) for name in found)
        if not same:
            raise FormulationError(
                f"{groups[0].form_name} and {group.form_name} name different shifts by gauge(p), {_listed(named)} and "
                f"{_listed(found)}: in one body a field has one unit; give their parameters the same scale"
            )
    return {name: UniformShift(_dofs_of(values, layout)) for name, values in named.items()}


def _listed(shifts: Mapping[str, FloatArray]) -> str:
    return ", ".join(f"{name!r} {values.tolist()}" for name, values in shifts.items()) or "none"


def _dofs_of(components: FloatArray, layout: DofLayout) -> FloatArray:
    """(owned dofs,) of a field with these components everywhere."""
    values = np.zeros(layout.n_local)
    for field in layout.fields:
        own = components[field.components]
        if own.any():
            function = fem.Function(field.space)
            function.interpolate(lambda x, own=own: np.outer(own, np.ones(x.shape[1])))
            values[field.dofs] = function.x.array
    return values[: layout.n_owned]


def find_conditions(
    conditions: Sequence[Condition], K: PETSc.Mat, forms: DiscreteForms  # noqa: N803
) -> tuple[PETSc.Mat, FieldConditions | None]:
    """Find conditions on a mesh, and build them into a body's stiffness. Collective.

    Args:
        conditions: the same on all ranks.
        K: stiffness without them; it is changed, or taken apart.
        forms: the formulations on the mesh.

    Returns:
        The stiffness of what is free, and the conditions; None where there is nothing to hold.

    Raises:
        MeshError: on all ranks: what is no condition, a group that the mesh has not or that is empty, two that share
            dofs, one named twice.
        FormulationError: on all ranks: as `checked_conditions`; formulations name different gauges.
    """
    shifts = uniform_shifts(forms.groups, forms.layout)
    given = checked_conditions(conditions, forms, shifts)
    return (K, None) if not shifts else _Builder(K, forms, shifts).build(given)


class _Builder:
    """Builds conditions into a stiffness. All of it is collective."""

    def __init__(self, K: PETSc.Mat, forms: DiscreteForms, shifts: dict[str, UniformShift]) -> None:  # noqa: N803
        self.K, self.forms, self.layout, self.shifts = K, forms, forms.layout, shifts
        self.comm, self.first = forms.comm, int(K.getOwnershipRange()[0])

    def build(self, conditions: Sequence[Condition]) -> tuple[PETSc.Mat, FieldConditions]:
        places = find_places(conditions, self.forms, {name: shift.values for name, shift in self.shifts.items()})
        held = places.held.copy()
        K = self._gathered(places.floating) if places.floating else self.K
        images = multiply(K, places.units)
        capacity = -inner(self.comm, places.units, images)
        sprung = any(group.optional.surface_energy is not None for group in self.forms.surfaces)
        for name, shift in list(self.shifts.items()):
            if name not in places.fixed and not (sprung and not costs_nothing(K, shift.values)):
                pin = free_dof(self.forms, shift.values, held)
                held[pin] = True
                self.shifts[name] = replace(shift, mean=mean_of(self.forms, shift.values), pin=pin)
        forces = np.where(held[:, None], 0.0, -images)
        take_out(K, held, first=self.first)
        others = tuple(one for one in conditions if not one.is_port)
        symmetric = 0.5 * (capacity + capacity.T)
        return K, FieldConditions(places.ports, others, forces, symmetric, held, places.floating, self.shifts)

    def _gathered(self, floating: Sequence[FloatingGroup]) -> PETSc.Mat:
        """P^T K P, P giving all dofs of a floating electrode the value of one of them."""
        n = self.layout.n_owned
        columns = np.arange(self.first, self.first + n, dtype=PETSc.IntType)
        follows = np.zeros(n, dtype=bool)
        for group in floating:
            columns[group.dofs] = group.leader
            follows[group.dofs] = group.dofs + self.first != group.leader
        sizes = self.K.getSizes()
        rows = np.arange(n + 1, dtype=PETSc.IntType)
        P = PETSc.Mat().createAIJ(sizes, csr=(rows, columns, np.ones(n)), comm=self.K.comm)
        gathered = self.K.ptap(P)
        # what follows keeps a diagonal, by which no factor is singular
        diagonal = self.K.getDiagonal()
        kept = np.where(follows, diagonal.array_r, 0.0)
        own = np.arange(self.first, self.first + n, dtype=PETSc.IntType)
        extra = PETSc.Mat().createAIJ(sizes, csr=(rows, own, kept), comm=self.K.comm)
        gathered.axpy(1.0, extra, structure=PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        for item in (P, extra, self.K, diagonal):
            item.destroy()
        return gathered


def take_out(K: PETSc.Mat, held: BoolArray, *, first: int) -> None:  # noqa: N803
    """Take rows and columns out of a stiffness, but for their diagonals. Collective."""
    rows = (np.flatnonzero(held) + first).astype(PETSc.IntType)
    diagonal = K.getDiagonal()
    K.setOption(PETSc.Mat.Option.KEEP_NONZERO_PATTERN, True)
    K.zeroRowsColumns(rows, diag=1.0)
    K.setDiagonal(diagonal)
    K.assemble()
    diagonal.destroy()


def costs_nothing(K: PETSc.Mat, shift: FloatArray) -> bool:  # noqa: N803
    """Whether K times a field is round-off of its terms. Collective."""
    left = multiply(K, shift[:, None])
    sizes = K.duplicate(copy=True)
    begins, columns, values = K.getValuesCSR()
    sizes.setValuesCSR(begins, columns, abs(values))
    sizes.assemble()
    terms = multiply(sizes, abs(shift)[:, None])
    sizes.destroy()
    comm = K.comm.tompi4py()
    largest = np.array([abs(left).max(initial=0.0), terms.max(initial=0.0)])
    comm.Allreduce(MPI.IN_PLACE, largest, op=MPI.MAX)
    return bool(largest[0] <= EQUAL * largest[1])


def refuse_unheld(K: PETSc.Mat, forms: DiscreteForms, conditions: FieldConditions | None) -> None:  # noqa: N803
    """Refuse a continuous field beside the motion that nothing holds, and that no gauge names. Collective.

    Args:
        K: stiffness with its conditions.
        forms: the formulations on the mesh.
        conditions: those.

    Raises:
        ReductionError: on all ranks.
    """
    layout, comm = forms.layout, forms.comm
    if forms.is_definite:
        return
    shifts = () if conditions is None else conditions.shifts.values()
    kinematic = layout.kinematic[: layout.n_owned]
    for field in layout.fields:
        own = owned(field.dofs, layout.n_owned)
        moves = comm.allreduce(bool(kinematic[own].any()), op=MPI.LOR)
        named = [comm.allreduce(bool(one.values[own].any()), op=MPI.LOR) for one in shifts]
        if moves or any(named) or is_broken(field):
            continue
        for component in range(field.components.start, field.components.stop):
            unit = np.zeros(max(one.components.stop for one in layout.fields))
            unit[component] = 1.0
            if costs_nothing(K, _dofs_of(unit, layout)):
                raise ReductionError(
                    f"{forms.form_name}: nothing holds component {component} of the unknown: a uniform shift of it "
                    "costs no energy, as of a potential. Name the shift, and one unit of it, by gauge(p), as "
                    '{"potential": (0.0, 0.0, 0.0, 1.0)}, and give the model electrodes, conditions=[Electrode(...)]; '
                    "or hold it by surface_energy on some facets"
                )
