"""Trajectory: the result of a simulation, by frame, joint and body."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.errors import PictureError, RecordError, SceneError
from flexmbd.files.result_table import ResultTable
from flexmbd.files.tree_file import is_kind
from flexmbd.given import checked, is_number, refuse_other
from flexmbd.multibody.bodies.body import Body, FlexibleBody, Frame
from flexmbd.multibody.bodies.continuum_body import ContinuumBody
from flexmbd.multibody.contact.surface_contact import SurfaceContact
from flexmbd.multibody.contact.touch import AnyContact
from flexmbd.multibody.exact_beam import ExactBeam
from flexmbd.multibody.force.protocol import WithStates
from flexmbd.multibody.force.states import States
from flexmbd.multibody.interiors.scene_interiors import InteriorRecord
from flexmbd.multibody.joint.connection import Connection
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.kernels.physics.time_functions import evaluate_times
from flexmbd.multibody.motion.instant import Instant
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.results.heat_factors import stress_in_machine
from flexmbd.multibody.results.port_series import tell_stress_of_modes
from flexmbd.multibody.start.independent_rows import decompose_rows
from flexmbd.multibody.start.redundancy import balancing_multipliers
from flexmbd.multibody.team import Team
from flexmbd.overflow import keep_overflow
from flexmbd.record.stress_field import StressField, StressModel
from flexmbd.run.controller import Controller
from flexmbd.run.recording import BodyRecording
from flexmbd.run.result_file import Runnable, SavedRun, load_run, save_run
from flexmbd.run.sampling import ControllerSamples, with_samples
from flexmbd.run.series.columns import table_columns
from flexmbd.run.series.contact_pressures import ContactPressures
from flexmbd.run.series.departure import Departure
from flexmbd.run.series.table_rows import table_times, tabulate
from flexmbd.run.stats import Stats
from flexmbd.run.stream_file import STREAM, load_stream

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from flexmbd.run.asked import Repeatable
    from flexmbd.run.checkpoint import Checkpoint
    from flexmbd.run.event import Occurrence
    from flexmbd.visual import Drawn, Look

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Trajectory(ContactPressures):
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
        events: those that took place, in order.
        checkpoints: states to restart from, at the times asked for.
        interior_rows: records of bodies with history at each instant; empty without any.
        departures: with what the machine goes on from breaks of functions of time, at which the rows hold what was
            just before.
        recordings: fields of bodies with history, where the simulation was given a recording.
        kept_rows: the independent rows, of which ``row_multipliers`` holds the reactions; None: there are no others.
        samples: measurements and inputs of each controller.
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
    samples: tuple[ControllerSamples, ...] = ()
    _repetition: Repeatable | None = None

    def __repr__(self) -> str:
        """The machine, the time and the number of steps; arrays are asked for by name."""
        n = len(self.bodies)
        return (
            f"<Trajectory of {n} {'body' if n == 1 else 'bodies'}, {self.scene.nv} velocities: "
            f"{self.t[0]:.6g} to {self.t[-1]:.6g} s in {len(self.t) - 1} steps>"
        )

    def _repr_html_(self) -> str:
        """Its text and, where pyvista can draw here, a picture of the start."""
        import flexmbd.visual.notebook as notebook  # pyvista loads only here

        return notebook.html_of(repr(self), lambda: notebook.still_of(self))

    def at(self, t: float) -> Instant:
        """The machine at a time (s).

        Between the ends of steps the reactions of loops are those that the interpolated motion needs: forces are then
        evaluated anew, which is collective over the team where they are Python callables.  What the joints of a machine
        with bodies that have a history pass on is told by ``reaction`` alone.

        Raises:
            SceneError: a time outside the trajectory, or not a single time.
        """
        if not is_number(t):
            raise SceneError(f"t must be one time in s, got {t!r:.100}")
        x, v, a = (part[0] for part in self.motion(t))
        return Instant(self.scene, float(t), x, v, a, self._multipliers(float(t), x, v, a))

    def sampled(self, controller: Controller) -> ControllerSamples:
        """Measurements and inputs of a controller at its samples.

        Raises:
            SceneError: it did not run here.
        """
        refuse_other(controller, Controller, "a controller", wanted="what scene.add_controller(...) gave")
        for one in self.samples:
            if one.name == controller.name:
                return one
        raise SceneError(f"{controller.what} did not run here")

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

    @checked("reactions", "energies")
    def table(
        self,
        *things: Connection | Frame | Body | ExactBeam | States | WithStates,
        reactions: Sequence[Connection] = (),
        energies: bool | None = None,
        t: ArrayLike | None = None,
        every: float | None = None,
    ) -> ResultTable:
        """Series as a table with units: ``.values``, ``.column(name)``, ``.save("run.csv")``, ``.to_pandas()``.

        Args:
            things: joints (coordinates, rates), frames (position, quaternion scalar first, velocity, angular velocity,
                acceleration), bodies (their frames; modal coordinates of flexible ones), exact beams (all sections as
                bodies; of each element the ``resultants``, along and about the section's tangent t, y and z) and states
                (in their own units).  Without any: all joints that have coordinates, all bodies and all states.
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

    @checked(error=RecordError)
    def save(self, path: str | Path) -> Path:
        """Write the trajectory to an HDF5 file, whole or not at all, by rank 0.

        Called on rank 0 alone, or on all ranks: each of these then returns once the file is written.  Where one run is
        saved first in the one way and then in the other, the other ranks do not wait for the second file.

        It is read back by ``Trajectory.load``, and by any HDF5 library: t, x, v, a, the names of the coordinates, and
        under "series" the table of all joints, bodies and energies.  Checkpoints are files of their own.

        Raises:
            RecordError: it cannot be written; on each rank that calls.
            SceneError: the path is none.
        """
        refuse_other(path, (str, Path), "path", wanted='a file, "run.h5"')
        saved = SavedRun(**{one.name: getattr(self, one.name) for one in fields(SavedRun)})
        with keep_overflow():
            save_run(Path(path), saved, self.table, scene=self.scene, team=self.team)
        return Path(path)

    @staticmethod
    @checked("path")
    def load(path: str | Path, machine: Runnable, **values: Any) -> Trajectory:
        """The trajectory that ``save`` wrote, of a machine that is at hand: all questions are answered as before.

        Or that ``simulate(..., stream=path)`` writes or wrote: of a run that goes on, or was killed, what is there so
        far.  Not collective: each rank reads the file.

        Args:
            path: of the file.
            machine: the System, or its compiled machine, with the same bodies, joints and forces.
            values: of the parameters with which it ran, of a compiled machine.

        Raises:
            RecordError: the file is missing, damaged, of another kind, or of another machine.
            SceneError: the path is none, the machine is none, or a value does not fit.
        """
        refuse_other(machine, Runnable, "machine", wanted="a System, or what its compile() gave")
        scene, bodies, team = machine.compiled_parts(values)
        read = load_stream if is_kind(Path(path), STREAM) else load_run
        saved = read(Path(path), scene)
        parts = {one.name: getattr(saved, one.name) for one in fields(saved)}
        scene = with_samples(scene, saved.samples)
        return Trajectory(scene, bodies={body.name: body for body in bodies}, team=team, **parts)

    @checked("folder")
    def report(self, folder: str | Path) -> Path:
        """Write a page with tables and pictures for a paper, by rank 0; return the page, folder/index.html.

        The machine is run again from this start, a dozen times and more: by the same method with rtol from a hundred
        times the one asked to a hundredth of it (of fixed steps, with h from twice to half of it), and by the other
        methods, each against a finer run.  Bodies with history, controllers and actions of events are not repeated,
        which the page says.  Besides: energies, costs, and what ``explain`` tells.

        Called on rank 0 alone, or on all ranks: each of these then returns once the page is written.

        Args:
            folder: that is not there, or empty.

        Raises:
            ExportError: the folder is not empty, or cannot be written; on each rank that calls.
            PictureError: matplotlib is not installed.
            SceneError: the folder is none.
        """
        refuse_other(folder, (str, Path), "folder", wanted='a folder, "pendulum_report"')
        import flexmbd.report as report  # with the rest of this only where it is called for
        from flexmbd.run.run_report import run_report

        error: Exception | None = None
        if self.team.is_root:
            try:
                report.refuse_folder(Path(folder))
                report.write_report(run_report(self, self._repetition), Path(folder))
            except Exception as reason:  # noqa: BLE001  (whatever it is, ranks that wait must hear of it)
                error = reason
        self.team.tell(f"the report {folder}", error)
        return Path(folder) / report.PAGE

    @checked("path", "ylabel", "title", error=PictureError)
    def plot(
        self,
        *series: tuple[str, Drawn] | Connection | Frame | FlexibleBody,
        path: str | Path | None = None,
        ylabel: str = "",
        title: str = "",
    ) -> Figure:
        """Plot things, or (label, what) pairs, over time, one panel a unit; without any, the energies.

        ``what`` is a joint (its coordinates), a frame (its position), a flexible body (its modal coordinates), a
        function of times (k,) that gives values (k,) or (k, m), or values at the instants ``t``; the unit of these two
        ends the label, "speed [m/s]".  All but values are drawn between the steps as well, from the dense output.
        Events are marked.

        See ``flexmbd.visual.plot_series``, with the same errors.
        """
        import flexmbd.visual as visual  # matplotlib loads only here

        return visual.plot_series(self, series, path=path, ylabel=ylabel, title=title)

    @checked(error=PictureError)
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
        view: ArrayLike | None = None,
        frames: bool = False,
        contacts: Sequence[AnyContact] = (),
        pressures: Sequence[SurfaceContact] = (),
        hide: Sequence[Body] = (),
        zoom: tuple[ArrayLike, float] | None = None,
        progress: bool = False,
    ) -> Path:
        """Film the machine off-screen to .mp4 or .gif; bodies with history as they were recorded.

        ``contacts``, as ``System.touch`` gave them, have arrows of their forces.  ``pressures``, of these the contacts
        of elastic surfaces, colour their reduced bodies, whose records keep surface and nodes.  ``hide`` are bodies
        that are left out, ``zoom=(place, radius)`` is a ball (m) that fills the height.  See ``flexmbd.visual.animate``
        for the other arguments and the errors.
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
            view=view,
            frames=frames,
            forces=self._forces_of(contacts),
            pressures=self._pressures_of(pressures),
            hide=hide,
            zoom=zoom,
            progress=progress,
        )

    @checked("models", "looks", "frames", "contacts", "pressures", "hide")
    def show(
        self,
        *,
        t: float | None = None,
        path: str | Path | None = None,
        size: tuple[int, int] = (1280, 720),
        amplification: float = 1.0,
        models: Mapping[FlexibleBody, StressModel] | None = None,
        looks: Mapping[ContinuumBody, Look] | None = None,
        view: ArrayLike | None = None,
        frames: bool = False,
        contacts: Sequence[AnyContact] = (),
        pressures: Sequence[SurfaceContact] = (),
        hide: Sequence[Body] = (),
        zoom: tuple[ArrayLike, float] | None = None,
    ) -> Path | None:
        """Show the machine in a window or a notebook, over all times or at ``t`` (s); or write it to ``path``, a .png.

        ``contacts``, ``pressures``, ``hide``, ``zoom`` as of ``animate``.  See ``flexmbd.visual.show`` for the other
        arguments and the errors.
        """
        import flexmbd.visual as visual  # pyvista loads only here

        return visual.show(
            self,
            t=t,
            path=path,
            size=size,
            amplification=amplification,
            models=models,
            recordings=self.recordings,
            looks=looks,
            view=view,
            frames=frames,
            forces=self._forces_of(contacts),
            pressures=self._pressures_of(pressures),
            hide=hide,
            zoom=zoom,
        )

    @checked("pressures", error=PictureError)
    def to_pyvista(
        self, t: float, *, amplification: float = 1.0, pressures: Sequence[SurfaceContact] = ()
    ) -> Any:
        """The scene of a picture at ``t`` (s) as a pyvista.MultiBlock, a block a body and joint (m). Not collective.

        Displacements (m), the fields of recorded bodies, and pressures (Pa) as of ``animate`` are point data.

        Raises:
            SceneError: a time outside the trajectory.
            PictureError: pyvista is not installed.
        """
        import flexmbd.visual as visual  # pyvista loads only here

        return visual.machine_meshes(
            self,
            t,
            amplification=amplification,
            recordings=self.recordings,
            pressures=self._pressures_of(pressures),
        )

    @checked("model")
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
        tell_stress_of_modes(self.scene, body, np.array([t]), *self.motion([t])[:2])
        return stress_in_machine(self.scene, body, model, self.q(body, t=t), t)
