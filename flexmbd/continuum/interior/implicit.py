"""A body with history that solves for its own nodes at a step's end: generalized-alpha, with consistent mass.

Nodes have absolute positions, velocities and accelerations in inertial axes, so that the mass matrix is constant and
there are no gyroscopic terms (Ambrosio & Nikravesh 1992, eq. 43-46); internal forces are those of the body's
axes, which the first interface frame carries.  Seen from the machine what is left of the body at a step's end is
a wrench on each frame, and its derivative with all other nodes condensed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from petsc4py import PETSc

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.finite_elements.interface import AveragedInterface
from flexmbd.continuum.history.applied_loads import AppliedLoads, TrialLoads, beside, is_following
from flexmbd.continuum.history.body_memory import BodyMemory
from flexmbd.continuum.history.displacement_newton import Balance, Convergence, Newton, Solution
from flexmbd.continuum.history.loads import BodyLoad, CentrifugalLoad
from flexmbd.continuum.history.nonlinear_model import NonlinearModel
from flexmbd.continuum.history.tangent_solver import LinearSolver
from flexmbd.continuum.interior.body_observer import BodyObserver
from flexmbd.continuum.interior.bonded_nodes import BondedNodes
from flexmbd.continuum.interior.face_averages import FaceAverages
from flexmbd.continuum.interior.frame_response import Condensation
from flexmbd.continuum.interior.linear_interior import linear_equations
from flexmbd.errors import ConvergenceError, SceneError
from flexmbd.multibody.bodies.body import RigidBody
from flexmbd.multibody.bodies.continuum_body import FrameMotion, InteriorFrame, Memory, Scheme
from flexmbd.multibody.interiors.observed import InteriorFields, InteriorMesh
from flexmbd.multibody.interiors.steady import InteriorModes, LinearInterior
from flexmbd.multibody.interiors.time_factor import TimeFactor

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

#: Far below the tolerance of a machine's own iteration.
_CONVERGENCE = Convergence(tolerance=1e-11, round_off=1e-6)

#: A tangent costs some ten times the forces, and a step of a motion is short.
_SOLVER = LinearSolver(reuse_below=0.03)

#: `Scheme.slopes` at rest: displacements cause no accelerations.
_AT_REST = (np.inf, 1.0)


@dataclass(frozen=True, eq=False)
class _NodalState:
    """Nodes at an instant: (local nodes including ghosts, 3) each, in inertial axes.

    Attributes:
        t: s.
        x, v, a: m, m/s, m/s^2.
        auxiliary: m/s^2, of the scheme.
        h: s, of the step before; zero at the start.
    """

    t: float
    x: FloatArray
    v: FloatArray
    a: FloatArray
    auxiliary: FloatArray
    h: float


@dataclass(frozen=True, eq=False)
class _Trial:
    """A step's end that was solved for.

    Attributes:
        motion, increment: there.
        load: (owned nodes, 3) N, in inertial axes, that acts there.
        dt: s, the time that passes for the material, none on the way to rest.
    """

    motion: _NodalState
    increment: FloatArray
    load: FloatArray
    dt: float


class ImplicitContinuum:
    """An `ImplicitInterior` and `SteadyInterior` of the machine on a body with history.

    Attributes:
        body: what is between the frames.
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
            body: undeformed, with interfaces, not used elsewhere.
            rigid_parts: by interface the rigid part there: mass, inertia, and centre of mass from the
                interface's origin, in the interface's axes.
            loads: on all nodes; what acts on bonded ones acts on their frames.
            solver: of the linear systems.

        Raises:
            InterfaceError: on all ranks: as `BondedNodes`.
            SceneError, MeshError: on all ranks: as `AppliedLoads`, or a load is for slow loading alone.
        """
        self.body = body
        self._M = body.mass()
        self._bonds = bonds = BondedNodes(body, rigid_parts=rigid_parts, may_average=True)
        self._averages = FaceAverages(body, bonds)
        self._remove_frame_mass()
        self.frames: tuple[InteriorFrame, ...] = self._bonds.frames
        self.mass = self._bonds.free_mass
        self._bonded = bonds.nodes[~bonds.averaged]
        dofs = body.displacement_dofs[bonds.nodes[bonds.own & ~bonds.averaged]]
        self._prescribed = np.sort(dofs.reshape(-1)).astype(np.int32)
        self._newton = Newton(body, self._prescribed, solver=solver, convergence=_CONVERGENCE)
        self._frames = Condensation(body, bonds, self._averages, self._newton, self._M)
        self._memory = BodyMemory(body)
        self._observer = BodyObserver(body, self._memory)
        self._loads = AppliedLoads(body, loads)
        for load in self._loads.loads:
            if isinstance(load, CentrifugalLoad):
                raise SceneError(
                    f"load {load.name!r}: nodes that move have inertia, and need no centrifugal load; let the body turn"
                )
        self._load_work = 0.0
        self._load: FloatArray = np.zeros((body.layout.n_owned_nodes, 3))
        self._R_begun: FloatArray = np.eye(3)
        self._undeformed = body.snapshot()
        # a residual of this size's `round_off` is rounding's, and good
        stiffness = body.tangent(np.zeros(body.layout.n_local), dt=0.0)
        self._smallest_force = self._round_off(stiffness, body.layout.node_x) / _CONVERGENCE.round_off
        self._gravity: FloatArray = np.zeros(3)
        self._state: _NodalState | None = None
        self._pose: tuple[FloatArray, FloatArray] = (np.zeros(3), np.eye(3))
        self._trial: _Trial | None = None

    def begin(self, t: float, motion: FrameMotion, gravity: FloatArray) -> FloatArray:
        """See `Interior.begin`. Collective."""
        body, bonds = self.body, self._bonds
        body.restore(self._undeformed)
        self._newton.discard_factor()
        self._gravity, self._pose, self._trial = np.asarray(gravity, dtype=float), bonds.pose(motion), None
        p, R = self._pose
        x: FloatArray = p + body.layout.node_x @ R.T
        v: FloatArray = motion.v[0] + np.cross(motion.w[0], x - motion.p[0])
        v[bonds.nodes] = bonds.velocities(motion)
        self._state = _NodalState(t, x, v, v, v, 0.0)
        self._R_begun, self._load_work = R, 0.0
        self._load = self._loads_after(t, x, R)
        return self._start_accelerations(motion, -self._load.reshape(-1))

    def resume(self, t: float, motion: FrameMotion) -> FloatArray:
        """See `SteadyInterior.resume`. Collective."""
        now, internal = self._current_state(), self.body.force(np.zeros(self.body.layout.n_local), dt=0.0)
        v = now.v.copy()
        v[self._bonded] = self._bonds.velocities(motion)[~self._bonds.averaged]
        self._state = replace(now, t=t, v=v, h=0.0)
        R = self._bonds.pose(motion)[1]
        self._load = self._loads_after(t, now.x, R)
        return self._start_accelerations(motion, self._in_inertial(internal, R) - self._load.reshape(-1))

    def equilibrate(self, t: float, motion: FrameMotion) -> tuple[FloatArray, FloatArray]:
        """See `SteadyInterior.equilibrate`. Collective."""
        self._check_rigid_interface()
        self._check_settles()
        body, bonds = self.body, self._bonds
        pose, still = bonds.pose(motion), np.zeros_like(self._current_state().x)
        weight = self._in_body(self._inertia(still), pose[1])
        loads = self._loads_at(self._loads.values(t), pose[1])

        def forces(increment: FloatArray) -> Balance:
            internal = body.force(increment, dt=0.0)
            if body.is_updated:
                body.check_cells()
            outer = weight - loads.force(increment)
            return Balance(internal + outer, max(body.norm(internal), body.norm(outer), self._smallest_force))

        def tangent(increment: FloatArray) -> PETSc.Mat:
            return loads.subtract_slopes(body.tangent(increment, dt=0.0), increment)

        guess = np.zeros(body.layout.n_local) if self._trial is None else self._trial.increment
        solution = self._solve(guess, motion, forces, tangent)
        x: FloatArray = self._positions(solution.increment, pose)
        v = still + motion.v[0]
        force = self._in_inertial(loads.force(solution.increment), pose[1]).reshape(-1, 3)
        self._trial = _Trial(_NodalState(t, x, v, still, still, 0.0), solution.increment, force, 0.0)
        response = self._frames.condense(
            lambda: tangent(solution.increment),
            self._in_inertial(solution.balance.residual, pose[1]),
            motion,
            x=x,
            apparent_acceleration=still - self._gravity,
            dead_load=self._in_inertial(loads.dead, pose[1]),
            slopes=_AT_REST,
        )
        return response.wrenches, response.slopes

    def linear(self, motion: FrameMotion, modes: InteriorModes) -> LinearInterior:
        """See `SteadyInterior.linear`; modes by block Lanczos, converged to a residual of 1e-12. Collective."""
        self._check_rigid_interface()
        self._check_settles()
        body, now = self.body, self._current_state()
        if self._loads.any_follow:
            raise SceneError(
                "a load that follows its surface is left out of the linear equations of a body with history; linearise "
                "without it, or with follows=False"
            )
        internal = body.force(np.zeros(body.layout.n_local), dt=0.0)
        R = self._bonds.pose(motion)[1]
        apparent_acceleration = np.zeros_like(now.x) - self._gravity
        dead_load = self._loads_after(now.t, now.x, R).reshape(-1)
        found = linear_equations(
            self._frames,
            motion,
            internal=self._in_inertial(internal, R) - dead_load,
            dead_load=dead_load,
            x=now.x,
            apparent_acceleration=apparent_acceleration,
            modes=modes,
            prescribed=self._prescribed,
        )
        self.revert()
        return found

    def trial(
        self, t_end: float, h: float, scheme: Scheme, motion: FrameMotion
    ) -> tuple[FloatArray, FloatArray]:
        """See `ImplicitInterior.trial`. Collective."""
        now, body, bonds = self._current_state(), self.body, self._bonds
        auxiliary = now.auxiliary
        if now.h > 0.0:
            auxiliary = scheme.carry(auxiliary, h, now.h, now.a)
        pose = bonds.pose(motion)
        a_bonds = bonds.accelerations(motion)[~bonds.averaged]
        per_x, _ = scheme.slopes(h)
        # accelerations are differences of places over the square of the step
        smallest = max(self._smallest_force, self._round_off(self._M, now.x) / (per_x * _CONVERGENCE.round_off))
        loads = self._loads_at(self._loads.values(beside(t_end, -1)), pose[1])

        def motion_of(increment: FloatArray) -> _NodalState:
            x = self._positions(increment, pose)
            a: FloatArray = (1.0 / per_x) * (x - self._predictor(now, auxiliary, h, scheme))
            a[self._bonded] = a_bonds
            return _NodalState(t_end, x, now.v, a, auxiliary, h)

        def forces(increment: FloatArray) -> Balance:
            internal = body.force(increment, dt=h)
            inertia = self._in_body(self._inertia(motion_of(increment).a), pose[1])
            outer = loads.force(increment)
            size = max(body.norm(internal), body.norm(inertia), body.norm(outer), smallest)
            return Balance(internal + inertia - outer, size)

        def tangent(increment: FloatArray) -> PETSc.Mat:
            matrix = loads.subtract_slopes(body.tangent(increment, dt=h), increment)
            matrix.axpy(1.0 / per_x, self._M, PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
            return matrix

        guess = self._initial_guess(now, auxiliary, h, scheme, pose=pose)
        try:
            solution = self._solve(guess, motion, forces, tangent)
        except ConvergenceError:
            # a guess by accelerations of vibrations shorter than the step is far off: begin from the deformed body
            if not guess.any():
                raise
            self._newton.discard_factor()
            solution = self._solve(np.zeros_like(guess), motion, forces, tangent)
        body.check_increment(solution.increment)
        end = motion_of(solution.increment)
        _, v, last = scheme.end(h, now.v, now.a, auxiliary, end.a)
        v[self._bonded] = bonds.velocities(motion)[~bonds.averaged]
        load = self._in_inertial(loads.force(solution.increment), pose[1]).reshape(-1, 3)
        self._trial = _Trial(replace(end, v=v, auxiliary=last), solution.increment, load, h)
        response = self._frames.condense(
            lambda: tangent(solution.increment),
            self._in_inertial(solution.balance.residual, pose[1]),
            motion,
            x=end.x,
            apparent_acceleration=end.a - self._gravity,
            dead_load=self._in_inertial(loads.dead, pose[1]),
            slopes=scheme.slopes(h),
        )
        return response.wrenches, response.slopes

    def commit(self) -> None:
        """See `ImplicitInterior.commit`. Collective."""
        if self._trial is None:
            raise SceneError("a continuum body is to accept a step that was not tried")
        self.body.commit(self._trial.increment, dt=self._trial.dt)
        before, self._state = self._current_state(), self._trial.motion
        if self._loads.any:
            n = self.body.layout.n_owned_nodes
            work = 0.5 * np.vdot(self._state.x[:n] - before.x[:n], self._load + self._trial.load)
            self._load_work += float(self._bonds.total(np.array(work)))
            self._load = self._trial.load
        self._state = replace(self._state, h=self._state.t - before.t)
        self._trial = None

    def revert(self) -> None:
        """See `ImplicitInterior.revert`."""
        self.body.revert()
        self._trial = None
        self._newton.discard_factor()

    def snapshot(self) -> Memory:
        """See `Interior.snapshot`. Collective."""
        now, memory = self._current_state(), self._memory
        arrays = {name: memory.gather_nodes(getattr(now, name)) for name in _NODAL}
        numbers = {"times": np.array([now.t, now.h]), "gravity": self._gravity.copy()}
        arrays["load"] = memory.gather_nodes(self._load)
        numbers |= {"load work": np.array(self._load_work), "begun": self._R_begun.copy()}
        return {**arrays, **numbers, **memory.gather(self.body.snapshot())}

    def restore(self, memory: Memory) -> None:
        """See `Interior.restore`. Collective."""
        arrays = {name: np.asarray(values, dtype=float) for name, values in memory.items()}
        self.body.restore(self._memory.scatter(arrays))
        nodal = {name: self._memory.scatter_nodes(arrays[name]) for name in _NODAL}
        t, h = (float(value) for value in arrays["times"])
        self._gravity, self._R_begun = arrays["gravity"].copy(), arrays["begun"].copy()
        self._load_work = float(arrays["load work"])
        self._load = self._memory.scatter_nodes(arrays["load"])[: self.body.layout.n_owned_nodes]
        self._state = _NodalState(t=t, h=h, **nodal)
        self._trial = None
        self._newton.discard_factor()

    def energies(self) -> Mapping[str, float]:
        """See `Interior.energies`; "loads" is minus the work that the loads have done. Collective."""
        now, bonds = self._current_state(), self._bonds
        n = self.body.layout.n_owned_nodes
        mine = bonds.own & ~bonds.averaged
        bonded, mass = bonds.nodes[mine], bonds.mass[mine]
        momentum = self._frames.product(now.v).reshape(-1, 3)
        kinetic = 0.5 * (momentum * now.v[:n]).sum() - 0.5 * (mass[:, None] * now.v[bonded] ** 2).sum()
        weight = self._frames.product(np.tile(self._gravity, (len(now.x), 1))).reshape(-1, 3)
        potential = -(weight * now.x[:n]).sum() + (mass[:, None] * now.x[bonded] @ self._gravity).sum()
        kinetic, potential = (float(value) for value in bonds.total(np.array([kinetic, potential])))
        outer = {"loads": -self._load_work} if self._loads.any else {}
        return {"kinetic": kinetic, "gravitational": potential, **self.body.energies(), **outer}

    @property
    def load_factors(self) -> tuple[TimeFactor, ...]:
        """See `LoadedInterior`."""
        return self._loads.factors

    def outline(self) -> InteriorMesh:
        """See `ObservedInterior`. Collective."""
        return self._observer.outline()

    def observe(self, motion: FrameMotion) -> InteriorFields:
        """See `ObservedInterior`. Collective."""
        now, pose = self._current_state(), self._bonds.pose(motion)
        return self._observer.fields(pose, pose[1], nodal=(now.x, now.v, now.a))

    def locate(self, point: FloatArray) -> tuple[IntArray, FloatArray]:
        """See `ObservedInterior`. Collective."""
        return self._observer.locate(point)

    def outer_forces(self) -> Mapping[str, FloatArray]:
        """See `ObservedInterior`: of the loads. Collective where there are some."""
        if not self._loads.any:
            return {}
        now = self._current_state()
        x = now.x[: self.body.layout.n_owned_nodes] @ self._R_begun
        found = self._loads.resultants(self._loads.values(beside(now.t, -1)), x, self._R_begun)
        following = {load.name for load in self._loads.loads if is_following(load)}
        return {name: self._R_begun @ force if name in following else force for name, force in found.items()}

    def _loads_after(self, t: float, x: FloatArray, R: FloatArray) -> FloatArray:
        """(owned nodes, 3) N, in inertial axes, just after t (s), with nodes at x (local nodes, 3). Collective."""
        values = self._loads.values(beside(t, 1))
        turned = self._loads.following(values, x[: self.body.layout.n_owned_nodes] @ R)
        return np.asarray(turned @ R.T + self._loads.dead(values, self._R_begun))

    def _loads_at(self, values: FloatArray, R: FloatArray) -> TrialLoads:
        """What acts on the body at trial displacements with its axes turned by R. Not collective."""
        dead = self._in_body(self._loads.dead(values, self._R_begun).reshape(-1), R)
        return TrialLoads(self.body, self._loads, values, dead)

    def _check_rigid_interface(self) -> None:
        if all(isinstance(found, AveragedInterface) for found in self.body.interfaces):
            raise SceneError(
                "it has averaged interfaces alone, which hold no node, and at rest no inertia does: its balance is "
                "found only where one interface is rigid (Coupling.RIGID)"
            )

    def _check_settles(self) -> None:
        if self.body.is_rate_dependent:
            raise SceneError(
                f"{self.body.form_name} has a stress that depends on rates: where it comes to rest, and how it answers "
                "to small motions, depends on the time that this takes. Let it come to rest in a simulation"
            )

    def _current_state(self) -> _NodalState:
        if self._state is None:
            raise SceneError("a continuum body is to step before it has begun: call begin, as a simulation does")
        return self._state

    def _predictor(self, now: _NodalState, auxiliary: FloatArray, h: float, scheme: Scheme) -> FloatArray:
        """(local nodes, 3) m, positions at the step's end by the scheme with zero accelerations there."""
        return now.x + scheme.end(h, now.v, now.a, auxiliary, np.zeros_like(now.a))[0]

    def _initial_guess(
        self, now: _NodalState, auxiliary: FloatArray, h: float, scheme: Scheme, *, pose: tuple[FloatArray, FloatArray]
    ) -> FloatArray:
        """Where Newton's method begins, in body axes: at the last trial's end, or with unchanged accelerations."""
        if self._trial is not None:
            return self._trial.increment
        x = now.x + scheme.end(h, now.v, now.a, auxiliary, now.a)[0]
        return self._increment(x, np.arange(len(x)), pose).reshape(-1)

    def _increment(
        self, x: FloatArray, nodes: NDArray[np.integer], pose: tuple[FloatArray, FloatArray]
    ) -> FloatArray:
        """(n, 3) m, displacement in body axes since the last accepted step of nodes at inertial positions x."""
        before = self.body.layout.node_x[nodes] + self.body.displacement.reshape(-1, 3)[nodes]
        return np.ascontiguousarray((x - pose[0]) @ pose[1] - before)

    def _inertia(self, a: FloatArray) -> FloatArray:
        """(owned dofs,) N, M (a - g), in inertial axes. Collective."""
        return self._frames.product(a - self._gravity)

    def _solve(
        self,
        guess: FloatArray,
        motion: FrameMotion,
        forces: Callable[[FloatArray], Balance],
        tangent: Callable[[FloatArray], PETSc.Mat],
    ) -> Solution:
        """Newton's solution with the frames as ``motion`` says. Collective."""
        bonds, pose = self._bonds, self._bonds.pose(motion)
        # the first step moves the bonded nodes, and the others with them
        moved, steps = guess.reshape(-1, 3).copy(), self._increment(bonds.positions(motion), bonds.nodes, pose)
        gap = steps - moved[bonds.nodes]
        moved[self._bonded] = steps[~bonds.averaged]
        constraints = self._averages.constraints(motion, pose[1], displacement=gap)
        return self._newton.solve(guess, moved.reshape(-1)[self._prescribed], forces, tangent, constraints)

    def _positions(self, increment: FloatArray, pose: tuple[FloatArray, FloatArray]) -> FloatArray:
        """(local nodes, 3) m, of the nodes in inertial axes."""
        shape = (self.body.layout.node_x.reshape(-1) + self.body.displacement + increment).reshape(-1, 3)
        return np.asarray(pose[0] + shape @ pose[1].T)

    def _in_inertial(self, forces: FloatArray, R: FloatArray) -> FloatArray:
        return np.asarray((forces.reshape(-1, 3) @ R.T).reshape(-1))

    def _in_body(self, forces: FloatArray, R: FloatArray) -> FloatArray:
        return np.asarray((forces.reshape(-1, 3) @ R).reshape(-1))

    def _round_off(self, matrix: PETSc.Mat, x: FloatArray) -> float:
        """Round-off of a matrix times places x (local nodes, 3) m. Collective."""
        extent = float(max(self.body.comm.allgather(abs(x).max(initial=0.0))))
        return float(matrix.getDiagonal().norm() * extent * np.finfo(float).eps)

    def _start_accelerations(self, motion: FrameMotion, internal: FloatArray) -> FloatArray:
        """Set the accelerations that internal forces (owned dofs,) N, in inertial axes, cause. Collective.

        Returns:
            (k, 6) wrenches on the frames.
        """
        now, bonds, body = self._current_state(), self._bonds, self.body
        a, carried = np.zeros_like(now.x), bonds.accelerations(motion)
        a[self._bonded] = carried[~bonds.averaged]
        constraints = self._averages.constraints(motion, np.eye(3), displacement=carried)
        matrix = self._M.copy()
        forces = -(internal + self._inertia(a)).reshape(-1, 1)
        found = self._newton.solve_columns(matrix, forces, constraints)[:, 0]
        self._newton.discard_factor()
        matrix.destroy()
        vector = body.vector()
        vector.array[: body.n_owned] = found
        vector.scatter_forward()
        a = np.asarray(a + vector.array.reshape(-1, 3))
        self._state = replace(now, a=a, auxiliary=a.copy())
        nodal_forces = self._frames.nodal_forces(internal + self._inertia(a), a - self._gravity)
        return bonds.wrenches(nodal_forces, bonds.arms(motion))

    def _remove_frame_mass(self) -> None:
        """Subtract from the mass matrix the nodal masses that frames of averaged interfaces carry. Collective."""
        bonds = self._bonds
        mine, diagonal = bonds.own & bonds.averaged, self._M.getDiagonal()
        diagonal.array.reshape(-1, 3)[bonds.nodes[mine]] -= bonds.mass[mine, None]
        self._M.setDiagonal(diagonal)


_NODAL = ("x", "v", "a", "auxiliary")
