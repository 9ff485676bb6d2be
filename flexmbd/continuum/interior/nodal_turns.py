"""Rotations with inertia at the nodes of a body that moves: sections of beams, fibres of plates, micro-structure.

A node that has turned by Q against inertial axes, with the spin w, has Omega = Q^T w in its own axes, in which the
inertia is constant. With the consistent mass matrix M of the rotations, in the body's axes at rest, momenta and
moments of inertia forces are

    Pi = M Omega,    M dOmega/dt + Omega x Pi,    dOmega/dt = Q^T dw/dt,

the equations of Euler and Poincare: the angular momentum, the sum of Q Pi, changes by moments alone, however far nodes
turn. Spins and their rates are inertial and go by the machine's scheme, the rotation in a step being exp(u), u what the
scheme has of spins (Bruels & Cardona 2010, doi:10.1115/1.4001370). Rotational unknowns stand for the rotation against
the body's axes, by the formulation's `TurnLaw`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from petsc4py import PETSc

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from flexmbd.continuum import parallel
from flexmbd.continuum.history.body_memory import BodyMemory
from flexmbd.continuum.history.displacement_newton import Newton
from flexmbd.continuum.history.fresh_body import is_fresh
from flexmbd.continuum.history.nonlinear_model import NonlinearModel
from flexmbd.continuum.history.tangent_solver import LinearSolver
from flexmbd.continuum.interior.turn_law import TurnLaw
from flexmbd.errors import FormulationError
from flexmbd.multibody.bodies.continuum_body import FrameMotion, Scheme
from flexmbd.round_off import EQUAL, SQUARED

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class TurnState:
    """Rotations of the nodes at an instant.

    Attributes:
        R: (3, 3), the body's axes.
        E: (local nodes, 3, 3), of the nodes against these.
        w, a, auxiliary: (local nodes, 3) spin, rad/s, its rate and that of the scheme, rad/s^2, in inertial axes.
    """

    R: FloatArray
    E: FloatArray
    w: FloatArray
    a: FloatArray
    auxiliary: FloatArray

    @property
    def Q(self) -> FloatArray:
        """(local nodes, 3, 3), of the nodes against inertial axes."""
        return np.asarray(self.R @ self.E)


@dataclass(frozen=True, eq=False)
class TurnInertia:
    """The inertia of rotations, and what it does.

    Attributes:
        body: the body.
        mass: its consistent mass matrix.
        dofs: (local nodes, 3) rotations at the displacement's nodes.
        nodal: (owned nodes, 3, 3) kg m^2, sums of the mass matrix's rows, in the body's axes at rest.
    """

    body: NonlinearModel
    mass: PETSc.Mat
    dofs: NDArray[np.integer]
    nodal: FloatArray

    @property
    def own(self) -> NDArray[np.integer]:
        """(owned nodes, 3) dofs."""
        return self.dofs[: len(self.nodal)]

    def momenta(self, omega: FloatArray) -> FloatArray:
        """(owned nodes, 3) kg m^2/s, M omega of (owned nodes, 3) rad/s in the nodes' own axes. Collective."""
        right, left = self.mass.createVecRight(), self.mass.createVecLeft()
        right.set(0.0)
        right.array[self.own] = omega
        self.mass.mult(right, left)
        return np.asarray(left.array_r[self.own])

    def moments(self, Q: FloatArray, w: FloatArray, a: FloatArray) -> FloatArray:
        """(owned nodes, 3) N m, of the inertia forces, in the nodes' own axes. Collective.

        Args:
            Q: (local nodes, 3, 3), of the nodes.
            w: (local nodes, 3) spins, rad/s, in inertial axes.
            a: (local nodes, 3) their rates, rad/s^2.
        """
        omega, rate = (self._own_axes(Q, part) for part in (w, a))
        return self.momenta(rate) + np.cross(omega, self.momenta(omega))

    def energy(self, state: TurnState, held: NDArray[np.integer]) -> float:
        """J, of this rank's nodes, less the rotary energy of nodes that frames hold. Collective."""
        omega = self._own_axes(state.Q, state.w)
        of_held = np.einsum("na,nab,nb->", omega[held], self.nodal[held], omega[held])
        return float(0.5 * ((omega * self.momenta(omega)).sum() - of_held))

    def accelerations(
        self, Q: FloatArray, carried: FloatArray, given: FloatArray, held: NDArray[np.integer], moments: FloatArray
    ) -> FloatArray:
        """(local nodes, 3) rad/s^2 that moments cause, in inertial axes. Collective.

        What has no inertia, as the drilling of plates, goes as the body does.

        Args:
            Q: (local nodes, 3, 3), of the nodes.
            carried: (3,) rad/s^2, of the body.
            given: (n, 3) rad/s^2, of held nodes.
            held: (n,) local nodes whose acceleration is given.
            moments: (owned nodes, 3) N m, in the nodes' own axes.
        """
        body, n = self.body, len(self.nodal)
        a = np.tile(carried, (len(self.dofs), 1))
        a[held] = given
        lacking = moments - self.momenta(self._own_axes(Q, a))
        ours = held[held < n]
        still = np.setdiff1d(np.arange(body.n_owned), np.delete(self.own, ours, axis=0)).astype(np.int32)
        right = np.zeros((body.n_owned, 1))
        right[self.own, 0] = lacking
        newton = Newton(body, still, solver=LinearSolver())
        found = newton.solve_columns(self._regular(), right)[:, 0]
        vector = body.vector()
        vector.array[: body.n_owned] = found
        vector.scatter_forward()
        return np.asarray(a + np.einsum("nab,nb->na", Q, vector.array[self.dofs]))

    def _own_axes(self, Q: FloatArray, vectors: FloatArray) -> FloatArray:
        n = len(self.nodal)
        return np.einsum("nba,nb->na", Q[:n], vectors[:n])

    def _regular(self) -> PETSc.Mat:
        """The mass matrix, with inertia where rotations have none, and ones at all other further unknowns. Collective.

        Raises nothing: that inertia multiplies zero accelerations.
        """
        sizes, axes = np.linalg.eigh(self.nodal)
        largest = max(self.body.comm.allgather(float(sizes.max(initial=0.0))))
        fill = np.where(sizes < SQUARED * largest, largest, 0.0)
        blocks = np.einsum("nab,nb,ncb->nac", axes, fill, axes)
        further = self.body.layout.further_dofs
        others = np.setdiff1d(further[further < self.body.n_owned], self.own)
        first = self.mass.getOwnershipRange()[0]
        matrix = PETSc.Mat().createAIJ(self.mass.getSizes(), nnz=3, comm=self.body.comm)
        for dofs, block in zip(self.own + first, blocks, strict=True):
            matrix.setValues(dofs.astype(PETSc.IntType), dofs.astype(PETSc.IntType), block)
        for dof in others + first:
            matrix.setValue(dof, dof, largest)
        matrix.assemble()
        regular = self.mass.copy()
        regular.axpy(1.0, matrix, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        matrix.destroy()
        return regular


@dataclass(frozen=True, eq=False)
class TurningNodes:
    """Nodes that turn, in a machine.

    Attributes:
        inertia: of the rotations.
        law: of the rotational unknowns.
        frame_inertia: (k, 3, 3) kg m^2, that frames have of the nodes they hold, in the frames' axes.
        held: (n,) local nodes that frames hold; frame_of: (n,) whose.
    """

    inertia: TurnInertia
    law: TurnLaw
    frame_inertia: FloatArray
    held: NDArray[np.integer]
    frame_of: NDArray[np.integer]

    def begun(self, R: FloatArray, motion: FrameMotion) -> TurnState:
        """As the body is deformed, turning with the first frame. Not collective."""
        dofs = self.inertia.dofs
        E = self.law.vector.rotations(self.inertia.body.displacement[dofs])
        w = np.tile(motion.w[0], (len(dofs), 1))
        return self.spun(TurnState(R, E, w, np.zeros_like(w), np.zeros_like(w)), motion)

    def spun(self, state: TurnState, motion: FrameMotion) -> TurnState:
        """The state with held nodes spinning as their frames. Not collective."""
        w = state.w.copy()
        w[self.held] = motion.w[self.frame_of]
        return TurnState(state.R, state.E, w, state.a, state.auxiliary)

    def relation(self, before: TurnState, increment: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Rotations (local nodes, 3, 3) against the body's axes after an increment (local dofs,), and T there."""
        theta, vector = increment[self.inertia.dofs], self.law.vector
        if self.law.by_steps:
            return np.asarray(vector.rotations(theta) @ before.E), vector.tangents(theta)
        theta = theta + self.inertia.body.displacement[self.inertia.dofs]
        return vector.rotations(theta), vector.tangents(theta)

    def tangents(self, now: TurnState) -> FloatArray:
        """(owned nodes, 3, 3) T of the accepted state: changes of the unknowns by small turns in the body's axes."""
        return self.relation(now, np.zeros(self.inertia.body.layout.n_local))[1][: len(self.inertia.nodal)]

    def present_mass(self, now: TurnState) -> PETSc.Mat:
        """The mass matrix by rates of the unknowns in the accepted state: a node spins E^T T^-1 of them. Collective."""
        mass, own, n = self.inertia.mass, self.inertia.own, len(self.inertia.nodal)
        spins = now.E[:n].transpose(0, 2, 1) @ np.linalg.inv(self.tangents(now))
        first = mass.getOwnershipRange()[0]
        matrix = PETSc.Mat().createAIJ(mass.getSizes(), nnz=3, comm=self.inertia.body.comm)
        for dof in np.setdiff1d(np.arange(self.inertia.body.n_owned), own) + first:
            matrix.setValue(dof, dof, 1.0)
        for dofs, block in zip((own + first).astype(PETSc.IntType), spins, strict=True):
            matrix.setValues(dofs, dofs, block)
        matrix.assemble()
        present = mass.ptap(matrix)
        matrix.destroy()
        return present

    def ended(
        self, before: TurnState, increment: FloatArray, R: FloatArray, motion: FrameMotion, h: float, scheme: Scheme
    ) -> TurnState:
        """The nodes at a step's end with the body's axes R there. Not collective."""
        E = self.relation(before, increment)[0]
        turned = Rotation.from_matrix(R @ E @ before.Q.transpose(0, 2, 1)).as_rotvec().reshape(-1, 3)
        past = before.w, before.a, before.auxiliary
        coasted = scheme.end(h, *past, np.zeros_like(turned))[0]
        a: FloatArray = (turned - coasted) / scheme.slopes(h)[0]
        a[self.held] = motion.alpha[self.frame_of]
        _, w, auxiliary = scheme.end(h, *past, a)
        w[self.held] = motion.w[self.frame_of]
        return TurnState(R, E, w, a, auxiliary)

    def rested(self, before: TurnState, increment: FloatArray, R: FloatArray) -> TurnState:
        """At rest after an increment (local dofs,), with the body's axes R. Not collective."""
        still = np.zeros_like(before.w)
        return TurnState(R, self.relation(before, increment)[0], still, still, still)

    def started(self, now: TurnState, motion: FrameMotion, forces: FloatArray) -> tuple[TurnState, FloatArray]:
        """The state with the rates of spins that forces (owned dofs,) of the unknowns cause. Collective.

        Returns:
            The state; and the inertia forces (owned nodes, 3) of the unknowns.
        """
        inertia = self.inertia
        own, n = inertia.own, len(inertia.nodal)
        T, E, Q, still = self.tangents(now), now.E[:n], now.Q, np.zeros_like(now.w)
        acting = -np.einsum("nba,ncb,nc->na", E, T, forces[own])
        gyroscopic = inertia.moments(Q, now.w, still)
        a = inertia.accelerations(
            Q, motion.alpha[0], motion.alpha[self.frame_of], self.held, acting - gyroscopic
        )
        moments = np.einsum("nab,nb->na", E, inertia.moments(Q, now.w, a))
        return replace(now, a=a, auxiliary=a.copy()), self.unknown_forces(T, moments)

    def forces(self, before: TurnState, end: TurnState, increment: FloatArray) -> FloatArray:
        """(owned nodes, 3) N m, inertia forces that belong to the rotational unknowns. Collective."""
        n = len(self.inertia.nodal)
        moments = np.einsum("nab,nb->na", end.E[:n], self.inertia.moments(end.Q, end.w, end.a))
        T = self.relation(before, increment)[1][:n]
        return self.unknown_forces(T, moments)

    def unknown_forces(self, T: FloatArray, moments: FloatArray) -> FloatArray:
        """Forces (n, 3) of the unknowns from moments (n, 3) in the body's axes."""
        return np.asarray(np.linalg.solve(T.transpose(0, 2, 1), moments[..., None])[..., 0])

    def frame_couples(self, motion: FrameMotion) -> FloatArray:
        """(k, 6) moments of the rotary inertia that the machine's frames have already, in inertial axes."""
        k = len(self.frame_inertia)
        J, w, alpha = self.inertial(motion), motion.w[:k], motion.alpha[:k]
        found = np.zeros((k, 6))
        found[:, 3:] = np.einsum("kab,kb->ka", J, alpha) + np.cross(w, np.einsum("kab,kb->ka", J, w))
        return found

    def couple_change(
        self, frame: int, turn: FloatArray, motion: FrameMotion, per_x: float, per_v: float
    ) -> FloatArray:
        """(k, 6) change of these where a frame turns by a small vector (3,), its spin going by the scheme."""
        J, w, alpha = self.inertial(motion)[frame], motion.w[frame], motion.alpha[frame]
        dw = per_v / per_x * turn

        def turned(v: FloatArray) -> FloatArray:
            """Change of J v with the axes of J."""
            return np.cross(turn, J @ v) - J @ np.cross(turn, v)

        found = np.zeros((len(self.frame_inertia), 6))
        found[frame, 3:] = turned(alpha) + J @ turn / per_x + np.cross(dw, J @ w) + np.cross(w, J @ dw + turned(w))
        return found

    def inertial(self, motion: FrameMotion) -> FloatArray:
        """(k, 3, 3) the frames' rotary inertia in inertial axes."""
        R = motion.R[: len(self.frame_inertia)]
        return np.asarray(R @ self.frame_inertia @ R.transpose(0, 2, 1))


_NODAL = ("w", "a", "auxiliary")


def remembered(state: TurnState, memory: BodyMemory) -> dict[str, FloatArray]:
    """A state as arrays over the whole body, for checkpoints. Collective."""
    arrays = {f"turns {name}": memory.gather_nodes(getattr(state, name)) for name in _NODAL}
    return {**arrays, "turns E": memory.gather_nodes(state.E.reshape(-1, 9)), "turns R": state.R.copy()}


def recalled(arrays: Mapping[str, FloatArray], memory: BodyMemory) -> TurnState:
    """This rank's part of `remembered`. Collective."""
    nodal = {name: memory.scatter_nodes(arrays[f"turns {name}"]) for name in _NODAL}
    E = memory.scatter_nodes(arrays["turns E"]).reshape(-1, 3, 3)
    return TurnState(R=arrays["turns R"].copy(), E=E, **nodal)


def turn_inertia(body: NonlinearModel, mass: PETSc.Mat) -> TurnInertia | None:
    """The rotary inertia of a body, where its rotations have some. Collective.

    Raises:
        FormulationError: on all ranks: other unknowns beside the displacement have mass; there are no three rotations
            at each node, about the mesh's axes; displacements and rotations share mass, as of sections off their
            centre.
    """
    layout, comm = body.layout, body.comm
    if not body.turns:
        return None
    further = layout.further_dofs[layout.further_dofs < body.n_owned]
    right, left = mass.createVecRight(), mass.createVecLeft()
    right.set(0.0)
    right.array[further] = 1.0 + np.random.default_rng(comm.rank).random(len(further))
    mass.mult(right, left)
    momenta = left.array_r.copy()
    size = max(comm.allgather(float(abs(momenta[further]).max(initial=0.0))))
    displaced = layout.displacement_dofs[: layout.n_owned_nodes]
    shared = max(comm.allgather(float(abs(momenta[displaced]).max(initial=0.0))))
    if size == 0.0 and shared == 0.0:
        return None
    blocked = len(layout.fields) == 1 and layout.space.dofmap.index_map_bs == 6
    dofs = layout.displacement_dofs + 3
    plain = blocked and np.array_equal(
        layout.rigid_columns(np.zeros(3), np.eye(3))[dofs, 3:], np.tile(np.eye(3), (len(dofs), 1, 1))
    )
    name, error = body.groups[0].form_name, None
    reach = np.sqrt(size) if size > 0.0 else 0.0
    masses = max(comm.allgather(float(mass.getDiagonal().array_r[displaced].max(initial=0.0))))
    if not all(comm.allgather(plain)):
        error = FormulationError(
            f"{name} has unknowns besides the displacement with a kinetic energy of their own that are not three "
            "rotations at each of its nodes, about the mesh's axes, which alone a body with history that moves "
            "carries; give them none where it is small, load it slowly (flexmbd.continuum.follow), or reduce it "
            "(craig_bampton)"
        )
    elif shared > EQUAL * reach * np.sqrt(masses):
        error = FormulationError(
            f"{name}: displacements and rotations share mass, as those of sections off their centre of mass; let the "
            "displacement be that of the centre, or reduce the body (craig_bampton)"
        )
    parallel.raise_collectively(comm, error)
    nodal = np.zeros((layout.n_owned_nodes, 3, 3))
    for k in range(3):
        right.set(0.0)
        right.array[dofs[: layout.n_owned_nodes, k]] = 1.0
        mass.mult(right, left)
        nodal[:, :, k] = left.array_r[dofs[: layout.n_owned_nodes]]
    return TurnInertia(body, mass, dofs, nodal)


def refuse_turned_already(body: NonlinearModel, law: TurnLaw | None) -> None:
    """Refuse a deformed body whose rotations are known by steps alone. Collective.

    Raises:
        FormulationError: on all ranks: it is one.
    """
    if law is not None and law.by_steps and not is_fresh(body):
        raise FormulationError(
            f"{body.form_name} adds up the rotation vectors of its steps, from which nobody knows how far a body "
            "that is deformed already has turned; take a body that is new, and load it in the machine"
        )
