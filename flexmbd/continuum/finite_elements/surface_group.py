"""Facets of a solid's surface with springs or mass of their own: one formulation and its parameters on each group."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.mesh import exterior_facet_indices

from flexmbd.continuum import parallel
from flexmbd.continuum.contract import quadrature
from flexmbd.continuum.contract.cell_fields import CellFields
from flexmbd.continuum.contract.dof_layout import shaped
from flexmbd.continuum.contract.entries import ON_FACETS, Entry, OptionalEntries, optional_entries
from flexmbd.continuum.contract.formulation import Formulation, IntegralTerm, load_form, symbols
from flexmbd.continuum.contract.surface_terms import check_values
from flexmbd.continuum.finite_elements.cell_group import CellGroup, Source, check_formulation, form_name
from flexmbd.continuum.grid.tagged_mesh import TaggedMesh
from flexmbd.errors import FlexmbdError, FormulationError, MeshError

Surfaces: TypeAlias = "Mapping[str, tuple[Source, Any]]"
"""A formulation with `surface_energy` or `surface_kinetic_energy`, and its parameters, by the name of a facet group."""


@dataclass(frozen=True, eq=False)
class SurfaceGroup:
    """Facets with one formulation's springs and mass.

    Attributes:
        name: of the mesh's facet group.
        formulation: the checked form file, whose terms on facets are taken and nothing else of it.
        parameters: an instance of its `Parameters`.
        symbols: the parameters as constants on the mesh (`formulation.symbols`).
        mesh: with the group.
        fields: of one cell, of which no term on facets is a part; None: there are none.
    """

    name: str
    formulation: Formulation
    parameters: Any
    symbols: Any
    mesh: TaggedMesh
    fields: CellFields | None = None

    @property
    def form_name(self) -> str:
        """Name of the formulation's module."""
        return form_name(self.formulation)

    @property
    def optional(self) -> OptionalEntries:
        """The formulation's optional functions of the contract."""
        return optional_entries(self.formulation)

    def energy(self, u: ufl.core.expr.Expr) -> list[ufl.Form]:
        """Energy of the springs at u, J, one form a term; not collective."""
        return self._integrals(self.optional.surface_energy, u)

    def kinetic_energy(self, v: ufl.core.expr.Expr) -> list[ufl.Form]:
        """Kinetic energy of the mass on the facets, J, one form a term; not collective."""
        return self._integrals(self.optional.surface_kinetic_energy, v)

    def negative_area(self, space: fem.FunctionSpace) -> float:
        """Area, m^2, on which the mass is negative or no number, where it depends on the place. Collective."""
        area = 0.0
        v = fem.Function(space)
        unit = shaped([1.0, *np.zeros(int(np.prod(v.ufl_shape)) - 1)], v.ufl_shape)
        for density, rule in self._terms(self.optional.surface_kinetic_energy, v):
            mass = ufl.algorithms.expand_derivatives(2 * ufl.replace(density, {v: unit}))
            if any(isinstance(part, ufl.classes.GeometricQuantity) for part in _parts(mass)):
                bad = ufl.conditional(ufl.ge(mass, 0.0), 0.0, 1.0)
                area += fem.assemble_scalar(fem.form(self._integral((bad, rule))))
        return float(self.mesh.comm.allreduce(area))

    def _integrals(self, function: Entry, unknown: Any) -> list[ufl.Form]:
        return [self._integral(term) for term in self._terms(function, unknown)]

    def _terms(self, function: Entry, unknown: Any) -> list[IntegralTerm]:
        if function is None:
            return []
        if self.fields is None:
            return list(function(unknown, self.symbols))
        return self.fields.shared_terms(lambda whole: function(whole, self.symbols), unknown)

    def _integral(self, term: IntegralTerm) -> ufl.Form:
        density, rule = term
        mesh = self.mesh
        metadata = quadrature.metadata(mesh.mesh.topology.cell_name(), rule)
        facets = ufl.Measure("ds", domain=mesh.mesh, subdomain_data=mesh.facet_tags, metadata=metadata)
        return density * facets(mesh.facet_groups[self.name])


def surface_work(surfaces: Sequence[SurfaceGroup], u: fem.Function, v: ufl.core.expr.Expr) -> list[ufl.Form]:
    """Virtual work, J, of the springs' forces at u on v, term by term and group by group; not collective."""
    return [ufl.derivative(term, u, v) for group in surfaces for term in group.energy(u)]


def surface_kinetic_energy(surfaces: Sequence[SurfaceGroup], v: fem.Function) -> list[ufl.Form]:
    """Kinetic energy, J, of the velocity v, term by term and group by group; not collective."""
    return [term for group in surfaces for term in group.kinetic_energy(v)]


