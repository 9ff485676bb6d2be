"""A machine compiled once: it runs with other values of its parameters without being set up anew."""

from __future__ import annotations

import inspect
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.ensemble.batch import BatchRuns
from flexmbd.ensemble.executing import refuse_executor, run_ensemble
from flexmbd.ensemble.results import Ensemble
from flexmbd.ensemble.sampled import Sampled
from flexmbd.ensemble.samples import Samples
from flexmbd.ensemble.stamp import study_digest
from flexmbd.ensemble.variants import Study, VariantOutput, refuse_outputs
from flexmbd.errors import FlexmbdError, SceneError
from flexmbd.given import checked, refuse_no_truth
from flexmbd.integrate.automatic import check_method
from flexmbd.integrate.protocol import Integrator
from flexmbd.machine.steppable import Steppable, StepperRequest
from flexmbd.machine.variable_scene import VariableScene
from flexmbd.multibody.linear.working_point import WorkingPoint
from flexmbd.multibody.plan.agreement import refuse_different, refuse_different_arguments
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.results.surface_series import tell_overlapping_surfaces
from flexmbd.multibody.start.consistent_start import Start
from flexmbd.multibody.start.motion_check import refuse_false_rates
from flexmbd.multibody.team import Alone, on_every_rank
from flexmbd.run.checkpoint import Checkpoint
from flexmbd.run.event import Event
from flexmbd.run.prepared import PreparedRuns, Workspaces, can_be_prepared
from flexmbd.run.recording import Recording
from flexmbd.run.repetition import Repetition
from flexmbd.run.run_on_root import run_on_root
from flexmbd.run.sampling import code_of
from flexmbd.run.settings import RunSettings, choice_of
from flexmbd.run.simulation import prepared_trajectory, run
from flexmbd.run.snapshot import new_snapshot
from flexmbd.run.stepped_integration import SteppedScene, stepped_scene
from flexmbd.run.stepped_machine import SteppedMachine
from flexmbd.run.trajectory import Trajectory

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False, repr=False)
class CompiledMachine(VariableScene, Steppable):
    """A machine as it stands when it is compiled; made by ``System.compile``.

    It can be pickled and deep-copied, together with the joints, frames and bodies that it is asked by.

    Attributes:
        scene: its flat arrays, and where its bodies, joints and forces stand in them.
        connections: its joints.
        bodies: its bodies.
        parameters: the quantities of each name.
        team: the processes that run it side by side.
        controllers: its sampled controllers.

    Raises:
        SceneError: a parameter does not fit the scene, or bears the name of an argument of ``simulate``.
    """

    _workspaces: Workspaces = field(default_factory=Workspaces, init=False)

    def __post_init__(self) -> None:
        taken = set(inspect.signature(CompiledMachine.simulate).parameters) if self.parameters else set()
        for name in self.parameters:
            if not (isinstance(name, str) and name.isidentifier()) or name in taken:
                raise SceneError(f"a parameter cannot be called {name!r}: simulate(...) takes it by its name")
        super().__post_init__()

    def __repr__(self) -> str:
        """How many bodies and joints, and the parameters."""
        named = ", ".join(self.parameters) or "none"
        return f"<CompiledMachine of {len(self.bodies)} bodies, {len(self.connections)} joints; parameters: {named}>"

    def simulate(
        self,
        t_end: float,
        *,
        rtol: float = 1e-6,
        h: float | None = None,
        t_start: float = 0.0,
        about: WorkingPoint | None = None,
        integrator: Integrator | Literal["auto"] = "auto",
        events: Sequence[Event] = (),
        checkpoints: Sequence[float] = (),
        checkpoint_file: str | Path | None = None,
        checkpoint_every: float | None = None,
        restart: Checkpoint | None = None,
        progress: bool = False,
        max_step: float | None = None,
        max_steps: int | None = None,
        max_rows: int | None = None,
        max_seconds: float | None = None,
        recording: Recording | None = None,
        stream: str | Path | None = None,
        **values: Any,
    ) -> Trajectory:
        """Run the machine with these values of its parameters; those not given stay as compiled.

        The trajectory is to the bit that of a scene built with these values; where loops have redundant rows to
        round-off, for other ones may be kept.  It is asked by the scene's own frames,
        joints and bodies, and answers with this variant's numbers.

        Args:
            t_end: end time (s).
            rtol: as of ``System.simulate``, as all arguments up to ``max_seconds``.
            h: fixed step (s).
            t_start: start time (s).
            about: where to begin.
            integrator: the method.
            events: to look for.
            checkpoints: times (s) of checkpoints to keep.
            checkpoint_file: of regular checkpoints.
            checkpoint_every: s between them.
            restart: a checkpoint to go on from, of a machine with these very values.
            progress: show a progress bar.
            max_step: longest step (s).
            max_steps: steps after which the run is broken off.
            max_rows: rows after which it is.
            max_seconds: s of the wall's clock after which it is.
            recording: as of ``System.simulate``.
            stream: as of ``System.simulate``.
            values: of the parameters, by their names.

        Raises:
            SceneError, AssemblyError, SimulationError: as ``System.simulate``, and as ``variant``.
        """
        settings = partial(
            RunSettings,
            t_end,
            rtol=rtol,
            h=h,
            t_start=t_start,
            about=about,
            integrator=integrator,
            events=events,
            checkpoints=checkpoints,
            checkpoint_file=checkpoint_file,
            checkpoint_every=checkpoint_every,
            restart=restart,
            progress=progress,
            max_step=max_step,
            max_steps=max_steps,
            max_rows=max_rows,
            max_seconds=max_seconds,
            recording=recording,
            stream=stream,
        )
        return self.run(on_every_rank(self.team, settings), **values)

    def run(self, settings: RunSettings, /, **values: Any) -> Trajectory:
        """As ``simulate``, by settings that several runs share.

        Args:
            settings: how long, how exactly, by which method.
            values: of the parameters, by their names.

        Raises:
            SceneError, AssemblyError, SimulationError: as ``simulate``.
        """
        scene = on_every_rank(self.team, lambda: self.variant(values))
        trajectory = self._run_on_team(scene, settings)
        repetition = Repetition.of(settings, scene, self.controllers, self.team)
        return replace(trajectory, _repetition=repetition)

    def _run_on_team(self, scene: CompiledScene, settings: RunSettings) -> Trajectory:
        """Run a variant, on this process or as the team shares it."""
        if self.team.size == 1:
            found, start = self._prepared_run(scene, settings)
            return found or self._run(scene, settings, start)
        refuse_different_arguments({**settings.told, "controllers": code_of(self.controllers)}, self.team)
        if scene.interiors is None and not self.team.collective_functions:
            x, v = on_every_rank(self.team, lambda: self._given(scene))
            refuse_different(scene, x, v, self.team)
            bodies = {body.name: body for body in self.bodies}
            simulate = partial(replace(self, team=Alone())._run, scene, settings)
            return run_on_root(scene, bodies, settings=settings, team=self.team, simulate=simulate)
        return self._run(scene, settings)

    def _run(self, scene: CompiledScene, settings: RunSettings, start: Start | None = None) -> Trajectory:
        """Run a variant on the ranks of this machine's team, each of which steps; ``start``: if it is found already."""
        if start is None:
            refuse_false_rates(scene, settings.starts, settings.t_end)
            start = self.start_of(scene, settings.begun, settings.about)
            if settings.about is None and settings.restart is None:
                tell_overlapping_surfaces(start.scene, start.x, self.team)
        choice = choice_of(settings, start)
        method = choice.method
        if settings.restart is None:
            snapshot = new_snapshot(
                start, method, t_start=settings.t_start, t_end=settings.t_end, rtol=settings.rtol, h=settings.h
            )
        else:
            snapshot = settings.restart.of(start, method, controllers=code_of(self.controllers))
        bodies = {body.name: body for body in self.bodies}
        return run(
            start, bodies, settings=settings, method=method, snapshot=snapshot, team=self.team,
            controllers=self.controllers, explicit_steps=choice.explicit_steps,
        )  # fmt: skip

    def _prepared_run(self, scene: CompiledScene, settings: RunSettings) -> tuple[Trajectory | None, Start | None]:
        """Run a variant in arrays of runs before; no trajectory where that is not for them, or the first of its kind.

        With the start of a machine with loops, which then need not be found again.
        """
        key = settings.stepping
        if self.controllers or not settings.is_stepping_alone or not self._workspaces.are_for(key):
            return None, None
        workspace = self._workspaces.taken(key, lambda: self._new_workspace(settings))
        if workspace is None:
            return None, None
        trajectory: Trajectory | None = None
        start: Start | None = None
        if workspace.take(scene):
            if len(scene.plan.rows):
                start = self.start_of(scene, settings.begun)
                begun = workspace.begin_at(start)
            else:
                workspace.x[:], workspace.v[:] = self._given(scene)
                begun = workspace.begin()
            if begun:
                rows = workspace.step()
                if rows is None:
                    return None, start
                bodies = {body.name: body for body in self.bodies}
                trajectory = prepared_trajectory(scene, rows, workspace, bodies, self.team, start=start)
        self._workspaces.give_back(key, workspace)
        return trajectory, start

    def _new_workspace(self, settings: RunSettings) -> PreparedRuns | None:
        """A workspace for runs of variants; None where there can be none, or what was compiled has no start."""
        if not can_be_prepared(self.scene, settings):
            return None
        try:
            start = self.start_of(self.scene, settings.begun)
            method = settings.method(start)
            check_method(method, start.scene)
            made = PreparedRuns(start, method, settings)
        except FlexmbdError:
            return None
        return made if made.is_of_use else None

    def _batch_runs(self, settings: RunSettings, outputs: Mapping[str, Sampled]) -> BatchRuns | None:
        """How variants are run in workspaces and outputs sampled there; None where that cannot be."""
        if self.controllers or not settings.is_stepping_alone or not can_be_prepared(self.scene, settings):
            return None
        if len(self.scene.plan.rows):  # starts of loops are found one by one, by ``run``
            return None
        key = settings.stepping
        self._workspaces.are_for(key)
        new = partial(self._new_workspace, settings)
        return BatchRuns(
            self.scene, self.parameters, self.variant, self._given, self._workspaces, key, new, outputs
        )

    def _begin_steps(self, request: StepperRequest) -> SteppedMachine:
        settings = on_every_rank(self.team, request.settings)
        scene = on_every_rank(self.team, lambda: self.variant(request.values))
        controllers, interpolation = code_of(self.controllers), f"{request.interpolation!r}"
        told = {**settings.told, "controllers": controllers, "interpolation": interpolation}
        refuse_different_arguments(told, self.team)
        on_root = self.team.size > 1 and not self.team.collective_functions
        steps = Alone() if on_root else self.team

        def begin() -> SteppedScene:
            start = replace(self, team=steps).start_of(scene, settings.t_start, settings.about)
            if settings.about is None:
                tell_overlapping_surfaces(start.scene, start.x, steps)
            bodies = {body.name: body for body in self.bodies}
            return stepped_scene(
                start, settings, bodies, self.controllers, steps, inputs=request.inputs, outputs=request.outputs,
                interpolation=request.interpolation, open_end=request.open_end,
            )  # fmt: skip

        return SteppedMachine(on_every_rank(self.team, begin), self.team)

    @checked("file")
    def ensemble(
        self,
        samples: Mapping[str, ArrayLike] | Sequence[Mapping[str, Any]],
        outputs: Mapping[str, VariantOutput],
        *,
        t_end: float,
        rtol: float = 1e-6,
        h: float | None = None,
        t_start: float = 0.0,
        integrator: Integrator | Literal["auto"] = "auto",
        max_step: float | None = None,
        max_steps: int | None = None,
        max_seconds: float | None = None,
        executor: Executor | None = None,
        workers: int | None = None,
        file: str | Path | None = None,
        progress: bool = False,
    ) -> Ensemble:
        """Run many variants of the machine, and keep some outputs of each.

        The outputs are the same to the bit whoever runs the variants and in what order.  A variant that fails is
        listed with its values in the result's ``failures``, and the others go on.

        Args:
            samples: the parameters' values, arrays (n, ...) by their names, or a list of n mappings.
            outputs: by name functions of a variant's trajectory that give a number, or an array of the same shape for
                all variants; or ``flexmbd.ensemble.Sampled`` series, for which no trajectory need be made.
            t_end: end time (s).
            rtol: as of ``System.simulate``, as all arguments up to ``max_seconds``.
            h: fixed step (s).
            t_start: start time (s).
            integrator: the method; a named one spares each variant the choice.
            max_step: longest step (s).
            max_steps: steps after which a variant fails.
            max_seconds: s of the wall's clock after which a variant fails.
            executor: who runs the variants: any ``concurrent.futures.Executor``, as ProcessPoolExecutor(),
                mpi4py.futures.MPIPoolExecutor(main=False) or dask's Client(...).get_executor(); by default threads of
                this process.  To executors other than thread pools the machine and the outputs are sent, so these
                must pickle.
            workers: how many the executor has; by default as many as there are processors, and those that show up.
            file: an HDF5 file that the outputs are streamed to.  If it holds a part of the very same ensemble, as
                one that was killed leaves, only what is missing is run.
            progress: show a progress bar.

        Raises:
            SceneError: samples, outputs or arguments do not fit, or all variants failed; the message has the first.
            RecordError: the file cannot be written, or is of another ensemble.
            EnsembleError: a worker was lost; names the variants that it may have been at.
        """
        if self.team.size > 1:
            raise SceneError("an ensemble runs each variant on one process: build the scene without a team")
        settings = RunSettings(
            t_end,
            rtol=rtol,
            h=h,
            t_start=t_start,
            integrator=integrator,
            max_step=max_step,
            max_steps=max_steps,
            max_seconds=max_seconds,
        )
        refuse_no_truth(progress=progress)
        refuse_executor(executor, workers)
        refuse_outputs(outputs)
        values = Samples(samples)
        self._refuse_unknown(values.names)
        method = integrator if isinstance(integrator, str) else integrator.name
        options = (t_end, rtol, h, t_start, method, max_step, max_steps)
        sampled = {name: ask for name, ask in outputs.items() if isinstance(ask, Sampled)}
        for ask in sampled.values():
            ask.check(self.scene, t_start, t_end)
        machine = self.scene.digest(), code_of(self.controllers)
        digest = study_digest(self.scene, machine, self.parameters, values.digest(), options, outputs)
        batch = self._batch_runs(settings, sampled) if len(sampled) == len(outputs) else None
        study = Study(partial(self.run, settings), outputs, shared=not self.scene.is_shared, batch=batch)
        return run_ensemble(
            study, values, digest, executor=executor, workers=workers, file=file, progress=progress
        )
