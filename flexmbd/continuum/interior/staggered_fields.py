"""Unknowns without mass in explicit steps: solved for where the displacement has stepped to, before forces are taken.

    u_n+1 = u_n + h v_n + h^2/2 a_n,    g(u_n+1, z_n+1) = 0,    M a_n+1 = -f(u_n+1, z_n+1)

As z is in balance at each step's end, the nodes move under f(u, z(u)), to the order of central differences, the second.
What the splitting loses is the work of what g is left at: of one correction that was not made, in each step.

The factor of dg/dz is kept; where corrections do not fall to a tenth of each other it is made anew.
"""

from __future__ import annotations

from dataclasses import dataclass

from petsc4py import PETSc

import numpy as np
from dolfinx import fem
from numpy.typing import NDArray

from flexmbd.continuation.newton import Correction, newton
from flexmbd.continuum.history.nonlinear_model import NonlinearModel
from flexmbd.continuum.history.tangent_solver import LinearSolver, TangentSolver
from flexmbd.continuum.interior.further_unknowns import owned_further_dofs
from flexmbd.errors import ConvergenceError, FormulationError

FloatArray = NDArray[np.float64]

# A last correction, as the root of its energy over what the body holds: the square is what a step may lose. Most
# corrections of a step.
_CLOSE, _MOST = 1e-6, 30

# A correction that is not below this part of the one before asks for a factor of its own, which costs some ten.
_SLOW = 0.1


@dataclass(frozen=True, eq=False)
class _FieldTrial:
    """An increment (local dofs including ghosts,), and the forces (owned dofs,) there."""

    increment: FloatArray
    force: FloatArray


