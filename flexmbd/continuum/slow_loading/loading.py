"""What loads a body slowly: given displacements and forces as functions of the load parameter, and the balance."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from petsc4py import PETSc

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.history.applied_loads import AppliedLoads, TrialLoads
from flexmbd.continuum.history.displacement_newton import Balance
from flexmbd.continuum.history.nonlinear_model import NonlinearModel

FloatArray = NDArray[np.float64]
LoadPath = Callable[[float], FloatArray]


@dataclass(frozen=True, eq=False)
class SlowLoads:
    """The loads of one body over a load parameter.

    Attributes:
        body: the body.
        prescribed: owned dofs whose displacement is given.
        displacement: (prescribed dofs,) m, from the undeformed body, at a load parameter; zero if None.
        load: (owned dofs,) N, dead loads in body axes; none if None.
        applied: further ones.
    """

    body: NonlinearModel
    prescribed: NDArray[np.int32]
    displacement: LoadPath | None
    load: LoadPath | None
    applied: AppliedLoads

    def given(self, t: float) -> FloatArray:
        """(prescribed dofs,) m, from the undeformed body."""
        return np.zeros(len(self.prescribed)) if self.displacement is None else self.displacement(t)

    def outer(self, t: float) -> TrialLoads:
        """The forces at a load parameter. Collective."""
        dead = np.zeros(self.body.n_owned) if self.load is None else self.load(t)
        values = self.applied.values(t)
        if self.applied.any:
            dead = dead + self.applied.dead(values, np.eye(3)).reshape(-1)
        return TrialLoads(self.body, self.applied, values, dead)

    def balance(self, outer: TrialLoads, increment: FloatArray, *, dt: float = 0.0, least: float = 0.0) -> Balance:
        """What is out of balance at a trial displacement after dt (s). Collective.

        ``least``: N, that the forces at hand are taken to have at least.

        Raises:
            ConvergenceError: as `NonlinearModel.force`.
        """
        internal = self.body.force(increment, dt=dt)
        if self.body.is_updated:
            # a cell that is inside out may have finite forces
            self.body.check_cells()
        external = outer.force(increment)
        residual = internal - external
        # reactions and loads are what balances; at rest nothing does
        size = max(least, self.body.norm(external), self.body.norm(residual[self.prescribed]))
        return Balance(residual, size if size > 0.0 else self.body.norm(internal))

    def tangent(
        self, outer: TrialLoads, increment: FloatArray, *, dt: float = 0.0, predicted: bool = False
    ) -> PETSc.Mat:
        """Its derivative, as of `NonlinearModel.tangent`. Collective."""
        return outer.subtract_slopes(self.body.tangent(increment, dt=dt, predicted=predicted), increment)
