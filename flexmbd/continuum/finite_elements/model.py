"""Formulations on a mesh: stiffness and mass as PETSc matrices, and the interfaces.

The matrices are the derivatives of internal forces and momentum at rest; see `assembly`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import ufl
from dolfinx import fem

from flexmbd.continuum import parallel
from flexmbd.continuum.finite_elements import assembly
from flexmbd.continuum.finite_elements.cell_group import Pairs, Source
from flexmbd.continuum.finite_elements.condensed_stiffness import CondensedStiffness
from flexmbd.continuum.finite_elements.discrete_forms import discretise
from flexmbd.continuum.finite_elements.elastic_sums import elastic_sums, tell_units
from flexmbd.continuum.finite_elements.electrode import Condition
from flexmbd.continuum.finite_elements.field_conditions import find_conditions
from flexmbd.continuum.finite_elements.held_surface import SurfaceSupport, find_supports, held_dofs
from flexmbd.continuum.finite_elements.interface import Interface
from flexmbd.continuum.finite_elements.linear_model import LinearModel
from flexmbd.continuum.finite_elements.nodal_group import NodalInterface
from flexmbd.continuum.finite_elements.nodal_interface import find_nodal_groups
from flexmbd.continuum.finite_elements.surface_group import Surfaces, surface_kinetic_energy, surface_work
from flexmbd.continuum.finite_elements.weld import Weld, with_welds
from flexmbd.continuum.grid.tagged_mesh import TaggedMesh
from flexmbd.errors import FormulationError, MeshError
from flexmbd.given import checked, is_list


@checked("condense", error=FormulationError, agree=parallel.told_to_all)
class ContinuumModel(LinearModel):
    """A linear elastic body on a mesh, with named interfaces, at rest. Constructing one is collective."""

    def __init__(
        self,
        mesh: TaggedMesh,
        formulation: Source | Pairs,
        parameters: Any = None,
        *,
        degree: int,
        interfaces: Sequence[Interface | NodalInterface] = (),
        surfaces: Surfaces | None = None,
        supports: Sequence[SurfaceSupport] = (),
        condense: bool = True,
        conditions: Sequence[Condition] = (),
        welds: Sequence[Weld] = (),
    ) -> None:
        """Check everything, then assemble. Collective over the mesh's communicator.

        Args:
            mesh: lengths in m.
            formulation: a module, the name of one in `flexmbd.forms`, or a form file's path; or
                several as {cell group: (formulation, parameters)}, whose elements are the same.
            parameters: an instance of the formulation's `Parameters`, SI units; left out with several.
            degree: of the elements, at least that of the mesh's geometry.
            interfaces: groups of the mesh that carry frames, and groups whose nodes keep their own dofs.
            surfaces: springs and mass on the surface: {facet group: (formulation, parameters)}, of which
                `surface_energy` and `surface_kinetic_energy` are taken.
            supports: symmetry planes of a half or a quarter of a part, and rollers, at rest in the body frame.
            condense: whether fields of one cell, as enhanced strains, are condensed there; else they are unknowns of
                the body. What is reduced is the same but for round-off.
            conditions: electrodes, of a formulation whose `gauge` names a potential. Where none of them fixes it, the
                potential is zero in the mean.
            welds: nodes that follow facets, of solids of displacements alone.

        Raises:
            FormulationError: a form file breaks its contract, or does not fit its parameters, the
                cell or the degree; the pairs do not fit the cell groups or each other; K or M has
                entries that are not finite; terms on facets without `surfaces`; a field of one cell that its own
                equations do not determine; electrodes, where the formulation has no `gauge` that names their
                field; a plane formulation (`plane_form`).
            InterfaceError: an interface cannot carry a frame (see `find_interfaces`), nodal interfaces that do not fit
                (`find_nodal_groups`), or the ranks were given different ones.
            MeshError: `mesh` is not a `TaggedMesh`; with several pairs, cells in no group or in two; `surfaces` on
                facets that the surface has not; supports that are not well formed; electrodes that touch, that are
                given twice, or on groups that the mesh has not; as `with_welds`, or a support that holds one side of a
                weld alone.
        """
        framed: Any = interfaces
        nodes: list[NodalInterface] = []
        if is_list(interfaces):  # of what is none all ranks are told below
            framed = [one for one in interfaces if not isinstance(one, NodalInterface)]
            nodes = [one for one in interfaces if isinstance(one, NodalInterface)]
        forms = discretise(
            mesh, formulation, parameters, degree=degree, interfaces=framed, surfaces=surfaces, condense=condense
        )
        if any(group.optional.thickness is not None for group in forms.groups):
            raise FormulationError(
                f"{forms.form_name} moves in its plane alone, and what is reduced moves in space: take "
                "forms.plane_stress, or make it a NonlinearModel"
            )
        forms = with_welds(forms, welds)
        held = find_supports(supports, mesh=mesh, layout=forms.layout)
        if forms.ties is not None:
            of_supports = held_dofs(held, layout=forms.layout)
            forms.ties.refuse_held(of_supports.reshape(-1, 3), by="supports", kind=MeshError)
        nodal = find_nodal_groups(
            nodes,
            mesh=mesh,
            layout=forms.layout,
            frames=forms.interfaces,
            supports=held,
            ties=forms.ties,
        )
        if parameters is None:
            parameters = {group.name: group.parameters for group in forms.groups}
        u, v = fem.Function(forms.space), ufl.TestFunction(forms.space)
        kinetic = [*assembly.kinetic_energy(forms.groups, u), *surface_kinetic_energy(forms.surfaces, u)]
        momentum = [ufl.derivative(term, u, v) for term in kinetic]
        springs = surface_work(forms.surfaces, u, v)
        integrals = {"mass": assembly.derivatives_at_rest(momentum, u)}
        condensed = None
        if forms.fields is None:
            work = [*assembly.internal_work(forms.groups, u, v), *springs]
            integrals = {"stiffness": assembly.derivatives_at_rest(work, u), **integrals}
            stiffness, mass = assembly.assemble(integrals, forms.groups, forms.space)
        else:
            condensed = CondensedStiffness(forms, forms.fields)
            stiffness = condensed.stiffness(assembly.derivatives_at_rest(springs, u))
            (mass,) = assembly.assemble(integrals, forms.groups, forms.space)
        if not forms.surfaces:
            tell_units(elastic_sums(mesh, forms.layout, stiffness, mass), mesh.comm)
        if forms.ties is not None:
            alone = stiffness, mass
            stiffness, mass = (forms.ties.condensed(matrix, keeps_diagonal=False) for matrix in alone)
            for matrix in alone:
                matrix.destroy()
        stiffness, found = find_conditions(conditions, stiffness, forms)
        super().__init__(
            forms,
            parameters,
            layout=forms.layout,
            interfaces=forms.interfaces,
            K=stiffness,
            M=mass,
            state=None,
            supports=held,
            nodal=nodal,
            condensed=condensed,
            conditions=found,
        )
        self._given: dict[str, Any] = {
            "degree": degree, "interfaces": interfaces, "surfaces": surfaces, "supports": supports, "condense": False,
            "conditions": conditions, "welds": welds,
        }  # fmt: skip
        self._formulation = formulation

    def coupled(self) -> LinearModel:
        """See `LinearModel.coupled`."""
        if self.condensed is None:
            return self
        parameters = None if isinstance(self._formulation, Mapping) else self.parameters
        return ContinuumModel(self.mesh, self._formulation, parameters, **self._given)