class StaggeredFields:
    """The further unknowns of a body that steps explicitly.

    Attributes:
        factorisations, corrections: so far.
        lost: J, work of what was left of their equations.
    """

    def __init__(self, body: NonlinearModel, given: NDArray[np.int32] | None = None) -> None:
        """Nothing is computed yet.

        Args:
            body: with unknowns beside the displacement, without mass.
            given: owned dofs of these that somebody else moves.

        Raises:
            FormulationError: it has springs on facets.
        """
        if body.holds_places:
            raise FormulationError(
                f"{body.form_name} has springs on facets and unknowns besides the displacement, which together do not "
                "step explicitly; take ImplicitContinuum, or load the body slowly (follow)"
            )
        held = np.zeros(0, dtype=np.int32) if given is None else given
        if body.conditions is not None:
            held = np.union1d(held, np.flatnonzero(body.conditions.held))
        self._body, self.rows = body, np.setdiff1d(owned_further_dofs(body), held)
        self._displaced = body.displacement_dofs[: body.layout.n_owned_nodes].reshape(-1)
        self._linear = TangentSolver(body, np.union1d(self._displaced, held).astype(np.int32), LinearSolver())
        self._own: PETSc.Mat | None = None  # of the further unknowns alone, by which sizes are measured
        self._ghosted = fem.Function(body.space).x
        self.corrections, self.lost = 0, 0.0

    @property
    def factorisations(self) -> int:
        """So far."""
        return self._linear.factorisations

    def forget(self) -> None:
        """Forget the factor, as at a checkpoint."""
        if self._own is not None:
            self._own.destroy()
            self._own = None
        self._linear.discard_preconditioner()

    def balanced(self, increment: FloatArray, *, dt: float) -> tuple[FloatArray, FloatArray]:
        """The body with its displacements as they are given and its further unknowns in balance. Collective.

        Args:
            increment: (local dofs including ghosts,) m; what it has of further unknowns is where they begin.
            dt: s.

        Returns:
            The increment with the further unknowns; (owned dofs,) the forces there.

        Raises:
            ConvergenceError: on all ranks: as `NonlinearModel.force`, or the further unknowns are not found.
        """
        problem = _FieldBalance(self, dt)
        found = newton(problem, problem.at(increment), most=_MOST, close=_CLOSE)
        if not found.is_solution:
            raise ConvergenceError(
                f"the unknowns of {self._body.form_name} besides the displacement were not found where that has "
                f"stepped to, in {found.iterations} corrections; take a shorter step"
            )
        return found.place.increment, found.place.force

    def step(self, increment: FloatArray, *, dt: float) -> FloatArray:
        """As `balanced`, accepted: the forces (owned dofs,). Collective."""
        whole, force = self.balanced(increment, dt=dt)
        self._body.commit(whole, dt=dt)
        self.lost += float(self._body.comm.allreduce(float(force[self.rows] @ whole[self.rows])))
        return force

    def solved(self, trial: _FieldTrial, before: float, *, dt: float) -> Correction[FloatArray]:
        """The correction (owned dofs,) at a trial, where the last one had the size `before`. Collective."""
        if self._own is None:
            self._factor(trial.increment, dt)
        found = self._correction(trial)
        if found.size > max(_SLOW * before, _CLOSE * found.scale):
            self._factor(trial.increment, dt)
            found = self._correction(trial)
        return found

    def forces(self, increment: FloatArray, *, dt: float) -> FloatArray:
        """(owned dofs,) the body's. Collective."""
        return self._body.force(increment, dt=dt)

    def moved(self, increment: FloatArray, change: FloatArray) -> FloatArray:
        """(local dofs,) an increment with a change (owned dofs,). Collective."""
        self._ghosted.array[:] = increment
        self._ghosted.array[: self._body.n_owned] += change
        self._ghosted.scatter_forward()
        return np.asarray(self._ghosted.array.copy())

    def _correction(self, trial: _FieldTrial) -> Correction[FloatArray]:
        """Sizes are roots of energies: those of the further unknowns and of the displacement are what a body holds."""
        body, rows, load = self._body, self.rows, np.zeros(self._body.n_owned)
        load[rows] = -trial.force[rows]
        change = self._linear.solve_factored(load)
        self.corrections += 1
        if not all(body.comm.allgather(bool(np.isfinite(change).all()))):
            raise ConvergenceError(
                f"the unknowns of {body.form_name} besides the displacement are not determined by it: the tangent of "
                "their own equations is singular"
            )
        total = body.displacement[: body.n_owned] + trial.increment[: body.n_owned]
        further = total[rows] + change[rows]
        right, image = self._own.createVecs()  # type: ignore[union-attr]
        right.array[:] = further
        self._own.mult(right, image)  # type: ignore[union-attr]
        of_change, of_displacement = change[rows] @ load[rows], total[self._displaced] @ trial.force[self._displaced]
        energies = abs(body.comm.allreduce(np.array([of_change, of_displacement, further @ image.array_r])))
        return Correction(change, float(np.sqrt(energies[0])), scale=float(np.sqrt(energies[1] + energies[2])))

    def _factor(self, increment: FloatArray, dt: float) -> None:
        """Of the tangent at an increment. Collective."""
        matrix = self._body.tangent(increment, dt=dt)
        if self._own is not None:
            self._own.destroy()
        rows = (self.rows + matrix.getOwnershipRange()[0]).astype(PETSc.IntType)
        which = PETSc.IS().createGeneral(rows, comm=self._body.comm)
        self._own = matrix.createSubMatrix(which, which)
        which.destroy()
        self._linear.constrain(matrix)
        self._linear.renew_preconditioner()
        self._linear.set_operator(matrix)


class _FieldBalance:
    """The further unknowns at given displacements, as a problem for Newton's method."""

    def __init__(self, fields: StaggeredFields, dt: float) -> None:
        self._fields, self._dt, self._before = fields, dt, np.inf

    def at(self, increment: FloatArray) -> _FieldTrial:
        return _FieldTrial(increment, self._fields.forces(increment, dt=self._dt))

    def is_solved(self, here: _FieldTrial, *, close: bool) -> bool:
        return close

    def correction(self, here: _FieldTrial) -> Correction[FloatArray]:
        found = self._fields.solved(here, self._before, dt=self._dt)
        self._before = found.size
        return found

    def moved(self, here: _FieldTrial, correction: Correction[FloatArray], *, close: bool) -> _FieldTrial:
        return here if close else self.at(self._fields.moved(here.increment, correction.change))
