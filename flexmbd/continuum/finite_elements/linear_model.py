"""A linear elastic body on a mesh, at rest or about a loaded static state: the input of a reduction."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from petsc4py import PETSc

import numpy as np
import ufl
from dolfinx import fem
from numpy.typing import ArrayLike, NDArray

from flexmbd.brief import brief
from flexmbd.continuum import parallel
from flexmbd.continuum.contract.dof_layout import DofLayout
from flexmbd.continuum.finite_elements import assembly
from flexmbd.continuum.finite_elements.cell_group import CellGroup
from flexmbd.continuum.finite_elements.condensed_stiffness import CondensedStiffness
from flexmbd.continuum.finite_elements.discrete_forms import DiscreteForms
from flexmbd.continuum.finite_elements.field_conditions import FieldConditions
from flexmbd.continuum.finite_elements.held_surface import HeldSurface
from flexmbd.continuum.finite_elements.interface import FoundInterface
from flexmbd.continuum.finite_elements.model_picture import PicturedModel
from flexmbd.continuum.finite_elements.nodal_group import NodalGroup
from flexmbd.continuum.finite_elements.stress import StressRecovery
from flexmbd.continuum.finite_elements.surface_group import surface_kinetic_energy, surface_work
from flexmbd.continuum.finite_elements.temperature import heated_groups
from flexmbd.errors import FormulationError, InterfaceError, RecordError
from flexmbd.given import checked, numbers
from flexmbd.record.reduced_body import ReducedBody
from flexmbd.record.stress_field import StressField

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class StaticState:
    """A static state of a model that is held at one interface.

    Attributes:
        frame: the interface that is held, and carries the body frame.
        displacement: (local dofs including ghosts,) in the mesh's axes.
        interfaces: the frames in that state.
        balance: (owned dofs,) N, internal forces less those on the nodes from outside; what is left of it are
            the forces that rigid interfaces hold together, and those of the interfaces' own loads.
        rigid_error: of the static shapes at rest; see `flexmbd.reduction.static_shapes.statics`.
        loads: the loads of the body, as text.
        note: on the iteration that found it, for provenance.
        spin: (3,) rad/s of the body, along the mesh's axes.
        rise: K, of the temperature; None where there is none.
    """

    frame: str
    displacement: FloatArray
    interfaces: tuple[FoundInterface, ...]
    balance: FloatArray
    rigid_error: float
    loads: tuple[str, ...]
    note: str
    spin: FloatArray
    rise: fem.Function | None = None

    __repr__ = brief


class LinearModel(PicturedModel):
    """Small displacements of a body about a state, with named interfaces; a `ContinuumModel` or a `PrestressedModel`.

    Nothing is changed after construction.

    Attributes:
        forms: the formulations on the mesh, and the interfaces at rest.
        parameters: as they were given: one instance of the formulation's `Parameters`, or a
            dictionary of them by cell group.
        layout: of the displacement and the other parts of the unknown in its space.
        interfaces: the frames found on the mesh, in the state.
        K: stiffness in the state (N/m, N, N m), over all dofs, PETSc AIJ matrix spread by rows.
        M: consistent mass (kg, kg m, kg m^2), the same layout.
        state: the loaded static state, or None at rest.
        supports: facets that are held in the axes of the body frame.
        nodal: groups whose nodes keep all their dofs in a reduction.
        condensed: matrices of the fields of one cell; None: there are none.
        conditions: what holds a potential, built into K, or None.
    """

    def __init__(
        self,
        forms: DiscreteForms,
        parameters: Any,
        *,
        layout: DofLayout,
        interfaces: tuple[FoundInterface, ...],
        K: PETSc.Mat,
        M: PETSc.Mat,
        state: StaticState | None,
        supports: tuple[HeldSurface, ...] = (),
        nodal: tuple[NodalGroup, ...] = (),
        condensed: CondensedStiffness | None = None,
        conditions: FieldConditions | None = None,
    ) -> None:
        """Keep the parts; not collective."""
        super().__init__(forms, layout=layout, interfaces=interfaces)
        self.parameters = parameters
        self.K, self.M, self.state = K, M, state
        self.supports, self.nodal = supports, nodal
        self.condensed, self.conditions = condensed, conditions

    @property
    def n_owned_nodes(self) -> int:
        """Number of displacement nodes this rank owns, which stand before its ghosts."""
        return self.layout.n_owned_nodes

    @property
    def node_x(self) -> FloatArray:
        """(local nodes including ghosts, 3) m, positions of the displacement nodes in the mesh's axes."""
        return self.layout.node_x

    @property
    def is_definite(self) -> bool:
        """Whether K is positive definite once the body is held: see `DiscreteForms`. Collective at the first call."""
        return self.forms.is_definite

    @property
    def has_sections(self) -> bool:
        """Whether the formulations have cross-sections (`motion`), as beams and shells do."""
        return all(group.has_sections for group in self.groups)

    @property
    def mesh_fingerprint(self) -> str:
        """`TaggedMesh.fingerprint` of the mesh. Collective at the first call."""
        return self.forms.mesh_fingerprint

    @cached_property
    def displacement(self) -> FloatArray:
        """(local dofs including ghosts,) from the undeformed mesh, in its axes: zero but for a loaded state."""
        return np.zeros(self.layout.n_local) if self.state is None else self.state.displacement

    @cached_property
    def warm_groups(self) -> tuple[CellGroup, ...]:
        """The cell groups with their formulations at the temperature of the loaded state; `groups` where it has none.

        Not collective.
        """
        rise = None if self.state is None else self.state.rise
        return self.groups if rise is None else heated_groups(self.groups, rise)

    def interface(self, name: str) -> FoundInterface:
        """The interface of that name.

        Raises:
            InterfaceError: there is none; the message lists those there are.
        """
        for found in self.interfaces:
            if found.name == name:
                return found
        if any(group.name == name for group in self.nodal):
            raise InterfaceError(
                f"interface {name!r} is nodal and carries no frame; where a frame is needed take Interface({name!r})"
            )
        known = ", ".join(repr(found.name) for found in self.interfaces) or "none"
        raise InterfaceError(f"the model has no interface {name!r}; it has: {known}")

    @checked(error=FormulationError)
    def rigid_motions(self, origin: ArrayLike, axes: ArrayLike) -> FloatArray:
        """The six unit rigid motions of the body, by the formulation's `rigid_motion`.

        Collective at the first call of a process, which may compile.

        Args:
            origin: (3,) m, the point that rotations leave at rest, in the mesh's axes.
            axes: (3, 3) rotation; motions are along and about its columns.

        Returns:
            (owned dofs, 6): three translations by 1 m, three small rotations by 1 rad.

        Raises:
            FormulationError: the origin or the axes are not finite numbers of that shape.
        """
        at, turned = numbers(origin), numbers(axes)
        if at.shape != (3,) or turned.shape != (3, 3):
            raise FormulationError(
                f"origin must be three numbers and axes (3, 3), a rotation, got shapes {at.shape} and {turned.shape}"
            )
        return np.asfortranarray(self.layout.rigid_columns(at, turned)[: self.n_owned])

    @checked(error=FormulationError)
    def internal_work(self, u: fem.Function, v: ufl.core.expr.Expr) -> list[ufl.Form]:
        """Virtual work, J, of the internal forces and of springs on facets at u on v, linear in v; not collective.

        One form a term and cell group, whose sum it is. Each must be assembled by itself, because its
        quadrature rule is its own, and so must be its derivatives by u: tangent, geometric stiffness.

        Args:
            u: on `space`.
            v: a test function or a function on `space`.

        Raises:
            FormulationError: there are fields of one cell, which are condensed.
        """
        self._refuse_fields()
        return [*assembly.internal_work(self.warm_groups, u, v), *surface_work(self.surfaces, u, v)]

    @checked(error=FormulationError)
    def kinetic_energy(self, v: fem.Function) -> list[ufl.Form]:
        """Kinetic energy, J, of the velocity v on `space`; one form a term and cell group."""
        return [*assembly.kinetic_energy(self.groups, v), *surface_kinetic_energy(self.surfaces, v)]

    @checked(error=FormulationError, agree=parallel.told_to_all)
    def tangent(self, u: FloatArray) -> PETSc.Mat:
        """Stiffness at a displacement: the derivative of the internal forces there. Collective.

        Compiles at the first call.

        Args:
            u: (owned dofs,) in the mesh's axes.

        Returns:
            A new matrix with the layout of `K`; the caller destroys it.

        Raises:
            FormulationError: on all ranks: u does not fit, an entry is not finite, or there are fields of one cell,
                which are condensed.
        """
        at, forms = self._tangent
        if np.shape(u) != (self.n_owned,):
            raise FormulationError(f"u must have shape ({self.n_owned},), that of the owned dofs, got {np.shape(u)}")
        at.x.array[: self.n_owned] = u
        at.x.scatter_forward()
        return self.tied(assembly.assemble({"tangent stiffness": forms}, self.groups, self.space)[0])

    @property
    def tied_dofs(self) -> NDArray[np.bool_]:
        """(owned dofs,) whether a dof follows others by ties."""
        follows = np.zeros(self.n_owned, dtype=bool)
        if self.ties is not None:
            follows[self.ties.dofs] = True
        return follows

    def tied(self, matrix: PETSc.Mat) -> PETSc.Mat:
        """A matrix over all dofs with the layout of `K`, as ties make of it; it is destroyed where it is another.

        Collective.
        """
        if self.ties is None:
            return matrix
        found = self.ties.condensed(matrix, keeps_diagonal=False)
        matrix.destroy()
        return found

    @checked(error=RecordError, agree=parallel.told_to_all)
    def stress_field(
        self, body: ReducedBody, q: ArrayLike, *, heat: Mapping[str, float] | None = None
    ) -> StressField:
        """Displacement and stress of a body reduced from this model. Collective.

        Args:
            body: as `flexmbd.continuum.finite_elements.recovery.nodal_modes` wants it.
            q: (n,) modal coordinates, the same on every rank.
            heat: factors of the record's temperatures (`Heat`) by their names, dimensionless; of others zero.

        Raises:
            RecordError: on all ranks: the modes are not there, `q` does not fit, or a temperature is not known.
        """
        return self._stress.field(body, q, heat=heat)

    @property
    def unknown_space(self) -> fem.FunctionSpace:
        """Of the formulations' own unknown: `space`, and the fields of one cell where there are some."""
        return self.forms.whole if self.condensed is not None else self.space

    def unknown_columns(self, columns: FloatArray) -> FloatArray:
        """Small motions as fields of the formulations' own unknown; not collective.

        Args:
            columns: (local dofs including ghosts, k).

        Returns:
            (local dofs of `unknown_space` including ghosts, k).
        """
        return columns if self.condensed is None else self.condensed.whole_columns(columns)

    def coupled(self) -> LinearModel:
        """The body with its fields of one cell as unknowns of the body; itself where there are none. Collective."""
        return self

    def _refuse_fields(self) -> None:
        if self.condensed is not None:
            raise FormulationError(
                f"{self.form_name} has fields of one cell, which are condensed at rest, so that its forces at a "
                "displacement are no form of it: take ContinuumModel(..., condense=False), or a NonlinearModel"
            )

    @cached_property
    def _stress(self) -> StressRecovery:
        return StressRecovery(self, rest=self.displacement)

    @cached_property
    def _tangent(self) -> tuple[fem.Function, list[fem.Form]]:
        at, v = fem.Function(self.space), ufl.TestFunction(self.space)
        return at, assembly.derivatives(self.internal_work(at, v), at)
