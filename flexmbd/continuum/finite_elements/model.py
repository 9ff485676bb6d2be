"""Formulations on a mesh: stiffness and mass as PETSc matrices, and the interfaces.

The matrices are the derivatives of internal forces and momentum at rest; see `assembly`.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import ufl
from dolfinx import fem
from numpy.typing import ArrayLike, NDArray

from flexmbd.continuum import parallel
from flexmbd.continuum.contract.dof_layout import DofLayout, dof_layout
from flexmbd.continuum.contract.formulation import Formulation
from flexmbd.continuum.finite_elements import assembly
from flexmbd.continuum.finite_elements.cell_group import CellGroup, Pairs, Source, pair_cells
from flexmbd.continuum.finite_elements.interface import FoundInterface, Interface, find_interfaces
from flexmbd.continuum.finite_elements.stress import StressRecovery
from flexmbd.continuum.grid.tagged_mesh import TaggedMesh
from flexmbd.errors import FormulationError, InterfaceError, MeshError
from flexmbd.record.reduced_body import ReducedBody
from flexmbd.record.stress_field import StressField

FloatArray = NDArray[np.float64]


# Largest difference of two formulations' rigid motions, relative to the motion.
_SAME_MOTION = 1e-12


class ContinuumModel:
    """A linear elastic body on a mesh, with named interfaces. Constructing one is collective.

    Nothing is changed after construction.

    Attributes:
        mesh: the mesh and its groups.
        groups: the cell groups, each with its formulation and parameters; one group with the name
            None where the whole body has the same.
        parameters: as they were given: one instance of the formulation's `Parameters`, or a
            dictionary of them by cell group.
        degree: of the elements.
        space: the unknown's function space.
        layout: where the displacement, and what else the unknown holds, lies in it.
        interfaces: the frames found on the mesh.
        K: stiffness at rest (N/m, N, N m), over all dofs, PETSc AIJ matrix spread by rows.
        M: consistent mass (kg, kg m, kg m^2), the same layout.
    """

    def __init__(
        self,
        mesh: TaggedMesh,
        formulation: Source | Pairs,
        parameters: Any = None,
        *,
        degree: int,
        interfaces: Sequence[Interface] = (),
    ) -> None:
        """Check everything, then assemble. Collective over the mesh's communicator.

        Args:
            mesh: lengths in m.
            formulation: a module, the name of one in `flexmbd.forms`, or a form file's path; or
                several as {cell group: (formulation, parameters)}, whose elements are the same.
            parameters: an instance of the formulation's `Parameters`, SI units; left out with several.
            degree: of the elements, at least that of the mesh's geometry.
            interfaces: groups of the mesh that carry frames.

        Raises:
            FormulationError: a form file breaks its contract, or does not fit its parameters, the
                cell or the degree; the pairs do not fit the cell groups or each other; K or M has
                entries that are not finite.
            InterfaceError: an interface cannot carry a frame (see `find_interfaces`), or the ranks were
                given different ones.
            MeshError: `mesh` is not a `TaggedMesh`; with several pairs, cells in no group or in two.
        """
        if not isinstance(mesh, TaggedMesh):
            raise MeshError(f"mesh must be a TaggedMesh, from flexmbd.meshes; got {mesh!r}")
        self.mesh = mesh
        self.degree = degree
        # on several ranks the matrices of a model that is gone wait for a collective call
        PETSc.garbage_cleanup(mesh.comm)
        self.groups: tuple[CellGroup, ...] = pair_cells(mesh, formulation, parameters, degree=degree)
        self.parameters = parameters
        if parameters is None:
            self.parameters = {group.name: group.parameters for group in self.groups}
        element = self.formulation.element(mesh.mesh.topology.cell_name(), 3, degree)
        self.space: fem.FunctionSpace = fem.functionspace(mesh.mesh, element)
        self.layout: DofLayout = dof_layout(self.space, self.formulation.rigid_motion)
        self._check_rigid_motions()
        parallel.check_same(mesh.comm, InterfaceError, interfaces=list(interfaces))
        self.interfaces = find_interfaces(interfaces, mesh=mesh, layout=self.layout)
        self.K, self.M = self._matrices()

    @property
    def comm(self) -> MPI.Comm:
        """The communicator the model is spread over."""
        return self.mesh.comm

    @property
    def formulation(self) -> Formulation:
        """The first group's formulation, whose element and rigid motion are those of all."""
        return self.groups[0].formulation

    @property
    def form_name(self) -> str:
        """Names of the formulations' modules."""
        return ", ".join(dict.fromkeys(group.form_name for group in self.groups))

    @property
    def n_owned(self) -> int:
        """Number of dofs this rank owns, which stand before its ghosts."""
        return self.layout.n_owned

    @property
    def n_owned_nodes(self) -> int:
        """Number of displacement nodes this rank owns, which stand before its ghosts."""
        return self.layout.n_owned_nodes

    @property
    def displacement_dofs(self) -> NDArray[np.int32]:
        """(local nodes including ghosts, 3) local dofs of the displacement's components at each node."""
        return self.layout.displacement_dofs

    @property
    def node_x(self) -> FloatArray:
        """(local nodes including ghosts, 3) m, positions of the displacement nodes in the mesh's axes."""
        return self.layout.node_x

    @cached_property
    def is_definite(self) -> bool:
        """Whether K is positive definite once the body is held. Collective at the first call.

        Not with unknowns that no rigid motion moves, as pressures: K is then that of a saddle point,
        and a factor must be one for indefinite matrices.
        """
        own = self.layout.kinematic[: self.n_owned]
        return bool(self.comm.allreduce(bool(own.all()), op=MPI.LAND))

    @property
    def has_sections(self) -> bool:
        """Whether the formulations have cross-sections (`motion`), as beams and shells do."""
        return all(group.has_sections for group in self.groups)

    @cached_property
    def mesh_fingerprint(self) -> str:
        """`TaggedMesh.fingerprint` of the mesh. Collective at the first call."""
        return self.mesh.fingerprint()

    def interface(self, name: str) -> FoundInterface:
        """The interface of that name.

        Raises:
            InterfaceError: there is none; the message lists those there are.
        """
        for found in self.interfaces:
            if found.name == name:
                return found
        known = ", ".join(repr(found.name) for found in self.interfaces) or "none"
        raise InterfaceError(f"the model has no interface {name!r}; it has: {known}")

    def rigid_motions(self, origin: ArrayLike, axes: ArrayLike) -> FloatArray:
        """The six unit rigid motions of the body, by the formulation's `rigid_motion`.

        Collective at the first call of a process, which may compile.

        Args:
            origin: (3,) m, the point that rotations leave at rest, in the mesh's axes.
            axes: (3, 3) rotation; motions are along and about its columns.

        Returns:
            (owned dofs, 6): three translations by 1 m, three small rotations by 1 rad.
        """
        return np.asfortranarray(self.layout.rigid_columns(origin, axes)[: self.n_owned])

    def internal_work(self, u: fem.Function, v: ufl.core.expr.Expr) -> list[ufl.Form]:
        """Virtual work, J, of the internal forces at u on v, linear in v; not collective.

        One form a term and cell group, whose sum it is. Each must be assembled by itself, because its
        quadrature rule is its own, and so must be its derivatives by u: tangent, geometric stiffness.

        Args:
            u: on `space`.
            v: a test function or a function on `space`.
        """
        return assembly.internal_work(self.groups, u, v)

    def kinetic_energy(self, v: fem.Function) -> list[ufl.Form]:
        """Kinetic energy, J, of the velocity v on `space`; one form a term and cell group."""
        return assembly.kinetic_energy(self.groups, v)

    def tangent(self, u: FloatArray) -> PETSc.Mat:
        """Stiffness at a displacement: the derivative of the internal forces there. Collective.

        Compiles at the first call.

        Args:
            u: (owned dofs,) in the mesh's axes.

        Returns:
            A new matrix with the layout of `K`; the caller destroys it.

        Raises:
            FormulationError: on all ranks: an entry is not finite.
        """
        at, forms = self._tangent
        at.x.array[: self.n_owned] = u
        at.x.scatter_forward()
        return assembly.assemble({"tangent stiffness": forms}, self.groups, self.space)[0]

    def stress_field(self, body: ReducedBody, q: ArrayLike) -> StressField:
        """Displacement and stress of a body reduced from this model. Collective.

        Args:
            body: as `flexmbd.continuum.finite_elements.recovery.nodal_modes` wants it.
            q: (n,) modal coordinates, the same on every rank.

        Raises:
            RecordError: on all ranks: the modes are not there, or `q` does not fit.
        """
        return self._stress.field(body, q)

    @cached_property
    def _stress(self) -> StressRecovery:
        return StressRecovery(self)

    @cached_property
    def _tangent(self) -> tuple[fem.Function, list[fem.Form]]:
        at, v = fem.Function(self.space), ufl.TestFunction(self.space)
        return at, assembly.derivatives(self.internal_work(at, v), at)

    def _matrices(self) -> tuple[PETSc.Mat, PETSc.Mat]:
        u, v = fem.Function(self.space), ufl.TestFunction(self.space)
        momentum = [ufl.derivative(term, u, v) for term in self.kinetic_energy(u)]
        forms = {
            "stiffness": assembly.derivatives_at_rest(self.internal_work(u, v), u),
            "mass": assembly.derivatives_at_rest(momentum, u),
        }
        stiffness, mass = assembly.assemble(forms, self.groups, self.space)
        return stiffness, mass

    def _check_rigid_motions(self) -> None:
        """Refuse formulations whose unknowns mean different things. Collective."""
        others = {group.form_name: group.formulation for group in self.groups}
        del others[self.groups[0].form_name]
        for name, other in others.items():
            own = self.layout.rigid_columns(np.zeros(3), np.eye(3))
            off = dof_layout(self.space, other.rigid_motion).rigid_columns(np.zeros(3), np.eye(3)) - own
            largest = np.array([abs(off).max(initial=0.0), abs(own).max(initial=0.0)])
            self.comm.Allreduce(MPI.IN_PLACE, largest, op=MPI.MAX)
            if not largest[0] <= _SAME_MOTION * largest[1]:
                raise FormulationError(
                    f"{self.groups[0].form_name} and {name} have different rigid motions, so their unknowns "
                    "mean different things: they cannot be in one body"
                )
