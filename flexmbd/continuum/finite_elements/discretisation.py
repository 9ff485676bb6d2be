"""The common protocol of linear models and bodies with history."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from mpi4py import MPI

from dolfinx import fem

from flexmbd.continuum.contract.dof_layout import DofLayout
from flexmbd.continuum.finite_elements.cell_group import CellGroup
from flexmbd.continuum.finite_elements.nodal_ties import NodalTies
from flexmbd.continuum.finite_elements.surface_group import SurfaceGroup
from flexmbd.continuum.grid.tagged_mesh import TaggedMesh


@runtime_checkable
class Discretisation(Protocol):
    """Formulations on a mesh, and the space of their unknown (`LinearModel`, `NonlinearModel`)."""

    @property
    def mesh(self) -> TaggedMesh:
        """The undeformed mesh and its groups."""

    @property
    def groups(self) -> tuple[CellGroup, ...]:
        """The cell groups, each with its formulation and parameters."""

    @property
    def surfaces(self) -> tuple[SurfaceGroup, ...]:
        """The facet groups with springs or mass, each with its formulation and parameters."""

    @property
    def space(self) -> fem.FunctionSpace:
        """The unknown's function space."""

    @property
    def layout(self) -> DofLayout:
        """The layout of the displacement and the other parts of the unknown."""

    @property
    def ties(self) -> NodalTies | None:
        """Of nodes that follow others."""

    @property
    def comm(self) -> MPI.Comm:
        """The ranks it is spread over."""
