"""A form on a small mesh of one rank, assembled term by term, as plain arrays."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

from mpi4py import MPI

import basix.ufl
import dolfinx
import numpy as np
import scipy.sparse
import ufl
from dolfinx import fem

from flexmbd.continuum.compat import interpolation_points
from flexmbd.continuum.contract import formulation


def cube(cell: str, *, n: int, degree: int, amplitude: float) -> dolfinx.mesh.Mesh:
    """Unit cube of n^3 boxes, moved by a smooth map; curved cells where the degree is 2."""
    kind = dolfinx.mesh.to_type(cell)
    straight = dolfinx.mesh.create_unit_cube(MPI.COMM_SELF, n, n, n, kind)
    variant = basix.LagrangeVariant.equispaced
    element = basix.ufl.element("Lagrange", cell, degree, lagrange_variant=variant, shape=(3,))
    nodes = fem.functionspace(straight, element)
    x = nodes.tabulate_dof_coordinates()
    s, c = np.sin(2 * x + 0.3), np.cos(3 * x)
    moved = x + amplitude * np.stack(
        (s[:, 1] * c[:, 2], s[:, 2] * c[:, 0] + x[:, 1] ** 2, s[:, 0] * c[:, 1]), axis=1
    )
    cells = nodes.dofmap.list.astype(np.int64)
    return dolfinx.mesh.create_mesh(comm=MPI.COMM_SELF, cells=cells, x=moved, e=element)


@dataclass(frozen=True)
class Assembled:
    """One formulation on one mesh; vectors (n,) and matrices (n, n) over all dofs."""

    form: Any
    mesh: dolfinx.mesh.Mesh
    degree: int

    @cached_property
    def space(self) -> fem.FunctionSpace:
        element = self.form.element(self.mesh.topology.cell_name(), 3, self.degree)
        return fem.functionspace(self.mesh, element)

    @cached_property
    def u(self) -> fem.Function:
        return fem.Function(self.space)

    @cached_property
    def nodes(self) -> np.ndarray:
        """Where the displacement's nodes lie, (n / 3, 3)."""
        return self.space.tabulate_dof_coordinates()

    @cached_property
    def p(self) -> Any:
        return formulation.symbols(self.form.reference().parameters, mesh=self.mesh)

    @cached_property
    def boundary(self) -> np.ndarray:
        """Dofs of the boundary's nodes."""
        self.mesh.topology.create_connectivity(2, 3)
        facets = dolfinx.mesh.exterior_facet_indices(self.mesh.topology)
        blocks = fem.locate_dofs_topological(self.space, 2, facets)
        return np.sort((3 * blocks[:, None] + np.arange(3)).ravel())

    @cached_property
    def strain_terms(self) -> list[ufl.Form]:
        return [self.integral(*term) for term in self.form.strain_energy(self.u, self.p)]

    @cached_property
    def kinetic_terms(self) -> list[ufl.Form]:
        return [self.integral(*term) for term in self.form.kinetic_energy(self.u, self.p)]

    def integral(self, integrand: Any, rule: Any) -> ufl.Form:
        return integrand * ufl.dx(domain=self.mesh, degree=rule.degree, scheme=rule.scheme)

    @cached_property
    def _compiled(self) -> dict[int, tuple[Any, Any, Any]]:
        return {}

    def _chain(self, term: ufl.Form) -> tuple[Any, Any, Any]:
        """Compiled energy, gradient and second derivative of one term."""
        if id(term) not in self._compiled:
            first = ufl.derivative(term, self.u)
            chain = (term, first, ufl.derivative(first, self.u))
            self._compiled[id(term)] = tuple(fem.form(form) for form in chain)  # type: ignore
        return self._compiled[id(term)]

    def energy(self, term: ufl.Form, at: np.ndarray) -> float:
        self.u.x.array[:] = at
        return float(fem.assemble_scalar(self._chain(term)[0]))

    def gradient(self, term: ufl.Form, at: np.ndarray) -> np.ndarray:
        self.u.x.array[:] = at
        return fem.assemble_vector(self._chain(term)[1]).array.copy()

    def hessian(self, term: ufl.Form, at: np.ndarray) -> scipy.sparse.csr_matrix:
        self.u.x.array[:] = at
        return fem.assemble_matrix(self._chain(term)[2]).to_scipy().copy()

    def rigid(self) -> np.ndarray:
        """The form's own six rigid motions, columns of (n, 6), by their values in the nodes."""
        translation, rotation = (fem.Constant(self.mesh, np.zeros(3)) for _ in range(2))
        x = ufl.SpatialCoordinate(self.mesh)
        motion = self.form.rigid_motion(x, translation, rotation)
        columns = []
        for unit in np.eye(6):
            translation.value[:], rotation.value[:] = unit[:3], unit[3:]
            columns.append(self.interpolated(motion))
        return np.stack(columns, axis=1)

    def interpolated(self, expression: Any) -> np.ndarray:
        field = fem.Function(self.space)
        field.interpolate(fem.Expression(expression, interpolation_points(self.space)))
        return field.x.array.copy()
