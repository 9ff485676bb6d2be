"""The modal stiffness by the stress of a static displacement.

With E = sym H + H^T H / 2, H = grad u, the strain energy about rest is W = W2 + W3 + ..., where

    W3(u) = 1/2 integral of stress(u) : (H^T H),    D^3 W(0)[a, b, c] = P(a; b, c) + P(b; c, a) + P(c; a, b),
    P(a; b, c) = integral of stress(a) : (grad b^T grad c),

and stress(a) is the small-strain stress. The geometric stiffness of a load with the displacement a is P(a; b, c), the
part with the stress of the load. It is minus the load's work on the second-order displacement g(b, c) that makes up,
at the least energy, for the second-order strain of the modes, K g = -P(.; b, c); with b + g(b, b) / 2 for b the cubic
energy is zero. The other two parts turn the stresses of the modes by the rotation of a. They stand for no stiffness
(a turned body is as stiff as before), and taken alone, without the fourth-order terms that complete the square, they
have a slender body bent sideways lose its stiffness at a small angle.

A formulation of a beam or shell, whose second-order strain is another one, marks its strain measures E by
`ufl.variable`; then P(a; b, c) is the integral of dW/dE (a) times the second derivative of E along b and c. Without
such marks it has no geometric stiffness.

Nothing is assembled for each a where the energy density is a function of H alone, the same in all points of its cells:
its second derivative is then one tensor of 9 x 9 numbers, made by UFL, and the sums over the points are dense products
over chunks of cells that stay in the cache. Any other density is assembled, one matrix for each a.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from petsc4py import PETSc

import basix
import numpy as np
import ufl
from dolfinx import fem
from numpy.typing import NDArray
from scipy.sparse import csr_array
from ufl.corealg.map_dag import map_expr_dag
from ufl.corealg.multifunction import MultiFunction
from ufl.corealg.traversal import unique_pre_traversal

from flexmbd.continuum.contract.formulation import IntegralTerm
from flexmbd.continuum.contract.substituted_field import SubstitutedField
from flexmbd.continuum.finite_elements.assembly import assemble, integral
from flexmbd.continuum.finite_elements.cell_group import CellGroup
from flexmbd.continuum.finite_elements.condensed_stiffness import GroupForms
from flexmbd.reduction.stiffening.point_gradients import (
    RulePoints,
    by_node,
    cell_type,
    field_gradients,
    point_gradients,
)

if TYPE_CHECKING:
    from flexmbd.continuum.finite_elements.linear_model import LinearModel

FloatArray = NDArray[np.float64]

# Cells of a chunk: so few that what is computed of them stays in the cache, so many that they share their nodes.
_CELLS = 64

# What a density at a constant gradient may hold, if it is to be the same in every point.
_CONSTANT = (ufl.classes.ConstantValue, ufl.classes.MultiIndex, ufl.classes.Constant, ufl.classes.Label)
# What sees more of the displacement than its gradient in the point.
_NOT_LOCAL = (ufl.classes.CellAvg, ufl.classes.FacetAvg, ufl.classes.Restricted)


def stress_stiffness(model: LinearModel, fields: FloatArray, modes: FloatArray) -> FloatArray | None:
    """P(u_l; phi_i, phi_j) for all fields and pairs of modes. Collective.

    Args:
        model: each term of its strain energy is integrated by its own rule, as the stiffness is.
        fields: (local dofs including ghosts, l) u_l, m.
        modes: (local dofs including ghosts, n) phi.

    Returns:
        (l, n, n) symmetric, N/m per unit of the fields, the same to the bit on every rank; None where nothing is
        known of the second-order strain: all third derivatives of the energy vanish identically, or a beam or shell
        does not mark its strains.
    """
    if fields.size == 0 or modes.size == 0:
        return np.zeros((fields.shape[1], modes.shape[1], modes.shape[1]))
    return of_whole_fields(model, model.unknown_columns(fields), model.unknown_columns(modes))


def of_whole_fields(model: LinearModel, fields: FloatArray, modes: FloatArray) -> FloatArray | None:
    """As `stress_stiffness`, of fields and modes of the formulations' own unknown, (local dofs of that, l or n)."""
    u = fem.Function(model.unknown_space)
    total = np.zeros((fields.shape[1], modes.shape[1], modes.shape[1]))
    known = False
    for group in model.groups:
        for term in group.formulation.strain_energy(u, group.symbols):
            if is_quadratic(term, u) or (group.has_sections and not marked_strains(term)):
                continue
            known = True
            tensor = gradient_tensor(term, u)
            if tensor is None:
                form, field = _directional(term, group, u)
                total += assembled_on_modes(fem.form(form), field, fields=fields, modes=modes)
            else:
                points = RulePoints(model, group.cells, term[1])
                total += _contracted(points, tensor, fields=fields, modes=modes)
    if not known:
        return None
    # each rank has the sums over its own cells
    everywhere = model.comm.reduce(total, root=0)
    return np.ascontiguousarray(model.comm.bcast(everywhere, root=0))


