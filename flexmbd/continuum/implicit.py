"""A body with history that solves for its own nodes at a step's end: generalized-alpha, with consistent mass.

Nodes have absolute positions, velocities and accelerations in inertial axes, so that the mass matrix is constant and
there are no gyroscopic terms (Ambrosio & Nikravesh 1992, eq. 43-46); internal forces are those of the body's
axes, which the first interface frame carries.  Seen from the machine what is left of the body at a step's end is
a wrench on each frame, and its derivative with all other nodes condensed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from petsc4py import PETSc

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.blocks import multiply
from flexmbd.continuum.body_memory import BodyMemory
from flexmbd.continuum.bonded_nodes import BondedNodes
from flexmbd.continuum.face_averages import FaceAverages
from flexmbd.continuum.newton import (
    Balance,
    Conditions,
    Convergence,
    Newton,
    Solution,
)
from flexmbd.continuum.tangent_solver import LinearSolver
from flexmbd.continuum.updated_lagrangian import UpdatedLagrangian
from flexmbd.errors import SceneError
from flexmbd.multibody.body import RigidBody
from flexmbd.multibody.continuum_body import FrameMotion, InterfaceFrame, Memory, Scheme

FloatArray = NDArray[np.float64]

#: Far below what a machine asks of its own iteration.
_TIGHT = Convergence(tolerance=1e-11, round_off=1e-6)

#: A tangent costs some ten times the forces, and a step of a motion is short.
_SOLVER = LinearSolver(keeps_below=0.03)


@dataclass(frozen=True, eq=False)
class _Motion:
    """Nodes at an instant: (local nodes including ghosts, 3) each, in inertial axes.

    Attributes:
        t: s.
        x, v, a: m, m/s, m/s^2.
        auxiliary: m/s^2, of the scheme.
        h: s, of the step before; zero at the start.
        a_before: m/s^2, at its begin.
    """

    t: float
    x: FloatArray
    v: FloatArray
    a: FloatArray
    auxiliary: FloatArray
    h: float
    a_before: FloatArray


@dataclass(frozen=True, eq=False)
class _Trial:
    """A step's end that was solved for."""

    motion: _Motion
    increment: FloatArray


