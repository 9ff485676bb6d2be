"""Trajectory: the result of a simulation, by frame, joint and body."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.errors import SceneError
from flexmbd.files.result_table import ResultTable
from flexmbd.given import is_number, refuse_other
from flexmbd.multibody.bodies.body import Body, FlexibleBody, Frame
from flexmbd.multibody.bodies.continuum_body import ContinuumBody
from flexmbd.multibody.bodies.pseudo_rigid_body import PseudoRigidBody
from flexmbd.multibody.force.protocol import Force
from flexmbd.multibody.interiors.scene_interiors import InteriorRecord
from flexmbd.multibody.joint.connection import Connection
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.kernels.physics.time_functions import evaluate_times
from flexmbd.multibody.kernels.reading.force_tables import force_elements, keep_forces
from flexmbd.multibody.kernels.sampling.series import body_series, energy_series, force_series, frame_series
from flexmbd.multibody.motion.instant import Instant
from flexmbd.multibody.motion.memory_series import memory_series
from flexmbd.multibody.motion.reaction import coordinate_force, reactions
from flexmbd.multibody.plan.compiled_scene import CompiledScene, add_probe
from flexmbd.multibody.results.energy import Energy
from flexmbd.multibody.results.momentum import Momentum, momentum_of
from flexmbd.multibody.scene_index import Slots
from flexmbd.multibody.start.independent_rows import decompose_rows
from flexmbd.multibody.start.redundancy import balancing_multipliers, minimum_norm_multipliers
from flexmbd.multibody.team import Team
from flexmbd.record.stress_field import StressField
from flexmbd.run.columns import table_columns, table_times, tabulate
from flexmbd.run.dense_output import motion_between
from flexmbd.run.departure import Departure
from flexmbd.run.recording import BodyRecording
from flexmbd.run.result_file import Runnable, SavedRun, load_run, save_run
from flexmbd.run.stats import Stats

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from flexmbd.run.checkpoint import Checkpoint
    from flexmbd.run.event import Occurrence
    from flexmbd.visual import Drawn, Look, StressModel

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Time series of a machine; arrays run over the accepted steps, start included.

    It can be pickled and deep-copied.  A copy answers for the copied bodies and joints, not for the first ones: take
    them from its ``bodies``, or copy system, frames and trajectory together, as one tuple.

    Attributes:
        scene: the compiled scene, with its redundant rows.
        t: (nt,) s.
        x: (nt, nx) configurations.  v, a: (nt, nv) velocities and accelerations.
        row_multipliers: (nt, m) reactions of the loop rows (N or N m); of redundant rows any that act alike.
        stats: cost and residuals.
        bodies: name to body.
        team: who writes files.
        events: what took place, in order.
        checkpoints: states to restart from, at the times asked for.
        interior_rows: records of bodies with history at each instant; empty without any.
        departures: with what the machine goes on from breaks of functions of time, at which the rows hold what was
            just before.
        recordings: fields of bodies with history, where the simulation was given a recording.
        kept_rows: the independent rows, of which ``row_multipliers`` holds the reactions; None: there are no others.
    """

    scene: CompiledScene
    t: FloatArray
    x: FloatArray
    v: FloatArray
    a: FloatArray
    row_multipliers: FloatArray
    stats: Stats
    bodies: Mapping[str, Body]
    team: Team
    events: tuple[Occurrence, ...] = ()
    checkpoints: tuple[Checkpoint, ...] = ()
    interior_rows: tuple[InteriorRecord, ...] = ()
    departures: tuple[Departure, ...] = ()
    kept_rows: tuple[int, ...] | None = None
    recordings: tuple[BodyRecording, ...] = ()

    def __repr__(self) -> str:
        """What ran, how long and in how many steps; arrays are asked for by name."""
        n = len(self.bodies)
        return (
            f"<Trajectory of {n} {'body' if n == 1 else 'bodies'}, {self.scene.nv} velocities: "
            f"{self.t[0]:.6g} to {self.t[-1]:.6g} s in {len(self.t) - 1} steps>"
        )

    @cached_property
    def multipliers(self) -> FloatArray:
        """(nt, m) reactions of the loops (N or N m), of redundant rows the smallest that act alike."""
        if self.kept_rows is None:
            return self.row_multipliers
        work = new_work(self.scene.plan)
        return minimum_norm_multipliers(self.scene, work, self.x, self.row_multipliers, kept=self.kept_rows)

    def position(self, frame: Frame, *, t: ArrayLike | None = None) -> FloatArray:
        """(nt, 3) m, position of the frame's origin in the inertial frame; or at times ``t`` (k,)."""
        return self._frame(frame, t)[:, :3]

    def rotation(self, frame: Frame, *, t: ArrayLike | None = None) -> FloatArray:
        """(nt, 3, 3) rotations from the frame's axes to inertial ones; or at times ``t`` (k,)."""
        return self._frame(frame, t)[:, 3:12].reshape(-1, 3, 3)

    def velocity(self, frame: Frame, *, t: ArrayLike | None = None) -> FloatArray:
        """(nt, 3) m/s, velocity of the frame's origin, in inertial axes; or at times ``t`` (k,)."""
        return self._frame(frame, t)[:, 12:15]

    def angular_velocity(self, frame: Frame, *, t: ArrayLike | None = None) -> FloatArray:
        """(nt, 3) rad/s, angular velocity of the frame, in inertial axes; or at times ``t`` (k,)."""
        return self._frame(frame, t)[:, 15:18]

    def acceleration(self, frame: Frame, *, t: ArrayLike | None = None) -> FloatArray:
        """(nt, 3) m/s^2, acceleration of the frame's origin, in inertial axes; or at times ``t`` (k,)."""
        return self._frame(frame, t)[:, 18:21]

    def body_motion(self, *, t: ArrayLike | None = None) -> FloatArray:
        """(nt, links, 21) of all bodies' axes, by their rows in the compiled scene, or at times ``t`` (k,).

        Position (3) m, rotation (9), velocity (3) m/s, angular velocity (3) rad/s, acceleration (3) m/s^2, in inertial
        axes: in one pass what ``position`` and its like tell frame by frame.
        """
        x, v, a = (self.x, self.v, self.a) if t is None else self.motion(t)
        plan = self.scene.plan
        out = np.zeros((len(x), len(plan.tree), 21))
        body_series(plan, new_work(plan), x, v, a, out)
        return out

    def beta(self, connection: Connection, *, t: ArrayLike | None = None) -> FloatArray:
        """Joint coordinates, (nt,) where there is one, else (nt, k); or at times ``t``."""
        x = self.x if t is None else self.motion(t)[0]
        return _single(x[:, self._slots(connection).x])

    def beta_rate(self, connection: Connection, *, t: ArrayLike | None = None) -> FloatArray:
        """Joint velocities, (nt,) where there is one, else (nt, k); or at times ``t``."""
        v = self.v if t is None else self.motion(t)[1]
        return _single(v[:, self._slots(connection).v])

    def q(self, body: Body, *, t: ArrayLike | None = None) -> FloatArray:
        """Modal coordinates (nt, n); or (k, n) at times ``t`` (k,), or (n,) at one time."""
        slots = self._modal_slots(body)
        if t is None:
            return self.x[:, slots.x]
        found = self.motion(t)[0][:, slots.x]
        return found if np.ndim(t) else found[0]

    def q_rate(self, body: Body, *, t: ArrayLike | None = None) -> FloatArray:
        """Rates of the modal coordinates (nt, n); or (k, n) at times ``t`` (k,), or (n,) at one time."""
        slots = self._modal_slots(body)
        if t is None:
            return self.v[:, slots.v]
        found = self.motion(t)[1][:, slots.v]
        return found if np.ndim(t) else found[0]

    def stretch(self, body: PseudoRigidBody, *, t: ArrayLike | None = None) -> FloatArray:
        """(nt, 3, 3) stretches U, in body axes; or at times ``t`` (k,)."""
        if body.rigid:
            return np.tile(np.eye(3), (len(self.t) if t is None else np.size(t), 1, 1))
        return body.stretch_of(self.q(body, t=None if t is None else np.atleast_1d(t)))

    def deformation_gradient(self, body: PseudoRigidBody, *, t: ArrayLike | None = None) -> FloatArray:
        """(nt, 3, 3) F = R U, from the undeformed body's axes to inertial ones; or at times ``t`` (k,)."""
        return self.rotation(body.frame(body.solid.com), t=t) @ self.stretch(body, t=t)

    def at(self, t: float) -> Instant:
        """The machine at a time (s).

        Between the ends of steps the reactions of loops are those that the interpolated motion needs: forces are then
        evaluated anew, which is collective over the team where they are Python callables.  What the joints of a machine
        with bodies that have a history pass on is told by ``reaction`` alone.

        Raises:
            SceneError: a time outside the trajectory, or not a single time.
        """
        if not is_number(t):
            raise SceneError(f"one time in s is wanted, got {t!r:.100}")
        x, v, a = (part[0] for part in self.motion(t))
        return Instant(self.scene, float(t), x, v, a, self._multipliers(float(t), x, v, a))

    def _multipliers(self, t: float, x: FloatArray, v: FloatArray, a: FloatArray) -> FloatArray | None:
        """(m,) at a time (s) at which the machine moves so; None where what interiors exert is not known."""
        if self.scene.interiors is not None:
            return None
        row = int(np.argmin(np.abs(self.t - t)))
        if self.t[row] == t or not self.row_multipliers.shape[1]:
            return self.multipliers[row]
        work = new_work(self.scene.plan)
        self.scene.forget_failure()
        evaluate_times(self.scene.plan, t, work.time)
        rank = sum(place.rank for place in decompose_rows(self.scene, work, self.x[row]))
        return balancing_multipliers(self.scene, work, x, v, a, rank=rank)

    def energy(self, *, t: ArrayLike | None = None) -> Energy:
        """Kinetic, elastic, gravitational energy and that of springs and stops at each instant, or at times ``t``."""
        if t is None:
            return self._energy
        x, v, _ = self.motion(t)
        return self._energy_of(x, v)

    def energies(self, body: ContinuumBody) -> dict[str, FloatArray]:
        """Energies (J) of a body's interior by name, each (nt,): kinetic, elastic, plastic, ...; see ``Interior``.

        Those of its frames, which are rigid bodies of the machine, are in ``energy()``.

        Raises:
            SceneError: the body is not in this trajectory.
        """
        k = self._interior(body)
        told = [row.energies[k] for row in self.interior_rows]
        return {name: np.array([energies[name] for energies in told]) for name in told[0]}

    def outer_forces(self, body: ContinuumBody) -> dict[str, FloatArray]:
        """Forces (N) of contact planes and loads on a body with history by name, each (nt, 3), in inertial axes.

        Raises:
            SceneError: the body is not in this trajectory.
        """
        k = self._interior(body)
        told = [row.outer_forces[k] for row in self.interior_rows]
        return {name: np.array([forces[name] for forces in told]) for name in told[0]}

    def interior_wrench(self, body: ContinuumBody, interface: str) -> FloatArray:
        """(nt, 6) force (N) and moment (N m) that a body with history exerts on the frame of one of its interfaces.

        In inertial axes, about the frame's origin.  What its joints pass on to the frame tells ``reaction``.

        Raises:
            SceneError: the body is not in this trajectory.
            InterfaceError: it has no such interface.
        """
        k = self._interior(body)
        body.frame(interface)
        bodies = () if self.scene.interiors is None else self.scene.interiors.bodies
        first = sum(len(other.interior.frames) for other in bodies[:k])
        row = first + [frame.name for frame in body.interior.frames].index(interface)
        return np.array([one.wrenches[row] for one in self.interior_rows])

    def remembered(self, force: Force, *, t: ArrayLike | None = None) -> dict[str, FloatArray]:
        """What a force element with memory remembers, by name, each (nt,); or of the step's beginning at times ``t``.

        Of elasto-plastic springs ``deformation`` (m or rad), ``plastic_deformation``, ``plastic_way``, the sum of its
        changes, and ``dissipated`` (J); of a law of one's own what it has named.

        Raises:
            SceneError: the force remembers nothing, or is not in the scene.
        """
        return memory_series(self.scene.index, force, self.x if t is None else self.motion(t)[0])

    def recorded(self, body: ContinuumBody) -> BodyRecording:
        """The fields of a body with history over time: nodes' motion, stress, what its form remembers.

        Raises:
            SceneError: the body is not in this trajectory, or the simulation had no recording.
        """
        self._interior(body)
        for one in self.recordings:
            if one.body is body:
                return one
        raise SceneError(
            f"the fields of body {body.name!r} were not kept; simulate with recording=fm.Recording(path, every=...)"
        )

    def _interior(self, body: ContinuumBody) -> int:
        """Which of the interiors is the body's."""
        bodies = () if self.scene.interiors is None else self.scene.interiors.bodies
        for k, other in enumerate(bodies):
            if other is body:
                return k
        raise SceneError(f"body {body.name!r} has no interior in this trajectory")

    def drive(self, connection: Connection) -> FloatArray:
        """(nt,) N m or N: what drives a joint: prescribed motion, joint torques and forces, users' functions.

        Springs, dampers, stops, friction and forces on frames are no drive.  Given forces are evaluated anew, which
        is collective over the team where they are Python callables.  Of a joint held by constraints it is what
        its reaction does along its only coordinate.
        """
        if connection in self.scene.index.closures and len(connection.joint.angular) == 1:
            return coordinate_force(connection.joint, self.reaction(connection))
        slots = self._slots(connection)
        plan = self.scene.plan
        elements = force_elements(plan)
        plan = keep_forces(plan, [], np.array([not one.drives for one in elements.behaviour], bool))
        if not (force_elements(plan).time >= 0).any():
            plan = plan.replace(times=plan.times[:0])
        work, out = new_work(plan), np.zeros_like(self.v)
        self.scene.callbacks.reset()
        for rows in self._stretches():
            series = (self.t, self.x, self.v, self.a, self.multipliers, out)
            force_series(plan, work, *(part[rows] for part in series))
        self.scene.refuse_failed(work)
        return _single(out[:, slots.v])

    def reaction(self, connection: Connection) -> FloatArray:
        """(nt, 6) force (N) and moment (N m) that a joint's parent exerts on its child through the joint.

        The moment is about the origin of the child's frame; both are in that frame's axes.  All that
        the joint passes on counts: what it holds, and along its free axes the forces of motors,
        springs and friction on its coordinates and of its prescribed motion.

        Raises:
            SceneError: the joint is of another scene.
        """
        found = [
            reactions(self.scene, connection, *(p[rows] for p in (self.t, self.x, self.v, self.a, self.multipliers)))
            for rows in self._stretches()
        ]
        return np.vstack(found)

    def configuration(self, t: ArrayLike) -> FloatArray:
        """(k, nx) configurations at times ``t`` (s); see ``motion``."""
        return self.motion(t)[0]

    def motion(self, t: ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Configurations (k, nx), velocities and accelerations (k, nv) at times ``t`` (s).

        Between the steps' ends they come from x, v, a at both ends, with errors of order 6, 5, 4 in the
        step: of x at most h^6 / 46080 times the motion's sixth derivative, that is 2e-8 rad where an
        oscillation of 1 rad takes 20 steps a period.  This lies below rtol for methods up to order 5; one
        of order 8 takes steps so long that it may be some thirty times rtol.  Where that matters take the
        values at the steps' ends, or a fixed step.  Closed loops are open by as much.  Modal coordinates of bodies
        that vibrate more than once in two steps follow straight lines where their accelerations contradict the rest.

        Raises:
            SceneError: a time outside the trajectory, or not a time.
        """
        return motion_between(self.scene.plan, (self.t, self.x, self.v, self.a), self.departures, t)

    def momentum(self, *, t: ArrayLike | None = None) -> Momentum:
        """Centre of mass, momentum and angular momentum of all bodies together at each instant, or at times ``t``.

        Raises:
            SceneError: the machine has no mass, or bodies with history, whose interiors have momenta of their own.
        """
        x, v = (self.x, self.v) if t is None else self.motion(t)[:2]
        return momentum_of(self.scene, x, v)

    def table(
        self,
        *things: Connection | Frame | Body,
        reactions: Sequence[Connection] = (),
        energies: bool | None = None,
        t: ArrayLike | None = None,
        every: float | None = None,
    ) -> ResultTable:
        """Series as a table with units: ``.values``, ``.column(name)``, ``.save("run.csv")``, ``.to_pandas()``.

        Args:
            things: joints (coordinates, rates), frames (position, quaternion scalar first, velocity, angular velocity,
                acceleration) and bodies (their frames; modal coordinates of flexible ones).  Without any: all joints
                that have coordinates, and all bodies.
            reactions: joints whose reactions are told, at the ends of steps alone.
            energies: whether the energies are told; by default where no things are named.
            t: (k,) s, when; by default at the ends of steps.
            every: s between equal times from the start, and the end, in place of ``t``.

        Raises:
            SceneError: times outside the trajectory, ``t`` and ``every`` together, a thing of another machine, or two
                columns of one name.
        """
        columns = table_columns(self, things, reactions, energies=energies)
        return tabulate(self, columns, t=table_times(self.t, t, every))

    def save(self, path: str | Path) -> Path:
        """Write what ran to an HDF5 file, whole or not at all, on rank 0.  Collective over the team.

        It is read back by ``Trajectory.load``, and by any HDF5 library: t, x, v, a, the names of the coordinates, and
        under "series" the table of all joints, bodies and energies.  Checkpoints are files of their own.

        Raises:
            RecordError: it cannot be written.
            SceneError: the path is none.
        """
        refuse_other(path, (str, Path), "path", wanted='a file, "run.h5"')
        saved = SavedRun(**{one.name: getattr(self, one.name) for one in fields(SavedRun)})
        save_run(Path(path), saved, self.table(), scene=self.scene, team=self.team)
        return Path(path)

    @staticmethod
    def load(path: str | Path, machine: Runnable, **values: Any) -> Trajectory:
        """The trajectory that ``save`` wrote, of a machine that is at hand: all questions are answered as before.

        Not collective: each rank reads the file.

        Args:
            path: of the file.
            machine: the System, or what its ``compile`` gave, with the same bodies, joints and forces.
            values: of the parameters with which it ran, of a compiled machine.

        Raises:
            RecordError: the file is missing, damaged, of another kind, or of another machine.
            SceneError: the path is none, the machine is none, or a value does not fit.
        """
        refuse_other(path, (str, Path), "path", wanted='a file, "run.h5"')
        refuse_other(machine, Runnable, "machine", wanted="a System, or what its compile() gave")
        scene, bodies, team = machine.compiled_parts(values)
        saved = load_run(Path(path), scene)
        parts = {one.name: getattr(saved, one.name) for one in fields(saved)}
        return Trajectory(scene, bodies={body.name: body for body in bodies}, team=team, **parts)

    def plot(
        self,
        *series: tuple[str, Drawn],
        path: str | Path | None = None,
        ylabel: str = "",
        title: str = "",
    ) -> Figure:
        """Plot (label, what) pairs over time; without any, the energies.

        ``what`` is a joint (its coordinates), a frame (its position), a flexible body (its modal coordinates), a
        function of times (k,) that gives values (k,) or (k, m), or values at the instants ``t``.  All but the
        last are drawn between the steps as well, from the dense output.  Events are marked.

        See ``flexmbd.visual.plot_series``, also for what is raised.
        """
        import flexmbd.visual as visual  # matplotlib loads only here

        return visual.plot_series(self, series, path=path, ylabel=ylabel, title=title)

    def animate(
        self,
        path: str | Path,
        *,
        between: tuple[float, float] | None = None,
        slow_motion: float | None = None,
        fps: int = 30,
        size: tuple[int, int] = (1280, 720),
        amplification: float = 1.0,
        models: Mapping[FlexibleBody, StressModel] | None = None,
        looks: Mapping[ContinuumBody, Look] | None = None,
        progress: bool = False,
    ) -> Path:
        """Film the machine off-screen to .mp4 or .gif; bodies with history as they were recorded.

        See ``flexmbd.visual.animate`` for the arguments and for what is raised.
        """
        import flexmbd.visual as visual  # pyvista loads only here

        return visual.animate(
            self,
            path,
            between=between,
            slow_motion=slow_motion,
            fps=fps,
            size=size,
            amplification=amplification,
            models=models,
            recordings=self.recordings,
            looks=looks,
            progress=progress,
        )

    def stress(
        self, body: FlexibleBody | ContinuumBody, model: StressModel | None = None, *, t: float
    ) -> StressField:
        """Stress of a body on its mesh at time ``t`` (s).

        Of a flexible body with the model that it was reduced from; collective over the model's communicator.  Of a
        body with history at the recorded instant nearest to ``t``.

        Raises:
            SceneError: a flexible body without a model, or a body with history that was not recorded.
            RecordError: the record holds no nodal modes: reduce the body with ``keep=Keep(modes=True)``.
        """
        if isinstance(body, ContinuumBody):
            return self.recorded(body).stress(t)
        if model is None:
            raise SceneError(f"the stress of body {body.name!r} needs the model that it was reduced from")
        return model.stress_field(self.scene.index.now(body).record, self.q(body, t=t))

    def _stretches(self) -> Iterator[slice]:
        """Blocks of rows with the plan of their forces: all at once, or row by row with the interiors' wrenches."""
        if self.scene.interiors is None:
            yield slice(None)
            return
        for k, row in enumerate(self.interior_rows):
            self.scene.interiors.apply_wrenches(self.scene.plan, row.wrenches)
            yield slice(k, k + 1)

    @cached_property
    def _energy(self) -> Energy:
        return self._energy_of(self.x, self.v)

    def _energy_of(self, x: FloatArray, v: FloatArray) -> Energy:
        plan = self.scene.plan
        out = np.zeros((len(x), 4))
        none, scratch = np.zeros((2, self.scene.nv))
        energy_series(plan, new_work(plan), x, v, none, scratch, out)
        return Energy(*out.T)

    def _frame(self, frame: Frame, t: ArrayLike | None = None) -> FloatArray:
        """(nt, 21) rows of ``frame_series``, or (k, 21) at times ``t`` (k,)."""
        x, v, a = (self.x, self.v, self.a) if t is None else self.motion(t)
        plan = add_probe(self.scene, frame)
        out = np.zeros((len(x), 21))
        frame_series(plan, new_work(plan), len(plan.frames) - 1, x, v, a, out)
        return out

    def _slots(self, connection: Connection) -> Slots:
        return self.scene.index.coordinates(connection)

    def _modal_slots(self, body: Body) -> Slots:
        return self.scene.index.modal(body)


def _single(values: FloatArray) -> FloatArray:
    return values[:, 0] if values.shape[1] == 1 else values
