"""Contact forces on nodes at a trial's end, the wrenches on the frames of touched bodies, and their derivatives."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

from petsc4py import PETSc

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.contract.dof_layout import DofLayout
from flexmbd.continuum.interior.reduced_contact import frame_wrenches

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Carrier:
    """A touched body: it moves with the first of c frames, and deforms by the displacements of the others.

    A place at the arm r moves by dp + w x r + R phi dy (`ReducedFacets`).  A rigid body has one frame.

    Attributes:
        p, R: (3,) m, (3, 3) of the first frame.
        y: (3 (c - 1),) m, displacements of the other frames in the first one's axes.
        phi: (n, 3, 3 (c - 1)) modes at the places of n nodes that touch it, in these axes.
        wander: (n, 3, 3, 3 (c - 1)) 1/m, derivative of phi by the places' coordinates; these are the second index.
        normal: (n, 3) of facets, which turn, in these axes; 0 of a rigid body.
        rows: the n nodes among those of all contacts.
        first: number of its first frame among those of all contacts.
    """

    p: FloatArray
    R: FloatArray
    y: FloatArray
    phi: FloatArray
    wander: FloatArray
    normal: FloatArray
    rows: slice
    first: int

    @property
    def frames(self) -> int:
        """c."""
        return 1 + len(self.y) // 3

    def motion(self, frame: int, axis: int) -> tuple[FloatArray, FloatArray, FloatArray] | None:
        """dp (m), w (rad) and dy (m) of a unit displacement or rotation of a frame; None of another's."""
        k = frame - self.first
        if not 0 <= k < self.frames:
            return None
        unit, dp, w, dy = np.eye(3)[axis % 3], np.zeros(3), np.zeros(3), np.zeros((self.frames - 1, 3))
        if k > 0:
            if axis < 3:
                dy[k - 1] = unit @ self.R
        elif axis < 3:
            dp = unit
            dy -= unit @ self.R
        else:
            w = unit
            dy -= np.cross(unit @ self.R, self.y.reshape(-1, 3))
        return dp, w, dy.reshape(-1)

    def way(self, motion: tuple[FloatArray, FloatArray, FloatArray], arms: FloatArray) -> FloatArray:
        """(n, 3) m, of places at arms (n, 3) m."""
        dp, w, dy = motion
        return np.asarray(dp + np.cross(w, arms) + (self.phi @ dy) @ self.R.T)

    def turned_forces(self, motion: tuple[FloatArray, FloatArray, FloatArray], force: FloatArray) -> FloatArray:
        """(n, 3) changes of forces (n, 3) that turn with the body and its facets."""
        _, w, dy = motion
        # a facet's normal goes against the slope of what moves along it
        tilt = -np.einsum("nbai,na,i->nb", self.wander, self.normal, dy)
        turns = w + np.cross(self.normal, tilt) @ self.R.T
        return np.asarray(np.cross(turns, force))

    def wrenches(self, force: FloatArray, arms: FloatArray) -> FloatArray:
        """(c, 6) on the frames by minus forces (n, 3) at arms (n, 3), in inertial axes."""
        f, r = -force @ self.R, arms @ self.R
        return self._turned(self._by(f, r))

    def wrench_changes(
        self, force: FloatArray, arms: FloatArray, changes: FloatArray, dx: FloatArray,
        motion: tuple[FloatArray, FloatArray, FloatArray] | None,
    ) -> FloatArray:
        """(c, 6) by which wrenches change with the forces (n, 3), with nodes that move by dx (n, 3), and the frames."""
        dp, w, dy = (np.zeros(3), np.zeros(3), np.zeros(len(self.y))) if motion is None else motion
        f, df = -force @ self.R, -(changes - np.cross(w, force)) @ self.R
        r, dr = arms @ self.R, (dx - dp - np.cross(w, arms)) @ self.R
        now = self._by(f, r)
        whole = self._by(df, r)
        modal = np.einsum("nai,na->i", self.phi, f).reshape(-1, 3)
        wandered = np.einsum("nbai,nb,na->i", self.wander, dr - self.phi @ dy, f).reshape(-1, 3)
        arms = self.y.reshape(-1, 3)
        whole[1:, :3] += wandered
        whole[0, :3] -= wandered.sum(axis=0)
        whole[0, 3:] += np.cross(dr, f).sum(axis=0)
        whole[0, 3:] -= (np.cross(dy.reshape(-1, 3), modal) + np.cross(arms, wandered)).sum(axis=0)
        return self._turned(whole) + np.cross(w, self._turned(now).reshape(-1, 3)).reshape(-1, 6)

    def _by(self, f: FloatArray, r: FloatArray) -> FloatArray:
        """(c, 6) wrenches by forces on the body at r, in its axes."""
        modal = np.einsum("nai,na->i", self.phi, f)
        return frame_wrenches(f.sum(axis=0), np.cross(r, f).sum(axis=0), modal, self.y)

    def _turned(self, wrenches: FloatArray) -> FloatArray:
        return np.asarray((wrenches.reshape(-1, 3) @ self.R.T).reshape(-1, 6))


