"""One pass over a group's cells: means, local unknowns, internal forces, and the history at the step's end.

DOLFINx would take a pass for each, in which it collects the same values of the cell, and each kernel would find
strain and stress again. The cells of large bodies are evaluated in blocks, in the lanes of vector registers.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum import compat
from flexmbd.continuum.contract.formulation import IntegralTerm, Quadrature
from flexmbd.continuum.contract.point_law import FAULTS, WRITING_FAULTS
from flexmbd.continuum.finite_elements.cell_group import CellGroup
from flexmbd.continuum.history.cell_fields_solved import CellFieldsSolved, no_cell_fields
from flexmbd.continuum.history.cell_kernels import CellCompiler, CellForms, CellKernel, LawCall, Unknowns, values_of
from flexmbd.continuum.history.cell_loop import pass_cells
from flexmbd.continuum.history.lane_pass import lane_pass
from flexmbd.continuum.history.point_loop import FORCES, Fields, Kernels, Room
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
        self._group, self._unknowns = group, unknowns
        self._law: CellKernel | None = None
        if law is not None:
            self._law = CellKernel(law.law.address, law.law.keep, [*law.symbols], values_of(law.symbols), [])
        self._domain = unknowns.u.function_space.mesh
        self._compiler = CellCompiler(unknowns, rule)
        self._codes = [
            self._compiler.mean(forms.averaged),
            self._compiler.equations(forms.equations),
            self._law,
            *self._compiler.step(forms.work, forms.update),
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
        own, warm = state.shape[1], given.shape[1] - state.shape[1]
        self._sizes = [dofmap.bs * dofmap.list.shape[1], own, warm, local.shape[1], 1]
        self._kernels = self._compiler.tables(self._codes, self._sizes, weights=weights)
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
        shared = unknowns.shared.function_space.dofmap
        self._blocks = lane_pass(
            self._domain.comm, group.cells, blocks=shared.list, width=shared.bs, kernels=self._kernels,
            room=self._room, inner=self._inner,
            modules=_modules(code if code is not self._law else None for code in self._codes),
        )  # fmt: skip

    def share(self, threads: int) -> None:
        """Share the cells of later passes among threads; not collective."""
        if self._blocks is not None:
            self._blocks.threads = threads

    def totals(self, terms: Sequence[IntegralTerm]) -> Callable[[], FloatArray] | None:
        """A function that finds the means and integrates terms over this rank's cells of the group, (terms,).

        They are of the accepted history, and of the accepted fields of one cell. None where there is little to do.
        Collective, compiles; calls of the function are not collective.
        """
        if self._blocks is None:
            return None
        further = self._compiler.totals(terms)
        codes = [self._codes[0], None, None, *further]
        kernels = self._compiler.tables(codes, self._sizes, weights=self._kernels.weights)
        wide = self._blocks.in_lanes(self._domain.comm, kernels, _modules(codes))
        if wide is None:
            return None
        blocks, nodes, used = self._blocks, compat.cell_nodes(self._domain), wide
        own = self._inner.values if self._solved is None else self._solved.accepted
        self._codes += further  # whose constants are renewed

        def found() -> FloatArray:
            self._take_known()
            return blocks.totals(self._fields, own, nodes, self._domain.geometry.x, used, count=len(terms))

        return found

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
        cells = self._group.cells
        if self._blocks is not None:
            self._take_known()
            cells = self._blocks.run(
                self._fields, compat.cell_nodes(self._domain), self._domain.geometry.x, forces,
                sweeps=_SWEEPS[0], tolerance=_LOCAL, accuracy=accuracy,
            )  # fmt: skip
        if len(cells):
            self._check(self._pass(self._fields, self._kernels, forces, accuracy=accuracy, cells=cells))
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
                code.constants[:] = values_of(code.symbols)

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

    def _take_known(self) -> None:
        """Put temperatures behind the history of each cell, as a part of what is known at the step's begin."""
        if self._unknowns.temperature is not None:
            columns = self._known.shape[1]
            self._fields.state[:, :columns] = self._known
            self._fields.state[:, columns:] = self._warmth()

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
        self._take_known()
        dofmap = self._unknowns.shared.function_space.dofmap
        return float(pass_cells(
            self._group.cells if cells is None else cells, compat.cell_nodes(self._domain), self._domain.geometry.x,
            dofmap.list, dofmap.bs, fields, kernels, self._room, self._inner, forces, _SWEEPS, _LOCAL, accuracy,
            int(predicts),
        ))  # fmt: skip


def _modules(codes: Iterable[CellKernel | None]) -> list[Any]:
    """What FFCx made of each, None for those that are none of its."""
    return [None if code is None else code.module for code in codes]
