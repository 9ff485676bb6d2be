"""Runs of a machine's variants one after the other in the same arrays, where compiled stepping is all that is asked.

A prepared run gives to the bit what ``simulation.run`` gives, and leaves to it whatever it cannot do, failures that are
to be told among them.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import FlexmbdError, SceneError
from flexmbd.integrate import state as st
from flexmbd.integrate.controller import NO_KNOTS, SAFETY, arrays_of
from flexmbd.integrate.protocol import Integrator
from flexmbd.multibody.bodies.body import Body
from flexmbd.multibody.bodies.pseudo_rigid_body import PseudoRigidBody
from flexmbd.multibody.kernels.base.arrays import Plan, memories_end, new_work, open_horizon
from flexmbd.multibody.kernels.inverse_dynamics.memories import remember
from flexmbd.multibody.kernels.inverse_dynamics.tree_accelerations import new_dense_work, tree_accelerations
from flexmbd.multibody.kernels.reading.force_tables import without_forces
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.plan.mass_solver import DENSE_UP_TO
from flexmbd.multibody.plan.misplaced_elements import misplaced_elements, placed_elements
from flexmbd.multibody.results.range_watch import RangeWatch
from flexmbd.multibody.start.consistent_start import Start, is_dense_tree
from flexmbd.multibody.start.energy_check import gives_energies
from flexmbd.multibody.start.kept_starts import can_be_kept
from flexmbd.run.fixed_step_watch import FixedStepWatch
from flexmbd.run.input_values import evaluate_inputs
from flexmbd.run.limits import MOST_ROWS
from flexmbd.run.settings import RunSettings
from flexmbd.run.snapshot import first_step, new_snapshot

FloatArray = NDArray[np.float64]

#: Arrays of a plan that a variant's numbers are written to.
_VARIED = ("frames", "rigid", "data", "time_data")


@dataclass(frozen=True, eq=False)
class SteppedRows:
    """The rows of a prepared run: t (nt,), x (nt, nx), v, a (nt, nv), multipliers (nt, m), and its stepping's seconds.

    The multipliers are of the kept rows.  Where they fit into the workspace the arrays are views of its own, good until
    its next run.  ``interrupt``: Ctrl-C, by which the run ended early.
    """

    t: FloatArray
    x: FloatArray
    v: FloatArray
    a: FloatArray
    multipliers: FloatArray
    seconds: float
    interrupt: KeyboardInterrupt | None = None


def can_be_prepared(scene: CompiledScene, settings: RunSettings) -> bool:
    """Whether runs of a scene's variants by these settings can: machines without functions that Python is asked for.

    Of loops such whose rows are kept for good, which a start tells.
    """
    joints = [scene.index.now(b.connection) for b in scene.topology.branches if b.connection is not None]
    return (
        settings.is_stepping_alone
        and scene.parts.team.size == 1
        and (has_prepared_loops(scene) or (is_dense_tree(scene) and not scene.topology.closures))
        and not scene.is_shared
        and not scene.sources.is_awaited
        and not gives_energies(scene.plan)
        and not any(row.has_pieces or (row.motion and row.is_users) for row in scene.time_rows)
        and not len(scene.declared_breaks())
        and not scene.switches
        and not any(isinstance(body, PseudoRigidBody) or _is_watched(body) for body in scene.index.bodies)
        and not any(j.motion is not None and (j.position is not None or j.velocity is not None) for j in joints)
    )


def has_prepared_loops(scene: CompiledScene) -> bool:
    """Whether a scene has loops whose starts are found by ``consistent_start`` and stepped in a workspace."""
    few = 0 < len(scene.plan.rows) and scene.nv <= DENSE_UP_TO
    return few and not len(scene.row_structure.couplings) and not memories_end(scene.plan) and can_be_kept(scene)


def _is_watched(body: Body) -> bool:
    """Whether a run says when the body leaves its range."""
    record = body.reduced()
    return record is not None and record.nonlinear is not None


class PreparedRuns:
    """A workspace for runs of a machine's variants, with arrays of its own; one thread uses it at a time.

    Attributes:
        scene: with the plan whose arrays take a variant's numbers.
        method: the integrator.
        x, v: (nx,), (nv,) the start, to be written before ``begin``; of a machine with loops ``begin_at`` writes it.
        rows: which of all constraint rows are kept.
    """

    def __init__(self, start: Start, method: Integrator, settings: RunSettings) -> None:
        scene = start.scene
        own = {name: getattr(scene.plan, name).copy() for name in _VARIED}
        # views can be written to, which the plan's own array may refuse
        self.numbers: dict[str, NDArray[Any]] = {name: array.view() for name, array in own.items()}
        callbacks = scene.callbacks.beside()
        plan = scene.plan.replace(**own, flag=callbacks.flag, horizon=open_horizon())
        full, floor = scene.group_full.copy(), scene.group_floor.copy()
        self.scene = replace(scene, plan=plan, callbacks=callbacks, group_full=full, group_floor=floor)
        self.method, self._settings, self._start, self.rows = method, settings, start, start.choice.rows
        self._keeps_rows = start.choice.for_good
        snapshot = new_snapshot(
            replace(start, scene=self.scene), method,
            t_start=settings.t_start, t_end=settings.t_end, rtol=settings.rtol, h=settings.h,
        )  # fmt: skip
        self._state, groups = snapshot.state, snapshot.groups
        self.x, self.v = self._state.x, self._state.v
        numbers = self._state.numbers
        numbers[st.SAFETY] = SAFETY
        if settings.max_step is not None:
            numbers[st.STEP_CEILING] = min(numbers[st.STEP_CEILING], settings.max_step)
        met = (groups.position, groups.velocity, groups.acceleration, groups.rate, groups.newest, groups.turned)
        kept = (*met, groups.stiffness, groups.softest, groups.held, self._state.numbers, self._state.counts)
        self._fresh = [(part, part.copy()) for part in kept]
        self._work = new_work(plan)
        self._stepper = method.stepper(self.scene, self._state, groups, self._work)
        self._memory = list(arrays_of(self._stepper.memory).values())
        self._bare, self._dense, self._placed = without_forces(plan), new_dense_work(plan), placed_elements(plan)
        sizes = (scene.nx, scene.nv, scene.nv, len(plan.rows))
        whole = [np.empty(1 + MOST_ROWS), *(np.empty((1 + MOST_ROWS, size)) for size in sizes)]
        t, x, v, a, multipliers = (part[1:] for part in whole)
        self._series, self._record = whole, st.Record(t, x, v, a, multipliers, self._work)
        self._ranges = RangeWatch(self.scene, scene.index.bodies)

    @property
    def is_of_use(self) -> bool:
        """Whether the method can go on with other numbers of the plan, and with the same rows."""
        return self._keeps_rows and self._stepper.refit()

    @property
    def plan(self) -> Plan:
        """The plan whose arrays take a variant's numbers."""
        return self.scene.plan

    @property
    def counts(self) -> NDArray[np.int64]:
        """Of the last run, by ``integrate.state``."""
        return self._state.counts

    def take(self, scene: CompiledScene) -> bool:
        """Take a variant's numbers; False where others differ than those that a workspace takes."""
        if scene.plan.modal is not self.plan.modal or len(scene.declared_breaks()):
            return False
        for name, array in self.numbers.items():
            array[...] = getattr(scene.plan, name)
        self.scene.group_full[:], self.scene.group_floor[:] = scene.group_full, scene.group_floor
        return True

    def begin(self) -> bool:
        """Set up a run of a tree from x, v with the plan's numbers; False where ``simulation.run`` is to do that."""
        s, plan = self._state, self.plan
        if not self._begins():
            return False
        if self._work.trial.size:
            remember(plan, self._work, s.x, s.v, self._settings.t_start)
        if not tree_accelerations(plan, self._bare, self._work, self._dense, s.x, s.v, s.a):
            return False
        if self._placed and any(misplaced_elements(plan, self._placed, s.x)):
            return False
        return self._is_begun(self.start())

    def begin_at(self, start: Start) -> bool:
        """As ``begin``, of a machine with loops at its start, whose numbers were taken."""
        s = self._state
        if not (start.choice.for_good and start.choice.rows == self.rows and self._begins()):
            return False
        s.x[:], s.v[:], s.a[:], s.multipliers[:] = start.x, start.v, start.a, start.multipliers
        return self._is_begun(start)

    def _begins(self) -> bool:
        """Bring all but the state to where a run begins; whether that can be."""
        if not self._stepper.refit():
            return False
        for part, kept in self._fresh:
            part[...] = kept
        for part in self._memory:
            part[...] = 0
        if self._stepper.fixed_errors is not None:
            self._stepper.fixed_errors[:] = 0.0
        self.plan.flag[0] = 0
        try:
            evaluate_inputs(self.scene, self._work, self._settings.t_start)
        except FlexmbdError:
            return False
        return True

    def _is_begun(self, start: Start) -> bool:
        """Let the method begin at the state; whether it can."""
        s = self._state
        if self._settings.h is None:
            s.numbers[st.STEP] = first_step(self.scene, s.numbers, s.v, s.a, self.method.order)
        if self._settings.integrator == "auto" and self._settings.method(start) != self.method:
            return False
        self._stepper.begin()
        try:
            self._stepper.refuse_step()
        except SceneError:
            return False
        return True

    def start(self) -> Start:
        """The start that ``begin`` found."""
        s = self._state
        return replace(self._start, scene=self.scene, unreduced=self.scene, x=s.x, v=s.v, a=s.a)

    def step(self) -> SteppedRows | None:
        """Step to the end; None where the run fails, which ``simulation.run`` has the words for.

        Warns:
            RangeWarning: as of any run, of a body beyond what its record knows.
        """
        s, began = self._state, time.perf_counter()
        for part, value in zip(self._series, (s.numbers[st.TIME], s.x, s.v, s.a, s.multipliers), strict=True):
            part[0] = value
        blocks: list[list[FloatArray]] = []
        code, interrupt = st.OUTPUT, None
        while code == st.OUTPUT:
            s.counts[st.STORED], s.counts[st.MOST_STORED] = 0, MOST_ROWS
            try:
                code = self._stepper.advance(self._record, NO_KNOTS)
            except KeyboardInterrupt as reason:
                code, interrupt = st.DONE, reason
            rows = slice(1 if blocks else 0, 1 + int(s.counts[st.STORED]))
            if code == st.OUTPUT or blocks:
                blocks.append([part[rows].copy() for part in self._series])
        if code != st.DONE or s.counts[st.AT_BREAK] == 1 or s.counts[st.RESELECT_ROWS] != 0:
            return None
        found = [np.concatenate(parts) for parts in zip(*blocks, strict=True)] or [part[rows] for part in self._series]
        t, x, v, a, multipliers = found
        self._ranges.judge(t, x, v)
        FixedStepWatch(self.scene.velocity_names, s, self.method).look(self._stepper.fixed_errors)
        return SteppedRows(t, x, v, a, multipliers, time.perf_counter() - began, interrupt)


