"""History at the quadrature points of one cell group: trial values, and those that are accepted.

A group's forms see the accepted history, the trial displacement, the local unknowns z solved at each
point for it, and the means over the cells; all of them live here, as functions that the compiled forms
read.  Where forms are differentiated, z is the stored solution less A r(z, u) with the equations r and the stored
inverse A of their derivative by z: r is zero, and the derivative by the displacement is that of the exact solution by
the theorem on implicit functions.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np
import ufl
from dolfinx import fem
from numpy.typing import NDArray

from flexmbd.continuum.contract.entries import STEP, is_rate_dependent
from flexmbd.continuum.contract.formulation import IntegralTerm, Quadrature, internal_work
from flexmbd.continuum.contract.quadrature import point_element, points_and_weights
from flexmbd.continuum.contract.results import solved, step_keyword
from flexmbd.continuum.contract.shared_nodes import share_nodes
from flexmbd.continuum.finite_elements import assembly
from flexmbd.continuum.finite_elements.cell_group import CellGroup
from flexmbd.continuum.history.cell_fields_solved import CellFieldsSolved
from flexmbd.continuum.history.cell_kernels import CellForms, LawCall, Unknowns
from flexmbd.continuum.history.cell_pass import EXPLICIT, IMPLICIT, CellPass
from flexmbd.continuum.history.shared_parts import share_parts
from flexmbd.errors import FormulationError

FloatArray = NDArray[np.float64]


class History:
    """History of one group of cells. Constructing one is collective, and may compile.

    Attributes:
        group: the cells, their formulation and parameters.
        accepted: (points, components) on all cells of this rank; empty without history.
        terms: the internal forces' virtual work as forms, linear in the test function.
        mean: the function of cell means, or None.
        rule: at whose points it lies.
        points: (points, 3) of the rule, in reference coordinates.
        unknown: the formulation's own, which its forms read.
        variation: test function on its space.
        work: the internal forces' virtual work at the unknown, local unknowns and history at hand.
    """

    def __init__(
        self,
        group: CellGroup,
        u: fem.Function,
        v: ufl.core.expr.Expr,
        *,
        means: bool,
        shared: fem.Function | None = None,
        temperature: fem.Function | None = None,
    ) -> None:
        """Not collective but for compilation.

        Args:
            group: of cells, with a checked formulation.
            u: trial unknown, which the forms read.
            v: test function on its space.
            means: whether cell means are taken where the formulation has them.
            shared: what of u cells share; None: there are no fields of one cell, and it is u.
            temperature: that the group's formulation reads, if any.

        Raises:
            FormulationError: terms in which the history stands have rules of their own each; cell means beside fields
                of one cell.
        """
        self.group = group
        self.unknown, self.variation = u, v
        self.solved: CellFieldsSolved | None = None
        if shared is not None and group.fields is not None:
            self.solved = CellFieldsSolved(group, group.fields, shared, u)
        self._mesh = u.function_space.mesh
        form: Any = group.formulation
        p = group.symbols
        self._has_state = group.optional.state is not None
        self.rule = _rule_of_history(group, u, v)
        self.points, self._weights = points_and_weights(self._mesh.topology.cell_name(), self.rule)
        self._dt = fem.Constant(self._mesh, 0.0)
        self._is_rate_dependent = is_rate_dependent(form)
        self._state: Any = None
        if self._has_state:
            self._state = self._function(int(form.state(p).ufl_shape[0]))
        cell_mean = group.optional.cell_mean if means else None
        self.mean: Any = None
        if cell_mean is not None:
            refuse_means_of_fields(group)
            self.mean = fem.Function(fem.functionspace(self._mesh, ("DG", 0)))
            self._averaged = cell_mean(u, self._state, p)
        self._z, self._slopes, equations, following = self._local_unknowns(u)
        given = self._given(self._z)
        update = None
        if self._has_state:
            self._initial = np.array([float(value) for value in form.state(group.parameters)])
            self._state.x.array.reshape(-1, len(self._initial))[:] = self._initial
            update = form.update(u, self._state, p, **given)

        def work(v: Any, z: Any) -> list[IntegralTerm]:
            if not self._has_state:
                return internal_work(form, u, v, p=p)
            terms = form.residual(u, v, self._state, p, **self._given(z))
            return [(share_nodes(density), rule) for density, rule in terms]

        self._pass = CellPass(
            group,
            Unknowns(
                u, u if shared is None else shared, self._state, self._z, self._slopes, self.mean, temperature
            ),
            CellForms(
                lambda v: work(v, self._z), update, equations, None if self.mean is None else self._averaged
            ),
            rule=self.rule,
            weights=self._weights,
            law=self._law(p),
            solved=self.solved,
        )
        self._begin_locally()
        self.work = work(v, self._z)
        self.terms = [assembly.integral(term, group, self._mesh) for term in self._shared(work(v, following))]
        if self.solved is not None:
            self.solved.compile_columns(self.terms)
        self._energy_terms = self._terms_of_energy(u, p)
        self._increment_size: ufl.core.expr.Expr | None = None
        self._compiled: dict[ufl.core.expr.Expr, fem.Expression] = {}

    @property
    def accepted(self) -> FloatArray:
        """(points of all cells of this rank, components) the accepted history."""
        if self._state is None:
            return np.zeros((0, 0))
        return self._state.x.array.reshape(-1, len(self._initial))

    def mean_forms(self) -> tuple[ufl.Form, ufl.Form]:
        """The averaged quantities and the measure of the cells, against test functions of the means."""
        w = ufl.TestFunction(self.mean.function_space)
        rule = self.rule
        averaged = assembly.integral((self._averaged * w, rule), self.group, self._mesh)
        return averaged, assembly.integral((ufl.as_ufl(1.0) * w, rule), self.group, self._mesh)

    def run(self, forces: FloatArray, *, explicit: bool = False) -> None:
        """Means, local unknowns and history at the step's end, for the trial displacement; not collective.

        Args:
            forces: (local dofs including ghosts,) N, to which this rank's internal forces are added.
            explicit: whether nothing is solved for with them, so that fields of one cell may be less exact.

        Raises:
            LocalEquationError: at a point, or in a cell, Newton's method does not end.
        """
        self._pass.run(forces, accuracy=EXPLICIT if explicit else IMPLICIT)

    def singular_fields(self) -> FormulationError | None:
        """What is wrong at rest with fields of one cell that their own equations do not determine; not collective."""
        return self._pass.singular_fields()

    def share(self, threads: int) -> None:
        """Share the cells of later passes among threads; not collective."""
        self._pass.share(threads)

    def set_step(self, dt: float) -> None:
        """Make the trial a step of that length, s; not collective."""
        if self._is_rate_dependent and float(self._dt.value) != dt:
            self._dt.value = dt
            self._pass.renew_constants()

    def renew_constants(self) -> None:
        """Take the values that the parameters' symbols have now; not collective."""
        self._pass.renew_constants()

    def average(self) -> None:
        """The means alone, for the trial displacement; not collective."""
        self._pass.average()

    @property
    def trial_is_finite(self) -> bool:
        """Whether the history at the step's end has values."""
        return bool(np.isfinite(self._pass.trial).all())

    def commit(self) -> None:
        """Accept the history at the step's end."""
        if self._state is not None:
            self._state.x.array[:] = self._pass.trial
        if self.solved is not None:
            self.solved.commit()
        self._begin_locally()

    def revert(self) -> None:
        """Forget the trial."""
        if self._state is not None:
            self._pass.trial[:] = self._state.x.array
        if self.solved is not None:
            self.solved.revert()
        self._begin_locally()

    def snapshot(self) -> FloatArray:
        """A copy of the accepted history, flat, cell by cell, and of the fields of one cell after it."""
        state = np.zeros(0) if self._state is None else self._state.x.array
        if self.solved is None:
            return state.copy()
        accepted = self.solved.accepted
        return np.hstack([state.reshape(len(accepted), -1), accepted]).reshape(-1)

    def fresh(self) -> FloatArray:
        """The snapshot of an undeformed body, with the first history."""
        state = np.zeros(0) if self._state is None else np.tile(self._initial, len(self.accepted))
        if self.solved is None:
            return state
        fields = np.zeros_like(self.solved.accepted)
        return np.hstack([state.reshape(len(fields), -1), fields]).reshape(-1)

    def restore(self, kept: FloatArray) -> None:
        """Go back to a snapshot, of the shared unknown that is on trial."""
        if self.solved is not None:
            rows = kept.reshape(len(self.solved.accepted), -1)
            count = rows.shape[1] - self.solved.accepted.shape[1]
            kept = rows[:, :count].reshape(-1)
            self.solved.restore(rows[:, count:])
        if self._state is not None:
            self._state.x.array[:] = kept
        self.revert()

    def energies(self) -> dict[str, float]:
        """This rank's energies, J, of the accepted history at the present displacement, by name. Collective."""
        if self._totals is not None:
            return dict(zip(self._energy_terms, map(float, self._totals()), strict=True))
        if self.solved is not None:
            self.solved.fill(accepted=True)
        self.average()
        return {name: float(fem.assemble_scalar(form)) for name, form in self._energy_forms.items()}

    @cached_property
    def _totals(self) -> Callable[[], FloatArray] | None:
        return self._pass.totals(list(self._energy_terms.values())) if self._energy_terms else None

    @cached_property
    def _energy_forms(self) -> dict[str, fem.Form]:
        terms = self._energy_terms.items()
        return {name: fem.form(assembly.integral(term, self.group, self._mesh)) for name, term in terms}

    def evaluate(self, expression: ufl.core.expr.Expr) -> FloatArray:
        """Values of an expression at the points of the group's cells, (cells, points, ...)."""
        if expression not in self._compiled:
            self._compiled[expression] = fem.Expression(expression, self.points)
        values: FloatArray = self._compiled[expression].eval(self._mesh, self.group.cells)
        return values.reshape(len(self.group.cells), len(self.points), *expression.ufl_shape)

    def increment_size(self) -> FloatArray:
        """(cells, points) the trial step over the largest that the form takes; empty where it knows none."""
        form: Any = self.group.formulation
        if self.group.optional.increment_size is None:
            return np.zeros((0, 0))
        if self._increment_size is None:
            self._increment_size = form.increment_size(self.unknown, self._state, self.group.symbols)
        self.fill_unknown()
        return self.evaluate(self._increment_size)

    def stress(self) -> FloatArray:
        """(cells, points, 3, 3) Pa, Cauchy stress of the trial displacement and the accepted history."""
        self.fill_unknown()
        return self.evaluate(self._stress)

    def fill_unknown(self) -> None:
        """Set the formulation's own unknown to the trial, where there are fields of one cell; not collective."""
        if self.solved is not None:
            self.solved.fill()

    @cached_property
    def _stress(self) -> ufl.core.expr.Expr:
        """Kept, for of two that a form builds the labels of variables differ, and each would be compiled."""
        form: Any = self.group.formulation
        p = self.group.symbols
        if not self._has_state:
            return form.stress(self.unknown, None, p)
        return form.stress(self.unknown, self._state, p, **self._given(self._z))

    def _given(self, z: Any) -> dict[str, Any]:
        given = {} if z is None else {"z": z}
        if self._is_rate_dependent:
            given[STEP] = self._dt
        return given if self.mean is None else {**given, "mean": self.mean}

    def _local_unknowns(self, u: fem.Function) -> tuple[fem.Function | None, fem.Function | None, Any, Any]:
        """The stored local unknowns and inverses, the equations with their derivatives, and z as it follows u."""
        form: Any = self.group.formulation
        p = self.group.symbols
        begin = solved(form, p).get("z")
        if begin is None:
            return None, None, None, None
        if self.group.optional.point_law is not None:
            law = self.group.optional.point_law(p)
            z, slopes = self._function(law.size), self._function((6, 6))
            return z, slopes, law.strain(u), law.following(z, slopes, u)
        shape = begin.ufl_shape
        z, inverse = self._function(shape), self._function(shape + shape)
        at, given = ufl.variable(z), self._given(None)
        lack = form.local_residual(at, u, self._state, p, **given)
        slope = ufl.diff(lack, at)
        left = form.local_residual(z, u, self._state, p, **given)
        if not shape:
            return z, inverse, ufl.as_vector([lack, slope]), z - inverse * left
        n = range(shape[0])
        equations = ufl.as_vector([*(lack[i] for i in n), *(slope[i, j] for i in n for j in n)])
        return z, inverse, equations, z - inverse * left

    def _law(self, p: Any) -> LawCall | None:
        """The compiled law, with the constants that it takes."""
        if self.group.optional.point_law is None:
            return None
        law = self.group.optional.point_law(p)
        return LawCall(law, [self._dt, *law.constants(p)])

    def _shared(self, terms: list[IntegralTerm]) -> list[IntegralTerm]:
        """The terms, with what the equations of the local unknowns have in common with the rest as one object."""
        if self._z is None:
            return terms
        return [(density, rule) for (_, rule), density in zip(terms, share_parts([d for d, _ in terms]), strict=True)]

    def _begin_locally(self) -> None:
        """Set the local unknowns to where the form lets them begin."""
        if self._z is not None:
            begin = solved(self.group.formulation, self.group.parameters)["z"]
            values = [float(begin[i]) for i in range(begin.ufl_shape[0])] if begin.ufl_shape else [float(begin)]
            self._z.x.array.reshape(-1, len(values))[:] = values

    def _function(self, shape: int | tuple[int, ...]) -> fem.Function:
        """A function that has its values at the points of the rule."""
        shape = (shape,) if isinstance(shape, int) else shape
        element = point_element(self._mesh.topology.cell_name(), self.rule, shape)
        return fem.Function(fem.functionspace(self._mesh, element))

    def _terms_of_energy(self, u: fem.Function, p: Any) -> dict[str, IntegralTerm]:
        form: Any = self.group.formulation
        if not self._has_state:
            return {f"elastic {k}" if k else "elastic": term for k, term in enumerate(form.strain_energy(u, p))}
        if self.group.optional.energies is None:
            return {}
        given = {} if self.mean is None else {"mean": self.mean}
        return dict(form.energies(u, self._state, p, **given))


