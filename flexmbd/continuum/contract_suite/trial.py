"""A formulation on a small mesh of one rank, assembled term by term, as plain arrays.

Displacements, rotations and pressures have entries of very different size in one matrix. What is
compared is therefore scaled: row and column i of the stiffness at rest by `scale[i]`, so that the
largest entry of every row is one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any, cast

import dolfinx.mesh
import numpy as np
import numpy.typing as npt
import scipy.sparse
import ufl
from dolfinx import fem

from flexmbd.continuum.compat import interpolation_points
from flexmbd.continuum.contract import quadrature
from flexmbd.continuum.contract.dof_layout import DofLayout, dof_layout
from flexmbd.continuum.contract.entries import is_layered, optional_entries
from flexmbd.continuum.contract.formulation import Formulation, Quadrature, internal_work, symbols
from flexmbd.continuum.contract_suite.trial_mesh import DIMENSION, distorted_mesh

FloatArray = npt.NDArray[np.float64]

# The meshes have few cells: what counts is the time of compiling.
_QUICK = {"cffi_extra_compile_args": ["-O0", "-g0"]}

_DIVISIONS = {1: 4, 2: 3, 3: 2}

# Of what is integrated over facets: the form's function, and how often it is derived.
_ON_FACETS = {
    "springs' energy": ("surface_energy", 0),
    "springs' force": ("surface_energy", 1),
    "springs' stiffness": ("surface_energy", 2),
    "surface kinetic": ("surface_kinetic_energy", 0),
    "surface mass": ("surface_kinetic_energy", 2),
}

# Of a displacement of trial, for cells of half a metre.
_AMPLITUDE = 0.02


class Trial:
    """One formulation on one mesh. Vectors are (n,) and matrices (n, n) over all dofs.

    Attributes:
        form: the formulation.
        cell: name of the cells.
        degree: of the element.
        mesh: on this rank alone.
        parameters: those of `reference()`, as constants on the mesh.
        space: of the unknown.
        u: the function that energies and forces are expressed in.
    """

    def __init__(
        self, form: Formulation, cell: str, degree: int, *, mesh: dolfinx.mesh.Mesh | None = None
    ) -> None:
        """Not collective.

        Args:
            form: a checked form file.
            cell: one of its cells.
            degree: one of its degrees on that cell.
            mesh: of such cells, on this rank alone; a distorted one of a few cells if None.
        """
        self.form, self.cell, self.degree = form, cell, degree
        self.dim = DIMENSION[cell]
        if mesh is None:
            mesh = distorted_mesh(cell, n=_DIVISIONS[self.dim], layered=is_layered(form))
        self.mesh = mesh
        self.parameters = symbols(form.reference().parameters, mesh=self.mesh)
        self.space: fem.FunctionSpace = fem.functionspace(self.mesh, form.element(cell, 3, degree))
        self.u = fem.Function(self.space)
        self._assemblers: dict[str, list[Callable[[], Any]]] = {}
        self._gyroscopic: list[fem.Form] | None = None

    @cached_property
    def layout(self) -> DofLayout:
        """Where displacements, rotations and the rest lie."""
        return dof_layout(self.space, self.form.rigid_motion)

    @property
    def size(self) -> int:
        """Number of dofs."""
        return len(self.u.x.array)

    @property
    def has_energy(self) -> bool:
        """Whether the form has `strain_energy`, and not `residual`."""
        return optional_entries(self.form).strain_energy is not None

    @property
    def holds_place(self) -> bool:
        """Whether a term of the strain energy or residual is written with the place."""
        return any(_holds_place(density) for density, _ in self._internal_work)

    @property
    def mass_holds_place(self) -> bool:
        """The same of the kinetic energy."""
        return any(_holds_place(density) for density, _ in self.form.kinetic_energy(self.u, self.parameters))

    @cached_property
    def rigid(self) -> FloatArray:
        """(n, 6) unit translations and small rotations about the origin."""
        return self.layout.rigid_columns(np.zeros(3), np.eye(3))

    @cached_property
    def displacement(self) -> npt.NDArray[np.int32]:
        """(nodes, 3) dofs of the displacement."""
        return self.layout.displacement_dofs

    @cached_property
    def volume(self) -> float:
        """Measure of the mesh."""
        return self.scalar_of(fem.Constant(self.mesh, 1.0), degree=self.dim)(self.rest())

    @cached_property
    def boundary(self) -> npt.NDArray[np.int32]:
        """Dofs on the boundary that rigid motions move, ascending."""
        self.mesh.topology.create_connectivity(self.dim - 1, self.dim)
        facets = dolfinx.mesh.exterior_facet_indices(self.mesh.topology)
        return self.layout.kinematic_dofs_on(self.dim - 1, facets)

    def boundary_where(self, there: Callable[[FloatArray], npt.NDArray[np.bool_]]) -> npt.NDArray[np.int32]:
        """As `boundary`, of the facets that lie where `there` is true of all their points (3, k)."""
        facets = dolfinx.mesh.locate_entities_boundary(self.mesh, self.dim - 1, there)
        return self.layout.kinematic_dofs_on(self.dim - 1, facets)

    @cached_property
    def scale(self) -> FloatArray:
        """(n,) by which rows and columns of the stiffness at rest are multiplied."""
        return equilibration(self.stiffness(self.rest()))

    def rest(self) -> FloatArray:
        """The unknown at rest, zero."""
        return np.zeros(self.size)

    def some(self, seed: int, *, size: float = _AMPLITUDE) -> FloatArray:
        """A random unknown whose displacements are of that size (m), and the rest in proportion."""
        values = self.scale * np.random.default_rng(seed).uniform(-1, 1, self.size)
        return size * values / self.scale[self.displacement].mean()

    def energies(self, at: FloatArray) -> FloatArray:
        """Strain energy of each term, J."""
        return np.array(self._assembled("energy", at), dtype=float)

    def forces(self, at: FloatArray) -> list[FloatArray]:
        """Internal forces of each term."""
        return self._assembled("force", at)

    def force(self, at: FloatArray) -> FloatArray:
        """Internal forces."""
        return np.sum(self.forces(at), axis=0)

    def stiffnesses(self, at: FloatArray) -> list[scipy.sparse.csr_matrix]:
        """Tangent of each term."""
        return self._assembled("stiffness", at)

    def stiffness(self, at: FloatArray) -> FloatArray:
        """Tangent, as a dense matrix."""
        return _dense_sum(self.stiffnesses(at))

    def geometric_force(self, at: FloatArray, along: FloatArray, other: FloatArray) -> FloatArray:
        """Change of the tangent along one unknown, times the other: the third derivative."""
        for function, values in zip(self._directions, (along, other), strict=True):
            function.x.array[:] = values
        return np.sum(self._assembled("third", at), axis=0)

    def kinetic_energies(self, velocity: FloatArray, *, finer: bool = False) -> FloatArray:
        """Kinetic energy of each term, J; by a finer rule than its own on request."""
        return np.array(self._assembled("finer kinetic" if finer else "kinetic", velocity), dtype=float)

    def masses(self) -> list[scipy.sparse.csr_matrix]:
        """Mass of each term."""
        return self._assembled("mass", self.rest())

    @cached_property
    def mass(self) -> FloatArray:
        """Mass, as a dense matrix."""
        return _dense_sum(self.masses())

    @property
    def has_dissipation(self) -> bool:
        """Whether the form has a Rayleigh function."""
        return optional_entries(self.form).dissipation is not None

    def dissipations(self, rates: FloatArray) -> FloatArray:
        """Rayleigh's function of each term, W."""
        return np.array(self._assembled("dissipation", rates), dtype=float)

    def viscous_forces(self, rates: FloatArray) -> list[FloatArray]:
        """Viscous forces of each term."""
        return self._assembled("viscous force", rates)

    def damping(self, rates: FloatArray) -> FloatArray:
        """Derivative of the viscous forces by the rates, as a dense matrix."""
        return _dense_sum(self._assembled("damping", rates))

    @property
    def has_gyroscopic(self) -> bool:
        """Whether the form has kinetic energy linear in the rates."""
        return optional_entries(self.form).gyroscopic is not None

    def gyroscopic_energy(self, at: FloatArray, rates: FloatArray) -> float:
        """T1(u, v), J, by the terms' own rules."""
        u, v = self._directions
        u.x.array[:], v.x.array[:] = at, rates
        if self._gyroscopic is None:
            terms = cast(Any, self.form).gyroscopic(u, v, self.parameters)
            self._gyroscopic = [fem.form(self._integral(*term), jit_options=_QUICK) for term in terms]
        return float(sum(fem.assemble_scalar(form) for form in self._gyroscopic))

    @property
    def has_surface_energy(self) -> bool:
        """Whether the form has springs on facets."""
        return optional_entries(self.form).surface_energy is not None

    @property
    def has_surface_mass(self) -> bool:
        """Whether the form has mass on facets."""
        return optional_entries(self.form).surface_kinetic_energy is not None

    def surface_energies(self, at: FloatArray) -> FloatArray:
        """Energy of the springs on the whole surface, of each term, J."""
        return np.array(self._assembled("springs' energy", at), dtype=float)

    def surface_forces(self, at: FloatArray) -> FloatArray:
        """Forces that hold these springs."""
        return np.sum(self._assembled("springs' force", at), axis=0)

    def surface_stiffness(self, at: FloatArray) -> FloatArray:
        """Derivative of these forces, as a dense matrix."""
        return _dense_sum(self._assembled("springs' stiffness", at))

    def surface_kinetic_energies(self, velocity: FloatArray) -> FloatArray:
        """Kinetic energy of the mass on the whole surface, of each term, J."""
        return np.array(self._assembled("surface kinetic", velocity), dtype=float)

    @cached_property
    def surface_mass(self) -> FloatArray:
        """Mass on the whole surface, as a dense matrix."""
        return _dense_sum(self._assembled("surface mass", self.rest()))

    def scalar_of(self, density: ufl.core.expr.Expr, *, degree: int) -> Callable[[FloatArray], float]:
        """Integral of a density that may hold `u`, by a rule of that degree, as a function of `u`."""
        form = fem.form(density * ufl.dx(domain=self.mesh, degree=degree), jit_options=_QUICK)

        def value(at: FloatArray) -> float:
            self.u.x.array[:] = at
            return float(fem.assemble_scalar(form))

        return value

    def load(self, density: ufl.core.expr.Expr, *, degree: int) -> FloatArray:
        """Vector of a density linear in a test function, by a rule of that degree."""
        if isinstance(ufl.algorithms.expand_derivatives(density), ufl.classes.Zero):
            return self.rest()
        form = fem.form(density * ufl.dx(domain=self.mesh, degree=degree), jit_options=_QUICK)
        vector: FloatArray = fem.assemble_vector(form).array.copy()
        return vector

    def interpolated(self, whole: ufl.core.expr.Expr) -> FloatArray:
        """Dofs of an unknown given as an expression; of a displacement (3,), the rest zero."""
        values = self.rest()
        if whole.ufl_shape == (3,):
            function = fem.Function(self.layout.node_space)
            function.interpolate(_expression(whole, self.layout.node_space))
            values[self.displacement.reshape(-1)] = function.x.array
            return values
        for field in self.layout.fields:
            shape = field.space.value_shape
            parts = [whole[i] for i in range(field.components.start, field.components.stop)]
            array = np.empty(shape, dtype=object)
            for index, part in zip(np.ndindex(shape), parts, strict=True):
                array[index] = part
            function = fem.Function(field.space)
            part = ufl.as_tensor(array.tolist()) if shape else parts[0]
            function.interpolate(_expression(part, field.space))
            values[field.dofs] = function.x.array
        return values

    def quick_stiffness(self) -> scipy.sparse.csr_matrix:
        """Stiffness at rest, sparse, compiled for a mesh of more cells."""
        total: Any = 0
        for form in self._stiffness_forms:
            total = total + fem.assemble_matrix(form).to_scipy()
        return scipy.sparse.csr_matrix(total)

    @cached_property
    def _stiffness_forms(self) -> list[fem.Form]:
        v, w = ufl.TestFunction(self.space), ufl.TrialFunction(self.space)
        zero = {self.u: ufl.zero(self.u.ufl_shape)}
        found = []
        for density, rule in internal_work(self.form, self.u, v, p=self.parameters):
            form = self._integral(density, rule)
            second = ufl.algorithms.expand_derivatives(ufl.derivative(form, self.u, w))
            found.append(fem.form(ufl.replace(second, zero)))
        return [form for form in found if form is not None]

    @cached_property
    def _internal_work(self) -> list[tuple[ufl.core.expr.Expr, Quadrature]]:
        return internal_work(self.form, self.u, ufl.TestFunction(self.space), p=self.parameters)

    @cached_property
    def _directions(self) -> tuple[fem.Function, fem.Function]:
        return fem.Function(self.space), fem.Function(self.space)

    def _integral(self, density: ufl.core.expr.Expr, rule: Quadrature, over: ufl.Measure = ufl.dx) -> ufl.Form:
        return density * over(domain=self.mesh, metadata=quadrature.metadata(self.mesh.topology.cell_name(), rule))

    def _forms(self, what: str) -> list[ufl.Form]:
        """One form a term."""
        u, p = self.u, self.parameters
        if what == "energy":
            return [self._integral(*term) for term in self.form.strain_energy(u, p)]
        if what == "finer kinetic":
            terms = self.form.kinetic_energy(u, p)
            return [density * ufl.dx(domain=self.mesh, degree=rule.degree + 4) for density, rule in terms]
        if what in ("kinetic", "mass"):
            forms = [self._integral(*term) for term in self.form.kinetic_energy(u, p)]
            if what == "mass":
                forms = [ufl.derivative(ufl.derivative(form, u), u) for form in forms]
            return forms
        if what in ("dissipation", "viscous force", "damping"):
            terms = cast(Any, self.form).dissipation(u, p)
            forms = [self._integral(*term) for term in terms]
            for _ in range(("dissipation", "viscous force", "damping").index(what)):
                forms = [ufl.derivative(form, u) for form in forms]
            return forms
        if what in _ON_FACETS:
            name, order = _ON_FACETS[what]
            terms = getattr(optional_entries(self.form), name)(u, p)
            forms = [self._integral(density, rule, over=ufl.ds) for density, rule in terms]
            for _ in range(order):
                forms = [ufl.derivative(form, u) for form in forms]
            return forms
        forms = [self._integral(*term) for term in self._internal_work]
        if what == "stiffness":
            forms = [ufl.derivative(form, u) for form in forms]
        elif what == "third":
            for direction in self._directions:
                forms = [ufl.derivative(form, u, direction) for form in forms]
        return forms

    def _assembled(self, what: str, at: FloatArray) -> list[Any]:
        if what not in self._assemblers:
            self._assemblers[what] = [_assembler(form, self.size, what) for form in self._forms(what)]
        self.u.x.array[:] = at
        return [assemble() for assemble in self._assemblers[what]]


