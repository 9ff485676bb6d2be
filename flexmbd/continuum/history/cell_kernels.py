"""The kernels that FFCx makes of a group's forms, and where in a cell's row of values they find what they read.

Forces and history are the two parts of one form on a mixed space of test functions, the displacement's and one that has
its values at the points of the rule: FFCx makes one kernel of it, that does for both what they have in common.
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
from flexmbd.continuum.contract.point_law import PointLaw
from flexmbd.continuum.history.point_loop import Kernels
from flexmbd.continuum.history.shared_parts import share_parts

FloatArray = NDArray[np.float64]


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
        work: virtual work of a test function of the displacement, as terms of any rules; those with history of one.
        update: history at the step's end.
        equations: of the local unknowns, (n + n n,): what they make zero, and its derivatives by them, row by row.
        averaged: what the means are of.
    """

    work: Callable[[Any], Sequence[IntegralTerm]]
    update: ufl.core.expr.Expr | None
    equations: ufl.core.expr.Expr | None
    averaged: ufl.core.expr.Expr | None


@dataclass(frozen=True, eq=False)
class CellKernel:
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


class CellCompiler:
    """Compiles the kernels of one group; each compilation is collective."""

    def __init__(self, unknowns: Unknowns, rule: Quadrature) -> None:
        """Not collective.

        Args:
            unknowns: the functions that the forms read.
            rule: at whose points history and local unknowns lie.
        """
        self._unknowns, self._rule = unknowns, rule
        self._domain = unknowns.u.function_space.mesh

    def mean(self, averaged: ufl.core.expr.Expr | None) -> CellKernel | None:
        """That of the means, which integrates what they are of and the measure of the cell."""
        if averaged is None:
            return None
        w = self._test_function(basix.ufl.element("DG", self._domain.topology.cell_name(), 0, shape=(2,)))
        return self._compiled(averaged * w[0] + w[1], self._rule)

    def equations(self, equations: ufl.core.expr.Expr | None) -> CellKernel | None:
        """That of the equations of the local unknowns."""
        if equations is None:
            return None
        return self._compiled(self._at_points(equations, self._test_function(self._pointwise(equations))), self._rule)

    def step(
        self, work: Callable[[Any], Sequence[IntegralTerm]], update: ufl.core.expr.Expr | None
    ) -> Iterator[CellKernel | None]:
        """Those of forces, and of the history with them."""
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
        yield self._compiled(sum([*densities, self._at_points(update, w)]), self._rule)

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

    def _compiled(self, density: ufl.core.expr.Expr, rule: Quadrature) -> CellKernel:
        metadata = quadrature.metadata(self._domain.topology.cell_name(), rule)
        (shared,) = share_parts([density])
        form = shared * ufl.dx(domain=self._domain, metadata=metadata)
        address, positions, module = compat.cell_kernel(self._domain.comm, form)
        symbols = list(form.constants())
        coefficients = form.coefficients()
        reads = [coefficients[position] for position in positions]
        return CellKernel(address, module, symbols, values_of(symbols), reads)

    def totals(self, terms: Sequence[IntegralTerm]) -> list[CellKernel]:
        """Those of the integrals of terms over a cell, (terms,), one for each rule."""
        element = basix.ufl.element("DG", self._domain.topology.cell_name(), 0, shape=(len(terms),))
        of_cell = self._test_function(element)
        found: dict[tuple[int, str], tuple[Any, Quadrature]] = {}
        for i, (density, rule) in enumerate(terms):
            before, _ = found.get((rule.degree, rule.scheme), (0, rule))
            found[rule.degree, rule.scheme] = before + density * of_cell[i], rule
        return [self._compiled(density, rule) for density, rule in found.values()]

    def tables(self, codes: Sequence[CellKernel | None], sizes: Sequence[int], *, weights: FloatArray) -> Kernels:
        """What the compiled loops are told of kernels.

        Args:
            codes: in the order of `Kernels`.
            sizes: numbers of a cell's unknown, history, temperatures, local unknowns and mean in its row.
            weights: of the rule's points.
        """
        known, count = self._unknowns, len(codes)
        pieces = [known.u, known.state, known.temperature, known.local, known.mean]
        begins = np.cumsum([0, *sizes])
        places = {id(field): k for k, field in enumerate(pieces) if field is not None}
        addresses, constants = np.zeros((2, count), dtype=np.int64)
        starts, lengths = np.zeros((2, count, len(sizes)), dtype=np.int64)
        for i, code in enumerate(codes):
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


def values_of(symbols: Sequence[fem.Constant]) -> FloatArray:
    """The values that constants have now, one after the other."""
    return np.concatenate([np.zeros(0), *(np.asarray(symbol.value, dtype=float).ravel() for symbol in symbols)])
