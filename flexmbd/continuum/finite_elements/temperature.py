"""Rises of temperature as functions on a body's mesh, and bodies at one.

A rise is a number (K), a function of points (n, 3) m that gives (n,) K, or the values (nodes,) K at the mesh's nodes in
the order of its input.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import basix.ufl
import numpy as np
import ufl
from dolfinx import fem
from numpy.typing import NDArray

from flexmbd.continuum import compat, parallel
from flexmbd.continuum.contract.dof_layout import DofLayout
from flexmbd.continuum.contract.formulation import IntegralTerm
from flexmbd.continuum.contract.heated_form import expands, expansion_of, heated
from flexmbd.continuum.finite_elements.cell_group import CellGroup
from flexmbd.continuum.finite_elements.discretisation import Discretisation
from flexmbd.continuum.grid.tagged_mesh import TaggedMesh
from flexmbd.errors import FlexmbdError, FormulationError, described
from flexmbd.given import numbers

FloatArray = NDArray[np.float64]


def checked_rise(rise: Any, what: str, *, kind: type[FlexmbdError]) -> Any:
    """A rise of temperature that is well formed, as far as it can be told without a mesh; not collective.

    Raises:
        FlexmbdError: of that kind: it is no finite number, function or row of finite numbers.
    """
    if callable(rise):
        return rise
    values = numbers(rise)
    if values.ndim > 1 or not values.size or not np.isfinite(values).all():
        raise kind(
            f"{what}: a rise of temperature is a finite number (K), a function of points (n, 3) m, or the values at "
            f"the mesh's nodes, got {rise!r:.80}"
        )
    values = values.copy()
    values.flags.writeable = False
    return values


def rise_function(model: Discretisation, rise: Any, what: str, *, kind: type[FlexmbdError]) -> fem.Function:
    """A rise of temperature (K) as a scalar function of the displacement's degree. Collective.

    Args:
        model: the body.
        rise: see above.
        what: its name in messages.
        kind: of error.

    Raises:
        FlexmbdError: on all ranks, of that kind: it gives no finite value at each node.
    """
    found = scalar_function(model.mesh, model.layout)
    error: FlexmbdError | None = None
    try:
        given = checked_rise(rise, what, kind=kind)
        if callable(given):
            found.x.array[:] = _at_points(given, found.function_space.tabulate_dof_coordinates(), what, kind=kind)
        elif given.ndim == 0:
            found.x.array[:] = given
        else:
            found.interpolate(_of_nodes(model, given, what, kind=kind))
    except FlexmbdError as caught:
        error = caught
    parallel.raise_collectively(model.comm, error)
    return found


def scalar_function(mesh: TaggedMesh, layout: DofLayout) -> fem.Function:
    """Zero at the displacement's nodes, as a scalar Lagrange function of its degree. Collective."""
    element = basix.ufl.element("Lagrange", mesh.mesh.topology.cell_name(), layout.displacement_degree)
    return fem.Function(fem.functionspace(mesh.mesh, element))


def at_nodes(model: Discretisation, rise: fem.Function) -> FloatArray:
    """(local nodes including ghosts,) its values at the displacement's nodes, in their order; not collective."""
    values = np.zeros(len(model.layout.node_x))
    values[model.layout.node_space.dofmap.list] = rise.x.array[rise.function_space.dofmap.list]
    return values


def set_at_nodes(model: Discretisation, rise: fem.Function, values: FloatArray) -> None:
    """Give it values (local nodes including ghosts,) at the displacement's nodes; not collective."""
    rise.x.array[rise.function_space.dofmap.list] = values[model.layout.node_space.dofmap.list]


def heated_groups(groups: Sequence[CellGroup], rise: ufl.core.expr.Expr) -> tuple[CellGroup, ...]:
    """The same cells with their formulations at a rise of temperature, K; not collective.

    Raises:
        FormulationError: as `refuse_without_expansion`; a form has a compiled law.
    """
    refuse_without_expansion(groups)
    for group in groups:
        if group.optional.point_law is not None:
            raise FormulationError(
                f"{group.form_name}: a compiled law (point_law) is given the whole strain, with the expansion in it; "
                "write the law as local unknowns (local_residual), or leave the temperature out"
            )
    return tuple(replace(group, formulation=heated(group.formulation, rise)) for group in groups)


