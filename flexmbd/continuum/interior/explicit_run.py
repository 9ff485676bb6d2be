"""A free body with history on its own: thrown, against planes, under gravity, by central differences."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from mpi4py import MPI

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.continuum import parallel
from flexmbd.continuum.history.loads import BodyLoad
from flexmbd.continuum.history.nonlinear_model import NonlinearModel
from flexmbd.continuum.interior.bulk_viscosity import BulkViscosity
from flexmbd.continuum.interior.contact_plane import RigidPlane
from flexmbd.continuum.interior.nodal_inertia import Support
from flexmbd.continuum.interior.nodal_motion import NodalMotion
from flexmbd.continuum.interior.run_checkpoint import RegularCheckpoints, RunState
from flexmbd.continuum.interior.thickness_mass import thickness_mass
from flexmbd.errors import ConvergenceError, ExplicitRunError, SceneError
from flexmbd.given import checked
from flexmbd.round_off import EPSILON, TEN_DIGITS

FloatArray = NDArray[np.float64]

# Share of the stable step that is taken where none is given, and steps after which it is found anew.
_SHARE, _RENEWAL = 0.9, 5

# A step that is the stable one but for the accuracy of the estimate is taken.
_ESTIMATE = 1e-4


@dataclass(eq=False)
class EnergyAccount:
    """Energies (J) at instants, and the error of their balance.

    Attributes:
        t: s, instants.
        rows: at each, energies by name (`NodalMotion.energies`).
        internal: at each, work done on the deformation, by the trapezoidal rule over all steps.
    """

    t: list[float] = field(default_factory=list)
    rows: list[dict[str, float]] = field(default_factory=list)
    internal: list[float] = field(default_factory=list)

    def __getitem__(self, name: str) -> FloatArray:
        """(instants,) J, of that name."""
        return np.array([row[name] for row in self.rows])

    @property
    def total(self) -> FloatArray:
        """(instants,) J, the sum of all names, which is constant but for errors."""
        return np.array([sum(row.values()) for row in self.rows])

    @property
    def error(self) -> float:
        """The largest change of the total, over the largest energy of one kind and its change."""
        total = self.total
        size = max(np.ptp(self[name]) for name in self.rows[0])
        return float(abs(total - total[0]).max() / size) if size > 0.0 else 0.0

    def __str__(self) -> str:
        names = list(self.rows[0])
        lines = [f"{'t, s':>11}" + "".join(f"{name:>14}" for name in [*names, "internal work", "total, J"])]
        for t, row, work, total in zip(self.t, self.rows, self.internal, self.total, strict=True):
            values = [*row.values(), work, total]
            lines.append(f"{t:11.4e}" + "".join(f"{value:14.6g}" for value in values))
        lines.append(f"the account closes within {100.0 * self.error:.2g} %")
        return "\n".join(lines)


@checked(but=("velocity",), agree=parallel.told_to_all)
class ExplicitRun:
    """A body that flies, falls or hits something by itself. Constructing one is collective.

    Attributes:
        motion: of the nodes.
        t: s, the present instant.
        steps: taken so far.
        account: energies at the outputs.
        places: at the outputs, (owned nodes, 3) m of this rank, inertial.
    """

    def __init__(
        self,
        body: NonlinearModel,
        *,
        velocity: ArrayLike | Callable[[FloatArray], FloatArray] = (0.0, 0.0, 0.0),
        planes: Sequence[RigidPlane] = (),
        supports: Sequence[Support] = (),
        gravity: ArrayLike = (0.0, 0.0, 0.0),
        damping: float = 0.0,
        bulk_viscosity: BulkViscosity | None = None,
        loads: Sequence[BodyLoad] = (),
        scaled_thickness: float = 0.0,
    ) -> None:
        """Set the body off where the mesh is, and where it has been deformed, as by `follow`, from there.

        Args:
            body: at rest, with the displacement, stress and history that it has.
            velocity: (3,) m/s of all nodes, or a function of places (n, 3) that returns (n, 3).
            planes: rigid planes that nodes may touch.
            supports: components of nodes held at zero.
            gravity: (3,) m/s^2.
            damping: 1/s, force per mass and velocity.
            bulk_viscosity: pressure by the rate of volume change, for shocks; a shorter stable step.
            loads: on the body, counted in the account.
            scaled_thickness: as of `ExplicitContinuum`.

        Raises:
            SceneError: the body begins behind a plane, or the velocity is not of that shape.
            MeshError: a support or a load is on facets or nodes that the mesh has not.
            FormulationError: the mass cannot be lumped; as `ThicknessMass`.
        """
        self.motion = NodalMotion(
            body, supports=supports, planes=planes, damping=damping, bulk_viscosity=bulk_viscosity, loads=loads,
            thickness=thickness_mass(body, scaled_thickness),
        )  # fmt: skip
        self.motion.begin(np.zeros(3), np.eye(3), np.asarray(gravity, dtype=float))
        x = self.motion.x
        given = np.asarray(velocity(x) if callable(velocity) else velocity, dtype=float)
        if given.shape not in ((3,), x.shape) or not np.isfinite(given).all():
            raise SceneError(f"velocity must be three finite numbers (m/s), at each node, got shape {given.shape}")
        self.motion.v[:] = given
        self.t, self.steps = 0.0, 0
        self.account = EnergyAccount()
        self.places: list[FloatArray] = []

    @property
    def comm(self) -> MPI.Comm:
        """The ranks that the body is spread over."""
        return self.motion.body.comm

    @property
    def stable_step(self) -> float:
        """The longest stable step, s, as last found."""
        return self.motion.limit

    @checked(agree=parallel.told_to_all)
    def simulate(
        self,
        t_end: float,
        *,
        h: float | None = None,
        outputs: int = 10,
        checkpoints: RegularCheckpoints | None = None,
        restart: str | Path | None = None,
    ) -> EnergyAccount:
        """Go on until `t_end` (s); may be called again with a later one. Collective.

        Args:
            t_end: s.
            h: the step, s; without it 0.9 of the stable one, as this changes with the shape of the body.
            outputs: number of equal stretches after each of which energies and places are noted.
            checkpoints: the file that is to hold the last of them; they change nothing else.
            restart: such a file of the same call of a run of the same body, on any number of ranks, which was broken
                off; what came before, the account too, is that run's. On one rank it goes on to the bit.

        Returns:
            The account, from the start on.

        Raises:
            SceneError: h is not positive, or longer than the stable step; t_end is past, or so far that times of two
                steps are one; outputs is below one, or more than memory holds; the checkpoint is of another run.
            RecordError: a checkpoint cannot be read or written.
            ExplicitRunError: a cell is turned inside out, or h has become longer than the stable step; names
                the cell and the instant, and what was noted is kept.
        """
        begun = self.t if restart is None else self._go_back(RunState.load(restart, self.motion))
        limit = self.motion.limit
        if h is not None and not 0.0 < h <= limit * (1.0 + _ESTIMATE):
            raise SceneError(f"the step h = {h!r} s must be positive and not above the stable step, {limit:.6g} s")
        over = t_end < self.t if restart is not None else t_end <= self.t
        if over or not np.isfinite(t_end) or outputs < 1:
            raise SceneError(f"t_end = {t_end!r} s must be after {self.t:.6g} s, and outputs at least 1: {outputs!r}")
        step = _SHARE * limit if h is None else h
        if (t_end - self.t) * EPSILON > step:
            raise SceneError(f"t_end = {t_end:g} s is so large that steps of {step:.3g} s vanish in its round-off")
        try:
            instants = [float(instant) for instant in np.linspace(begun, t_end, outputs + 1)[1:]]
        except (MemoryError, OverflowError, ValueError) as error:  # numpy says so in three ways
            raise SceneError(f"outputs = {outputs:.3g} are more than memory holds") from error
        if not self.account.t:
            self.motion.start(self._step(instants[0], h))
            self._note()
        for instant in instants:
            if instant > self.account.t[-1]:
                self._advance(instant, h, begun=begun, checkpoints=checkpoints)
                self._note()
        return self.account

    def _advance(
        self, instant: float, h: float | None, *, begun: float, checkpoints: RegularCheckpoints | None
    ) -> None:
        motion = self.motion
        due = np.inf if checkpoints is None else checkpoints.next(begun, self.t)
        while self.t < instant:
            if self.steps % _RENEWAL == 0 and self.steps:
                motion.renew_limit()
            step = self._step(instant, h)
            try:
                motion.advance(step)
            except ConvergenceError as reason:
                raise ExplicitRunError(f"at t = {self.t + step:.6g} s, step {self.steps + 1}: {reason}") from reason
            self.steps += 1
            self.t = instant if instant - self.t <= step * (1.0 + TEN_DIGITS) else self.t + step
            if checkpoints is not None and self.t >= due:
                self._state(begun).save(checkpoints.path, motion)
                due = checkpoints.next(begun, self.t)

    def _step(self, instant: float, h: float | None) -> float:
        """The step to take: equal ones to the instant, so that none is a splinter."""
        limit = self.motion.limit
        step = _SHARE * limit if h is None else h
        if step > limit * (1.0 + _ESTIMATE):
            raise ExplicitRunError(
                f"at t = {self.t:.6g} s the step h = {step:.4g} s is above the stable one, which has fallen to "
                f"{limit:.4g} s; take a smaller h, or none"
            )
        rest = instant - self.t
        return float(rest / np.ceil(rest / step * (1.0 - TEN_DIGITS)))

    def _note(self) -> None:
        self.account.t.append(self.t)
        self.account.rows.append(self.motion.energies())
        self.account.internal.append(self.motion.internal_work())
        self.places.append(self.motion.x.copy())

    def _state(self, begun: float) -> RunState:
        """All that tells how it goes on, of the whole body. Collective."""
        account, memory = self.account, self.motion.memory
        names = tuple(account.rows[0])
        energies = np.column_stack([*(account[name] for name in names), account.internal])
        places = np.array([memory.gather_nodes(x) for x in self.places])
        return RunState(
            (self.t, begun), self.steps, np.array(account.t), names, energies, places, self.motion.snapshot()
        )

    def _go_back(self, state: RunState) -> float:
        """Be where a run was; returns where its call of `simulate` had begun (s). Collective."""
        (self.t, begun), self.steps = state.times, state.steps
        self.motion.restore(state.motion)
        rows = [dict(zip(state.names, map(float, row), strict=False)) for row in state.energies]
        self.account = EnergyAccount([*map(float, state.instants)], rows, [*map(float, state.energies[:, -1])])
        owned = len(self.motion.masses)
        self.places = [self.motion.memory.scatter_nodes(x)[:owned] for x in state.places]
        return begun
