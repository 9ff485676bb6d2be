"""How a run is repeated from its own first row: by other methods, tolerances and steps, for its report."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np

from flexmbd.integrate.automatic import IntegratorChoice, choose
from flexmbd.integrate.protocol import Integrator
from flexmbd.multibody.bodies.body import Body
from flexmbd.multibody.interiors.scene_interiors import NO_INTERIORS
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.results.explain import explain
from flexmbd.multibody.start.consistent_start import Start, consistent_start
from flexmbd.multibody.team import Alone, Team
from flexmbd.run.asked import Asked, Rung
from flexmbd.run.controller import Controller
from flexmbd.run.input_values import evaluate_inputs
from flexmbd.run.settings import RunSettings
from flexmbd.run.simulation import run
from flexmbd.run.snapshot import new_snapshot
from flexmbd.run.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class Repetition:
    """What a run was asked, as far as its report repeats it; it pickles, whatever was asked besides.

    Attributes:
        rtol, h, max_step, integrator: as of ``System.simulate``.
        obstacle: why it cannot be repeated; empty where it can.
    """

    rtol: float
    h: float | None
    max_step: float | None
    integrator: Integrator | Literal["auto"]
    obstacle: str

    @staticmethod
    def of(settings: RunSettings, scene: CompiledScene, controllers: Sequence[Controller], team: Team) -> Repetition:
        """That of a run by these settings."""
        obstacle = ""
        if scene.interiors is not None:
            obstacle = "bodies with history have changed since, and do not go back to the start by themselves"
        elif controllers:
            obstacle = "controllers are called by their own state, which is not that of the start"
        elif any(event.action is not None for event in settings.events):
            obstacle = "actions of events may change more than the machine"
        elif team.collective_functions:
            obstacle = "functions of the machine are collective, and a report is written by rank 0 alone"
        return Repetition(settings.rtol, settings.h, settings.max_step, settings.integrator, obstacle)

    def asked(self, trajectory: Trajectory) -> Asked:
        """What was asked, in terms of the machine as it ran.

        Raises:
            FlexmbdError: its first row is no start.
        """
        scene, bodies = trajectory.scene, trajectory.bodies
        if scene.interiors is not None:
            stepped = f"integrator: {trajectory.stats.integrator}"
            return Asked(self.rtol, self.h, None, stepped, None, self.obstacle)
        with _quietly(scene):
            start = _start(trajectory)
            if isinstance(self.integrator, str):
                choice = choose(start, t=float(trajectory.t[0]), rtol=self.rtol, h=self.h)
            else:
                choice = IntegratorChoice(self.integrator, "as asked")
        method = choice.method
        explained = f"{explain(start)}\nintegrator: {method.name} ({choice.why})"
        repeat = partial(_repeated, trajectory, bodies, start, self.max_step)
        return Asked(self.rtol, self.h, method, explained, repeat, self.obstacle)


@contextmanager
def _quietly(scene: CompiledScene) -> Iterator[None]:
    """On this rank alone, and what the first run has told is not told again."""
    with scene.callbacks.alone(), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


def _start(trajectory: Trajectory) -> Start:
    """The consistent start of a run: its first row."""
    scene, held = trajectory.scene, np.zeros(trajectory.scene.nv, bool)
    work = new_work(scene.plan)
    evaluate_inputs(scene, work, float(trajectory.t[0]))
    return consistent_start(
        scene, work, trajectory.x[0], trajectory.v[0], held_x=held, held_v=held, memories=NO_INTERIORS
    )


def _repeated(
    trajectory: Trajectory, bodies: Mapping[str, Body], start: Start, max_step: float | None, rung: Rung
) -> Trajectory:
    """The run once more, up to where it came.

    Raises:
        FlexmbdError: the method refuses the machine, or a step failed.
    """
    t_start, t_end = float(trajectory.t[0]), float(trajectory.t[-1])
    most = 20 * (len(trajectory.t) + 1000) if rung.h is None else None
    settings = RunSettings(
        t_end, rtol=rung.rtol, h=rung.h, t_start=t_start, integrator=rung.method, max_step=max_step, max_steps=most,
        checkpoints=[t for t in rung.times if t < t_end],
    )  # fmt: skip
    with _quietly(start.scene):
        snapshot = new_snapshot(start, rung.method, t_start=t_start, t_end=t_end, rtol=rung.rtol, h=rung.h)
        return run(start, bodies, settings=settings, method=rung.method, snapshot=snapshot, team=Alone())