def refuse_means_of_fields(group: CellGroup) -> None:
    """Refuse a cell mean beside fields of one cell, which would have to know of each other.

    Raises:
        FormulationError: there are both.
    """
    if group.fields is not None:
        names = group.fields.names(range(len(group.fields.cell_places)))
        raise FormulationError(
            f"{group.form_name} has a cell_mean and the {names}, fields of one cell, which are both against locking: "
            "take away one of them, or say cell_means=False"
        )


def _rule_of_history(group: CellGroup, u: fem.Function, v: ufl.core.expr.Expr) -> Quadrature:
    """The rule at whose points the history lies: that of all terms in which it stands."""
    form: Any = group.formulation
    p = group.symbols
    if group.optional.state is None:
        terms: list[IntegralTerm] = list(form.strain_energy(u, p))
        return terms[0][1]
    begin = ufl.as_ufl(form.state(p))
    domain = u.function_space.mesh
    state = ufl.Constant(domain, shape=begin.ufl_shape)
    local = {name: ufl.Constant(domain, shape=value.ufl_shape) for name, value in solved(form, p).items()}
    terms = list(form.residual(u, v, state, p, **{**step_keyword(form, 0.0), **local}))
    known = {state, *local.values()}
    kept = [rule for density, rule in terms if known & set(ufl.algorithms.analysis.extract_type(density, ufl.Constant))]
    rules = {(rule.degree, rule.scheme) for rule in kept}
    if len(rules) > 1:
        raise FormulationError(
            f"{group.form_name}: its terms with the history have the quadrature rules {sorted(rules)}, and a history "
            "needs one set of quadrature points; give them the same rule"
        )
    return (kept or [rule for _, rule in terms])[0]