def pair_facets(
    mesh: TaggedMesh, groups: Sequence[CellGroup], surfaces: Surfaces | None, *, degree: int
) -> tuple[SurfaceGroup, ...]:
    """Check formulations and parameters and give each its facets. Collective.

    Args:
        mesh: of a solid.
        groups: the body's cells.
        surfaces: formulations by facet group; None: there are none, and no formulation of the cells has terms on
            facets.
        degree: of the elements.

    Raises:
        FormulationError: on all ranks: a form file breaks its contract, has no terms on facets, or does not fit its
            parameters, the cells' elements or the degree; terms on facets without a facet group; mass on facets of a
            body with micro-structure; or the ranks were given different things.
        MeshError: on all ranks: no such facet group, no facet in it, or facets inside the part.
    """
    error: FlexmbdError | None = None
    pairs: dict[str, tuple[Formulation, Any]] = {}
    try:
        pairs = _loaded(mesh, groups, surfaces)
        for name, (form, values) in pairs.items():
            _check(name, form, values, mesh, groups, degree=degree)
    except FlexmbdError as caught:
        error = caught
    parallel.raise_collectively(mesh.comm, error)
    given = [(name, form_name(form), repr(values)) for name, (form, values) in pairs.items()]
    parallel.check_same(mesh.comm, FormulationError, surfaces=given)
    for name in pairs:
        _check_facets(mesh, name)
    return tuple(
        SurfaceGroup(name, form, values, symbols(values, mesh=mesh.mesh), mesh)
        for name, (form, values) in pairs.items()
    )


def check_mass(surfaces: Sequence[SurfaceGroup], space: fem.FunctionSpace) -> None:
    """Refuse mass on facets that is negative somewhere. Collective; may compile.

    Raises:
        FormulationError: on all ranks.
    """
    for group in surfaces:
        area = group.negative_area(space)
        if area > 0.0:
            raise FormulationError(
                f"{group.form_name} on facets {group.name!r}: the mass per area of surface_kinetic_energy is negative "
                f"or not finite on {area:.3g} m^2"
            )


def _loaded(
    mesh: TaggedMesh, groups: Sequence[CellGroup], surfaces: Surfaces | None
) -> dict[str, tuple[Formulation, Any]]:
    if surfaces is None:
        for group in groups:
            there = [name for name in ON_FACETS if getattr(group.optional, name) is not None]
            if there:
                raise FormulationError(
                    f"{group.form_name} has {' and '.join(there)}, and no facets are named for it: write "
                    'surfaces={"facet group": (formulation, parameters)}, or surfaces={} to leave it out'
                )
        return {}
    if not isinstance(surfaces, Mapping):
        raise FormulationError(
            f'surfaces must be {{"facet group": (formulation, parameters), ...}}, got {surfaces!r:.100}'
        )
    loaded = {}
    for name, pair in surfaces.items():
        if name not in mesh.facet_groups:
            raise MeshError(_unknown(mesh, name))
        if not isinstance(pair, tuple) or len(pair) != 2:
            raise FormulationError(
                f"facet group {name!r} must have a pair (formulation, parameters), got {pair!r:.100}"
            )
        loaded[name] = (load_form(pair[0]), pair[1])
    return loaded


def _unknown(mesh: TaggedMesh, name: str) -> str:
    there = sorted(mesh.facet_groups)
    close = difflib.get_close_matches(str(name), there, n=1)
    meant = f"; did you mean {close[0]!r}?" if close else "."
    return (
        f"surfaces: the mesh has no facet group {name!r}{meant} Its facet groups are: "
        f"{', '.join(map(repr, there)) or 'none'}"
    )


def _check(
    name: str, form: Formulation, values: Any, mesh: TaggedMesh, groups: Sequence[CellGroup], *, degree: int
) -> None:
    """Refuse what does not fit; not collective."""
    called, optional = form_name(form), optional_entries(form)
    if mesh.dim != 3:
        raise FormulationError(
            f"facets {name!r}: terms on facets are for solids; a beam or shell has springs and masses of the scene"
        )
    if optional.surface_energy is None and optional.surface_kinetic_energy is None:
        raise FormulationError(
            f"{called} has neither surface_energy nor surface_kinetic_energy: it has nothing on facets {name!r}"
        )
    check_formulation(form, values, mesh, degree, with_history=True)
    cell = mesh.mesh.topology.cell_name()
    own, others = form.element(cell, 3, degree), groups[0].formulation.element(cell, 3, degree)
    if own != others:
        raise FormulationError(
            f"{called} on facets {name!r} has elements other than those of the cells: {own}, and there {others}"
        )
    if optional.surface_kinetic_energy is not None and groups[0].has_sections:
        raise FormulationError(
            f"{called} on facets {name!r}: a body with micro-structure (motion, section_inertia) takes no mass on its "
            "facets; give the scene a point mass there"
        )
    faults = check_values(form, cell, degree, parameters=values)
    if faults:
        raise FormulationError(f"{called} with {values!r} on facets {name!r}: {'; '.join(faults)}")


def _check_facets(mesh: TaggedMesh, name: str) -> None:
    """Refuse an empty group, and facets inside the part, which no term would see. Collective."""
    topology, facets = mesh.mesh.topology, mesh.facets(name)
    topology.create_connectivity(topology.dim - 1, topology.dim)
    own = facets[facets < topology.index_map(topology.dim - 1).size_local]
    outer = exterior_facet_indices(topology)
    inside, count = mesh.comm.allreduce(np.array([len(np.setdiff1d(own, outer)), len(own)]))
    if inside or not count:
        what = f"{inside} facets inside the part" if inside else "no facets"
        raise MeshError(f"surfaces: the facet group {name!r} has {what}; tag facets of the surface")


def _parts(expression: ufl.core.expr.Expr) -> Any:
    return ufl.corealg.traversal.unique_pre_traversal(expression)
