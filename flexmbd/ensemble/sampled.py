"""Outputs that are series at given times: asked of a trajectory, or taken from a prepared run without one."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.errors import SceneError
from flexmbd.given import checked, numbers, refuse_other
from flexmbd.multibody.bodies.body import FlexibleBody, Frame
from flexmbd.multibody.bodies.pseudo_rigid_body import PseudoRigidBody
from flexmbd.multibody.joint.connection import Connection
from flexmbd.multibody.kernels.base.arrays import Plan, Work, new_work
from flexmbd.multibody.kernels.reading.tree import move_frames
from flexmbd.multibody.kernels.sampling.interpolation import interpolated_coordinates, motion_at
from flexmbd.multibody.kernels.sampling.series import frame_series
from flexmbd.multibody.motion.quantity import Acceleration, Position, Velocity
from flexmbd.multibody.plan.compiled_scene import CompiledScene, add_probe
from flexmbd.run.prepared import PreparedRuns, SteppedRows
from flexmbd.run.trajectory import Trajectory

FloatArray = NDArray[np.float64]
#: Where a frame lies in its body: p (3,) m, R (3, 3).
Placing: TypeAlias = Callable[[Frame], tuple[FloatArray, FloatArray]]

_ORDERS = {Position: 0, Velocity: 1, Acceleration: 2}


@dataclass(frozen=True, eq=False)
class Sampled:
    """An output of a variant: position, velocity or acceleration of a frame, a joint or a flexible body at given times.

    It gives the numbers that the trajectory's functions give at these times; of a frame they are in inertial axes.  An
    ensemble whose outputs are all of this kind makes no trajectories where it can do without.

    Attributes:
        output: ``flexmbd.output.Position(frame)`` (also of a joint, of a body's modes), ``Velocity``, ``Acceleration``.
        t: s, one time or (k,) times; the output then has a first axis of k.

    Raises:
        SceneError: no such output, or no times.
    """

    output: Position | Velocity | Acceleration
    t: ArrayLike

    def __post_init__(self) -> None:
        wanted = "fm.output.Position, Velocity or Acceleration of a frame, a joint or a body"
        refuse_other(self.output, (Position, Velocity, Acceleration), "what is sampled", wanted=wanted)
        kinds = (Frame, Connection, FlexibleBody, PseudoRigidBody)
        refuse_other(self.output.of, kinds, "what is sampled", wanted=wanted)
        t = numbers(self.t)
        if t.ndim > 1 or not t.size or not np.isfinite(t).all():
            raise SceneError(f"an output is sampled at a time, or at an array (k,) of times, in s, got {self.t!r:.100}")

    @property
    def times(self) -> FloatArray:
        """(k,) s."""
        return np.atleast_1d(numbers(self.t))

    def check(self, scene: CompiledScene, t_start: float, t_end: float) -> None:
        """Raise SceneError where the scene has nothing of the kind, or a time lies outside the simulation (s)."""
        times = self.times
        if times.min() < t_start or times.max() > t_end:
            raise SceneError(
                f"an output is sampled from {times.min():g} to {times.max():g} s, but the simulation runs from "
                f"{t_start:g} to {t_end:g} s"
            )
        of = self.output.of
        if isinstance(of, Frame):
            scene.index.row_of(of)
        elif isinstance(of, Connection):
            scene.index.coordinates(of)
        else:
            scene.index.modal(of)

    def meaning(self, scene: CompiledScene) -> str:
        """Which quantity of the scene at which times; the same in any process."""
        of, index = self.output.of, scene.index
        place: object
        if isinstance(of, Frame):
            where = of.p_BF_B.tolist(), of.R_BF.tolist()
            place = (index.row_of(of), of.interface, where, scene.sources.rows_of.get(of))
        else:
            place = of.name
        return f"{type(self.output).__name__} {place} {np.shape(self.t)} {self.times.tolist()}"

    @checked()
    def __call__(self, run: Trajectory) -> FloatArray:
        """The output by a trajectory."""
        of, t = self.output.of, self.times
        if isinstance(of, Frame):
            ask = {Position: run.position, Velocity: run.velocity, Acceleration: run.acceleration}[type(self.output)]
            found = ask(of, t=t)
        else:
            found = self.of_motion(run.scene, run.motion(t))
        return self.shaped(found)

    def of_motion(self, scene: CompiledScene, motion: tuple[FloatArray, FloatArray, FloatArray]) -> FloatArray:
        """(k, n) or, of one coordinate, (k,) of a joint or of modes, by x (k, nx), v and a (k, nv)."""
        of: Any = self.output.of
        order = _ORDERS[type(self.output)]
        slots = scene.index.coordinates(of) if isinstance(of, Connection) else scene.index.modal(of)
        found = motion[order][:, slots.x if order == 0 else slots.v]
        return found[:, 0] if isinstance(of, Connection) and found.shape[1] == 1 else found

    def shaped(self, found: FloatArray) -> FloatArray:
        """A series (k, ...) as the output has it: of a single time without its first axis."""
        return found if np.ndim(self.t) else found[0]


class Sampler:
    """Takes outputs from the runs of one workspace."""

    def __init__(self, outputs: Mapping[str, Sampled], workspace: PreparedRuns) -> None:
        self._workspace = workspace
        by_times: dict[bytes, list[tuple[str, Sampled]]] = {}
        for name, output in outputs.items():
            by_times.setdefault(output.times.tobytes(), []).append((name, output))
        self._asked = [(asked[0][1].times, asked) for asked in by_times.values()]
        self._probes: dict[str, tuple[Plan, Work]] = {}
        for name, output in outputs.items():
            if isinstance(output.output.of, Frame):
                plan = add_probe(workspace.scene, output.output.of)
                self._probes[name] = plan, new_work(plan)
        self._coordinates = interpolated_coordinates(workspace.plan)

    def outputs(self, rows: SteppedRows, placing: Placing) -> dict[str, FloatArray]:
        """The outputs of a run by their names; ``placing`` says where frames lie in this variant."""
        found: dict[str, FloatArray] = {}
        if len(self._coordinates[1]):  # quaternions, whose bodies may have become round
            self._coordinates = interpolated_coordinates(self._workspace.plan)
        for times, asked in self._asked:
            motion = motion_at(self._coordinates, (rows.t, rows.x, rows.v, rows.a), times)
            for name, output in asked:
                frame = output.output.of
                if isinstance(frame, Frame):
                    found[name] = output.shaped(self._of_frame(name, output, motion, placing(frame)))
                else:
                    found[name] = output.shaped(output.of_motion(self._workspace.scene, motion)).copy()
        return found

    def _of_frame(
        self,
        name: str,
        output: Sampled,
        motion: tuple[FloatArray, FloatArray, FloatArray],
        place: tuple[FloatArray, FloatArray],
    ) -> FloatArray:
        plan, work = self._probes[name]
        move_frames(plan, self._workspace.plan, *place)
        series = np.zeros((len(motion[0]), 21))
        frame_series(plan, work, len(plan.frames) - 1, *motion, series)
        first = {Position: 0, Velocity: 12, Acceleration: 18}[type(output.output)]
        return series[:, first : first + 3]