def stress_stiffness_matrix(model: LinearModel, field: FloatArray) -> PETSc.Mat | None:
    """P(u; ., .) of one field over all dofs. Collective.

    Args:
        model: each term of its strain energy is integrated by its own rule, as the stiffness is.
        field: (local dofs including ghosts,) u, m.

    Returns:
        A new symmetric AIJ matrix with the layout of `K`, N/m, which the caller destroys; None as `stress_stiffness`.
    """
    return matrix_of_whole_field(model, model.unknown_columns(field[:, None])[:, 0])


def matrix_of_whole_field(model: LinearModel, whole: FloatArray) -> PETSc.Mat | None:
    """As `stress_stiffness_matrix`, of a field of the formulations' own unknown, (local dofs of that,). Collective."""
    u = fem.Function(model.unknown_space)
    forms: dict[int, list[ufl.Form]] = {}
    for k, group in enumerate(model.groups):
        for term in group.formulation.strain_energy(u, group.symbols):
            if is_quadratic(term, u) or (group.has_sections and not marked_strains(term)):
                continue
            form, at = _directional(term, group, u)
            at.x.array[:] = whole
            forms.setdefault(k, []).append(form)
    return symmetric_sum(model, forms)


def symmetric_sum(model: LinearModel, forms: GroupForms) -> PETSc.Mat | None:
    """The symmetric part of a sum of bilinear forms of the formulations' own unknown, as a new AIJ matrix. Collective.

    None where there are none.
    """
    if not forms:
        return None
    name = "geometric stiffness"
    if model.condensed is not None:
        return model.tied(_symmetric_part(model.condensed.matrix(forms, name=name)))
    compiled = [fem.form(form) for some in forms.values() for form in some]
    return model.tied(_symmetric_part(assemble({name: compiled}, model.groups, model.space)[0]))


