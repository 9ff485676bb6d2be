"""Conditions on a field whose uniform shift costs no energy, at the trial displacements of a body with history.

On an electrode the unknown is what the conditions say, whatever the trial says there: the voltage that is given, zero,
or the value of one of its dofs where it floats.  Forces on what is given are taken out, but for the charge
Q = -dH/dV = -w . f of the electrode, w being one volt there and f the derivative of the electric enthalpy H; those on
an electrode that floats add up in the row of its one dof, and vanish in balance.  The tangent follows, in the basis in
which all dofs of such an electrode move with that one.  Of what is held the diagonal is left, so that Newton's method
has nothing to correct there and needs to know no more.

With voltages V the enthalpy is the energy less what the sources hold: the body has H + V . Q, and gets V dQ.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
from dolfinx import fem
from numpy.typing import NDArray

from flexmbd.continuum.finite_elements.condition_places import (
    checked_conditions,
    condense,
    find_places,
    first_dof,
    free_dof,
)
from flexmbd.continuum.finite_elements.discrete_forms import DiscreteForms
from flexmbd.continuum.finite_elements.electrode import Condition
from flexmbd.continuum.finite_elements.field_conditions import costs_nothing, take_out, uniform_shifts
from flexmbd.continuum.history.surface_springs import SurfaceSprings

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


class HeldFields:
    """Conditions found on the mesh of a body with history. Constructing one is collective.

    Attributes:
        ports: those whose voltage is given, k of them.
        held: (owned dofs,) what the conditions say the value of.
        efforts: (k,) V, of trials from now on.
    """

    def __init__(
        self, conditions: Sequence[Condition], forms: DiscreteForms, springs: SurfaceSprings | None
    ) -> None:
        """Find them.

        Args:
            conditions: the same on all ranks.
            forms: the formulations on the mesh.
            springs: on facets, which may fix a field.

        Raises:
            MeshError, FormulationError: on all ranks: as `find_conditions`.
        """
        self._comm, self._n = forms.comm, forms.layout.n_owned
        self._first = first_dof(forms)
        shifts = {name: shift.values for name, shift in uniform_shifts(forms.groups, forms.layout).items()}
        given = checked_conditions(conditions, forms, shifts)
        places = find_places(given, forms, shifts)
        self.ports, self._floating = places.ports, places.floating
        self.held: BoolArray = places.held.copy()
        for name, shift in shifts.items():
            if name not in places.fixed and not _is_sprung(springs, shift, forms.layout.n_local):
                self.held[free_dof(forms, shift, self.held)] = True
        self._vector = fem.Function(forms.space).x
        none = np.zeros((len(self._vector.array), 0))
        self._units = np.stack([self._spread(unit) for unit in places.units.T], axis=1) if self.ports else none
        # local dofs, ghosts included, of each floating electrode
        self._together = [np.flatnonzero(self._spread(_marked(self._n, one.dofs))) for one in self._floating]
        self._zero = np.flatnonzero(self._spread(self.held.astype(float)))
        self.efforts: FloatArray = np.zeros(len(self.ports))
        self._change, self._gathered = PETSc.Mat(), PETSc.Mat()  # no handles before the first tangent

    def complete(self, values: FloatArray) -> None:
        """Give an unknown (local dofs including ghosts,) the values of the conditions; it is changed. Collective."""
        values[self._zero] = self._units[self._zero] @ self.efforts
        for one, dofs in zip(self._floating, self._together, strict=True):
            place = one.leader - self._first
            values[dofs] = self._comm.allreduce(values[place] if 0 <= place < self._n else 0.0)

    def flows(self, parts: FloatArray) -> FloatArray:
        """(k,) C, charges, of the parts (local dofs including ghosts,) of forces that the ranks have. Collective."""
        return np.asarray(self._comm.allreduce(-(self._units.T @ parts))) if self.ports else np.zeros(0)

    def condense(self, forces: FloatArray) -> None:
        """As `condition_places.condense`. Collective."""
        condense(self._comm, forces, held=self.held, floating=self._floating, first=self._first)

    def constrain(self, matrix: PETSc.Mat) -> PETSc.Mat:
        """The tangent of what is free, the same matrix or one that is filled anew at each call. Collective."""
        if self._floating:
            if self._change.handle:
                matrix.ptap(self._change, result=self._gathered)
            else:
                self._change = self._moved_together(matrix)
                self._gathered = matrix.ptap(self._change)
            matrix = self._gathered
        take_out(matrix, self.held, first=self._first)
        return matrix

    def _moved_together(self, matrix: PETSc.Mat) -> PETSc.Mat:
        """The change to the basis in which the dofs of each floating electrode move with one of them. Collective."""
        change = PETSc.Mat().createAIJ(matrix.getSizes(), nnz=2, comm=self._comm)
        rows = np.arange(self._first, self._first + self._n, dtype=PETSc.IntType)
        for row in rows:
            change.setValue(row, row, 1.0)
        for one in self._floating:
            for row in one.dofs + self._first:
                change.setValue(row, one.leader, 1.0)
        change.assemble()
        return change

    def _spread(self, values: FloatArray) -> FloatArray:
        """(local dofs including ghosts,) of owned ones. Collective."""
        self._vector.array[: self._n] = values
        self._vector.scatter_forward()
        return np.asarray(self._vector.array.copy())


@dataclass(frozen=True, eq=False)
class PortStates:
    """Of the k ports of a body, in an accepted step.

    Attributes:
        efforts: (k,) V.
        flows: (k,) C.
        works: (k,) J that came in by each, effort over flow by trapezoids.
    """

    efforts: FloatArray
    flows: FloatArray
    works: FloatArray

    @classmethod
    def at_rest(cls, count: int) -> PortStates:
        """Nothing of any."""
        return cls(*np.zeros((3, count)))

    def moved(self, efforts: FloatArray, flows: FloatArray) -> PortStates:
        """After a step."""
        works = self.works + 0.5 * (self.efforts + efforts) * (flows - self.flows)
        return PortStates(efforts.copy(), flows.copy(), works)


def held_fields(
    conditions: Sequence[Condition], forms: DiscreteForms, springs: SurfaceSprings | None
) -> HeldFields | None:
    """As `HeldFields`; None of forms without a gauge. Collective."""
    if conditions == () and not any(group.optional.gauge is not None for group in forms.groups):
        return None
    found = HeldFields(conditions, forms, springs)
    return found if forms.comm.allreduce(bool(found.held.any()), op=MPI.LOR) else None


def _marked(count: int, dofs: NDArray[np.int64]) -> FloatArray:
    marks: FloatArray = np.zeros(count)
    marks[dofs] = 1.0
    return marks


def _is_sprung(springs: SurfaceSprings | None, shift: FloatArray, count: int) -> bool:
    """Whether springs on facets hold a field (owned dofs,) of an unknown of so many local dofs. Collective."""
    if springs is None:
        return False
    matrix = springs.tangent(np.zeros(count))
    found = not costs_nothing(matrix, shift)
    matrix.destroy()
    return found
