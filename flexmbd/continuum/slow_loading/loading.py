"""The slow loading of a body: given displacements and forces as functions of the load parameter, and the balance."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from petsc4py import PETSc

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum import parallel
from flexmbd.continuum.history.applied_loads import AppliedLoads, TrialLoads
from flexmbd.continuum.history.displacement_newton import Balance
from flexmbd.continuum.history.nonlinear_model import HistorySnapshot, NonlinearModel
from flexmbd.errors import FormulationError
from flexmbd.given import numbers
from flexmbd.round_off import SEVEN_DIGITS

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

    Raises:
        FormulationError: on all ranks: `prescribed` is no array of owned dofs, each once; at a load parameter a
            displacement or a load of another shape, or one that is not finite; a displacement that moves a plane body
            out of its plane.
    """

    body: NonlinearModel
    prescribed: NDArray[np.int32]
    displacement: LoadPath | None
    load: LoadPath | None
    applied: AppliedLoads

    def __post_init__(self) -> None:
        self._agree(self._fault_of_prescribed())
        ties = self.body.ties
        if ties is not None:
            held = np.zeros(self.body.n_owned, dtype=bool)
            held[self.prescribed] = True
            ties.refuse_held(held.reshape(-1, 3), by="prescribed dofs", kind=FormulationError)

    @property
    def is_held(self) -> NDArray[np.bool_]:
        """(owned nodes, 3) the components whose displacement is given."""
        held = np.zeros(self.body.n_owned, dtype=bool)
        held[self.prescribed] = True
        return np.asarray(held[self.body.layout.displacement_dofs[: self.body.layout.n_owned_nodes]])

    def given(self, t: float) -> FloatArray:
        """(prescribed dofs,) m, from the undeformed body. Collective."""
        n = len(self.prescribed)
        if self.displacement is None:
            return np.zeros(n)
        found = self._answer("displacement", self.displacement, t, n)
        self._refuse_torn(found, t)
        if self.body.plane_axis is not None:
            across = np.isin(self.prescribed, self.body.held_dofs)
            leaves = abs(found[across]).max(initial=0.0) > SEVEN_DIGITS * self._largest(found)
            self._agree(f"displacement moves nodes out of the plane of the body at {t:g}" if leaves else "")
            found = np.where(across, 0.0, found)  # what a rotation rounds
        return found

    def _refuse_torn(self, given: FloatArray, t: float) -> None:
        """Refuse displacements (prescribed dofs,) m that pull a weld apart. Collective."""
        if self.body.ties is None:
            return
        whole = np.zeros(self.body.n_owned)
        whole[self.prescribed] = given
        off = abs(self.body.complete(whole.copy()) - whole)[np.intersect1d(self.prescribed, self.body.ties.dofs)]
        torn = off.max(initial=0.0) > SEVEN_DIGITS * self._largest(given)
        self._agree(
            f"displacement moves nodes of a weld by {off.max():.4g} m away from the facets that they follow, at {t:g}; "
            "give both sides one motion" if torn else ""
        )

    def _largest(self, given: FloatArray) -> float:
        """m, of displacements (prescribed dofs,), without regard to signs. Collective."""
        return max(self.body.comm.allgather(float(abs(given).max(initial=0.0))))

    def outer(self, t: float) -> TrialLoads:
        """The forces at a load parameter. Collective."""
        n = self.body.n_owned
        dead = np.zeros(n) if self.load is None else self.body.condense(self._answer("load", self.load, t, n).copy())
        values = self.applied.values(t)
        if self.applied.any:
            dead = dead + self.body.layout.at_dofs(self.applied.dead(values, np.eye(3)), owned=True)
        return TrialLoads(self.body, self.applied, values, dead)

    def balance(self, outer: TrialLoads, increment: FloatArray, *, dt: float = 0.0, least: float = 0.0) -> Balance:
        """The residual at a trial displacement after dt (s). Collective.

        ``least``: N, that the forces at hand are taken to have at least.

        Raises:
            ConvergenceError: as `NonlinearModel.force`.
        """
        outer.set_given_fields()
        internal = self.body.force(increment, dt=dt)
        if self.body.is_updated:
            # a cell that is inside out may have finite forces
            self.body.check_cells()
        external = outer.force(increment)
        residual = internal - external
        # reactions and loads are what balances; at rest nothing does
        least = max(least, outer.loads.size_of_given_fields(outer.values))
        size = max(least, self.body.norm(external), self.body.norm(residual[self.prescribed]))
        return Balance(residual, size if size > 0.0 else self.body.norm(internal))

    def net_load(self, outer: TrialLoads, increment: FloatArray) -> FloatArray:
        """(owned dofs,) N, less the internal forces where a temperature changes those. Collective."""
        force = outer.force(increment)
        if not self.applied.any_given_fields:
            return force
        outer.set_given_fields()
        return np.asarray(force - self.body.force(increment))

    def accept(self, before: HistorySnapshot, increment: FloatArray, t: float) -> None:
        """Let the body take a step, at the temperature of a load parameter. Collective.

        Raises:
            ConvergenceError: a history is not finite.
        """
        self.body.restore(before)
        self.outer(t).set_given_fields()
        self.body.commit(increment, dt=0.0)

    def tangent(
        self, outer: TrialLoads, increment: FloatArray, *, dt: float = 0.0, predicted: bool = False
    ) -> PETSc.Mat:
        """Its derivative, as of `NonlinearModel.tangent`. Collective."""
        outer.set_given_fields()
        return outer.subtract_slopes(self.body.tangent(increment, dt=dt, predicted=predicted), increment)

    def _fault_of_prescribed(self) -> str:
        """What is wrong with the given dofs, if anything is."""
        given: Any = self.prescribed
        if not isinstance(given, np.ndarray) or given.ndim != 1 or not np.issubdtype(given.dtype, np.integer):
            return f"prescribed must be dofs, as prescribed_dofs and clamped_dofs give them, got {given!r:.100}"
        if given.size and not (0 <= given.min() and given.max() < self.body.n_owned):
            return f"prescribed must be dofs that this rank owns, 0 to {self.body.n_owned - 1}, got {given!r:.100}"
        if len(np.unique(given)) < len(given):
            return "prescribed has a dof twice; np.unique makes them one"
        return ""

    def _answer(self, name: str, function: LoadPath, t: float, n: int) -> FloatArray:
        """(n,) what a user's function gives at a load parameter."""
        found = numbers(function(t))
        fault = ""
        if found.shape != (n,):
            fault = f"{name} gave an array of shape {found.shape} at {t:g}, not ({n},)"
        elif not np.isfinite(found).all():
            fault = f"{name} gave values that are not finite at {t:g}"
        self._agree(fault)
        return found

    def _agree(self, fault: str) -> None:
        """Raise on all ranks if anything is wrong on one. Collective."""
        parallel.raise_collectively(self.body.comm, FormulationError(fault) if fault else None)
