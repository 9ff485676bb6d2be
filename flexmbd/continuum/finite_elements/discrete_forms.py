"""Formulations on a mesh with their unknown and interfaces: the basis of linear models and bodies with history."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
from dolfinx import fem
from numpy.typing import NDArray

from flexmbd.continuum import parallel
from flexmbd.continuum.contract.cell_fields import CellFields, common_cell_fields, find_cell_fields
from flexmbd.continuum.contract.dof_layout import DofLayout, RigidDisplacement, dof_layout
from flexmbd.continuum.contract.formulation import Formulation
from flexmbd.continuum.finite_elements.cell_group import CellGroup, Pairs, Source, pair_cells
from flexmbd.continuum.finite_elements.interface import FoundInterface, Interface, find_interfaces
from flexmbd.continuum.finite_elements.layered_cells import tell_layers
from flexmbd.continuum.finite_elements.nodal_ties import NodalTies
from flexmbd.continuum.finite_elements.surface_group import SurfaceGroup, Surfaces, check_mass, pair_facets
from flexmbd.continuum.grid.tagged_mesh import TaggedMesh
from flexmbd.errors import FormulationError, InterfaceError, MeshError
from flexmbd.given import is_list
from flexmbd.round_off import EQUAL


@dataclass(frozen=True, eq=False)
class DiscreteForms:
    """Formulations on a mesh; made by `discretise`.

    Attributes:
        mesh: the undeformed mesh and its groups.
        groups: the cell groups, each with its formulation and parameters; one group with the name
            None where the whole body has the same.
        degree: of the elements.
        space: the unknown's function space: of what cells share.
        layout: of the displacement and the other parts of the unknown.
        interfaces: the frames found on the mesh.
        surfaces: facet groups with springs or mass.
        fields: of one cell, which are condensed there and are no part of `space`; None: there are none.
        whole: the space of the formulations' own unknown where there are such fields; else `space`.
        ties: of nodes that follow others, as of welds; None: there are none.
    """

    mesh: TaggedMesh
    groups: tuple[CellGroup, ...]
    degree: int
    space: fem.FunctionSpace
    layout: DofLayout
    interfaces: tuple[FoundInterface, ...]
    surfaces: tuple[SurfaceGroup, ...]
    fields: CellFields | None
    whole: fem.FunctionSpace
    ties: NodalTies | None = None

    @property
    def comm(self) -> MPI.Comm:
        """The ranks it is spread over."""
        return self.mesh.comm

    @property
    def formulation(self) -> Formulation:
        """The first group's formulation, whose element and rigid motion are those of all."""
        return self.groups[0].formulation

    @property
    def form_name(self) -> str:
        """Names of the formulations' modules."""
        return ", ".join(dict.fromkeys(group.form_name for group in self.groups))

    @cached_property
    def is_definite(self) -> bool:
        """Whether the stiffness is positive definite once the body is held. Collective at the first call.

        Not with unknowns that no rigid motion moves, as pressures: K is then that of a saddle point,
        and a factor must be one for indefinite matrices.
        """
        own = self.layout.kinematic[: self.layout.n_owned]
        return bool(self.mesh.comm.allreduce(bool(own.all()), op=MPI.LAND))

    @cached_property
    def mesh_fingerprint(self) -> str:
        """`TaggedMesh.fingerprint` of the mesh. Collective at the first call."""
        return self.mesh.fingerprint()


