"""The lowest modes by SLEPc: Krylov-Schur with shift and invert at zero, and spectrum slicing."""

from __future__ import annotations

from collections.abc import Callable

from petsc4py import PETSc
from slepc4py import SLEPc

import numpy as np

from flexmbd.continuum.matrices.blocks import FloatArray, inner, multiply
from flexmbd.continuum.matrices.eigen import TOLERANCE, BlockOperator, Modes
from flexmbd.errors import ConvergenceError

# How often the basis is doubled to find what was missed, and restarts of one search.
_TIMES, _RESTARTS = 4, 1000
# Modes beside those below an eigenvalue, which show that there are none between.
_BESIDE = 8


class KrylovSchurSearch:
    """A `ModeSearch` by SLEPc's Krylov-Schur method, begun anew with a larger basis where more is asked for.

    Attributes:
        eigenvalues: (k,) ascending, 1/s^2.
        exhausted: whether these are all there are.
    """

    def __init__(
        self,
        solve: BlockOperator,
        stiffness: BlockOperator,
        mass: PETSc.Mat,
        *,
        start: FloatArray,
        size: int,
        prefix: str,
    ) -> None:
        """Nothing is computed yet; not collective.

        Args:
            solve: K^-1 times a block (owned rows, k), collective.
            stiffness: K times a block, collective; read only where the options ask for true residuals.
            mass: M.
            start: (owned rows, b) of which the first is the start vector.
            size: number of modes there are.
            prefix: of PETSc's options.
        """
        self.eigenvalues: FloatArray = np.zeros(0)
        self.exhausted = size == 0
        self._solve, self._stiffness, self._mass, self._prefix = solve, stiffness, mass, prefix
        self._comm = mass.comm.tompi4py()
        self._start, self._size = start, size
        self._shapes: FloatArray = np.zeros((len(start), 0), order="F")
        self._basis: int | None = None

    def find(self, count: int, *, spare: int = 0) -> None:
        """As in `ModeSearch`."""
        requested = min(count + spare, self._size)
        if len(self.eigenvalues) < requested:
            self._take(*self._search(requested))
        if len(self.eigenvalues) < count:
            raise ConvergenceError(
                f"the eigensolver (SLEPc's Krylov-Schur) found {len(self.eigenvalues)} of {count} fixed-interface "
                f"modes to a relative residual of {TOLERANCE:.0e}; take a larger basis, -{self._prefix}eps_ncv, or "
                "fewer modes"
            )

    def find_beyond(self, eigenvalue: float, *, most: int) -> None:
        """As in `ModeSearch`."""
        while not (self.exhausted or np.any(self.eigenvalues > eigenvalue) or self.count_below(eigenvalue) > most):
            self.find(min(2 * len(self.eigenvalues) + _BESIDE, self._size))

    def search_below(self, eigenvalue: float, number: int) -> None:
        """As in `ModeSearch`."""
        basis = 2 * number + _BESIDE
        for time in range(_TIMES):
            if self.count_below(eigenvalue) >= number:
                return
            self._start_anew(time)
            basis *= 2
            self._basis = min(basis, int(self._mass.getSize()[0]))
            self._take(*self._search(min(number + _BESIDE, self._size)))
        if self.count_below(eigenvalue) < number:
            raise ConvergenceError(
                f"the eigensolver (SLEPc's Krylov-Schur) found {self.count_below(eigenvalue)} of the {number} "
                f"fixed-interface modes that are counted below {np.sqrt(eigenvalue) / (2.0 * np.pi):.6g} Hz, with "
                f"{self._basis} basis vectors as well; take eigensolver=BlockMethod()"
            )

    def search_again(self) -> None:
        """As in `ModeSearch`."""
        self._start_anew(_TIMES)
        self._take(*self._search(min(len(self.eigenvalues) + 2, self._size)))

    def _start_anew(self, seed: int) -> None:
        """From a generic vector. Collective."""
        rng = np.random.default_rng((seed, self._comm.rank))
        self._start = np.asfortranarray(self._solve(multiply(self._mass, rng.normal(size=(len(self._start), 1)))))

    def count_below(self, eigenvalue: float) -> int:
        """As in `ModeSearch`."""
        return int(np.sum(self.eigenvalues < eigenvalue))

    def products(self, block: FloatArray, count: int) -> FloatArray:
        """As in `ModeSearch`."""
        return inner(self._comm, block, self._shapes[:, :count])

    def modes(self, count: int) -> Modes:
        """As in `ModeSearch`."""
        return Modes(self.eigenvalues[:count], self._shapes[:, :count].copy(order="F"))

    def _take(self, eigenvalues: FloatArray, shapes: FloatArray) -> None:
        order = np.argsort(eigenvalues, kind="stable")[: self._size]
        self.eigenvalues, self._shapes = eigenvalues[order], np.asfortranarray(shapes[:, order])
        self.exhausted = len(order) == self._size

    def _search(self, count: int) -> tuple[FloatArray, FloatArray]:
        """Eigenvalues and shapes of all pairs that converged. Collective."""
        sizes = self._mass.getSizes()
        operator = PETSc.Mat().createPython(sizes, ShellProduct(self._stiffness), comm=self._mass.comm)
        operator.setUp()
        solver = SLEPc.EPS().create(self._mass.comm)
        first = self._mass.createVecRight()
        try:
            solver.setOperators(operator, self._mass)
            solver.setDimensions(count, self._basis if self._basis is not None else PETSc.DECIDE)
            solver.setTarget(0.0)
            solver.setWhichEigenpairs(SLEPc.EPS.Which.TARGET_MAGNITUDE)
            first.setArray(self._solve(multiply(self._mass, self._start[:, :1]))[:, 0])
            solver.setInitialSpace(first)
            _configure(solver, self._prefix)
            # K^-1 is that of the static shapes, held averages and free bodies included
            inverse = solver.getST().getKSP()
            inverse.setType(PETSc.KSP.Type.PREONLY)
            inverse.getPC().setType(PETSc.PC.Type.PYTHON)
            inverse.getPC().setPythonContext(ShellInverse(self._solve))
            return _solved(solver, self._mass)
        finally:
            for item in (solver, operator, first):
                item.destroy()