def refuse_without_expansion(groups: Sequence[CellGroup]) -> None:
    """Refuse a temperature that strains nothing; the same on every rank, not collective.

    Raises:
        FormulationError: a formulation does not name its expansion, or all parameters say that there is none.
    """
    for group in groups:
        if expansion_of(group.formulation) is None:
            raise FormulationError(
                f"a temperature without expansion: {group.form_name} does not say how it expands, by "
                "thermal_stretch(p, dT) or thermal_strain(p, dT); leave the temperature out, or take a form that does"
            )
    if not any(expands(group.formulation, group.parameters) for group in groups):
        names = ", ".join(dict.fromkeys(group.form_name for group in groups))
        raise FormulationError(
            f"a temperature without expansion: the coefficients of {names} are zero, so that it would strain nothing; "
            "give the material its own, as Parameters(..., alpha=1.2e-5) (1/K)"
        )


def refuse_nonlinear_expansion(groups: Sequence[CellGroup]) -> None:
    """Refuse an expansion that is not in proportion to the rise, of which no load of unit size can be made.

    Raises:
        FormulationError: there is one; the same on every rank.
    """
    for group in groups:
        named = expansion_of(group.formulation)
        if named is None:
            continue
        rise = ufl.variable(fem.Constant(_domain(group), 1.0))
        strain = named(group.parameters, rise)
        for i in range(3):
            for j in range(i, 3):
                bend = ufl.algorithms.expand_derivatives(ufl.diff(ufl.diff(strain[i, j], rise), rise))
                if not isinstance(bend, ufl.constantvalue.Zero):
                    raise FormulationError(
                        f"the expansion of {group.form_name} is not in proportion to the temperature, and a reduced "
                        "body's loads are superposed; reduce the body about the hot state (prestressed), or load it as "
                        "a NonlinearModel"
                    )


def heated_terms(group: CellGroup, u: fem.Function, temperature: fem.Function) -> list[IntegralTerm]:
    """The terms of one group's strain energy at a temperature; not collective."""
    return list(heated(group.formulation, temperature).strain_energy(u, group.symbols))


def _domain(group: CellGroup) -> Any:
    return ufl.Mesh(basix.ufl.element("Lagrange", group.formulation.CELLS[0], 1, shape=(3,)))


def _at_points(rise: Any, points: FloatArray, what: str, *, kind: type[FlexmbdError]) -> FloatArray:
    try:
        values = numbers(rise(points.copy()))
    except Exception as reason:
        raise kind(f"{what}: the function of points failed: {described(reason)}") from reason
    if values.ndim == 0:
        values = np.full(len(points), float(values))
    if values.shape != (len(points),) or not np.isfinite(values).all():
        raise kind(
            f"{what}: the function must give a finite number (K) for each of the points (n, 3), got the shape "
            f"{values.shape} for {len(points)} points, or values that are not finite"
        )
    return values


def _of_nodes(model: Discretisation, values: FloatArray, what: str, *, kind: type[FlexmbdError]) -> fem.Function:
    """Values at the nodes of the mesh's input as a function of the geometry's degree."""
    mesh = model.mesh.mesh
    count = mesh.geometry.index_map().size_global
    if len(values) != count:
        raise kind(f"{what}: the mesh has {count} nodes, got {len(values)} values")
    element = basix.ufl.element("Lagrange", mesh.topology.cell_name(), compat.geometry_degree(mesh))
    found = fem.Function(fem.functionspace(mesh, element))
    rows = np.asarray(mesh.geometry.input_global_indices)[compat.cell_nodes(mesh)]
    found.x.array[found.function_space.dofmap.list] = values[rows]
    return found
