"""Diagonal mass matrices with positive entries and the exact total mass.

The sums of the mass matrix's rows are no rule for every element: those of a quadratic tetrahedron are
negative at its vertices.  Elements of degree one take them, which on straight simplices is the rule
with its points in the vertices; elements of higher degree take the diagonal, scaled in each cell so
that its mass is kept (Hinton, Rock & Zienkiewicz 1976, doi:10.1002/eqe.4290040305).  Mass on facets takes
the sums of its rows throughout: they are not negative for facets of either degree, and it adds to that of cells.
"""

from __future__ import annotations

from dataclasses import dataclass

import basix
import numpy as np
import ufl
from dolfinx import fem, la

from flexmbd.continuum import parallel
from flexmbd.continuum.contract.dof_layout import Field, shaped
from flexmbd.continuum.contract.quadrature import points_and_weights
from flexmbd.continuum.finite_elements.cell_group import CellGroup
from flexmbd.continuum.finite_elements.discretisation import Discretisation
from flexmbd.continuum.finite_elements.surface_group import surface_kinetic_energy
from flexmbd.continuum.matrices.blocks import FloatArray
from flexmbd.errors import FormulationError
from flexmbd.given import checked


@checked(error=FormulationError, agree=parallel.told_to_all)
def lumped_mass(model: Discretisation) -> FloatArray:
    """The diagonal of the lumped mass matrix. Collective, may compile.

    What follows others has handed its mass on to these, by its weights: the mass and its first moments are kept.
    Each component of the unknown is lumped by itself, with the density that the kinetic energy gives
    it: the displacement's mass, and the inertia of rotations about the mesh's axes.

    Returns:
        (owned dofs,) kg, or kg m^2 for rotations; positive, but zero for unknowns without inertia,
        such as pressures. Over the dofs of a component of the displacement they sum to the mass of
        the body.

    Raises:
        FormulationError: on all ranks: an unknown with inertia is not one of continuous Lagrange
            elements, or has a density that is not positive; a node on the far side of a weld has no mass left.
    """
    lumped = own_lumped_mass(model)
    if model.ties is None:
        return lumped
    model.ties.condense_dofs(lumped)
    free = np.setdiff1d(model.layout.displacement_dofs[: model.layout.n_owned_nodes], model.ties.dofs)
    error = None
    if not (lumped[free] > 0.0).all():
        error = FormulationError(
            "the mass cannot be lumped: nodes that are welded far off the facets that they follow take more mass from "
            "the other side of these than is there; weld the other side's nodes instead, or bring the parts together"
        )
    parallel.raise_collectively(model.comm, error)
    return lumped


def own_lumped_mass(model: Discretisation) -> FloatArray:
    """As `lumped_mass`, with what follows others as if it did not. Collective, may compile."""
    total = fem.Function(model.space).x
    error: FormulationError | None = None
    for group in model.groups:
        terms = _terms(model, group)
        for field in model.layout.fields:
            entries = _lumped(field, group, terms)
            if entries is None:
                error = FormulationError(
                    f"{group.form_name}: the mass cannot be lumped: unknowns {field.components.start} to "
                    f"{field.components.stop - 1} have a density that is not positive, or no Lagrange element"
                )
                continue
            size = field.space.dofmap.index_map_bs
            blocks = field.space.dofmap.list[group.cells]
            dofs = field.dofs[size * blocks[..., None] + np.arange(size)]
            np.add.at(total.array, dofs, entries)
    for form in _row_sums(model):
        fem.assemble_vector(total.array, form)
    parallel.raise_collectively(model.comm, error)
    total.scatter_reverse(la.InsertMode.add)
    lumped: FloatArray = total.array[: model.layout.n_owned].copy()
    if model.surfaces:
        bare = (lumped[model.layout.displacement_dofs[: model.layout.n_owned_nodes]] <= 0.0).any()
        if bare:
            error = FormulationError(
                "the mass cannot be lumped: mass on facets varies so much over one of them that a node has none; "
                "refine the mesh there"
            )
        parallel.raise_collectively(model.comm, error)
    return lumped


def _row_sums(model: Discretisation) -> list[fem.Form]:
    """Momenta of the mass on facets where every displacement has the velocity one along each axis. Collective."""
    v, w = fem.Function(model.space), ufl.TestFunction(model.space)
    components = int(np.prod(v.ufl_shape))
    unit = shaped([float(k < 3) for k in range(components)], v.ufl_shape)
    momenta = [ufl.derivative(term, v, w) for term in surface_kinetic_energy(model.surfaces, v)]
    return [fem.form(ufl.replace(ufl.algorithms.expand_derivatives(momentum), {v: unit})) for momentum in momenta]


@dataclass(frozen=True, eq=False)
class _Term:
    """One term of the kinetic energy at the points of its rule.

    Attributes:
        points: (q, dimension of the cells) in the reference cell.
        masses: (cells, q, components) density of each component of the unknown, times the weights and
            the measure of the cells.
    """

    points: FloatArray
    masses: FloatArray


def _terms(model: Discretisation, group: CellGroup) -> list[_Term]:
    """The terms of a group that have inertia. Collective, may compile."""
    mesh, u = model.mesh.mesh, fem.Function(model.space)
    measure = abs(ufl.JacobianDeterminant(mesh))
    n = int(np.prod(u.ufl_shape))
    found = []
    for density, rule in group.kinetic_energy(u):
        units = [shaped([float(i == k) for i in range(n)], u.ufl_shape) for k in range(n)]
        # the energy of a unit velocity is half the density
        values = ufl.as_vector([2 * measure * ufl.replace(density, {u: unit}) for unit in units])
        values = ufl.algorithms.expand_derivatives(values)
        if isinstance(values, ufl.classes.Zero):
            continue
        points, weights = points_and_weights(mesh.topology.cell_name(), rule)
        at = fem.Expression(values, points).eval(mesh, group.cells)
        found.append(_Term(points, at.reshape(-1, len(points), n) * weights[:, None]))
    return found


def _lumped(field: Field, group: CellGroup, terms: list[_Term]) -> FloatArray | None:
    """Entries (cells, nodes of a cell, components of the field); None where there is no lumping."""
    element = field.space.element.basix_element
    nodes = field.space.dofmap.list.shape[1]
    size = field.components.stop - field.components.start
    mass, entries = np.zeros((len(group.cells), 1, size)), np.zeros((len(group.cells), nodes, size))
    for term in terms:
        masses = term.masses[..., field.components]
        if not masses.any():
            continue
        if element.family != basix.ElementFamily.P:
            return None
        shapes = element.tabulate(0, term.points)[0, :, :, 0]
        mass += masses.sum(axis=1, keepdims=True)
        entries += np.einsum("cqk,qn->cnk", masses, shapes if element.degree == 1 else shapes**2)
    whole = entries.sum(axis=1, keepdims=True)
    inert = mass == 0.0
    if (mass < 0.0).any() or (entries <= 0.0)[np.broadcast_to(~inert, entries.shape)].any():
        return None
    lumped: FloatArray = entries * (mass / np.where(inert, 1.0, whole))
    return lumped