class DiscretisedBody:
    """A body of formulations on a mesh: the common base of `LinearModel` and `NonlinearModel`.

    Attributes:
        forms: the formulations on the mesh, and the interfaces of the undeformed body.
        layout: where the displacement, and what else the unknown holds, lies in the unknown's space.
        interfaces: the frames found on the mesh.
    """

    def __init__(self, forms: DiscreteForms, *, layout: DofLayout, interfaces: tuple[FoundInterface, ...]) -> None:
        """Keep the parts; not collective."""
        self.forms, self.layout, self.interfaces = forms, layout, interfaces

    @property
    def mesh(self) -> TaggedMesh:
        """The undeformed mesh and its groups."""
        return self.forms.mesh

    @property
    def groups(self) -> tuple[CellGroup, ...]:
        """The cell groups, each with its formulation and parameters; one with the name None where all is the same."""
        return self.forms.groups

    @property
    def surfaces(self) -> tuple[SurfaceGroup, ...]:
        """Facet groups with springs or mass, each with its formulation and parameters."""
        return self.forms.surfaces

    @property
    def has_surface_energy(self) -> bool:
        """Whether springs lie on facets, so that a rigid motion costs energy."""
        return any(group.optional.surface_energy is not None for group in self.surfaces)

    @property
    def degree(self) -> int:
        """Degree of the elements; with a formulation of the updated configuration that of the mesh's geometry too."""
        return self.forms.degree

    @property
    def space(self) -> fem.FunctionSpace:
        """The unknown's function space."""
        return self.forms.space

    @property
    def fields(self) -> CellFields | None:
        """The fields of one cell, which are condensed there and are no part of `space`; None: there are none."""
        return self.forms.fields

    @property
    def comm(self) -> MPI.Comm:
        """The communicator the body is spread over."""
        return self.mesh.comm

    @property
    def formulation(self) -> Formulation:
        """The first group's formulation, whose element and rigid motion are those of all."""
        return self.forms.formulation

    @property
    def form_name(self) -> str:
        """Names of the formulations' modules."""
        return self.forms.form_name

    @property
    def n_owned(self) -> int:
        """Number of dofs this rank owns, which stand before its ghosts."""
        return self.layout.n_owned

    @property
    def ties(self) -> NodalTies | None:
        """Of nodes that follow others, as of welds; None: there are none."""
        return self.forms.ties

    def complete(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Give what follows among dofs (owned, or local ones with ghosts, ...) its values. Collective with ties.

        Returns:
            The same array, which is changed; so of the methods below.
        """
        return values if self.ties is None else self.ties.complete_dofs(values)

    def complete_nodes(self, nodal: NDArray[np.float64]) -> NDArray[np.float64]:
        """As `complete`, of nodes (owned, or local ones with ghosts, ...). Collective with ties."""
        return nodal if self.ties is None else self.ties.complete(nodal)

    def condense(self, forces: NDArray[np.float64]) -> NDArray[np.float64]:
        """Hand forces (owned dofs, ...) on what follows on to what leads. Collective with ties."""
        return forces if self.ties is None else self.ties.condense_dofs(forces)

    def condense_nodes(self, forces: NDArray[np.float64]) -> NDArray[np.float64]:
        """As `condense`, of nodes (owned nodes, ...). Collective with ties."""
        return forces if self.ties is None else self.ties.condense(forces)

    @property
    def displacement_dofs(self) -> NDArray[np.int32]:
        """(local nodes including ghosts, 3) local dofs of the displacement's components at each node."""
        return self.layout.displacement_dofs


def discretise(
    mesh: TaggedMesh,
    formulation: Source | Pairs,
    parameters: Any,
    *,
    degree: int,
    interfaces: Sequence[Interface],
    surfaces: Surfaces | None = None,
    with_history: bool = False,
    condense: bool = True,
) -> DiscreteForms:
    """Check everything that both kinds of bodies are made of. Collective over the mesh's communicator.

    Args:
        mesh: lengths in m.
        formulation: a module, the name of one in `flexmbd.forms`, or a form file's path; or
            several as {cell group: (formulation, parameters)}, whose elements are the same.
        parameters: an instance of the formulation's `Parameters`, SI units; None with several.
        degree: of the elements, at least that of the mesh's geometry.
        interfaces: groups of the mesh that carry frames.
        surfaces: formulations and parameters by facet group (`pair_facets`).
        with_history: whether formulations may keep a history.
        condense: whether fields of one cell are condensed there, and are no unknowns of the body.

    Raises:
        FormulationError: a form file breaks its contract, or does not fit its parameters, the
            cell or the degree; the pairs do not fit the cell groups or each other.
        InterfaceError: an interface cannot carry a frame (see `find_interfaces`), or the ranks were
            given different ones.
        MeshError: `mesh` is not a `TaggedMesh`; with several pairs, cells in no group or in two; `surfaces` on facets
            that the surface has not.
    """
    if not isinstance(mesh, TaggedMesh):
        raise MeshError(f"mesh must be a TaggedMesh, from flexmbd.meshes; got {mesh!r}")
    # on several ranks the matrices of a model that is gone wait for a collective call
    PETSc.garbage_cleanup(mesh.comm)
    groups = pair_cells(mesh, formulation, parameters, degree=degree, with_history=with_history)
    tell_layers(mesh, groups)
    facets = pair_facets(mesh, groups, surfaces, degree=degree)
    form, cell = groups[0].formulation, mesh.mesh.topology.cell_name()
    whole = space = fem.functionspace(mesh.mesh, form.element(cell, 3, degree))
    fields = None
    if condense:
        pairs = [(one.formulation, one.parameters) for one in groups]
        pairs += [(one.formulation, one.parameters) for one in facets]
        fields = common_cell_fields([find_cell_fields(one, p, cell=cell, degree=degree) for one, p in pairs])
    if fields is not None:
        space = fem.functionspace(mesh.mesh, fields.shared_element)
        groups = tuple(replace(one, fields=fields) for one in groups)
        facets = tuple(replace(one, fields=fields) for one in facets)
    layout = dof_layout(space, _rigid_motion(form, fields))
    _check_rigid_motions(groups, space, layout)
    check_mass(facets, space)
    parallel.check_same(mesh.comm, InterfaceError, interfaces=interfaces)
    if not is_list(interfaces):
        raise InterfaceError(f"interfaces must be a list, as interfaces=[Interface('root')], got {interfaces!r:.100}")
    is_plane = any(group.optional.thickness is not None for group in groups)
    found = tuple(find_interfaces(interfaces, mesh=mesh, layout=layout, is_plane=is_plane))
    return DiscreteForms(mesh, groups, degree, space, layout, found, facets, fields, whole)


def _rigid_motion(form: Formulation, fields: CellFields | None) -> RigidDisplacement:
    return form.rigid_motion if fields is None else fields.shared_rigid_motion(form.rigid_motion)


def _check_rigid_motions(groups: tuple[CellGroup, ...], space: fem.FunctionSpace, layout: DofLayout) -> None:
    """Refuse formulations whose unknowns mean different things. Collective."""
    others = {group.form_name: group.formulation for group in groups}
    del others[groups[0].form_name]
    for name, other in others.items():
        own = layout.rigid_columns(np.zeros(3), np.eye(3))
        motion = _rigid_motion(other, groups[0].fields)
        off = dof_layout(space, motion).rigid_columns(np.zeros(3), np.eye(3)) - own
        largest = np.array([abs(off).max(initial=0.0), abs(own).max(initial=0.0)])
        space.mesh.comm.Allreduce(MPI.IN_PLACE, largest, op=MPI.MAX)
        if not largest[0] <= EQUAL * largest[1]:
            raise FormulationError(
                f"{groups[0].form_name} and {name} have different rigid motions, so their unknowns "
                "mean different things: they cannot be in one body"
            )