@dataclass
class _Kind:
    """Idle workspaces for runs of one kind, and whether there can be any."""

    key: object
    idle: list[PreparedRuns]
    can: bool = True


class Workspaces:
    """Idle workspaces of a machine, for the runs of one kind that it made last; threads may share it.

    Each call looks once at what kind that is, for another thread may change it at any time.
    """

    def __init__(self) -> None:
        self._kind = _Kind(None, [])

    def __reduce__(self) -> tuple[type[Workspaces], tuple[()]]:
        """Copies and pickles have none."""
        return Workspaces, ()

    def are_for(self, key: object) -> bool:
        """Whether runs of this kind were the last ones, and can be prepared; workspaces for others are dropped."""
        kind = self._kind
        if kind.key == key:
            return kind.can
        self._kind = _Kind(key, [])
        return False

    def taken(self, key: object, new: Callable[[], PreparedRuns | None]) -> PreparedRuns | None:
        """An idle workspace for runs of this kind, else a new one; None where there can be none."""
        kind = self._kind
        if kind.key == key:
            with suppress(IndexError):
                return kind.idle.pop()
        made = new()
        if made is None and kind.key == key:
            kind.can = False
        return made

    def give_back(self, key: object, workspace: PreparedRuns) -> None:
        """Keep a workspace whose run did not fail."""
        kind = self._kind
        if kind.key == key:
            kind.idle.append(workspace)
