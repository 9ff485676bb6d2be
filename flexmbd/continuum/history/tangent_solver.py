"""The linear systems of Newton's method: Krylov iterations, preconditioned by a factor or by multigrid.

A factor (MUMPS) costs some twenty times an iteration, and plastic tangents change little: an older factor serves as
long as few iterations are needed.  Where a factor would not fit in memory multigrid takes its place.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from functools import cached_property

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.history.nonlinear_model import NonlinearModel
from flexmbd.continuum.matrices.blocks import from_dense, inner, to_dense
from flexmbd.continuum.matrices.near_null_space import near_null_space
from flexmbd.continuum.matrices.saddle_point import negative_directions
from flexmbd.errors import ConvergenceError, FormulationError
from flexmbd.given import checked
from flexmbd.round_off import EQUAL

FloatArray = NDArray[np.float64]


# Krylov's method: most iterations, and the relative residual to which the systems of a block are solved.
_MAX_ITERATIONS, _EXACT = 200, 1e-12

# Part of a residual, with too much energy left, at which the energy is looked at again.
_NEXT_LOOK = 0.1

# MUMPS: controls of the last part of a factor and of the determinant; where negative pivots and its sign are told.
_ROOT, _DETERMINES, _NEGATIVE, _DETERMINANT = 13, 33, 12, 12

# Couplings weaker than this, relative to the diagonal, do not join two nodes to one aggregate.
_THRESHOLD, _PREFIX = 0.02, "flexmbd_newton_"


class Preconditioner(Enum):
    """The preconditioner of Krylov's method.

    Attributes:
        FACTOR: MUMPS' factor of a tangent, this one or an older one.
        MULTIGRID: smoothed aggregation (GAMG) that knows the body's rigid motions; memory in proportion to the dofs,
            for solids alone.
    """

    FACTOR = "factor"
    MULTIGRID = "multigrid"


@checked()
@dataclass(frozen=True)
class LinearSolver:
    """How the linear systems of Newton's method are solved.

    Attributes:
        max_iterations: after a solution that took more Krylov iterations the next tangent is
            factorised, or coarsened, anew; 0: every tangent is.
        reuse_below: a tangent is used for the next step too where the last one left less than this part of
            the residual; 0: every step has its own, and Newton's method is quadratic.
        forcing_term: largest relative error of a linear system's solution, by its residual and by its energy, which
            sees where a slender body bends beside what stretches it; the closer Newton's method comes, the smaller, so
            that it stays quadratic (Eisenstat & Walker 1996, doi:10.1137/0917003).
        preconditioner: of Krylov's method.
    """

    max_iterations: int = 12
    reuse_below: float = 0.0
    forcing_term: float = 1e-2
    preconditioner: Preconditioner = Preconditioner.FACTOR


DEFAULT_SOLVER = LinearSolver()


class TangentSolver:
    """Solves with one tangent of a body after the other, keeping the preconditioner.

    Attributes:
        factorisations: so far; with multigrid, how often a tangent was coarsened.
        iterations: of Krylov's method so far.
    """

    def __init__(
        self,
        body: NonlinearModel,
        prescribed: NDArray[np.int32],
        settings: LinearSolver,
        *,
        counts: bool = False,
    ) -> None:
        """Nothing is computed yet.

        Args:
            body: whose tangents they are.
            prescribed: owned dofs whose displacement is given.
            settings: of the solver.
            counts: whether `negative_pivots` and `sign` are wanted of its factors.

        Raises:
            FormulationError: multigrid is asked for, and there are unknowns besides the displacement.
        """
        self._uses_multigrid = settings.preconditioner is Preconditioner.MULTIGRID
        if self._uses_multigrid and body.layout.has_further:
            raise FormulationError(
                f"{body.groups[0].form_name} has unknowns besides the displacement, which multigrid cannot treat; take "
                "Preconditioner.FACTOR"
            )
        self._body, self._settings, self._counts = body, settings, counts
        self._prescribed = np.union1d(prescribed, body.held_dofs).astype(np.int32)
        self._first = body.space.dofmap.index_map.local_range[0] * body.space.dofmap.index_map_bs
        self._ksp: PETSc.KSP | None = None
        self._preconditioning_matrix = PETSc.Mat()  # what the preconditioner was made of
        self._stale = True
        self._is_symmetric = self._is_own = False
        self.factorisations = self.iterations = 0

    @property
    def comm(self) -> MPI.Comm:
        """Of the body."""
        return self._body.comm

    @property
    def is_symmetric(self) -> bool:
        """Whether the tangent is that was factorised last."""
        return self._is_symmetric

    @property
    def negative_pivots(self) -> int:
        """How many negative eigenvalues the tangent has that was factorised last; of a symmetric one."""
        return int(self._current_ksp().getPC().getFactorMatrix().getMumpsInfog(_NEGATIVE))

    def negative_pivots_but_of(self, mask: NDArray[np.bool_]) -> int:
        """Those of a symmetric tangent that it does not owe to the unknowns of a mask (owned dofs,). Collective."""
        return self.negative_pivots - negative_directions(self._preconditioning_matrix, mask)

    @property
    def sign(self) -> float:
        """Of the determinant of the tangent that was factorised last."""
        if self._is_symmetric:
            return -1.0 if self.negative_pivots % 2 else 1.0
        return float(np.sign(self._current_ksp().getPC().getFactorMatrix().getMumpsRinfog(_DETERMINANT)))

    def renew_preconditioner(self) -> None:
        """Make the preconditioner of the next tangent; of a factor the order of elimination is kept."""
        self._stale = True

    def discard_preconditioner(self) -> None:
        """Forget all that older tangents left, as at a checkpoint."""
        if self._ksp is not None:
            self._ksp.destroy()
            self._preconditioning_matrix.destroy()
        self._ksp, self._stale = None, True

    def constrain(self, matrix: PETSc.Mat) -> None:
        """Make rows and columns of prescribed dofs those of the unit matrix. Collective."""
        matrix.setOption(PETSc.Mat.Option.KEEP_NONZERO_PATTERN, True)
        matrix.zeroRowsColumns((self._prescribed + self._first).astype(PETSc.IntType), diag=1.0)

    def set_operator(self, matrix: PETSc.Mat) -> None:
        """Solve with this tangent from now on; prescribed dofs are constrained in it already. Collective."""
        if self._ksp is None or self._stale or self._settings.max_iterations == 0:
            if self._ksp is None or not self._factored_anew(self._ksp, matrix):
                self.discard_preconditioner()
                self._preconditioning_matrix = matrix.copy()
                self._ksp = self._new_ksp(matrix, self._preconditioning_matrix)
            self.factorisations += 1
            self._stale = False
            self._is_own = not self._uses_multigrid
        else:
            self._is_own = False
            self._ksp.setOperators(matrix, self._preconditioning_matrix)

    def solve(self, load: FloatArray, tolerance: float) -> FloatArray:
        """(owned dofs,) m, for a load (owned dofs,). Collective.

        Args:
            load: (owned dofs,) N.
            tolerance: largest error of the solution over it, by its residual and, unless the factor is the tangent's
                own, by its energy.

        Raises:
            ConvergenceError: on all ranks: it takes too many iterations.
        """
        ksp = self._current_ksp()
        right, left = ksp.getOperators()[0].createVecs()
        right.setArray(load)
        ksp.setTolerances(rtol=max(tolerance, _EXACT), atol=0.0, max_it=_MAX_ITERATIONS)
        ksp.setConvergenceTest(_Accuracy(by_energy=not self._is_own))
        ksp.solve(right, left)
        iterations = ksp.getIterationNumber()
        self.iterations += iterations
        self._stale = iterations > self._settings.max_iterations
        if ksp.getConvergedReason() < 0:
            self._stale = True
            if not self._is_own and not self._uses_multigrid:  # an old factor is no help any more
                self.set_operator(ksp.getOperators()[0])
                return self.solve(load, tolerance)
            remedy = "take a smaller step" + (", or Preconditioner.FACTOR" if self._uses_multigrid else "")
            raise ConvergenceError(
                f"the linear system of a Newton step was not solved ({iterations} iterations); {remedy}"
            )
        return np.asarray(left.array_r.copy())

    def solve_block(self, block: FloatArray) -> FloatArray:
        """The inverse times a block (owned dofs, k), zero at prescribed dofs. Collective.

        Right after a `set_operator` that made a new preconditioner. Rows of prescribed dofs are not read.

        Raises:
            ConvergenceError: as `solve`.
        """
        free = block.copy()
        free[self._prescribed] = 0.0
        if self._uses_multigrid:
            columns = [self.solve(column, _EXACT) for column in free.T]
            return np.stack(columns, axis=1) if columns else free
        right = to_dense(self._body.comm, free)
        left = right.duplicate()
        self._current_ksp().getPC().getFactorMatrix().matSolve(right, left)
        solution = from_dense(left)
        left.destroy()
        right.destroy()
        return solution

    def solve_factored(self, load: FloatArray) -> FloatArray:
        """As `solve_block`, for one load (owned dofs,). Collective."""
        if self._uses_multigrid:
            return self.solve_block(load[:, None])[:, 0]
        right, left = self._factored_vectors
        right.array[:] = load
        right.array[self._prescribed] = 0.0
        self._current_ksp().getPC().getFactorMatrix().solve(right, left)
        return np.asarray(left.array_r.copy())

    @cached_property
    def _factored_vectors(self) -> tuple[PETSc.Vec, PETSc.Vec]:
        right, left = self._preconditioning_matrix.createVecs()
        return right, left

    def _current_ksp(self) -> PETSc.KSP:
        if self._ksp is None:
            raise ConvergenceError("there is no linear system to solve before the first tangent")
        return self._ksp

    def _factored_anew(self, ksp: PETSc.KSP, matrix: PETSc.Mat) -> bool:
        """Factor a matrix in the order of the one before; False where it needs another kind of factor. Collective."""
        kept = self._preconditioning_matrix
        if self._uses_multigrid or is_symmetric(matrix) != self._is_symmetric:
            return False
        matrix.copy(kept, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
        ksp.getPC().setReusePreconditioner(False)
        ksp.setOperators(matrix, kept)
        ksp.setUp()
        ksp.getPC().setReusePreconditioner(True)
        return True

    def _new_ksp(self, matrix: PETSc.Mat, preconditioning_matrix: PETSc.Mat) -> PETSc.KSP:
        """Krylov's method on a matrix, preconditioned by a copy of it that is kept. Collective."""
        ksp = PETSc.KSP().create(matrix.comm)
        ksp.setType(PETSc.KSP.Type.GMRES)
        ksp.setPCSide(PETSc.PC.Side.RIGHT)
        ksp.setGMRESRestart(100)  # slender bodies by multigrid take some 70
        ksp.setOperators(matrix, preconditioning_matrix)
        if self._uses_multigrid:
            self._set_up_multigrid(ksp, preconditioning_matrix)
        else:
            self._is_symmetric = symmetric = is_symmetric(matrix)
            preconditioning_matrix.setOption(PETSc.Mat.Option.SYMMETRIC, symmetric)
            ksp.getPC().setType(PETSc.PC.Type.CHOLESKY if symmetric else PETSc.PC.Type.LU)
            ksp.getPC().setFactorSolverType(PETSc.Mat.SolverType.MUMPS)
            if self._counts:
                ksp.getPC().setFactorSetUpSolverType()
                # pivots are counted only where ScaLAPACK does not take over the last part
                ksp.getPC().getFactorMatrix().setMumpsIcntl(_ROOT if symmetric else _DETERMINES, 1)
            ksp.setUp()
        ksp.getPC().setReusePreconditioner(True)
        return ksp

    def _set_up_multigrid(self, ksp: PETSc.KSP, matrix: PETSc.Mat) -> None:
        """Make the levels of multigrid, with the rigid motions from where the body stands. Collective."""
        layout, n = self._body.layout, self._body.layout.n_owned_nodes
        x = (layout.node_x + self._body.displacement.reshape(-1, 3))[:n]
        nodal = np.zeros((n, 3, 6))
        nodal[:, :, :3] = np.eye(3)
        for axis, turn in enumerate(np.eye(3)):
            nodal[:, :, 3 + axis] = np.cross(turn, x)
        motions: FloatArray = nodal.reshape(-1, 6)
        motions[self._prescribed] = 0.0
        # a direction in which all dofs are prescribed, as in plane strain, has no rigid motion
        near, vectors = near_null_space(matrix, motions[:, np.diag(inner(self._body.comm, motions, motions)) > 0.0])
        matrix.setNearNullSpace(near)
        options = PETSc.Options(_PREFIX)  # PETSc sets this by its options alone
        options["pc_gamg_threshold"] = _THRESHOLD
        ksp.setOptionsPrefix(_PREFIX)
        ksp.getPC().setType(PETSc.PC.Type.GAMG)
        ksp.getPC().setFromOptions()
        options.delValue("pc_gamg_threshold")
        ksp.setUp()
        for item in (near, *vectors):
            item.destroy()


