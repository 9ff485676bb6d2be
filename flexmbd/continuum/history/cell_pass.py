"""One pass over a group's cells: means, local unknowns, internal forces, and the history at the step's end.

DOLFINx would take a pass for each, in which it collects the same values of the cell, and each kernel would find
strain and stress again.  Here forces and history are the two parts of one form on a mixed space of test functions,
the displacement's and one that has its values at the points of the rule: FFCx makes one kernel of it, that does for
both what they have in common.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import basix.ufl
import numpy as np
import ufl
from dolfinx import fem
from numpy.typing import NDArray

from flexmbd.continuum import compat
from flexmbd.continuum.contract import quadrature
from flexmbd.continuum.contract.formulation import IntegralTerm, Quadrature
from flexmbd.continuum.contract.point_law import FAULTS, WRITING_FAULTS, PointLaw
from flexmbd.continuum.finite_elements.cell_group import CellGroup
from flexmbd.continuum.history.cell_fields_solved import CellFieldsSolved, no_cell_fields
from flexmbd.continuum.history.cell_loop import pass_cells
from flexmbd.continuum.history.point_loop import FORCES, Fields, Kernels, Room
from flexmbd.continuum.history.shared_parts import share_parts
from flexmbd.errors import ConvergenceError, FormulationError

FloatArray = NDArray[np.float64]

# Local Newton steps, whole ones, then, from the start again, shortened where they do not lessen what is lacking; and
# the change of the local unknowns, over their size in the cell, at which they end.
_SWEEPS = (30, 1000)
_LOCAL = 1e-10

#: Fields of one cell: change of a cell's forces by their last step, over these, where it ends.  Explicit steps take
#: what is left into the next one, and it does not add up.
IMPLICIT, EXPLICIT = 1e-12, 1e-3

# How often tangents of fields of one cell are renewed for one trial.
_RENEWALS = 30

_NONE = np.zeros(0)


class LocalEquationError(ConvergenceError):
    """The equations at a quadrature point are not solved for a trial displacement; a smaller step may help."""


@dataclass(frozen=True, eq=False)
class Unknowns:
    """The functions that a group's forms read; None for what the formulation does not have.

    Attributes:
        u: trial unknown of the formulation.
        shared: what of it cells share; `u` itself where there are no fields of one cell.
        state: history at the step's begin.
        local: local unknowns, n at each point.
        slopes: at each point the inverse (n, n) of the derivative of their equations.
        mean: over the cells.
        temperature: at the nodes of each cell.
    """

    u: fem.Function
    shared: fem.Function
    state: fem.Function | None
    local: fem.Function | None
    slopes: fem.Function | None
    mean: fem.Function | None
    temperature: fem.Function | None = None


@dataclass(frozen=True, eq=False)
class CellForms:
    """The forms evaluated in a cell; None for those that the formulation does not have.

    Attributes:
        work: virtual work of a test function of the displacement, as terms of any rules; those of the history have its own.
        update: history at the step's end.
        equations: of the local unknowns, (n + n n,): what they make zero, and its derivatives by them, row by row.
        averaged: what the means are of.
    """

    work: Callable[[Any], Sequence[IntegralTerm]]
    update: ufl.core.expr.Expr | None
    equations: ufl.core.expr.Expr | None
    averaged: ufl.core.expr.Expr | None


@dataclass(frozen=True, eq=False)
class _CellKernel:
    """A kernel: its address, what is kept alive for it, its constants and their values, and what it reads, in order."""

    address: int
    module: Any
    symbols: list[fem.Constant]
    constants: FloatArray
    reads: list[fem.Function]


@dataclass(frozen=True, eq=False)
class LawCall:
    """A compiled law, whose equations are the strain that it is given, and the symbols of its constants."""

    law: PointLaw
    symbols: Sequence[fem.Constant]


class CellPass:
    """The kernels of one group, ready to run. Constructing one is collective, and compiles."""

    def __init__(
        self,
        group: CellGroup,
        unknowns: Unknowns,
        forms: CellForms,
        *,
        rule: Quadrature,
        weights: FloatArray,
        law: LawCall | None = None,
        solved: CellFieldsSolved | None = None,
    ) -> None:
        """Compile.

        Args:
            group: of cells.
            unknowns: the functions of its forms.
            forms: what is evaluated.
            rule: at whose points history and local unknowns lie.
            weights: of its points.
            law: that makes the local unknowns; None: their equations do.
            solved: fields of one cell; None: there are none.
        """
        self._group, self._unknowns, self._rule = group, unknowns, rule
        self._law: _CellKernel | None = None
        if law is not None:
            self._law = _CellKernel(law.law.address, law.law.keep, [*law.symbols], _values(law.symbols), [])
        self._domain = unknowns.u.function_space.mesh
        self._codes = [
            self._mean(forms.averaged),
            self._equations(forms.equations),
            self._law,
            *self._step(forms.work, forms.update),
        ]
        n_cells, dofmap = len(compat.cell_nodes(self._domain)), unknowns.u.function_space.dofmap
        self._solved = solved
        self._inner = no_cell_fields() if solved is None else solved.unknowns
        none = np.zeros((n_cells, 0))
        state, local, slopes = (
            # the number of columns is said: of a rank without cells it could not be found
            none if field is None else field.x.array.reshape(n_cells, len(weights) * field.function_space.dofmap.bs)
            for field in (unknowns.state, unknowns.local, unknowns.slopes)
        )
        mean = np.zeros(0) if unknowns.mean is None else unknowns.mean.x.array
        #: (points of all cells of this rank, components) flat, history at the step's end
        self.trial: FloatArray = state.flatten()
        self._known = state
        given = state if unknowns.temperature is None else np.hstack([state, self._warmth()])
        self._fields = Fields(unknowns.shared.x.array, given, local, slopes, mean, self.trial.reshape(state.shape))
        self._sizes = [dofmap.bs * dofmap.list.shape[1], given.shape[1], local.shape[1], 1]
        self._kernels = self._tables(weights)
        row, n = sum(self._sizes), local.shape[1] // len(weights)
        each, kept = (n, state.shape[1] // len(weights)) if self._law is not None else (0, 0)
        n -= each
        self._room = Room(
            coordinates=np.zeros((compat.cell_nodes(self._domain).shape[1], 3)),
            row=np.zeros(row + 1),
            given=np.zeros(row + 1),
            tensor=np.zeros(max(row, local.shape[1] + slopes.shape[1]) + 1),
            matrix=np.zeros((n, 2 * n)),
            sizes=np.zeros((2, n)),
            steps=np.zeros((len(weights), n + 2)),
            where=np.zeros(2, dtype=np.int64),
            given_law=np.zeros(6 + kept),
            made_by_law=np.zeros(each + 37),
        )

    def run(self, forces: FloatArray, *, accuracy: float) -> None:
        """Evaluate for the trial displacement, and add this rank's internal forces; not collective.

        Args:
            forces: (local dofs including ghosts,) N, to which they are added.
            accuracy: of a cell's forces, to which its own fields are solved for.

        Raises:
            ConvergenceError: at a point, or for the fields of one cell, Newton's method does not end; or a law returns
                what is not finite.
            FormulationError: a law returns other shapes than at rest, or raises an error.
        """
        self._check(self._pass(self._fields, self._kernels, forces, accuracy=accuracy))
        if self._solved is not None:
            self._solve_cells(self._solved, forces, accuracy)

    def singular_fields(self) -> FormulationError | None:
        """What is wrong at rest with fields of one cell that their own equations do not determine; not collective."""
        if self._solved is None:
            return None
        self._check(self._pass(self._fields, self._kernels, _NONE))  # local unknowns alone, for the tangents
        singular = self._group.cells[self._solved.renew(self._group.cells)]
        return self._solved.singular_error(int(singular[0])) if len(singular) else None

    def _solve_cells(self, solved: CellFieldsSolved, forces: FloatArray, accuracy: float) -> None:
        """Solve for the fields of those cells whose tangent is too old, with new ones."""
        cells = solved.unsolved()
        for renewals in range(_RENEWALS + 1):
            if not len(cells):
                solved.end_pass()
                return
            if renewals == _RENEWALS:
                break
            singular = solved.renew(cells)
            if singular.any():
                cells = cells[singular]
                break
            self._check(
                self._pass(self._fields, self._kernels, forces, accuracy=accuracy, cells=cells, predicts=False)
            )
            cells = solved.unsolved()
        raise LocalEquationError(
            f"{self._group.form_name}: the {solved.open_names(cells[0])}, fields of one cell, were not solved for in "
            f"{_RENEWALS} tangents of the cell around ({self._place(cells[0])}) m; take a smaller step"
        )

    def _check(self, change: float) -> None:
        """Raise where local unknowns were not found."""
        if change != 0.0 and self._law is not None:
            fault = int(change)
            if fault <= WRITING_FAULTS:
                raise FormulationError(f"{self._group.form_name}: {FAULTS[fault - 1]}, {self._where()}")
            raise ConvergenceError(
                f"{self._group.form_name}: {FAULTS[fault - 1]}, {self._where()}; take a smaller step"
            )
        if change != 0.0:
            raise LocalEquationError(
                f"{self._group.form_name}: the equations at a quadrature point were not solved, in {_SWEEPS[0]} whole "
                f"steps of Newton's method and {_SWEEPS[1]} that were shortened where they did not help (last "
                f"relative change {change:.1e}): {self._where()}; take a smaller step"
            )

    def _where(self) -> str:
        """Point, cell and history where the local unknowns were not found."""
        cell, point = map(int, self._room.where)
        state = self._known[cell].reshape(len(self._kernels.weights), -1)[point]
        names = self._group.optional.state_names
        counts = {"": len(state)} if names is None else names(self._group.parameters)
        parts = np.split(state, np.cumsum([*counts.values()])[:-1])
        values = [", ".join(f"{value:.4g}" for value in part) for part in parts]
        history = ", ".join(f"{name} [{part}]".strip() for name, part in zip(counts, values, strict=True))
        return f"point {point} of the cell around ({self._place(cell)}) m, whose history is {history}"

    def _place(self, cell: int) -> str:
        centre = self._domain.geometry.x[compat.cell_nodes(self._domain)[cell]].mean(axis=0)
        return ", ".join(f"{x:.4g}" for x in centre)

    def renew_constants(self) -> None:
        """Take the values that the forms' constants have now; not collective."""
        for code in self._codes:
            if code is not None:
                code.constants[:] = _values(code.symbols)

    def average(self) -> None:
        """Evaluate the means alone for the trial displacement; not collective."""
        if self._unknowns.mean is not None:
            fields = self._fields._replace(local=np.zeros((len(self._fields.local), 0)))
            kernels = self._kernels._replace(addresses=self._kernels.addresses[:FORCES])
            self._pass(fields, kernels, _NONE)

    def _warmth(self) -> FloatArray:
        """(cells, nodes of one) K, the temperature at the nodes of each cell."""
        at: Any = self._unknowns.temperature
        return np.asarray(at.x.array[at.function_space.dofmap.list])

    def _pass(
        self,
        fields: Fields,
        kernels: Kernels,
        forces: FloatArray,
        *,
        accuracy: float = 0.0,
        cells: NDArray[np.int32] | None = None,
        predicts: bool = True,
    ) -> float:
        if self._unknowns.temperature is not None:
            # behind the history of a cell, as a part of what is known of it at the step's begin
            columns = self._known.shape[1]
            self._fields.state[:, :columns] = self._known
            self._fields.state[:, columns:] = self._warmth()
        dofmap = self._unknowns.shared.function_space.dofmap
        return float(pass_cells(
            self._group.cells if cells is None else cells, compat.cell_nodes(self._domain), self._domain.geometry.x,
            dofmap.list, dofmap.bs, fields, kernels, self._room, self._inner, forces, _SWEEPS, _LOCAL, accuracy,
            int(predicts),
        ))  # fmt: skip

    def _mean(self, averaged: ufl.core.expr.Expr | None) -> _CellKernel | None:
        if averaged is None:
            return None
        w = self._test_function(basix.ufl.element("DG", self._domain.topology.cell_name(), 0, shape=(2,)))
        return self._compiled(averaged * w[0] + w[1], self._rule)

    def _equations(self, equations: ufl.core.expr.Expr | None) -> _CellKernel | None:
        if equations is None:
            return None
        (density,) = share_parts([self._at_points(equations, self._test_function(self._pointwise(equations)))])
        return self._compiled(density, self._rule)

    def _step(
        self, work: Callable[[Any], Sequence[IntegralTerm]], update: ufl.core.expr.Expr | None
    ) -> Iterator[_CellKernel | None]:
        displaced = self._unknowns.u.function_space.ufl_element()
        if update is None:
            for density, rule in work(self._test_function(displaced)):
                yield self._compiled(density, rule)
            return
        # terms without history have rules of their own; the kernel that leaves a history is the last one
        for density, rule in work(self._test_function(displaced)):
            if not self._is_of_history(rule):
                yield self._compiled(density, rule)
        both = basix.ufl.mixed_element([displaced, self._pointwise(update)])
        v, w = ufl.split(self._test_function(both))
        densities = [density for density, rule in work(v) if self._is_of_history(rule)]
        yield self._compiled(sum(share_parts([*densities, self._at_points(update, w)])), self._rule)

    def _is_of_history(self, rule: Quadrature) -> bool:
        return (rule.degree, rule.scheme) == (self._rule.degree, self._rule.scheme)

    def _at_points(self, values: ufl.core.expr.Expr, w: ufl.core.expr.Expr) -> ufl.core.expr.Expr:
        """A density whose integral has the values at the points times their weights."""
        return ufl.inner(values, w) / abs(ufl.JacobianDeterminant(self._domain))

    def _pointwise(self, values: ufl.core.expr.Expr) -> Any:
        """The element with values of this shape at the points of the rule."""
        return quadrature.point_element(self._domain.topology.cell_name(), self._rule, values.ufl_shape)

    def _test_function(self, element: Any) -> ufl.Argument:
        return ufl.TestFunction(ufl.FunctionSpace(self._domain.ufl_domain(), element))

    def _compiled(self, density: ufl.core.expr.Expr, rule: Quadrature) -> _CellKernel:
        metadata = quadrature.metadata(self._domain.topology.cell_name(), rule)
        form = density * ufl.dx(domain=self._domain, metadata=metadata)
        address, positions, module = compat.cell_kernel(self._domain.comm, form)
        symbols = list(form.constants())
        coefficients = form.coefficients()
        reads = [coefficients[position] for position in positions]
        return _CellKernel(address, module, symbols, _values(symbols), reads)

    def _tables(self, weights: FloatArray) -> Kernels:
        known, count = self._unknowns, len(self._codes)
        pieces = [known.u, known.state, known.local, known.mean]
        sizes = [*self._sizes]
        if known.temperature is not None:
            pieces.insert(2, known.temperature)
            columns = self._known.shape[1]
            sizes[1:2] = [columns, sizes[1] - columns]
        begins = np.cumsum([0, *sizes])
        places = {id(field): k for k, field in enumerate(pieces) if field is not None}
        addresses, constants = np.zeros((2, count), dtype=np.int64)
        starts, lengths = np.zeros((2, count, len(sizes)), dtype=np.int64)
        for i, code in enumerate(self._codes):
            if code is None:
                continue
            addresses[i], constants[i] = code.address, code.constants.ctypes.data
            last = -1
            for k in (places[id(field)] for field in code.reads):
                joined = last >= 0 and begins[k] == starts[i, last] + lengths[i, last]
                last += not joined
                starts[i, last] = starts[i, last] if joined else begins[k]
                lengths[i, last] += sizes[k]
        return Kernels(addresses, constants, starts, lengths, np.asarray(weights, dtype=float))


def _values(symbols: Sequence[fem.Constant]) -> FloatArray:
    return np.concatenate([np.zeros(0), *(np.asarray(symbol.value, dtype=float).ravel() for symbol in symbols)])
