"""The third derivative of the strain energy at rest, contracted with one field and pairs of modes.

D^3 W(0)[u, phi_i, phi_j] = phi_i^T (dK/du) u phi_j: what a static displacement u changes in the modal stiffness.
Nothing is assembled for each u where the energy density is a function of grad u alone, the same in all points of
its cells: its third derivative with respect to grad u is then one tensor T of 9 x 9 x 9 numbers, made by UFL, and

    sum over points of weight * T[a, b, c] grad(u)_a grad(phi_i)_b grad(phi_j)_c

is a chain of dense products over chunks of cells that stay in the cache. Any other density is assembled, one matrix
for each u.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from mpi4py import MPI

import basix
import basix.ufl
import numpy as np
import ufl
from dolfinx import fem
from numpy.typing import NDArray
from ufl.algorithms.transformer import strip_variables
from ufl.corealg.traversal import unique_pre_traversal

from flexmbd.continuum import compat
from flexmbd.continuum.formulation import Quadrature, Term, symbols

if TYPE_CHECKING:
    from flexmbd.continuum.model import ContinuumModel

FloatArray = NDArray[np.float64]

# Numbers in the largest array of a chunk of cells: 1 MB, so that it stays in the second-level cache.
_CHUNK = 2**17

# What a density at a constant gradient may hold, if it is to be the same in every point.
_CONSTANT = (ufl.classes.ConstantValue, ufl.classes.MultiIndex, ufl.classes.Constant, ufl.classes.Label)
# What sees more of the displacement than its gradient in the point.
_NOT_LOCAL = (ufl.classes.CellAvg, ufl.classes.FacetAvg, ufl.classes.Restricted)


def third_derivative(model: ContinuumModel, fields: FloatArray, modes: FloatArray) -> FloatArray | None:
    """D^3 W(0)[u_l, phi_i, phi_j] for all fields and pairs of modes. Collective.

    Args:
        model: its strain energy is W; each term is integrated by its own rule, as the stiffness is.
        fields: (local dofs including ghosts, l) u_l, m.
        modes: (local dofs including ghosts, n) phi.

    Returns:
        (l, n, n) symmetric, the same to the bit on every rank; None where every third derivative vanishes
        identically, that is where the energy is quadratic.
    """
    u = fem.Function(model.space)
    parameters = symbols(model.parameters, mesh=model.mesh.mesh)
    total = np.zeros((fields.shape[1], modes.shape[1], modes.shape[1]))
    quadratic = True
    for term in model.formulation.strain_energy(u, parameters):
        tensor = gradient_tensor(term, u)
        if tensor is None:
            form = _directional(term, u)
            if form is not None:
                quadratic = False
                total += _assembled(model, form, fields=fields, modes=modes)
        elif tensor.any():
            quadratic = False
            total += _contracted(model, term[1], tensor, fields=fields, modes=modes)
    if quadratic:
        return None
    # each rank has the sums over its own cells
    everywhere = model.comm.reduce(total, root=0)
    return np.ascontiguousarray(model.comm.bcast(everywhere, root=0))


def gradient_tensor(term: Term, u: fem.Function) -> FloatArray | None:
    """Third derivative at rest of an energy density with respect to the gradient of u. Collective.

    Args:
        term: density, as an expression in u, and its rule.
        u: the displacement the density is written in.

    Returns:
        (9, 9, 9) Pa, entries of grad u row by row; None where the density is not a function of grad u alone, or
        not the same in every point, or where the fast contraction does not know the element or the rule.
    """
    density, rule = term
    if rule.scheme != "default" or not _is_plain(u.function_space) or not _is_of_gradient(density, u):
        return None
    mesh = u.function_space.mesh
    gradient, one, other = (fem.Constant(mesh, np.zeros((3, 3))) for _ in range(3))
    # a displacement of constant gradient; what is left of the position then comes from elsewhere
    affine = ufl.dot(gradient, ufl.SpatialCoordinate(mesh))
    local = ufl.algorithms.expand_derivatives(ufl.replace(density, {u: affine}))
    if not all(isinstance(item, _CONSTANT) for item in unique_pre_traversal(local) if item._ufl_is_terminal_):
        return None
    variable = ufl.variable(gradient)
    derivative = ufl.diff(ufl.replace(local, {gradient: variable}), variable)
    for direction in (one, other):
        derivative = ufl.diff(ufl.inner(derivative, direction), variable)
    centre = basix.geometry(_cell_type(u.function_space)).mean(axis=0, keepdims=True)
    # a variable's label differs from call to call, and would have the same code compiled again
    plain = strip_variables(ufl.algorithms.expand_derivatives(derivative))
    expression = fem.Expression(plain, centre)
    return _evaluated(expression, one, other, mesh=mesh)


def _evaluated(expression: fem.Expression, one: fem.Constant, other: fem.Constant, *, mesh: object) -> FloatArray:
    """All entries of the tensor, from a rank that has a cell. Collective."""
    comm: MPI.Comm = mesh.comm  # type: ignore[attr-defined]
    tensor: FloatArray | None = None
    if mesh.topology.index_map(3).size_local > 0:  # type: ignore[attr-defined]
        tensor = np.zeros((9, 9, 9))
        for i in range(9):
            for j in range(i, 9):
                one.value[:] = np.eye(9)[i].reshape(3, 3)
                other.value[:] = np.eye(9)[j].reshape(3, 3)
                row = expression.eval(mesh, np.zeros(1, dtype=np.int32)).reshape(9)
                tensor[i, j] = tensor[j, i] = row
    return next(found for found in comm.allgather(tensor) if found is not None)


def _is_plain(space: fem.FunctionSpace) -> bool:
    """Whether the unknown is a Lagrange displacement, three components a node, whose dofs are its values."""
    element = space.ufl_element()
    parts = element.sub_elements
    return (
        len(parts) == 3
        and element.reference_value_shape == (3,)
        and space.dofmap.bs == 3
        and all(part == parts[0] and part.reference_value_shape == () for part in parts)
        and parts[0].map_type == basix.MapType.identity
        and not space.element.needs_dof_transformations
    )


def _is_of_gradient(density: ufl.core.expr.Expr, u: fem.Function) -> bool:
    """Whether no derivative but grad(u), and no average, occurs in a density."""
    for item in unique_pre_traversal(ufl.algorithms.expand_derivatives(density)):
        if isinstance(item, _NOT_LOCAL):
            return False
        if isinstance(item, ufl.differentiation.Derivative) and not (
            isinstance(item, ufl.classes.Grad) and item.ufl_operands[0] == u
        ):
            return False
    return True


def _cell_type(space: fem.FunctionSpace) -> basix.CellType:
    return basix.CellType[space.mesh.topology.cell_name()]


def _contracted(
    model: ContinuumModel, rule: Quadrature, tensor: FloatArray, *, fields: FloatArray, modes: FloatArray
) -> FloatArray:
    """The sum over this rank's own cells, (l, n, n), by gradients in the points of the rule."""
    # gradients come with the derivative's direction first
    swapped = tensor.reshape((3,) * 6).transpose(1, 0, 3, 2, 5, 4).reshape(9, 9, 9)
    count, n = fields.shape[1], modes.shape[1]
    of_fields, of_modes = (np.ascontiguousarray(block).reshape(-1, 3, block.shape[1]) for block in (fields, modes))
    nodes = model.space.dofmap.list
    total = np.zeros((n, count * n))
    for cells, operator, weights in _gradients(model, rule, chunk=_CHUNK // (9 * max(count * n, 1))):
        points = weights.size
        grad_fields = _apply(operator, of_fields, nodes[cells])
        grad_modes = _apply(operator, of_modes, nodes[cells])
        weighted = (grad_fields * weights.reshape(-1, 1, 1)).transpose(0, 2, 1).reshape(-1, 9)
        # (points, 9, fields, 9): rows so that one product sums over points and rows for all fields at once
        stress = (weighted @ swapped.reshape(9, 81)).reshape(points, count, 9, 9).transpose(0, 2, 1, 3)
        products = np.ascontiguousarray(stress).reshape(points, 9 * count, 9) @ grad_modes
        total += grad_modes.reshape(points * 9, n).T @ products.reshape(points * 9, count * n)
    whole = total.reshape(n, count, n).transpose(1, 0, 2)
    return 0.5 * (whole + whole.transpose(0, 2, 1))


def _apply(operator: FloatArray, field: FloatArray, nodes: NDArray[np.int32]) -> FloatArray:
    """(points of all cells, 9, k) gradients, direction first, of fields (nodes, 3, k)."""
    k = field.shape[2]
    gradient = operator @ field[nodes].reshape(*nodes.shape, 3 * k)
    return gradient.reshape(-1, 9, k)


def _gradients(
    model: ContinuumModel, rule: Quadrature, *, chunk: int
) -> Iterator[tuple[slice, FloatArray, FloatArray]]:
    """By chunks of this rank's own cells: from nodal values to gradients, and the points' weights.

    Args:
        model: the body.
        rule: of the points.
        chunk: about how many points to take at a time.

    Yields:
        A slice of cells; (cells, points * 3, nodes of a cell) derivatives of the basis functions, direction last
        among the rows; (cells, points) weights, m^3.
    """
    mesh = model.mesh.mesh
    points, weights = basix.make_quadrature(_cell_type(model.space), rule.degree)
    shapes = _scalar_derivatives(model.space.ufl_element(), points)
    geometry = _scalar_derivatives(mesh.ufl_domain().ufl_coordinate_element(), points)
    corners, x = compat.cell_nodes(mesh), mesh.geometry.x
    count = mesh.topology.index_map(3).size_local
    step = max(1, chunk // len(weights))
    for start in range(0, count, step):
        cells = slice(start, min(start + step, count))
        # [c, q, r, k] = dx_k / dX_r, so that its inverse times d/dX is d/dx
        jacobian = geometry @ x[corners[cells]][:, None]
        operator = np.linalg.inv(jacobian) @ shapes
        volume = np.abs(np.linalg.det(jacobian)) * weights
        yield cells, operator.reshape(len(volume), -1, shapes.shape[2]), volume


def _scalar_derivatives(element: basix.ufl._ElementBase, points: FloatArray) -> FloatArray:
    """(points, 3, nodes) derivatives of the scalar basis functions on the reference cell."""
    table: FloatArray = element.sub_elements[0].tabulate(1, points)[1:]
    return np.ascontiguousarray(table.transpose(1, 0, 2))


def _directional(term: Term, u: fem.Function) -> tuple[fem.Form, fem.Function] | None:
    """The bilinear form D^3 of one term at rest along a displacement, which is also returned. Collective.

    None where it vanishes identically.
    """
    density, rule = term
    metadata = {"quadrature_degree": rule.degree, "quadrature_rule": rule.scheme}
    space = u.function_space
    direction = fem.Function(space)
    form = density * ufl.dx(domain=space.mesh, metadata=metadata)
    for argument in (direction, ufl.TestFunction(space), ufl.TrialFunction(space)):
        form = ufl.derivative(form, u, argument)
    form = ufl.replace(ufl.algorithms.expand_derivatives(form), {u: ufl.zero(u.ufl_shape)})
    form = ufl.algorithms.expand_derivatives(form)
    return (fem.form(form), direction) if form.integrals() else None


def _assembled(
    model: ContinuumModel, form: tuple[fem.Form, fem.Function], *, fields: FloatArray, modes: FloatArray
) -> FloatArray:
    """The sum over this rank's own cells, (l, n, n), by one matrix for each field. Collective."""
    bilinear, direction = form
    matrix = fem.create_matrix(bilinear)
    total = np.empty((fields.shape[1], modes.shape[1], modes.shape[1]))
    for i, field in enumerate(fields.T):
        direction.x.array[:] = field
        matrix.set_value(0.0)
        fem.assemble_matrix(matrix, bilinear)
        # rows of ghosts included and not added to their owners: the ranks' sums are added instead
        whole = modes.T @ (matrix.to_scipy(ghosted=True) @ modes)
        total[i] = 0.5 * (whole + whole.T)
    return total