def _symmetric_part(half: PETSc.Mat) -> PETSc.Mat:
    other = half.copy()
    other.transpose()
    half.axpy(1.0, other, structure=PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
    half.scale(0.5)
    other.destroy()
    return half


def gradient_tensor(term: IntegralTerm, u: fem.Function) -> FloatArray | None:
    """Second derivative at rest of an energy density with respect to the gradient of u. Collective.

    Args:
        term: density, as an expression in u, and its rule.
        u: the displacement the density is written in.

    Returns:
        (9, 9) Pa, entries of grad u row by row; None where the density is not a function of grad u alone, or not the
        same in every point, or where the fast contraction does not know the element or the rule.
    """
    density, rule = term
    if rule.scheme != "default" or not _is_plain(u.function_space) or not _is_of_gradient(density, u):
        return None
    mesh = u.function_space.mesh
    gradient, direction = (fem.Constant(mesh, np.zeros((3, 3))) for _ in range(2))
    # a displacement of constant gradient; what is left of the position then comes from elsewhere
    affine = ufl.dot(gradient, ufl.SpatialCoordinate(mesh))
    local = ufl.algorithms.expand_derivatives(ufl.replace(density, {u: affine}))
    if not all(isinstance(item, _CONSTANT) for item in unique_pre_traversal(local) if item._ufl_is_terminal_):
        return None
    variable = ufl.variable(gradient)
    first = ufl.diff(ufl.replace(local, {gradient: variable}), variable)
    second = ufl.diff(ufl.inner(first, direction), variable)
    centre = basix.geometry(cell_type(u.function_space)).mean(axis=0, keepdims=True)
    # a variable's label differs from call to call, and would have the same code compiled again
    expression = fem.Expression(without_variables(ufl.algorithms.expand_derivatives(second)), centre)
    tensor: FloatArray | None = None
    if mesh.topology.index_map(3).size_local > 0:
        tensor = np.empty((9, 9))
        for i in range(9):
            direction.value[:] = np.eye(9)[i].reshape(3, 3)
            tensor[i] = expression.eval(mesh, np.zeros(1, dtype=np.int32)).reshape(9)
    return next(found for found in mesh.comm.allgather(tensor) if found is not None)


def is_quadratic(term: IntegralTerm, u: fem.Function) -> bool:
    """Whether the third derivative of a term at rest vanishes identically."""
    form = term[0] * ufl.dx(domain=u.function_space.mesh)
    for _ in range(3):
        form = ufl.derivative(form, u, fem.Function(u.function_space))
    form = ufl.algorithms.expand_derivatives(form)
    at_rest = ufl.replace(form, {u: ufl.zero(u.ufl_shape)})
    return not ufl.algorithms.expand_derivatives(at_rest).integrals()


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


def _contracted(
    points: RulePoints, tensor: FloatArray, *, fields: FloatArray, modes: FloatArray
) -> FloatArray:
    """The sum over the cells, (l, n, n).

    Of each field and cell one matrix of its nodes, the same for the three components; its products with the modes are
    summed in the nodes of a chunk of cells before they meet the modes once more.
    """
    # gradients come with the derivative's direction first
    elastic = tensor.reshape((3,) * 4).transpose(1, 0, 3, 2).reshape(9, 9)
    count, n = fields.shape[1], modes.shape[1]
    of_fields, of_modes = by_node(fields), by_node(modes)
    nodes = points.model.space.dofmap.list
    m = nodes.shape[1]
    total = np.zeros((count, n, n))
    for cells, operator, weights in point_gradients(points, chunk=_CELLS * len(points.reference[1])):
        k, size = weights.shape
        stress = elastic @ field_gradients(operator, of_fields, nodes[cells]) * weights.reshape(-1, 1, 1)
        stress = np.ascontiguousarray(np.moveaxis(stress.reshape(k, size, 3, 3, count), -1, 0))
        slopes = operator.reshape(k, size, 3, m)
        own, place = np.unique(nodes[cells], return_inverse=True)
        gather = csr_array((np.ones(place.size), (place.ravel(), np.arange(place.size))), (len(own), place.size))
        local, whole = of_modes[nodes[cells]].reshape(k, m, 3 * n), of_modes[own].reshape(-1, n)
        for share, of_field in zip(total, stress, strict=True):
            stiffness = operator.transpose(0, 2, 1) @ (of_field @ slopes).reshape(k, -1, m)
            share += whole.T @ (gather @ (stiffness @ local).reshape(k * m, 3 * n)).reshape(-1, n)
    return 0.5 * (total + total.transpose(0, 2, 1))


def assembled_on_modes(
    form: fem.Form, direction: fem.Function, *, fields: FloatArray, modes: FloatArray
) -> FloatArray:
    """The sum over this rank's own cells, (l, n, n), by one matrix for each field. Collective."""
    matrix = fem.create_matrix(form)
    total = np.empty((fields.shape[1], modes.shape[1], modes.shape[1]))
    for i, field in enumerate(fields.T):
        direction.x.array[:] = field
        matrix.set_value(0.0)
        fem.assemble_matrix(matrix, form)
        # rows of ghosts included and not added to their owners: the ranks' sums are added instead;
        # after this rank's own columns come some that only the owners of its ghosts need
        local = matrix.to_scipy(ghosted=True).tocsr()[:, : len(modes)]
        whole = modes.T @ (local @ modes)
        total[i] = 0.5 * (whole + whole.T)
    return total


def _directional(term: IntegralTerm, group: CellGroup, u: fem.Function) -> tuple[ufl.Form, fem.Function]:
    """P(a; ., .) of one term as a bilinear form, and the field a; not collective."""
    density, rule = term
    a = fem.Function(u.function_space)
    # a solid's variables are its own affair: F = variable(I + grad u), say, has no second-order part
    strains = marked_strains(term) if group.has_sections else []
    integrand = _by_strains(density, strains, u, a) if strains else _by_gradient(density, u, a)
    return integral((integrand, rule), group, u.function_space.mesh), a


def marked_strains(term: IntegralTerm) -> list[ufl.core.expr.Expr]:
    """The strain measures that a density marks."""
    return [item for item in unique_pre_traversal(term[0]) if isinstance(item, ufl.classes.Variable)]


def _by_strains(
    density: ufl.core.expr.Expr, strains: list[ufl.core.expr.Expr], u: fem.Function, a: fem.Function
) -> ufl.core.expr.Expr:
    """The stress of a, dW/dE, times the second derivative of each strain E that the form marks as a variable."""
    b, c = ufl.TestFunction(u.function_space), ufl.TrialFunction(u.function_space)
    parts = []
    for strain in strains:
        stress = ufl.derivative(ufl.diff(density, strain), u, a)
        second_order = ufl.derivative(ufl.derivative(strain, u, b), u, c)
        parts.append(ufl.inner(stress, second_order))
    whole = without_variables(ufl.algorithms.expand_derivatives(sum(parts)))
    return ufl.replace(whole, {u: ufl.zero(u.ufl_shape)})


def _by_gradient(density: ufl.core.expr.Expr, u: fem.Function, a: fem.Function) -> ufl.core.expr.Expr:
    """The second derivative at rest along a and along a field of which only a displacement gradient is not zero.

    This gradient is grad b^T grad c; in a mixed unknown the displacement comes first.
    """
    gradient = second_order_gradient(u.function_space)
    small = [fem.Constant(u.function_space.mesh, 0.0) for _ in range(2)]
    s, t = map(ufl.variable, small)
    along = SubstitutedField(u, s * a, s * ufl.grad(a) + t * gradient)
    expression = map_expr_dag(along, ufl.algorithms.expand_derivatives(density))
    expression = ufl.algorithms.expand_derivatives(ufl.diff(ufl.diff(expression, t), s))
    return ufl.replace(without_variables(expression), dict.fromkeys(small, ufl.zero()))


class _Unmarked(MultiFunction):
    """Puts what a variable stands for in its place."""

    expr = MultiFunction.reuse_if_untouched

    def variable(self, o: ufl.core.expr.Expr, value: ufl.core.expr.Expr, label: Any) -> ufl.core.expr.Expr:
        """A variable."""
        return value


def without_variables(expression: ufl.core.expr.Expr) -> ufl.core.expr.Expr:
    """As UFL's `strip_variables`, which walks into a shared part once for every time it is used."""
    return map_expr_dag(_Unmarked(), expression)


def second_order_gradient(space: fem.FunctionSpace) -> ufl.core.expr.Expr:
    """grad b^T grad c of the displacements in two arguments on the space; zero in the rows of further unknowns."""
    arguments = ufl.TestFunction(space), ufl.TrialFunction(space)
    b, c = (ufl.as_tensor([ufl.grad(field)[i, :] for i in range(3)]) for field in arguments)
    second_order = ufl.transpose(b) * c
    others = [ufl.zero(3) for _ in range(arguments[0].ufl_shape[0] - 3)]
    return ufl.as_tensor([*(second_order[i, :] for i in range(3)), *others])
