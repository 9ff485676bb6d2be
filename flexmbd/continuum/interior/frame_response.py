"""The wrenches of a body with history on its frames, and their derivative with the other nodes condensed.

The nodes between the frames follow small motions of these in equilibrium: at a step's end with their inertia, by the
scheme of integration, or at rest without.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from petsc4py import PETSc

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.history.displacement_newton import Newton
from flexmbd.continuum.history.nonlinear_model import NonlinearModel
from flexmbd.continuum.interior.bonded_nodes import BondedNodes
from flexmbd.continuum.interior.face_averages import FaceAverages
from flexmbd.continuum.interior.frame_columns import BalancedNodes, FrameColumns, UnitMotion, crossed, unit_motion
from flexmbd.continuum.interior.nodal_turns import TurningNodes
from flexmbd.continuum.interior.touched_nodes import TouchedNodes
from flexmbd.continuum.matrices.blocks import multiply
from flexmbd.multibody.bodies.continuum_body import FrameMotion

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class FrameResponse:
    """The wrenches on k frames, those of shapes that are touched included, and their derivatives.

    Attributes:
        wrenches: (k, 6) on them.
        slopes: (6 k, 6 k) their derivative, as `ImplicitInterior.trial` has it.
        fields: (6 k, owned nodes, 3) m, displacement of all nodes by a unit motion of each frame, in inertial axes.
        relative: (owned dofs, 6 k) what of it is not the rigid motion of the body's axes, in these, m, and the
            change of further unknowns.
        nodal_forces: (interface nodes, 3) N, on the frames.
    """

    wrenches: FloatArray
    slopes: FloatArray
    fields: FloatArray
    relative: FloatArray
    nodal_forces: FloatArray


@dataclass(frozen=True, eq=False)
class Condensation:
    """The parts of a body that its frames' response is made of.

    Attributes:
        body: what is between the frames.
        bonds: its nodes on them.
        averages: of averaged interfaces.
        newton: solves the linear systems.
        mass: the mass matrix.
        turning: nodes whose rotations have inertia; None: there are none.
    """

    body: NonlinearModel
    bonds: BondedNodes
    averages: FaceAverages
    newton: Newton
    mass: PETSc.Mat
    turning: TurningNodes | None = None

    def product(self, nodal: FloatArray) -> FloatArray:
        """(owned nodes, 3) mass matrix times (local nodes, 3). Collective."""
        layout = self.body.layout
        right, left = self.mass.createVecRight(), self.mass.createVecLeft()
        right.array[:] = layout.at_dofs(np.ascontiguousarray(nodal[: layout.n_owned_nodes]), owned=True)
        self.mass.mult(right, left)
        return np.array(layout.displacements(left.array))

    def nodal_forces(self, residual: FloatArray, apparent_acceleration: FloatArray) -> FloatArray:
        """(interface nodes, 3) N, on the frames: the nodes' constraint forces less inertia of the bonded ones' mass.

        Args:
            residual: (owned nodes, 3) N, in inertial axes.
            apparent_acceleration: (held nodes, 3) m/s^2, acceleration less gravity of the nodes that frames hold.
        """
        bonds = self.bonds
        forces = np.zeros((len(bonds.nodes), 3))
        forces[bonds.own] = -residual[bonds.nodes[bonds.own]]
        forces[~bonds.averaged] += bonds.mass[~bonds.averaged, None] * apparent_acceleration
        return forces

    def condense(self, tangent: Callable[[], PETSc.Mat], at: BalancedNodes) -> FrameResponse:
        """Condense with the residual's tangent, in body axes, with the nodes' inertia by the scheme. Collective."""
        matrix = tangent()
        full_tangent = matrix.copy()
        constraints = self.averages.constraints(at.motion, self.bonds.pose(at.motion)[1])
        found = self.columns_of(full_tangent, at)
        followed = self.newton.solve_columns(matrix, -found.left - found.kept, constraints)
        response = self.answer(found, followed, found.left + multiply(full_tangent, followed))
        full_tangent.destroy()
        return response

    def columns_of(self, tangent: PETSc.Mat, at: BalancedNodes) -> FrameColumns:
        """What unit motions of frames, those of touched bodies too, do where other nodes go with the body's axes.

        The tangent is as of `condense`, and not changed. Collective.
        """
        bonds, motion, x, touched = self.bonds, at.motion, at.x, at.touched
        R = bonds.pose(motion)[1]
        nodes, n, (per_x, per_v) = bonds.nodes, self.body.layout.n_owned_nodes, at.slopes
        internal = at.residual - self.product(at.apparent_acceleration) + at.dead_load
        if touched is not None:
            internal = internal + self._on_nodes(touched, touched.force)
        nodal_forces = self.nodal_forces(at.residual, at.apparent_acceleration[nodes[~bonds.averaged]])
        own_columns = 6 * len(bonds.frames)
        columns = range(6 * len(motion.p))
        arms = x[nodes] - motion.p[bonds.frame_of]
        moves = [unit_motion(bonds, arms, motion, j, per_x, per_v) for j in range(own_columns)]
        own, averaged = bonds.own, bonds.own & bonds.averaged
        # of each column at owned nodes, in inertial axes
        carried, relative, accelerations, turned, constraint_forces = np.zeros((5, len(columns), n, 3))
        for j, (dx, da, turn, shift) in enumerate(moves):
            # what the nodes move against the body's axes, which the first frame carries
            relative[j, nodes[own]] = dx[own]
            if j < 6:
                carried[j] = shift + crossed(turn, x[:n] - motion.p[0])
                relative[j] -= carried[j]
                turned[j] = crossed(turn, internal)
                if touched is not None:  # what touches goes by the whole motion
                    turned[j] -= self._on_nodes(touched, touched.changes(carried[j, touched.nodes]))
            accelerations[j] = (-1.0 / per_x) * relative[j]
            accelerations[j, nodes[own]] += da[own]
            # the forces that keep the averages turn with their frame
            mine = averaged & (bonds.frame_of == j // 6)
            constraint_forces[j, nodes[mine]] = crossed(turn, nodal_forces[mine])
        if touched is not None:
            for j in columns[own_columns:]:
                turned[j] = -self._on_nodes(touched, touched.by_frame(*divmod(j - own_columns, 6)))
        given = self._given(relative @ R, moves, motion, R)
        left = multiply(tangent, given)
        left += multiply(self.mass, self._accelerated(accelerations @ R, given, moves, R, per_x))
        left += self.columns(turned @ R)
        kept = self.columns(constraint_forces @ R)
        return FrameColumns(R, at, tuple(moves), carried, relative, given, left, kept, nodal_forces, arms)

    def answer(self, found: FrameColumns, followed: FloatArray, change: FloatArray) -> FrameResponse:
        """The response. Collective.

        Args:
            found: the columns.
            followed: (owned dofs, c) m, how nodes that no frame holds follow, in the body's axes.
            change: (owned dofs, c) N, of the residual by all of it.
        """
        bonds, R, moves, motion = self.bonds, found.R, found.moves, found.at.motion
        nodal_forces, arms, (per_x, per_v) = found.nodal_forces, found.arms, found.at.slopes
        couples, touched = found.at.couples, found.at.touched
        own_columns, columns = len(moves), range(followed.shape[1])
        changes = self._fields(change) @ R.T
        moved = self._fields(followed) @ R.T
        shapes = 0 if touched is None else sum(one.frames for one in touched.carriers)
        derivative = np.zeros((own_columns + 6 * shapes, len(columns)))
        for j in columns:
            step = moves[j] if j < own_columns else None
            wrench = self._wrench_change(j, step, changes[j], moved[j], nodal_forces, arms)
            if bonds.turns.any:
                wrench += self._couple_change(j, step, change[:, j], couples, motion, R)
            if self.turning is not None and step is not None:
                wrench += self.turning.couple_change(j // 6, step[2], motion, per_x, per_v)
            derivative[:own_columns, j] = wrench.reshape(-1)
        relative = self._completed(found.relative + moved)
        if touched is not None:
            derivative[own_columns:] = self._on_shapes(touched, found.carried + relative, own_columns)
        if bonds.turns.any:
            rows = bonds.turns.dofs[bonds.turns.own]
            followed[rows] = found.given[rows]
        in_axes = self.columns(relative @ R, further=followed)
        wrenches = bonds.wrenches(nodal_forces, arms) + couples + self.frame_couples(motion)
        fields = found.carried + relative
        return FrameResponse(self.with_shapes(wrenches, touched), derivative, fields, in_axes, nodal_forces)

    def _on_nodes(self, touched: TouchedNodes, forces: FloatArray) -> FloatArray:
        """(owned nodes, 3) N, of forces (n, 3) N on nodes that touch. Collective with ties."""
        return self.body.condense_nodes(touched.at_nodes(forces, self.body.layout.n_owned_nodes))

    def _completed(self, fields: FloatArray) -> FloatArray:
        """Fields (k, owned nodes, 3) with what follows by ties; they are changed. Collective with ties."""
        return fields if self.body.ties is None else np.stack([self.body.complete_nodes(field) for field in fields])

    def frame_couples(self, motion: FrameMotion) -> FloatArray:
        """(k, 6) moments on the frames of the rotary inertia of nodes that the machine's frames have already."""
        k = len(self.bonds.frames)
        return np.zeros((k, 6)) if self.turning is None else self.turning.frame_couples(motion)

    def _accelerated(
        self, fields: FloatArray, given: FloatArray, moves: Sequence[UnitMotion], R: FloatArray, per_x: float
    ) -> FloatArray:
        """(owned dofs, k) accelerations by unit motions, beside what the tangent has of them.

        Those of nodes are ``fields`` (k, owned nodes, 3). Rotations are against the body's axes, with which nodes
        between the frames turn.
        """
        accelerated = self.columns(fields)
        if self.turning is None:
            return accelerated
        own, n = self.turning.inertia.own, len(self.turning.inertia.nodal)
        bonds = self.bonds
        for j, (_, _, turn, _) in enumerate(moves):
            if j % 6 < 3:
                continue
            turned = R.T @ turn / per_x
            change = np.tile(turned if j < 6 else np.zeros(3), (n, 1))
            held = bonds.nodes[bonds.own]
            mine = (bonds.frame_of[bonds.own] == j // 6)[:, None]
            change[held] = np.where(mine, turned, 0.0) - given[own[held], j] / per_x
            accelerated[own, j] = change
        return accelerated

    def _given(
        self, fields: FloatArray, moves: Sequence[UnitMotion], motion: FrameMotion, R: FloatArray
    ) -> FloatArray:
        """(owned dofs, k) of fields (k, owned nodes, 3) in body axes, and of unknowns that turn with the frames."""
        turns, given = self.bonds.turns, self.columns(fields)
        if turns.any:
            for j, (_, _, turn, _) in enumerate(moves):
                given[turns.dofs[turns.own], j] = turns.follow(turn, j // 6, motion.R, R)[turns.own]
        return given

    def _wrench_change(
        self,
        j: int,
        step: UnitMotion | None,
        changes: FloatArray,
        moved: FloatArray,
        nodal_forces: FloatArray,
        arms: FloatArray,
    ) -> FloatArray:
        """(k, 6) change of the wrenches on the body's frames by column j. Collective.

        Args:
            j: of a motion of the body's frames, or of a shape's.
            step: what it does to the nodes that frames hold; None of a shape's.
            changes: (owned nodes, 3) N, of the forces that hold nodes.
            moved: (owned nodes, 3) m, by which nodes follow.
            nodal_forces: (interface nodes, 3) N.
            arms: (interface nodes, 3) m.
        """
        bonds, own, averaged = self.bonds, self.bonds.own, self.bonds.own & self.bonds.averaged
        forces, arm_changes = np.zeros((2, len(bonds.nodes), 3))
        forces[own] = -changes[bonds.nodes[own]]
        if step is not None:
            _, da, turn, _ = step
            forces[~bonds.averaged] += bonds.mass[~bonds.averaged, None] * da[~bonds.averaged]
            # the arms turn with their frame
            arm_changes = np.where((bonds.frame_of == j // 6)[:, None], crossed(turn, arms), 0.0)
        arm_changes[averaged] += moved[bonds.nodes[averaged]]  # averaged nodes move
        wrench = bonds.wrenches(forces, arms)
        wrench[:, 3:] += bonds.wrenches(nodal_forces, arm_changes)[:, 3:]
        return wrench

    def _couple_change(
        self, j: int, step: UnitMotion | None, change: FloatArray, couples: FloatArray, motion: FrameMotion,
        R: FloatArray,
    ) -> FloatArray:
        """(k, 6) change of the couples (k, 6) that hold rotations, by column j; ``change`` (owned dofs,) of forces."""
        found = self.bonds.turns.wrenches(change, motion.R, R)
        if step is not None:
            found[:, 3:] += self.bonds.turns.couple_changes(couples[:, 3:], step[2], j // 6, motion.R, R)
        return found

    def columns(self, fields: FloatArray, *, further: FloatArray | None = None) -> FloatArray:
        """(owned dofs, k) from k fields (k, owned nodes, 3), and at further unknowns what columns like these have."""
        layout = self.body.layout
        if not layout.has_further:
            return np.asarray(fields.reshape(len(fields), -1).T)
        columns = layout.at_dofs(fields.transpose(1, 2, 0), owned=True)
        if further is not None:
            rows = layout.further_dofs[layout.further_dofs < layout.n_owned]
            columns[rows] = further[rows]
        return columns

    def with_shapes(self, wrenches: FloatArray, touched: TouchedNodes | None) -> FloatArray:
        """Wrenches (k, 6) on the body's frames, and those on the frames of shapes. Collective."""
        if touched is None:
            return wrenches
        return np.vstack([wrenches, self.bonds.total(touched.wrenches())])

    def _on_shapes(self, touched: TouchedNodes, fields: FloatArray, own_columns: int) -> FloatArray:
        """(6 m, 6 (k + m)) derivative of the wrenches on shapes by the frames' motions. Collective.

        Args:
            touched: the contact forces.
            fields: (6 (k + m), n, 3) m, motions of the nodes by those of the frames.
            own_columns: 6 k.
        """
        found = []
        for j, field in enumerate(fields):
            frame = None if j < own_columns else divmod(j - own_columns, 6)
            found.append(touched.wrench_changes(field[touched.nodes], frame).reshape(-1))
        return self.bonds.total(np.array(found).T.copy())

    def _fields(self, columns: FloatArray) -> FloatArray:
        """(k, owned nodes, 3) from columns (owned dofs, k)."""
        layout = self.body.layout
        if not layout.has_further:
            return columns.T.reshape(columns.shape[1], -1, 3)
        return layout.displacements(columns).transpose(2, 0, 1)