class ImplicitContinuum:
    """An `ImplicitInterior` of the machine on a body with history.

    Attributes:
        body: what is between the frames.
        frames: of its interfaces.
        mass: kg, of the nodes that are not bonded (lumped).
    """

    def __init__(
        self,
        body: UpdatedLagrangian,
        *,
        rigid_parts: Mapping[str, RigidBody] | None = None,
        solver: LinearSolver = _SOLVER,
    ) -> None:
        """Assemble the mass. Collective.

        Args:
            body: undeformed, with interfaces, not used elsewhere.
            rigid_parts: by interface the rigid part there: mass, inertia, and centre of mass from the
                interface's origin, in the interface's axes.
            solver: of the linear systems.

        Raises:
            InterfaceError: on all ranks: as `BondedNodes`.
        """
        self.body = body
        self._M = body.mass()
        self._bonds = bonds = BondedNodes(body, rigid_parts=rigid_parts, may_average=True)
        self._averages = FaceAverages(body, bonds)
        self._lend()
        self.frames: tuple[InterfaceFrame, ...] = self._bonds.frames
        self.mass = self._bonds.free_mass
        self._bonded = bonds.nodes[~bonds.averaged]
        dofs = body.displacement_dofs[bonds.nodes[bonds.own & ~bonds.averaged]]
        self._held = np.sort(dofs.reshape(-1)).astype(np.int32)
        self._newton = Newton(body, self._held, solver=solver, convergence=_TIGHT)
        self._memory = BodyMemory(body)
        self._rest = body.snapshot()
        # a residual of this size's `round_off` is rounding's, and good
        self._least = self._round_off() / _TIGHT.round_off
        self._gravity: FloatArray = np.zeros(3)
        self._state: _Motion | None = None
        self._pose: tuple[FloatArray, FloatArray] = (np.zeros(3), np.eye(3))
        self._trial: _Trial | None = None

    def begin(self, t: float, motion: FrameMotion, gravity: FloatArray) -> FloatArray:
        """See `Interior.begin`. Collective."""
        body, bonds = self.body, self._bonds
        body.restore(self._rest)
        self._newton.factorise_next()
        self._gravity, self._pose, self._trial = np.asarray(gravity, dtype=float), bonds.pose(motion), None
        p, R = self._pose
        x: FloatArray = p + body.layout.node_x @ R.T
        v: FloatArray = motion.v[0] + np.cross(motion.w[0], x - motion.p[0])
        v[bonds.nodes] = bonds.velocities(motion)
        a, carried = np.zeros_like(x), bonds.accelerations(motion)
        a[self._bonded] = carried[~bonds.averaged]
        conditions = self._averages.conditions(motion, np.eye(3), lacking=carried)
        a = self._rest_of_accelerations(a, conditions)
        self._state = _Motion(t, x, v, a, a.copy(), 0.0, a.copy())
        return bonds.wrenches(self._pushes(self._inertia(a), a), bonds.arms(motion))

    def trial(
        self, t_end: float, h: float, scheme: Scheme, motion: FrameMotion
    ) -> tuple[FloatArray, FloatArray]:
        """See `ImplicitInterior.trial`. Collective."""
        now, body, bonds = self._started(), self.body, self._bonds
        auxiliary = now.auxiliary
        if now.h > 0.0:
            auxiliary = scheme.carry(auxiliary, h, now.h, now.a, now.a_before)
        pose = bonds.pose(motion)
        carried, a_bonds = bonds.positions(motion), bonds.accelerations(motion)[~bonds.averaged]
        per_x, _ = scheme.slopes(h)

        def motion_of(increment: FloatArray) -> _Motion:
            shape = (body.layout.node_x.reshape(-1) + body.displacement + increment).reshape(-1, 3)
            x: FloatArray = pose[0] + shape @ pose[1].T
            a: FloatArray = (1.0 / per_x) * (x - self._foretold(now, auxiliary, h, scheme))
            a[self._bonded] = a_bonds
            return _Motion(t_end, x, now.v, a, auxiliary, h, now.a)

        def forces(increment: FloatArray) -> Balance:
            internal = body.force(increment)
            inertia = self._in_body(self._inertia(motion_of(increment).a), pose[1])
            return Balance(internal + inertia, max(body.norm(internal), body.norm(inertia), self._least))

        def tangent(increment: FloatArray) -> PETSc.Mat:
            matrix = body.tangent(increment)
            matrix.axpy(1.0 / per_x, self._M, PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
            return matrix

        guess = self._guess(now, auxiliary, h, scheme, pose=pose)
        # the first step moves the bonded nodes, and the others with them
        moved, steps = guess.reshape(-1, 3).copy(), self._increment(carried, bonds.nodes, pose)
        lacking = steps - moved[bonds.nodes]
        moved[self._bonded] = steps[~bonds.averaged]
        conditions = self._averages.conditions(motion, pose[1], lacking=lacking)
        solution = self._newton.solve(guess, moved.reshape(-1)[self._held], forces, tangent, conditions)
        end = motion_of(solution.increment)
        _, v, last = scheme.end(h, now.v, now.a, auxiliary, end.a)
        v[self._bonded] = bonds.velocities(motion)[~bonds.averaged]
        self._trial = _Trial(replace(end, v=v, auxiliary=last), solution.increment)
        return self._condense(solution, scheme, h, motion, end, tangent)

    def commit(self) -> None:
        """See `ImplicitInterior.commit`. Collective."""
        if self._trial is None:
            raise SceneError("a continuum body is to accept a step that was not tried")
        self.body.commit(self._trial.increment)
        before, self._state = self._started(), self._trial.motion
        self._state = replace(self._state, h=self._state.t - before.t)
        self._trial = None

    def revert(self) -> None:
        """See `ImplicitInterior.revert`."""
        self.body.revert()
        self._trial = None
        self._newton.factorise_next()

    def snapshot(self) -> Memory:
        """See `Interior.snapshot`. Collective."""
        now, memory = self._started(), self._memory
        arrays = {name: memory.gather_nodes(getattr(now, name)) for name in _NODAL}
        numbers = {"times": np.array([now.t, now.h]), "gravity": self._gravity.copy()}
        return {**arrays, **numbers, **memory.gather(self.body.snapshot())}

    def restore(self, memory: Memory) -> None:
        """See `Interior.restore`. Collective."""
        arrays = {name: np.asarray(values, dtype=float) for name, values in memory.items()}
        self.body.restore(self._memory.scatter(arrays))
        nodal = {name: self._memory.scatter_nodes(arrays[name]) for name in _NODAL}
        t, h = (float(value) for value in arrays["times"])
        self._gravity = arrays["gravity"].copy()
        self._state = _Motion(t=t, h=h, **nodal)
        self._trial = None
        self._newton.factorise_next()

    def energies(self) -> Mapping[str, float]:
        """See `Interior.energies`. Collective."""
        now, bonds = self._started(), self._bonds
        n = self.body.layout.n_owned_nodes
        held = bonds.own & ~bonds.averaged
        bonded, mass = bonds.nodes[held], bonds.mass[held]
        momentum = self._product(now.v).reshape(-1, 3)
        kinetic = 0.5 * (momentum * now.v[:n]).sum() - 0.5 * (mass[:, None] * now.v[bonded] ** 2).sum()
        weight = self._product(np.tile(self._gravity, (len(now.x), 1))).reshape(-1, 3)
        potential = -(weight * now.x[:n]).sum() + (mass[:, None] * now.x[bonded] @ self._gravity).sum()
        kinetic, potential = (float(value) for value in bonds.total(np.array([kinetic, potential])))
        return {"kinetic": kinetic, "gravitational": potential, **self.body.energies()}

    def _started(self) -> _Motion:
        if self._state is None:
            raise SceneError("a continuum body is to step before it has begun: call begin, as a simulation does")
        return self._state

    def _foretold(self, now: _Motion, auxiliary: FloatArray, h: float, scheme: Scheme) -> FloatArray:
        """Positions at the step's end if no node had a true acceleration there."""
        return now.x + scheme.end(h, now.v, now.a, auxiliary, np.zeros_like(now.a))[0]

    def _guess(
        self, now: _Motion, auxiliary: FloatArray, h: float, scheme: Scheme, *, pose: tuple[FloatArray, FloatArray]
    ) -> FloatArray:
        """Displacement in body axes to begin with: the last trial's, or with unchanged accelerations."""
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

    def _product(self, nodal: FloatArray) -> FloatArray:
        """(owned dofs,) mass matrix times (local nodes, 3). Collective."""
        right, left = self._M.createVecRight(), self._M.createVecLeft()
        right.array[:] = np.ascontiguousarray(nodal).reshape(-1)[: self.body.n_owned]
        self._M.mult(right, left)
        return np.asarray(left.array.copy())

    def _inertia(self, a: FloatArray) -> FloatArray:
        """(owned dofs,) N, M (a - g), in inertial axes. Collective."""
        return self._product(a - self._gravity)

    def _in_body(self, forces: FloatArray, R: FloatArray) -> FloatArray:
        return np.asarray((forces.reshape(-1, 3) @ R).reshape(-1))

    def _round_off(self) -> float:
        """N, what rounding does to the internal forces. Collective."""
        matrix = self.body.tangent(np.zeros(self.body.layout.n_local))
        largest = abs(self.body.layout.node_x).max(initial=0.0)
        extent = float(max(self.body.comm.allgather(largest)))
        return float(matrix.getDiagonal().norm() * extent * np.finfo(float).eps)

    def _rest_of_accelerations(self, a: FloatArray, conditions: Conditions | None) -> FloatArray:
        """Accelerations of the nodes that are not bonded, without internal forces. Collective."""
        matrix = self._M.copy()
        forces = -self._inertia(a).reshape(-1, 1)
        found = self._newton.solve_columns(matrix, forces, conditions)[:, 0]
        self._newton.factorise_next()
        matrix.destroy()
        vector = self.body.vector()
        vector.array[: self.body.n_owned] = found
        vector.scatter_forward()
        return np.asarray(a + vector.array.reshape(-1, 3))

    def _lend(self) -> None:
        """Take what the frames of averaged interfaces have of their nodes' mass out of the mass matrix. Collective."""
        bonds = self._bonds
        mine, diagonal = bonds.own & bonds.averaged, self._M.getDiagonal()
        diagonal.array.reshape(-1, 3)[bonds.nodes[mine]] -= bonds.mass[mine, None]
        self._M.setDiagonal(diagonal)

    def _pushes(self, residual: FloatArray, a: FloatArray) -> FloatArray:
        """(interface nodes, 3) N, on the frames, from the residual (owned dofs,) in inertial axes.

        What the nodes are held with, but for the lumped mass of the bonded ones.
        """
        bonds = self._bonds
        forces = np.zeros((len(bonds.nodes), 3))
        forces[bonds.own] = -residual.reshape(-1, 3)[bonds.nodes[bonds.own]]
        inertia = bonds.mass[:, None] * (a[bonds.nodes] - self._gravity)
        return np.where(bonds.averaged[:, None], forces, forces + inertia)

    def _condense(
        self,
        solution: Solution,
        scheme: Scheme,
        h: float,
        motion: FrameMotion,
        end: _Motion,
        tangent: Callable[[FloatArray], PETSc.Mat],
    ) -> tuple[FloatArray, FloatArray]:
        """Wrenches on the frames and their derivative with the other nodes condensed. Collective."""
        body, bonds = self.body, self._bonds
        R = bonds.pose(motion)[1]
        nodes, n, (per_x, per_v) = bonds.nodes, body.layout.n_owned_nodes, scheme.slopes(h)
        residual = (solution.balance.residual.reshape(-1, 3) @ R.T).reshape(-1)
        internal = residual - self._inertia(end.a)
        pushes = self._pushes(residual, end.a)
        matrix = tangent(solution.increment)
        whole = matrix.copy()
        columns = range(6 * len(self.frames))
        arms = end.x[nodes] - motion.p[bonds.frame_of]
        moves = [_unit_motion(bonds, arms, motion, j, per_x, per_v) for j in columns]
        own, averaged = bonds.own, bonds.own & bonds.averaged
        # of each column at owned nodes, in inertial axes
        against, accelerations, turned, kept = np.zeros((4, len(columns), n, 3))
        for j, (dx, da, turn, shift) in enumerate(moves):
            # what the nodes move against the body's axes, which the first frame carries
            against[j, nodes[own]] = dx[own]
            if j < 6:
                against[j] -= shift + _crossed(turn, end.x[:n] - motion.p[0])
                turned[j] = _crossed(turn, internal.reshape(-1, 3))
            accelerations[j] = (-1.0 / per_x) * against[j]
            accelerations[j, nodes[own]] += da[own]
            # the forces that keep the averages turn with their frame
            mine = averaged & (bonds.frame_of == j // 6)
            kept[j, nodes[mine]] = _crossed(turn, pushes[mine])
        left = multiply(whole, _columns(against @ R)) + multiply(self._M, _columns(accelerations @ R))
        left += _columns(turned @ R)
        conditions = self._averages.conditions(motion, R)
        moved = self._newton.solve_columns(matrix, -left - _columns(kept @ R), conditions)
        changes = (left + multiply(whole, moved)).T.reshape(len(columns), n, 3) @ R.T
        moved = moved.T.reshape(len(columns), n, 3) @ R.T
        derivative = np.zeros((len(columns), len(columns)))
        for j, (_, da, turn, _) in enumerate(moves):
            forces = np.zeros((len(nodes), 3))
            forces[own] = -changes[j, nodes[own]]
            forces[~bonds.averaged] += bonds.mass[~bonds.averaged, None] * da[~bonds.averaged]
            # the arms turn with their frame, and averaged nodes move
            swung: FloatArray = np.where((bonds.frame_of == j // 6)[:, None], _crossed(turn, arms), 0.0)
            swung[averaged] += moved[j, nodes[averaged]]
            wrench = bonds.wrenches(forces, arms)
            wrench[:, 3:] += bonds.wrenches(pushes, swung)[:, 3:]
            derivative[:, j] = wrench.reshape(-1)
        whole.destroy()
        return bonds.wrenches(pushes, arms), derivative


_NODAL = ("x", "v", "a", "auxiliary", "a_before")


def _columns(fields: FloatArray) -> FloatArray:
    """(owned dofs, k) from k fields (k, owned nodes, 3)."""
    return np.asarray(fields.reshape(len(fields), -1).T)


def _crossed(w: FloatArray, vectors: FloatArray) -> FloatArray:
    """w x each of vectors (n, 3); numpy's own takes several times as long."""
    return np.asarray(vectors @ np.array([[0.0, w[2], -w[1]], [-w[2], 0.0, w[0]], [w[1], -w[0], 0.0]]))


def _unit_motion(
    bonds: BondedNodes, arms: FloatArray, motion: FrameMotion, j: int, per_x: float, per_v: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """What a unit displacement or rotation of a frame does to its nodes.

    Returns:
        (interface nodes, 3) their displacement and acceleration; (3,) the frame's rotation and shift.
    """
    k, axis = divmod(j, 6)
    mine = bonds.frame_of == k
    dx, da = np.zeros((2, len(arms), 3))
    shift, turn = np.zeros((2, 3))
    if axis < 3:
        shift[axis] = 1.0
        dx[mine], da[mine] = shift, shift / per_x
        return dx, da, turn, shift
    turn[axis - 3] = 1.0
    arm, w, alpha = arms[mine], motion.w[k], motion.alpha[k]
    moved, dw = _crossed(turn, arm), per_v / per_x * turn
    dx[mine] = moved
    if bonds.averaged[mine].any():
        # they go by the scheme as all free nodes do
        da[mine] = moved / per_x
        return dx, da, turn, shift
    da[mine] = (
        moved / per_x
        + _crossed(alpha, moved)
        + _crossed(dw, _crossed(w, arm))
        + _crossed(w, _crossed(dw, arm))
        + _crossed(w, _crossed(w, moved))
    )
    return dx, da, turn, shift