@dataclass(frozen=True, eq=False)
class TouchedNodes:
    """Contact forces on n nodes by what m frames carry, and their derivatives, in inertial axes.

    Attributes:
        nodes: (n,) owned nodes; one may stand in it several times.
        x: (n, 3) m, of the nodes.
        force: (n, 3) N, on the nodes.
        slopes: (n, 3, 3) N/m, minus its derivative by the node's motion against what it touches.
        carriers: what is touched, in the order of the nodes and of the frames.
    """

    nodes: IntArray
    x: FloatArray
    force: FloatArray
    slopes: FloatArray
    carriers: tuple[Carrier, ...]

    @cached_property
    def arms(self) -> FloatArray:
        """(n, 3) m, to the nodes from the first frame of what they touch."""
        origins = [self.x[one.rows] - one.p for one in self.carriers]
        return np.concatenate(origins) if origins else np.zeros((0, 3))

    def at_nodes(self, values: FloatArray, n_owned: int) -> FloatArray:
        """(owned nodes, 3) sums of values (n, 3)."""
        out = np.zeros((n_owned, 3))
        np.add.at(out, self.nodes, values)
        return out

    def add_slopes(self, matrix: PETSc.Mat, R: FloatArray, layout: DofLayout) -> PETSc.Mat:
        """The body's tangent, in axes that R turns to inertial ones, with the derivatives; it changes. Collective."""
        first = matrix.getOwnershipRange()[0]
        blocks = np.einsum("ba,nbc,cd->nad", R, self.slopes, R)
        for node, block in zip(self.nodes, blocks, strict=True):
            dofs = (first + layout.displacement_dofs[node]).astype(PETSc.IntType)
            matrix.setValues(dofs, dofs, block, addv=PETSc.InsertMode.ADD_VALUES)
        matrix.assemble()
        return matrix

    def moved(self, nodal: FloatArray) -> TouchedNodes:
        """Linearised, where the nodes have moved by (owned nodes, 3) m and what they touch has not."""
        dx = nodal[self.nodes]
        return replace(self, x=self.x + dx, force=self.force + self.changes(dx))

    def changes(self, dx: FloatArray) -> FloatArray:
        """(n, 3) N, changes of the forces by displacements (n, 3) m of the nodes against what they touch."""
        return np.asarray(-np.einsum("nab,nb->na", self.slopes, dx))

    def by_frame(self, frame: int, axis: int) -> FloatArray:
        """(n, 3) N, changes of the forces by a unit displacement or rotation of a frame."""
        out = np.zeros_like(self.force)
        for one in self.carriers:
            motion, rows = one.motion(frame, axis), one.rows
            if motion is not None:
                way = one.way(motion, self.arms[rows])
                out[rows] = np.einsum("nab,nb->na", self.slopes[rows], way)
                out[rows] += one.turned_forces(motion, self.force[rows])
        return out

    def wrenches(self) -> FloatArray:
        """(m, 6) on the frames: this rank's part."""
        found = [one.wrenches(self.force[one.rows], self.arms[one.rows]) for one in self.carriers]
        return np.concatenate(found) if found else np.zeros((0, 6))

    def wrench_changes(self, dx: FloatArray, frame: tuple[int, int] | None) -> FloatArray:
        """(m, 6) changes of the wrenches where the nodes move by dx (n, 3) m, and a frame by its unit motion."""
        changes = self.changes(dx)
        motions = () if frame is None else (one.motion(*frame) or () for one in self.carriers)
        if not dx.any() and not any(part.any() for motion in motions for part in motion):
            return np.zeros((sum(one.frames for one in self.carriers), 6))
        if frame is not None:
            changes = changes + self.by_frame(*frame)
        found = []
        for one in self.carriers:
            part = self.force[one.rows], self.arms[one.rows], changes[one.rows], dx[one.rows]
            found.append(one.wrench_changes(*part, None if frame is None else one.motion(*frame)))
        return np.concatenate(found) if found else np.zeros((0, 6))
