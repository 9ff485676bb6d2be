"""A body with history that solves for its own nodes at a step's end: generalized-alpha, with consistent mass.

Nodes have absolute positions, velocities and accelerations in inertial axes, so that the mass matrix is constant and
there are no gyroscopic terms (Ambrosio & Nikravesh 1992, eq. 43-46); internal forces are those of the body's
axes, which the first interface frame carries.  Seen from the machine what is left of the body at a step's end is
a wrench on each frame, and its derivative with all other nodes condensed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum import parallel
from flexmbd.continuum.history.body_memory import BodyMemory
from flexmbd.continuum.history.fresh_body import is_fresh
from flexmbd.continuum.history.loads import BodyLoad
from flexmbd.continuum.history.nonlinear_model import NonlinearModel
from flexmbd.continuum.history.tangent_solver import LinearSolver
from flexmbd.continuum.interior.body_at_rest import balance_at_rest, linear_at_rest, refuse_restless
from flexmbd.continuum.interior.body_observer import BodyObserver
from flexmbd.continuum.interior.condensed_part import BodyTrial
from flexmbd.continuum.interior.coupled_bodies import CoupledBody
from flexmbd.continuum.interior.halved_steps import HalvedSteps
from flexmbd.continuum.interior.implicit_contacts import ImplicitContacts
from flexmbd.continuum.interior.loads_in_motion import LoadsInMotion
from flexmbd.continuum.interior.nodal_solution import NodalSolution
from flexmbd.continuum.interior.plane_motion import PlaneMotion
from flexmbd.continuum.interior.shape_contacts import check_surface
from flexmbd.continuum.interior.staggered_fields import StaggeredFields
from flexmbd.continuum.interior.step_equations import NodalState, StepEnd, StepEquations, TriedStep
from flexmbd.continuum.interior.turn_watch import TurnWatch
from flexmbd.errors import SceneError
from flexmbd.given import checked
from flexmbd.multibody.bodies.body import RigidBody
from flexmbd.multibody.bodies.continuum_body import (
    FrameMotion,
    Interior,
    InteriorFrame,
    InteriorIteration,
    Memory,
    Scheme,
)
from flexmbd.multibody.interiors.observed import InteriorFields, InteriorMesh
from flexmbd.multibody.interiors.steady import InteriorModes, LinearInterior
from flexmbd.multibody.interiors.time_factor import TimeFactor
from flexmbd.multibody.interiors.touching_interior import FacingSurface, Obstacle, ReducedFacets

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

#: A tangent costs some ten times the forces, and a step of a motion is short.
_SOLVER = LinearSolver(reuse_below=0.03)


@checked(agree=parallel.told_to_all)
class ImplicitContinuum:
    """An `ImplicitInterior` and `SteadyInterior` of the machine on a body with history.

    Attributes:
        body: the body with history between the frames.
        frames: of its interfaces.
        mass: kg, of the nodes that are not bonded (lumped).
    """

    def __init__(
        self,
        body: NonlinearModel,
        *,
        rigid_parts: Mapping[str, RigidBody] | None = None,
        loads: Sequence[BodyLoad] = (),
        solver: LinearSolver = _SOLVER,
    ) -> None:
        """Assemble the mass. Collective.

        Args:
            body: at rest, with interfaces, not used elsewhere. What has deformed it before, as `follow`, it begins
                with: its stress and history, and the frames where its interfaces are.
            rigid_parts: by interface the rigid part there: mass, inertia, and centre of mass from the
                interface's origin, in the interface's axes.
            loads: on all nodes; those on bonded nodes act on their frames.
            solver: of the linear systems.

        Raises:
            InterfaceError: on all ranks: as `BondedNodes`.
            SceneError, MeshError: on all ranks: as `AppliedLoads`, or a load is for slow loading alone.
        """
        self.body = body
        self._nodes = nodes = NodalSolution(body, rigid_parts=rigid_parts, solver=solver)
        self._bonds = bonds = nodes.bonds
        self.frames: tuple[InteriorFrame, ...] = bonds.frames
        self.mass = bonds.free_mass
        self._memory = BodyMemory(body)
        self._observer = BodyObserver(body, self._memory)
        self._loads = LoadsInMotion(body, bonds, loads)
        self._first, self._begins_fresh = body.snapshot(), is_fresh(body)
        self._contacts = self._contacts_with((), ())
        self._among = CoupledBody(
            self, body, nodes, self._frame_count, self._equations, self._held_energy, self._take
        )
        self._gravity: FloatArray = np.zeros(3)
        self._state: NodalState | None = None
        self._trial: StepEnd | None = None
        self._iterated: tuple[BodyTrial, FloatArray] | None = None  # a trial that is not worked out
        self._step: TriedStep | None = None  # that is tried
        self._known_energies: dict[str, float] | None = None  # of the last accepted state, once they were asked for
        self._plane = PlaneMotion(body)
        self._watch = TurnWatch(body, nodes.law)
        self._halved: HalvedSteps | None = None  # where the error of updates is asked for

    def begin(self, t: float, motion: FrameMotion, gravity: FloatArray) -> FloatArray:
        """See `Interior.begin`. Collective."""
        body, bonds, motion = self.body, self._bonds, self._own(motion)
        body.restore(self._first)
        self._halved = None
        self._watch.begin()
        self._forget()
        self._set_gravity(np.asarray(gravity, dtype=float))
        p, R = bonds.pose(motion)
        self._plane.begin(R, motion)
        x: FloatArray = p + body.node_x @ R.T
        v: FloatArray = motion.v[0] + np.cross(motion.w[0], x - motion.p[0])
        v[bonds.nodes] = bonds.velocities(motion)
        turns = None if self._nodes.turning is None else self._nodes.turning.begun(R, motion)
        bonds.turns.accept(motion.R, R)
        self._state = NodalState(t, x, v, v, v, 0.0, turns)
        self._loads.begin(R)
        self._loads.now = self._loads.after(t, x)
        self._contacts.begin(x, motion)
        self._among.begin(x, self._nodes.axes(motion))
        if self._begins_fresh and not self._loads.applied.any_given_fields:
            return self._start(motion, -self._loads.now, np.zeros(body.n_owned))
        # what holds the body in its shape at rest: warm, with voltages, or deformed before
        still: FloatArray = np.zeros(body.layout.n_local)
        if body.layout.has_further and self._nodes.turning is None:
            still = StaggeredFields(body, bonds.turns.dofs[bonds.turns.own]).balanced(still, dt=0.0)[0]
            body.commit(still, dt=0.0)
        return self._start_in_shape(motion)

    def resume(self, t: float, motion: FrameMotion) -> FloatArray:
        """See `SteadyInterior.resume`. Collective."""
        now, motion = self._current_state(), self._own(motion)
        v = now.v.copy()
        v[self._nodes.bonded] = self._bonds.velocities(motion)[~self._bonds.averaged]
        turning = self._nodes.turning
        turns = None if turning is None or now.turns is None else turning.spun(now.turns, motion)
        self._state = replace(now, t=t, v=v, h=0.0, turns=turns)
        self._loads.now = self._loads.after(t, now.x)
        self._forget()
        return self._start_in_shape(motion)

    def equilibrate(self, t: float, motion: FrameMotion) -> tuple[FloatArray, FloatArray]:
        """See `SteadyInterior.equilibrate`. Collective."""
        refuse_restless(self.body, [*self._contacts.names, *self._among.names])
        guess = np.zeros(self.body.layout.n_local) if self._trial is None else self._trial.increment
        self._trial, wrenches, slopes = balance_at_rest(
            self._nodes, self._loads, self._current_state(), t, motion, guess=guess, gravity=self._gravity
        )
        return wrenches, slopes

    def linear(self, motion: FrameMotion, modes: InteriorModes) -> LinearInterior:
        """See `SteadyInterior.linear`; modes by block Lanczos, converged to a residual of 1e-12. Collective."""
        refuse_restless(self.body, [*self._contacts.names, *self._among.names])
        now = self._current_state()
        found = linear_at_rest(self._nodes, self._loads, now, motion, modes=modes, gravity=self._gravity)
        self.revert()
        return found

    def trial(
        self, t_end: float, h: float, scheme: Scheme, motion: FrameMotion
    ) -> tuple[FloatArray, FloatArray]:
        """See `ImplicitInterior.trial`. Collective."""
        if self._among.is_touched:
            return self._among.trial(t_end, h, scheme, motion)
        equations = self._equations(t_end, h, scheme, motion)
        axes = equations.axes
        if self._trial is None:
            guess = self.body.layout.at_dofs(axes.increment(equations.step.coasted()), owned=False)
        else:
            guess = self._trial.increment
        nodes = self._nodes
        solution = nodes.solve_or_anew(guess, motion, axes, equations)
        self.body.check_increment(solution.increment)
        self._trial, self._iterated = self._end(BodyTrial(equations, motion), solution.increment), None
        state = self._trial.state
        response = nodes.response(
            solution, equations, motion, x=state.x, apparent=state.a - self._gravity, slopes=scheme.slopes(h),
            touched=equations.touched(state.x) if self._contacts.touches else None,
        )  # fmt: skip
        return response.wrenches, response.slopes

    def iterate(
        self, t_end: float, h: float, scheme: Scheme, motion: FrameMotion, *, tolerance: float, renew: bool
    ) -> InteriorIteration:
        """See `IteratedInterior.iterate`. Collective."""
        return self._among.iterate(t_end, h, scheme, motion, tolerance=tolerance, renew=renew)

    def _take(self, trial: BodyTrial, increment: FloatArray) -> None:
        """See `CoupledBody`."""
        self._iterated = trial, increment

    def commit(self) -> None:
        """See `ImplicitInterior.commit`. Collective."""
        if self._iterated is not None:
            self._trial = self._end(*self._iterated)
        if self._trial is None:
            raise SceneError("a continuum body cannot commit a step before its trial")
        self.body.commit(self._trial.increment, dt=self._trial.dt)
        if self._halved is not None:
            self._halved.follow(self._trial.increment, self._trial.dt)
        before, self._state = self._current_state(), self._trial.state
        self._bonds.turns.accept(self._trial.frames, self._bonds.axes_of(self._trial.frames))
        self._loads.accept(self._state.x - before.x, self._trial.load)
        self._contacts.accept(self._trial.touched)
        self._state = replace(self._state, h=self._state.t - before.t)
        self._trial = self._iterated = self._step = self._known_energies = None
        self._among.accept()
        self._watch.look(self._state.t)

    def revert(self) -> None:
        """See `ImplicitInterior.revert`."""
        self.body.revert()
        self._contacts.revert()
        self._forget()

    def snapshot(self) -> Memory:
        """See `Interior.snapshot`. Collective."""
        memory = self._memory
        own = {**self._current_state().remembered(memory), **self._loads.snapshot(memory)}
        if self._bonds.turns.any:
            own["turned frames"] = self._bonds.turns.accepted.copy()
        touch = {**self._contacts.snapshot(), **self._among.snapshot(memory)}
        return {**own, "gravity": self._gravity.copy(), **memory.gather(self.body.snapshot()), **touch}

    def restore(self, memory: Memory) -> None:
        """See `Interior.restore`. Collective."""
        arrays = {name: np.asarray(values, dtype=float) for name, values in memory.items()}
        self.body.restore(self._memory.scatter(arrays))
        self._set_gravity(arrays["gravity"].copy())
        self._loads.restore(arrays, self._memory)
        self._state = NodalState.recalled(arrays, self._memory, turns=self._nodes.turning is not None)
        if self._bonds.turns.any:
            self._bonds.turns.accepted = arrays["turned frames"].copy()
        self._contacts.restore(arrays)
        self._among.restore(self._memory, arrays)
        if self._halved is not None:
            self._halved.begin_anew()
        self._forget()

    def watch_updates(self) -> None:
        """See `UpdatedInterior.watch_updates`: of forms whose stress depends on rates."""
        self._halved = HalvedSteps(self.body) if self.body.is_rate_dependent else None

    def update_error(self) -> float:
        """See `UpdatedInterior.update_error`."""
        return 0.0 if self._halved is None else self._halved.error

    def energies(self) -> Mapping[str, float]:
        """See `Interior.energies`; "loads", "contact" and "friction" are minus the work of these. Collective.

        "kinetic" is that of the consistent mass less the frames', lumped: below zero where little else moves.
        """
        own, others = self._own_energies(), self._among.works()
        weight = self._nodes.weight_energy(self._weight, self._gravity, self._current_state().x)
        outer = {**self._loads.energies(), **self._contacts.energies(others)}
        return {"kinetic": own["kinetic"], "gravitational": weight, **own, **outer}

    def _own_energies(self) -> dict[str, float]:
        """J, what the body holds in the last accepted state, of all kinds but its weight's. Collective."""
        if self._known_energies is None:
            now = self._current_state()
            kinetic = self._nodes.kinetic_energy(now.v, now.turns)
            self._known_energies = {"kinetic": kinetic, **self.body.energies()}
        return self._known_energies

    def _held_energy(self) -> float:
        """See `CoupledBody`. Collective."""
        return sum(abs(value) for value in self._own_energies().values())

    @property
    def load_factors(self) -> tuple[TimeFactor, ...]:
        """See `LoadedInterior`."""
        return self._loads.applied.factors

    def outline(self) -> InteriorMesh:
        """See `ObservedInterior`. Collective."""
        return self._observer.outline()

    def observe(self, motion: FrameMotion) -> InteriorFields:
        """See `ObservedInterior`. Collective."""
        now, pose = self._current_state(), self._bonds.pose(motion)
        pushed = self._contacts.pushed(self._among.pushed())
        return self._observer.fields(pose, pose[1], nodal=(now.x, now.v, now.a), pushed=pushed)

    def locate(self, point: FloatArray) -> tuple[IntArray, FloatArray]:
        """See `ObservedInterior`. Collective."""
        return self._observer.locate(point)

    def port_states(self) -> Mapping[str, FloatArray]:
        """See `PortedInterior`."""
        return self.body.port_states()

    def outer_forces(self) -> Mapping[str, FloatArray]:
        """See `ObservedInterior`: of loads and contacts. Collective where there are some."""
        now = self._current_state()
        touch = {**self._contacts.resultants(), **self._among.resultants()}
        return {**self._loads.resultants(now.t, now.x), **touch}

    def check_surface(self, surface: str, *, what: str) -> None:
        """See `TouchingInterior`. Collective."""
        check_surface(self.body, surface, what=what)

    def meet(self, obstacles: Sequence[Obstacle]) -> None:
        """See `TouchingInterior`. Collective."""
        self._contacts = self._contacts_with(obstacles, ())
        self._among.leave()

    def meet_reduced(self, surfaces: Sequence[ReducedFacets]) -> None:
        """See `ReducedTouchingInterior`. Collective."""
        self._contacts = self._contacts_with(self._contacts.obstacles, surfaces)

    def _contacts_with(self, obstacles: Sequence[Obstacle], surfaces: Sequence[ReducedFacets]) -> ImplicitContacts:
        """The contacts of the surfaces. Collective."""
        self._refuse_loads({one.name for one in obstacles} | {one.name for one in surfaces})
        size = self._nodes.extent_of(self.body.layout.node_x)
        return ImplicitContacts(
            self.body, self._memory, self._nodes.diagonal, size=size, obstacles=obstacles, surfaces=surfaces
        )

    def _refuse_loads(self, names: set[str]) -> None:
        both = names & set(self._loads.applied.names)
        if both:
            raise SceneError(f"a contact and a load are both called {sorted(both)[0]!r}; give each its own name")

    def face(self, facing: FacingSurface) -> None:
        """See `TouchingInterior`. Collective."""
        other = facing.other
        if not isinstance(other, ImplicitContinuum):
            raise SceneError(
                f"contact {facing.name!r}: surfaces of two bodies with history touch where both step alike, both of "
                f"them ImplicitContinuum or ExplicitContinuum; the other's interior is {type(other).__name__}"
            )
        for one in (self, other):
            one._refuse_loads({facing.name})
        self._among.touch(facing, other._among)

    @property
    def beside(self) -> tuple[Interior, ...]:
        """See `CoupledInterior`."""
        return tuple(one.interior for one in self._among.others())

    def _frame_count(self) -> int:
        """See `CoupledBody`."""
        return len(self.frames) + sum(one.frames for one in self._contacts.touches)

    def _own(self, motion: FrameMotion) -> FrameMotion:
        """Of frames with those of bodies beside this one its own, and those of shapes."""
        return FrameMotion(*(part[: self._frame_count()] for part in motion))

    def _current_state(self) -> NodalState:
        if self._state is None:
            raise SceneError("a continuum body cannot step before begin was called, as a simulation does")
        return self._state

    def _step_to(self, t_end: float, h: float, scheme: Scheme) -> TriedStep:
        """The step to try, the last one if it is the same. Collective."""
        step = self._step
        if step is None or (step.t_end, step.h, step.scheme) != (t_end, h, scheme):
            now, touch = self._current_state(), float(np.hypot(self._contacts.stiffness, self._among.stiffness()))
            round_off = self._nodes.round_off_of_step(now.x, scheme.slopes(h)[0], touch)
            factors = self._loads.factors_before(t_end)
            self._step = step = TriedStep(t_end, h, scheme, now.carried(h, scheme), factors, self._gravity, round_off)
        return step

    def _equations(self, t_end: float, h: float, scheme: Scheme, motion: FrameMotion) -> StepEquations:
        """See `CoupledBody`. Collective."""
        step = self._step_to(t_end, h, scheme)
        self._plane.check(motion)
        bonds, axes = self._bonds, self._nodes.axes(motion)
        loads = self._loads.at(step.factors, axes)
        held = self._nodes.bonded, bonds.accelerations(motion)[~bonds.averaged]
        return StepEquations(self.body, step, axes, self._nodes.frames, loads, *held, self._contacts, motion)

    def _end(self, trial: BodyTrial, increment: FloatArray) -> StepEnd:
        """A trial's end. Collective."""
        equations, motion = trial.equations, trial.motion
        state = equations.end(increment, self._bonds.velocities(motion)[~self._bonds.averaged])
        load = equations.axes.to_inertial(equations.loads.force(increment))
        touched = self._contacts.evaluate(state.x, motion)[1]
        return StepEnd(state, increment, load, touched, equations.step.h, motion.R)

    def _set_gravity(self, gravity: FloatArray) -> None:
        """Take (3,) m/s^2. Collective."""
        self._gravity = gravity
        self._weight = self._nodes.inertia(np.tile(gravity, (len(self.body.layout.node_x), 1)))

    def _forget(self) -> None:
        """Forget trials, guesses and factors."""
        self._trial = self._iterated = self._step = self._known_energies = None
        self._nodes.discard_factors()
        self._among.forget()

    def _start_in_shape(self, motion: FrameMotion) -> FloatArray:
        """As `_start`, of the body as it is deformed and touches. Collective."""
        axes = self._nodes.axes(motion)
        internal = self.body.force(np.zeros(self.body.layout.n_local), dt=0.0)
        acting = self._loads.now + self.body.condense_nodes(self._contacts.nodal()) + self._among.nodal()
        return self._start(motion, axes.to_inertial(internal) - acting, internal)

    def _start(self, motion: FrameMotion, internal: FloatArray, unknowns: FloatArray) -> FloatArray:
        """See `NodalSolution.begun`; wrenches on the frames of all that it touches as well. Collective."""
        # a node has one mass along all axes: these may be inertial, but for dofs that are held in the body's
        R = self._nodes.axes(motion).R if self._plane.is_plane else np.eye(3)
        self._state, wrenches = self._nodes.begun(
            self._current_state(), motion, weight=self._weight, gravity=self._gravity, internal=internal,
            unknowns=unknowns, R=R,
        )  # fmt: skip
        if self._contacts.touches:
            wrenches = np.vstack([wrenches, self._bonds.total(self._contacts.wrenches())])
        return self._among.widened(wrenches)
