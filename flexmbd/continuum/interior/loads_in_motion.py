"""Loads on a body with history that moves in a machine: nodal forces in each step, and their work."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.history.applied_loads import AppliedLoads, TrialLoads, beside
from flexmbd.continuum.history.body_memory import BodyMemory
from flexmbd.continuum.history.loads import BodyLoad, CentrifugalLoad
from flexmbd.continuum.history.nonlinear_model import NonlinearModel
from flexmbd.continuum.interior.bonded_nodes import BondedNodes
from flexmbd.continuum.interior.step_equations import BodyAxes
from flexmbd.errors import SceneError

FloatArray = NDArray[np.float64]


def loads_on_moving_nodes(
    body: NonlinearModel, loads: Sequence[BodyLoad], *, mass: FloatArray | None = None
) -> AppliedLoads:
    """Loads on a body whose nodes have inertia; mass: as of `AppliedLoads`. Collective.

    Raises:
        SceneError, MeshError: on all ranks: as `AppliedLoads`, or a load is for slow loading alone.
    """
    applied = AppliedLoads(body, loads, mass=mass)
    for load in applied.loads:
        if isinstance(load, CentrifugalLoad):
            raise SceneError(
                f"load {load.name!r}: moving nodes have inertia, so that a centrifugal load would count twice; let "
                "the body rotate"
            )
    return applied


class LoadsInMotion:
    """The loads of one body.

    Attributes:
        applied: them.
        now: (owned nodes, 3) N, in inertial axes, in the last accepted state, as it goes on from there.
        work: J, that they have done.
        R_begun: (3, 3) the body's axes at the start, in which dead loads are given.
    """

    def __init__(self, body: NonlinearModel, bonds: BondedNodes, loads: Sequence[BodyLoad]) -> None:
        """Find where they act. Collective.

        Raises:
            SceneError, MeshError: on all ranks: as `AppliedLoads`, or a load is for slow loading alone.
        """
        self._body, self._bonds, self._n = body, bonds, body.layout.n_owned_nodes
        self.applied = loads_on_moving_nodes(body, loads)
        self.now: FloatArray = np.zeros((self._n, 3))
        self.work = 0.0
        self.R_begun: FloatArray = np.eye(3)

    def begin(self, R: FloatArray) -> None:
        """Begin anew with the body's axes turned by R."""
        self.R_begun, self.work = R, 0.0

    def after(self, t: float, x: FloatArray) -> FloatArray:
        """(owned nodes, 3) N, in inertial axes, just after t (s), with nodes at x (local nodes, 3). Collective.

        The body is brought to its temperature then.
        """
        factors = self.applied.values(beside(t, 1))
        self.applied.set_given_fields(factors)
        return self.applied.forces(factors, x[: self._n], self.R_begun)

    def factors_before(self, t: float) -> FloatArray:
        """The loads' factors just before t (s), the same on all ranks. Collective."""
        return self.applied.values(beside(t, -1))

    def at(self, factors: FloatArray, axes: BodyAxes) -> TrialLoads:
        """The nodal forces on the body at trial displacements in these axes. Not collective."""
        dead = axes.to_body(self.applied.dead(factors, self.R_begun))
        return TrialLoads(self._body, self.applied, factors, dead)

    def accept(self, moved: FloatArray, load: FloatArray) -> None:
        """Count the work on a displacement (local nodes, 3) m to where a load (owned nodes, 3) N acts. Collective."""
        if self.applied.any:
            work = 0.5 * np.vdot(moved[: self._n], self.now + load)
            self.work += float(self._bonds.total(np.array(work)))
            self.now = load

    def energies(self) -> dict[str, float]:
        """J, minus the work done; nothing without loads."""
        return {"loads": -self.work} if self.applied.any else {}

    def snapshot(self, memory: BodyMemory) -> dict[str, FloatArray]:
        """Copies of what they remember, of the whole body. Collective."""
        return {"load": memory.gather_nodes(self.now), "load work": np.array(self.work), "begun": self.R_begun.copy()}

    def restore(self, kept: Mapping[str, FloatArray], memory: BodyMemory) -> None:
        """Go back to a snapshot, on any number of ranks. Collective."""
        self.now, self.work = memory.scatter_nodes(kept["load"])[: self._n], float(kept["load work"])
        self.R_begun = kept["begun"].copy()

    def resultants(self, t: float, x: FloatArray) -> Mapping[str, FloatArray]:
        """(3,) N of each load by name, in inertial axes, with nodes at x (local nodes, 3). Collective."""
        if not self.applied.any:
            return {}
        return self.applied.resultants(self.factors_before(t), x[: self._n], self.R_begun)