class SlicingSearch(KrylovSchurSearch):
    """A `ModeSearch` by SLEPc's spectrum slicing, up to where Krylov-Schur finds as many as are asked for."""

    def __init__(self, matrix: Callable[[], PETSc.Mat], **arguments: object) -> None:
        """As `KrylovSchurSearch`, with what makes K itself."""
        super().__init__(**arguments)  # type: ignore[arg-type]
        self._matrix = matrix

    def _search(self, count: int) -> tuple[FloatArray, FloatArray]:
        more = min(count + _BESIDE, self._size)
        known = np.sort(super()._search(more)[0])[:more]
        if len(known) == self._size:
            return super()._search(self._size)
        high, _ = shift_after(known, min(count, len(known) - 1))
        solver, matrix = SLEPc.EPS().create(self._mass.comm), self._matrix()
        try:
            solver.setOperators(matrix, self._mass)
            solver.setWhichEigenpairs(SLEPc.EPS.Which.ALL)
            # below all there are but rigid motions
            solver.setInterval(0.5 * known[0], high)
            _configure(solver, self._prefix)
            factor = solver.getKrylovSchurKSP()
            factor.setType(PETSc.KSP.Type.PREONLY)
            factor.getPC().setType(PETSc.PC.Type.CHOLESKY)
            factor.getPC().setFactorSolverType(PETSc.Mat.SolverType.MUMPS)
            # set by PETSc's options alone; without it the pivots of the root are not counted
            options, name = PETSc.Options(factor.getOptionsPrefix()), "mat_mumps_icntl_13"
            given = options.hasName(name)
            if not given:
                options[name] = 1
            try:
                return _solved(solver, self._mass)
            finally:
                if not given:
                    options.delValue(name)
        finally:
            solver.destroy()
            matrix.destroy()


def shift_after(eigenvalues: FloatArray, count: int) -> tuple[float, int]:
    """The middle of the widest gap of k ascending eigenvalues after `count` < k of them, and how many lie below."""
    ends = eigenvalues[max(count, 1) - 1 :]
    gap = int((ends[1:] / ends[:-1]).argmax())
    return float(np.sqrt(ends[gap] * ends[gap + 1])), max(count, 1) + gap


class ShellProduct:
    """A matrix by its product with a block."""

    def __init__(self, product: BlockOperator) -> None:
        self._product = product

    def mult(self, _: PETSc.Mat, right: PETSc.Vec, left: PETSc.Vec) -> None:
        """Called by PETSc."""
        left.setArray(self._product(right.array_r[:, None].copy(order="F"))[:, 0])


class ShellInverse:
    """A preconditioner that is the inverse."""

    def __init__(self, solve: BlockOperator) -> None:
        self._solve = solve

    def apply(self, _: PETSc.PC, right: PETSc.Vec, left: PETSc.Vec) -> None:
        """Called by PETSc."""
        left.setArray(self._solve(right.array_r[:, None].copy(order="F"))[:, 0])


def _configure(solver: SLEPc.EPS, prefix: str) -> None:
    solver.setProblemType(SLEPc.EPS.ProblemType.GHEP)
    solver.setType(SLEPc.EPS.Type.KRYLOVSCHUR)
    solver.setTolerances(TOLERANCE, _RESTARTS)
    solver.getST().setType(SLEPc.ST.Type.SINVERT)
    solver.setOptionsPrefix(prefix)
    solver.setFromOptions()
    solver.getST().setType(SLEPc.ST.Type.SINVERT)


def _solved(solver: SLEPc.EPS, mass: PETSc.Mat) -> tuple[FloatArray, FloatArray]:
    """Eigenvalues (k,) and mass-normalised shapes (owned rows, k) of all pairs that converged. Collective."""
    try:
        solver.solve()
    except PETSc.Error as error:
        raise ConvergenceError(
            f"SLEPc's eigensolver failed (PETSc error {error.ierr}); look at the options of the prefix "
            f"{solver.getOptionsPrefix()!r}, or take eigensolver=BlockMethod()"
        ) from error
    vector = mass.createVecRight()
    found = solver.getConverged()
    eigenvalues: FloatArray = np.array([solver.getEigenvalue(i).real for i in range(found)])
    shapes: FloatArray = np.zeros((mass.getLocalSize()[0], found), order="F")
    for i in range(found):
        solver.getEigenvector(i, vector)
        shapes[:, i] = vector.array_r
    vector.destroy()
    lengths = np.diag(inner(mass.comm.tompi4py(), shapes, multiply(mass, shapes)))
    return eigenvalues, np.asfortranarray(shapes / np.sqrt(lengths))
