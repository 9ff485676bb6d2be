"""System: the machine that a user builds, compiles and simulates.

It stands above bodies, joints, integrators and trajectories, and ties them together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import NoneType
from typing import Literal, overload

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuation.request import Continuation
from flexmbd.errors import EquilibriumWarning, SceneError, warn
from flexmbd.given import checked, refuse_other
from flexmbd.integrate.automatic import choose
from flexmbd.integrate.matrix_text import matrix_text
from flexmbd.integrate.protocol import Integrator
from flexmbd.machine.compilable import CompilableMachine
from flexmbd.machine.linearization import linear_machine, working_point
from flexmbd.machine.linearized_machine import LinearizedMachine
from flexmbd.machine.steppable import Steppable, StepperRequest
from flexmbd.multibody.force.protocol import Force
from flexmbd.multibody.interiors.steady import InteriorModes
from flexmbd.multibody.joint.connection import Connection
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.kernels.reading.force_tables import refuse_hard_contacts
from flexmbd.multibody.linear.curved_fits import tell_curved_fits
from flexmbd.multibody.linear.equilibrium import ToldEquilibrium, equilibrium_at_rest, find_equilibrium
from flexmbd.multibody.linear.path.continuation import equilibrium_path
from flexmbd.multibody.linear.path.equilibrium_path import EquilibriumPath
from flexmbd.multibody.linear.ports import Input, refuse_followers, without_inputs
from flexmbd.multibody.linear.working_point import WorkingPoint
from flexmbd.multibody.motion.quantity import LinearOutput
from flexmbd.multibody.results.explain import explain
from flexmbd.multibody.results.range_watch import RangeWatch
from flexmbd.multibody.team import on_every_rank
from flexmbd.run.checkpoint import Checkpoint
from flexmbd.run.event import Event
from flexmbd.run.input_values import evaluate_inputs
from flexmbd.run.recording import Recording
from flexmbd.run.settings import RunSettings, refuse_no_integrator
from flexmbd.run.stepped_machine import SteppedMachine
from flexmbd.run.trajectory import Trajectory

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

_INTERIOR_MODES = InteriorModes()


class System(CompilableMachine, Steppable):
    """A machine: bodies, joints, forces, gravity.

    Attributes:
        gravity: (3,) m/s^2, in inertial axes.
        team: the processes that run this machine side by side; alone by default.
    """

    @overload
    def equilibrium(
        self, *, t: float = ..., about: WorkingPoint | None = ..., path: None = ..., stable: bool = ...
    ) -> WorkingPoint: ...

    @overload
    def equilibrium(
        self, *, t: float = ..., about: WorkingPoint | None = ..., path: Continuation, stable: bool = ...
    ) -> EquilibriumPath: ...

    @checked("t", "stable")
    def equilibrium(
        self,
        *,
        t: float = 0.0,
        about: WorkingPoint | None = None,
        path: Continuation | None = None,
        stable: bool = False,
    ) -> WorkingPoint | EquilibriumPath:
        """Find an equilibrium near the start, or with the start's velocities a steady motion.

        By Newton's method, and where that fails by homotopy: along a path on which the residual forces of the start
        are released.  ``unstable`` of the equilibrium tells whether it is stable; a start that is in equilibrium is
        kept.  A coordinate that nothing resists stays where it is, and is named by ``neutral``.  Bodies with history
        find their own balance in each step; the equilibrium keeps their state.  In a steady motion the whole turns at
        one rate about one line, or moves straight on, and inside symmetric rotors turn.

        Args:
            t: s, at which forces and motions are taken.
            about: an equilibrium to begin from, as one under a part of the load, instead of the initial
                values of joints and bodies.
            path: follow the equilibria from there on, with the time as the factor of the loads, through limit points
                and past bifurcations (``fm.Continuation``).  The path begins at ``about`` under its own factor, or at
                the equilibrium at ``t``; from a bifurcation of another path it is the one that crosses.
            stable: search downhill for one that the machine would settle in, and leave unstable ones.

        Returns:
            The equilibrium; with ``path`` an ``EquilibriumPath``.

        Raises:
            SceneError, AssemblyError: as ``start``; or there is no equilibrium, with the coordinate of the largest
                residual; or no stable one is found; or the motion is not steady, with the coordinate that would
                accelerate; or a body with history has no balance, can only be stepped, or turns.  Of a path: the loads
                do not change, the machine is a mechanism, moves, or holds bodies with history.
            PathError: a path cannot be followed to its end; the error has the path up to there.

        Warns:
            EquilibriumWarning: the equilibrium is unstable, or lies beyond a place where paths of equilibria turn or
                cross.
            RangeWarning: a reduced body is bent or spins beyond the range of its record (docs/limits.md).
        """
        refuse_other(about, (WorkingPoint, NoneType), "about", wanted="what scene.equilibrium() gives")
        refuse_other(path, (Continuation, NoneType), "path", wanted="fm.Continuation(to=...)")
        if path is not None and about is not None:
            if t not in (0.0, about.t):
                raise SceneError(
                    f"a path begins at `about` under its own load factor, {about.t:g}, and t = {t:g} is another; leave "
                    "one of them out"
                )
            t = about.t
        start = self._start(self._compile(()), t, about)
        refuse_hard_contacts(start.scene.plan, "an equilibrium")
        work = new_work(start.scene.plan)
        evaluate_inputs(start.scene, work, t)
        ranges = RangeWatch(start.scene, self._bodies if self.team.is_root else ())
        if path is None:
            found = self._told(find_equilibrium(start, work, stable=stable))
            ranges.judge(np.array([found.t]), found.x[None], found.v[None])
            if self.team.is_root:
                tell_curved_fits(start.scene, work, found.x)
            return found
        for connection in self._connections:
            if connection.velocity is not None and np.any(connection.velocity):
                raise SceneError(
                    f"a path of equilibria is of a machine at rest, but joint {connection.name!r} is given a velocity; "
                    "take it away"
                )
        if about is None:
            begin = self._told(equilibrium_at_rest(start, work, stable=stable))
        else:
            begin = replace(about, scene=start.scene)
        whole = equilibrium_path(begin, path, work, evaluate_inputs)
        ranges.judge(whole.factors, np.array([one.x for one in whole.points]))
        return whole

    def _told(self, found: ToldEquilibrium) -> WorkingPoint:
        """What was found; its warning is told by rank 0."""
        if found.warning is not None and self.team.is_root:
            warn(found.warning, EquilibriumWarning)
        return found.point

    @checked("t", "modes")
    def linearize(
        self,
        *,
        inputs: Sequence[Input] = (),
        disturbances: Sequence[Input] = (),
        outputs: Sequence[LinearOutput] = (),
        about: WorkingPoint | Trajectory | None = None,
        t: float = 0.0,
        modes: InteriorModes = _INTERIOR_MODES,
    ) -> LinearizedMachine:
        """Linearise about an equilibrium or a steady motion, seen from the axes that turn with it.

        Args:
            inputs: the columns of V.  Of a JointTorque or JointForce per N m or N of its value, of another force
                by functions of time per unit of each, of a FrameForce by numbers per force as given; they need not
                be in the scene.  Of a joint with a prescribed motion three: displacement, velocity, acceleration.
            disturbances: the columns of W, alike.
            outputs: the quantities observed: fm.output.Position(frame or joint or flexible body), ..., a port's
                strain_charge or strain_current.
            about: of ``equilibrium``, or a trajectory, whose end is meant; by default the start.
            t: s, at which forces and motions are taken; of ``about`` its own.
            modes: how many coordinates bodies with history get, fm.InteriorModes(count, below_hz).

        Raises:
            SceneError: the motion is not steady, the constraints are singular there, or an input or output does not
                fit; the message names it.
            AssemblyError: as ``start``.

        Warns:
            RangeWarning: at the start a reduced body without modes spins so fast that it matters how it is stiffened.
        """
        for name, several in (("inputs", inputs), ("disturbances", disturbances), ("outputs", outputs)):
            refuse_other(several, Sequence, name, wanted="a list")
        ports = [*inputs, *disturbances]
        forces = list({id(one): one for one in ports if not isinstance(one, Connection)}.values())
        for one in ports:
            if isinstance(one, Connection):
                self._refuse_foreign_joint(one)
            else:
                refuse_other(one, Force, "an input", wanted="a force element, or a joint whose motion is prescribed")
        about_what = "what scene.equilibrium() gives, or a trajectory"
        refuse_other(about, (WorkingPoint, Trajectory, NoneType), "about", wanted=about_what)
        refuse_followers(self._forces, ports)
        added = [force for force in forces if not any(force is other for other in self._forces)]
        for force in forces:
            self._check_force(force)
        whole = self._compile(added)
        t = float(about.t[-1]) if isinstance(about, Trajectory) else t if about is None else about.t
        start = self._start(without_inputs(whole, added), t)
        refuse_hard_contacts(start.scene.plan, "the linear machine")
        bodies = {body.name: body for body in self._bodies}
        point = working_point(start, about, t)
        machine = linear_machine(
            whole,
            point,
            inputs=inputs,
            disturbances=disturbances,
            outputs=outputs,
            modes=modes,
            bodies=bodies,
            team=self.team,
        )
        if about is None:  # of what was found before the equilibrium or the run has told
            ranges = RangeWatch(point.scene, self._bodies if self.team.is_root else ())
            ranges.judge(np.array([point.t]), point.x[None], point.v[None])
        return machine

    @checked("rtol", "h")
    def explain(
        self,
        *,
        rtol: float = 1e-6,
        h: float | None = None,
        integrator: Integrator | Literal["auto"] = "auto",
    ) -> str:
        """A text for the user: what is computed, what is left out, and why.

        Args:
            rtol: as for ``simulate``; it plays a part in the choice of the integrator.
            h: as for ``simulate``.
            integrator: as for ``simulate``.

        Raises:
            SceneError, AssemblyError: as ``start``.
        """
        RunSettings(1.0 if h is None else h, rtol=rtol, h=h, integrator=integrator)  # which refuses what no run takes
        start = self.start()
        if integrator == "auto":
            choice = choose(start, t=0.0, rtol=rtol, h=h)
            chosen, why = choice.method, choice.why
        else:
            refuse_no_integrator(integrator)
            chosen, why = integrator, "as asked"
        method = f"{chosen.name} ({why})"
        sampled = "".join(f"{one.explained}\n" for one in self._controllers)
        return f"{explain(start)}\n{sampled}{matrix_text(chosen, start.scene)}integrator: {method}"

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
    ) -> Trajectory:
        """Run the machine from ``t_start`` to ``t_end`` (s).

        Args:
            t_end: end time (s).
            rtol: error tolerated per radian of the machine's motion, relative to 1 rad, the machine's extent, and, of
                deformations, the largest met or a thousandth of that extent, whichever is more.
            h: fixed step (s) instead of error control; then ``rtol`` rules Newton alone.
            t_start: start time (s).
            about: where to begin, of ``equilibrium``, instead of the initial values of joints and bodies.
            integrator: the method, as fm.RadauIIA(); "auto" chooses by the scene's parts, as
                ``explain`` says.
            events: to look for; each is located to the method's own accuracy and listed in the
                trajectory's ``events``.  One that never takes place is not listed.
            checkpoints: times (s) at which the state for a restart is kept, in the trajectory's
                ``checkpoints``.
            checkpoint_file: where the last of regular checkpoints is kept for ``Checkpoint.load``, so that a simulation
                that was killed can go on; the file is whole at any instant.
            checkpoint_every: s of simulated time between them.
            restart: a checkpoint to go on from instead of the scene's start, with its rtol or h; the
                numbers are those of going on without a stop, to the bit.
            progress: show a progress bar.
            max_step: longest step (s) of error control, so that an event's function is asked as often.
            max_steps: accepted steps of this run after which it is broken off; the trajectory up to then is kept.
            max_rows: rows of its trajectory after which it is broken off.
            max_seconds: s of the wall's clock after which it is broken off.
            recording: a file that the fields of bodies with history go to at a rate of one's own, for the trajectory's
                ``recorded``, its films and stresses.
            stream: a file that the trajectory goes to while the machine runs, about once a second, so that
                ``Trajectory.load`` reads it at any time: from another process, and after this one was killed.  An
                existing one is replaced, or goes on where the run is a restart.

        Raises:
            RecordError: the recording or the stream cannot be written.
            SceneError, AssemblyError: as ``start``; or a bad argument.
            SimulationError: a step failed however short it was, or a fixed step did; impacts followed each other ever
                faster; or a limit was reached.  Its ``trajectory`` holds the motion up to then.
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
        checked, machine = on_every_rank(self.team, lambda: (settings(), self._as_it_is()))
        return machine.run(checked)

    def _begin_steps(self, request: StepperRequest) -> SteppedMachine:
        return on_every_rank(self.team, self.compile)._begin_steps(request)