class _Accuracy:
    """Whether residual and energy of the error, r.P r by the preconditioner P, are small enough, as PETSc asks.

    Of forces of one size those that bend a slender body have the most energy, by the square of its slenderness.
    """

    def __init__(self, *, by_energy: bool) -> None:
        """``by_energy``: whether it is asked for as well."""
        self._by_energy = by_energy
        self._size = 0.0  # N, of the load
        self._look_at = 0.0  # N, residual at which the energy is looked at

    def __call__(self, ksp: PETSc.KSP, iteration: int, residual: float) -> int:
        """A reason to end, or 0."""
        if not np.isfinite(residual):
            return int(PETSc.KSP.ConvergedReason.DIVERGED_NANORINF)
        rtol = ksp.getTolerances()[0]
        if iteration == 0:
            self._size, self._look_at = residual, rtol * residual
        if residual > self._look_at:
            return 0
        if self._by_energy and residual > _EXACT * self._size:
            error = _relative_energy(ksp) ** 0.5
            if error > rtol:
                self._look_at = residual * max(rtol / error, _NEXT_LOOK)
                return 0
        return int(PETSc.KSP.ConvergedReason.CONVERGED_RTOL)


def _relative_energy(ksp: PETSc.KSP) -> float:
    """Of the error of the solution at hand, over its own. Collective."""
    left = ksp.buildResidual()
    error = left.duplicate()
    ksp.getPC().apply(left, error)
    whole = abs(ksp.getRhs().dot(ksp.buildSolution()))
    return abs(left.dot(error)) / whole if whole > 0.0 else np.inf


def is_symmetric(matrix: PETSc.Mat) -> bool:
    """Whether a matrix is symmetric up to round-off. Collective."""
    x, y = matrix.createVecRight(), matrix.createVecRight()
    first, last = x.getOwnershipRange()
    # the same vectors on any number of ranks
    x.array[:] = np.sin(1.0 + 7.0 * np.arange(first, last))
    y.array[:] = np.cos(2.0 + 3.0 * np.arange(first, last))
    ay = matrix.createVecLeft()
    matrix.mult(y, ay)
    one, size = x.dot(ay), ay.norm() * x.norm()
    matrix.mult(x, ay)
    return bool(abs(one - y.dot(ay)) <= EQUAL * size)
