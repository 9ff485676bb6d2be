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
from flexmbd.continuum.contract.formulation import IntegralTerm, Quadrature
from flexmbd.continuum.contract.point_law import FAULTS, WRITING_FAULTS, PointLaw
from flexmbd.continuum.finite_elements.cell_group import CellGroup
from flexmbd.continuum.history.cell_loop import FORCES, Fields, Kernels, Room, pass_cells
from flexmbd.continuum.history.lane_pass import lane_pass
from flexmbd.continuum.history.shared_parts import share_parts
from flexmbd.errors import ConvergenceError, FormulationError

FloatArray = NDArray[np.float64]

# Local Newton steps, whole ones, then, from the start again, shortened where they do not lessen what is lacking; and
# the change of the local unknowns, over their size in the cell, at which they end.
_SWEEPS = (30, 1000)
_LOCAL = 1e-10

_NONE = np.zeros(0)


class LocalEquationError(ConvergenceError):
    """The equations at a quadrature point are not solved for a trial displacement; a smaller step may help."""


@dataclass(frozen=True, eq=False)
class Unknowns:
    """The functions that a group's forms read; None for what the formulation does not have.

    Attributes:
        u: trial displacement.
        state: history at the step's begin.
        local: local unknowns, n at each point.
        slopes: at each point the inverse (n, n) of the derivative of their equations.
        mean: over the cells.
    """

    u: fem.Function
    state: fem.Function | None
    local: fem.Function | None
    slopes: fem.Function | None
    mean: fem.Function | None