def equilibration(matrix: FloatArray) -> FloatArray:
    """(n,) scaling d for which every row of diag(d) matrix diag(d) has one as its largest entry.

    By the iteration of Ruiz; it only halves the error of each exponent, so it is run until that is
    gone. Rows of zeros keep the scale they have. (Ruiz 2001, RAL-TR-2001-034.)
    """
    scale = np.ones(len(matrix))
    for _ in range(60):
        largest = abs(scale[:, None] * matrix * scale).max(axis=1)
        largest[~(largest > 0)] = 1.0
        scale /= np.sqrt(largest)
        if abs(largest - 1).max() < 1e-3:
            break
    return scale


def _dense_sum(matrices: Sequence[scipy.sparse.csr_matrix]) -> FloatArray:
    dense: FloatArray = np.sum([matrix.toarray() for matrix in matrices], axis=0)
    return dense


def _assembler(form: ufl.Form, size: int, what: str) -> Callable[[], Any]:
    """Assembles a form of that kind; zero, where nothing is left of it."""
    form = ufl.algorithms.expand_derivatives(form)
    compiled = None if form.empty() else fem.form(form, jit_options=_QUICK)
    if what in ("energy", "kinetic", "finer kinetic", "dissipation", "springs' energy", "surface kinetic"):
        return lambda: 0.0 if compiled is None else float(fem.assemble_scalar(compiled))
    if what in ("force", "third", "viscous force", "springs' force"):
        return lambda: np.zeros(size) if compiled is None else fem.assemble_vector(compiled).array.copy()
    empty = scipy.sparse.csr_matrix((size, size))
    return lambda: empty if compiled is None else fem.assemble_matrix(compiled).to_scipy().tocsr()


def _expression(value: ufl.core.expr.Expr, space: fem.FunctionSpace) -> fem.Expression:
    return fem.Expression(value, interpolation_points(space), jit_options=_QUICK)


def _holds_place(density: ufl.core.expr.Expr) -> bool:
    return any(
        isinstance(part, ufl.classes.SpatialCoordinate)
        for part in ufl.corealg.traversal.unique_pre_traversal(density)
    )