@dataclass(frozen=True, eq=False)
class CellForms:
    """The forms evaluated in a cell; None for those that the formulation does not have.

    Attributes:
        work: virtual work of a test function of the displacement, as terms of any rules; with history of one.
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
    ) -> None:
        """Compile.

        Args:
            group: of cells.
            unknowns: the functions of its forms.
            forms: what is evaluated.
            rule: at whose points history and local unknowns lie.
            weights: of its points.
            law: that makes the local unknowns; None: their equations do.
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
        none = np.zeros((n_cells, 0))
        state, local, slopes = (
            # the number of columns is said: of a rank without cells it could not be found
            none if field is None else field.x.array.reshape(n_cells, len(weights) * field.function_space.dofmap.bs)
            for field in (unknowns.state, unknowns.local, unknowns.slopes)
        )
        mean = np.zeros(0) if unknowns.mean is None else unknowns.mean.x.array
        #: (points of all cells of this rank, components) flat, history at the step's end
        self.trial: FloatArray = state.flatten()
        self._fields = Fields(unknowns.u.x.array, state, local, slopes, mean, self.trial.reshape(state.shape))
        self._sizes = [dofmap.bs * dofmap.list.shape[1], state.shape[1], local.shape[1], 1]
        self._kernels = self._tables(weights, self._codes)
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
        # many cells are evaluated in blocks
        self._blocks = lane_pass(
            self._domain.comm, group.cells, blocks=dofmap.list, width=dofmap.bs, kernels=self._kernels, room=self._room,
            modules=[None if code is None or code is self._law else code.module for code in self._codes],
        )  # fmt: skip

    def share(self, threads: int) -> None:
        """Share the cells of later passes among threads; not collective."""
        if self._blocks is not None:
            self._blocks.threads = threads

    def totals(self, terms: Sequence[IntegralTerm]) -> Callable[[], FloatArray] | None:
        """A function that integrates terms over this rank's cells of the group, means found before, (terms,).

        None where there are few cells, or terms have other rules than the history; collective, compiles. The function
        is not.
        """
        cell = self._domain.topology.cell_name()
        of_cell = self._test_function(basix.ufl.element("DG", cell, 0, shape=(len(terms),)))
        if self._blocks is None or any(rule != self._rule for _, rule in terms):
            return None
        density = sum(share_parts([density * of_cell[i] for i, (density, _) in enumerate(terms)]))
        codes = [self._codes[0], None, None, self._compiled(density, self._rule)]
        modules = [None if code is None else code.module for code in codes]
        kernels = self._blocks.in_lanes(self._domain.comm, self._tables(self._kernels.weights, codes), modules)
        if kernels is None:
            return None
        blocks, nodes = self._blocks, compat.cell_nodes(self._domain)
        self._codes += codes[3:]  # whose constants are renewed

        def found() -> FloatArray:
            return blocks.totals(self._fields, nodes, self._domain.geometry.x, kernels, count=len(terms))[0]

        return found

    def run(self, forces: FloatArray) -> None:
        """Evaluate for the trial displacement, and add this rank's internal forces; not collective.

        Args:
            forces: (local dofs including ghosts,) N, to which they are added.

        Raises:
            ConvergenceError: at a point Newton's method does not end, or a law returns what is not finite.
            FormulationError: a law returns other shapes than at rest, or raises an error.
        """
        cells = self._group.cells
        if self._blocks is not None:
            cells = self._blocks.run(
                self._fields, compat.cell_nodes(self._domain), self._domain.geometry.x, forces,
                sweeps=_SWEEPS[0], tolerance=_LOCAL,
            )  # fmt: skip
        change = self._pass(self._fields, self._kernels, forces, cells=cells) if len(cells) else 0.0
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
        centre = self._domain.geometry.x[compat.cell_nodes(self._domain)[cell]].mean(axis=0)
        place = ", ".join(f"{x:.4g}" for x in centre)
        state = self._fields.state[cell].reshape(len(self._kernels.weights), -1)[point]
        names = self._group.optional.state_names
        counts = {"": len(state)} if names is None else names(self._group.parameters)
        parts = np.split(state, np.cumsum([*counts.values()])[:-1])
        values = [", ".join(f"{value:.4g}" for value in part) for part in parts]
        history = ", ".join(f"{name} [{part}]".strip() for name, part in zip(counts, values, strict=True))
        return f"point {point} of the cell around ({place}) m, whose history is {history}"

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

    def _pass(
        self, fields: Fields, kernels: Kernels, forces: FloatArray, *, cells: NDArray[np.int32] | None = None
    ) -> float:
        dofmap = self._unknowns.u.function_space.dofmap
        return float(pass_cells(
            self._group.cells if cells is None else cells, compat.cell_nodes(self._domain), self._domain.geometry.x,
            dofmap.list, dofmap.bs, fields, kernels, self._room, forces, _SWEEPS, _LOCAL,
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
        both = basix.ufl.mixed_element([displaced, self._pointwise(update)])
        v, w = ufl.split(self._test_function(both))
        densities = [density for density, _ in work(v)]
        yield self._compiled(sum(share_parts([*densities, self._at_points(update, w)])), self._rule)

    def _at_points(self, values: ufl.core.expr.Expr, w: ufl.core.expr.Expr) -> ufl.core.expr.Expr:
        """A density whose integral has the values at the points times their weights."""
        return ufl.inner(values, w) / abs(ufl.JacobianDeterminant(self._domain))

    def _pointwise(self, values: ufl.core.expr.Expr) -> Any:
        """The element with values of this shape at the points of the rule."""
        return basix.ufl.quadrature_element(
            self._domain.topology.cell_name(),
            value_shape=values.ufl_shape,
            scheme=self._rule.scheme,
            degree=self._rule.degree,
        )

    def _test_function(self, element: Any) -> ufl.Argument:
        return ufl.TestFunction(ufl.FunctionSpace(self._domain.ufl_domain(), element))

    def _compiled(self, density: ufl.core.expr.Expr, rule: Quadrature) -> _CellKernel:
        metadata = {"quadrature_degree": rule.degree, "quadrature_rule": rule.scheme}
        form = density * ufl.dx(domain=self._domain, metadata=metadata)
        address, positions, module = compat.cell_kernel(self._domain.comm, form)
        symbols = list(form.constants())
        coefficients = form.coefficients()
        reads = [coefficients[position] for position in positions]
        return _CellKernel(address, module, symbols, _values(symbols), reads)

    def _tables(self, weights: FloatArray, codes: Sequence[_CellKernel | None]) -> Kernels:
        known, count = self._unknowns, len(codes)
        begins = np.cumsum([0, *self._sizes])
        places = {
            id(field): k for k, field in enumerate((known.u, known.state, known.local, known.mean)) if field is not None
        }
        addresses, constants = np.zeros((2, count), dtype=np.int64)
        starts, lengths = np.zeros((2, count, len(self._sizes)), dtype=np.int64)
        for i, code in enumerate(codes):
            if code is None:
                continue
            addresses[i], constants[i] = code.address, code.constants.ctypes.data
            last = -1
            for k in (places[id(field)] for field in code.reads):
                joined = last >= 0 and begins[k] == starts[i, last] + lengths[i, last]
                last += not joined
                starts[i, last] = starts[i, last] if joined else begins[k]
                lengths[i, last] += self._sizes[k]
        return Kernels(addresses, constants, starts, lengths, np.asarray(weights, dtype=float))


def _values(symbols: Sequence[fem.Constant]) -> FloatArray:
    return np.concatenate([np.zeros(0), *(np.asarray(symbol.value, dtype=float).ravel() for symbol in symbols)])
