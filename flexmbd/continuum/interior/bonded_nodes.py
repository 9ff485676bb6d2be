"""Nodes on the interface frames of a body with history: their positions and the forces that they pass on.

Ambrosio & Nikravesh 1992, eq. 47-53: the nodes on the boundary of a rigid part move with it, their lumped
mass is part of it, and the forces that they are held with act on it.  The nodes of an averaged interface stay
free; they lend the frame, which a machine gives a mass, a small part of theirs.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum import parallel
from flexmbd.continuum.finite_elements.interface import AveragedInterface
from flexmbd.continuum.finite_elements.lumping import lumped_mass
from flexmbd.continuum.history.nonlinear_model import NonlinearModel
from flexmbd.continuum.interior.bonded_turns import BondedTurns, refuse_turning_unknowns
from flexmbd.continuum.interior.further_unknowns import refuse_inertia_of_further_unknowns
from flexmbd.continuum.interior.machine_frames import check_frames, interface_frame, mass_of_part, mass_of_points
from flexmbd.continuum.interior.present_interfaces import present_poses
from flexmbd.continuum.interior.thickness_mass import ThicknessMass
from flexmbd.continuum.interior.turn_law import SMALL_TURNS, TurnLaw
from flexmbd.errors import InterfaceError
from flexmbd.multibody.bodies.body import RigidBody
from flexmbd.multibody.bodies.continuum_body import FrameMotion, InteriorFrame
from flexmbd.round_off import SAME_PLACE

FloatArray = NDArray[np.float64]

#: What part of their lumped mass free nodes lend a frame: below the least share of it that any vibration of an
#: element feels by the consistent mass (1/27 for linear bricks), so that what is left is positive.
LENT = 0.01


class BondedNodes:
    """The nodes of all interfaces of a body. Constructing one is collective.

    Attributes:
        frames: one for each interface, in the order of `NonlinearModel.interfaces`, where the body stands.
        nodes: (n,) local nodes, ghosts included.
        frame_of: (n,) the number of each node's frame.
        own: (n,) whether this rank owns the node.
        averaged: (n,) whether the frame moves as the mean of the nodes instead of holding them.
        mass: (n,) kg, what moves with the frame: of bonded nodes the lumped mass, of averaged ones a part of it.
        free_mass: kg, all other mass of nodes.
        turns: unknowns of the nodes that turn with the frames.
        reach: m, the largest distance of a node from its frame's origin along one of the frame's axes.
    """

    def __init__(
        self,
        body: NonlinearModel,
        *,
        rigid_parts: Mapping[str, RigidBody] | None = None,
        may_average: bool = False,
        thickness: ThicknessMass | None = None,
        law: TurnLaw | None = None,
        rotary: FloatArray | None = None,
    ) -> None:
        """Collect nodes and inertia.

        Args:
            body: with one interface at least.
            rigid_parts: by interface the rigid part there: mass, inertia, and centre of mass from the
                interface's origin, in the interface's axes.
            may_average: whether interfaces may be averaged.
            thickness: further mass of edges through a wall, of those that go with one frame a part of its inertia;
                others of bonded nodes are left out of it.
            law: of unknowns that turn with the body, which may be rotations of beams and plates; None: of solids alone.
            rotary: (owned nodes, 3, 3) kg m^2, inertia of their rotations in the body's axes, where these have some.

        Raises:
            InterfaceError: on all ranks: no interface, an averaged one where none may be or which shares nodes
                with another, a rigid part of another name, or nodes whose inertia about an axis is zero where no
                rigid part helps; as `present_poses`.
            FormulationError: the mass cannot be lumped, or there are unknowns besides the displacement that have mass
                (``rotary`` apart) or turn with the body (without a ``law``), or springs on facets.
        """
        if law is None:
            refuse_turning_unknowns(body)
        body.refuse_surface_energy(by="a machine")
        parts, names = dict(rigid_parts or {}), [found.name for found in body.interfaces]
        check_frames(body.interfaces, parts, may_average=may_average)
        self._comm = body.comm
        self.nodes = np.concatenate([found.nodes for found in body.interfaces])
        self.frame_of = np.repeat(np.arange(len(names)), [len(found.nodes) for found in body.interfaces])
        self.own = self.nodes < body.layout.n_owned_nodes
        self._dofs = body.displacement_dofs[self.nodes]
        self._refuse_shared(names)
        lumped = body.vector()
        lumped.array[: body.n_owned] = lumped_mass(body)
        lumped.scatter_forward()
        if rotary is None:
            refuse_inertia_of_further_unknowns(body, lumped.array)
        self.turns = BondedTurns(body, law or SMALL_TURNS)
        mass: FloatArray = body.layout.displacements(lumped.array)[:, 0]
        kinds = [isinstance(found, AveragedInterface) for found in body.interfaces]
        self.averaged = np.array(kinds)[self.frame_of]
        self.mass = np.where(self.averaged, LENT, 1.0) * mass[self.nodes]
        own = mass[: body.layout.n_owned_nodes].sum() - self.mass[self.own].sum()
        self.free_mass = float(self.total(np.array(own)))
        self._origins, self._axes = present_poses(body)
        self._refuse_turned(body)
        offsets = body.node_x[self.nodes] - self._origins[self.frame_of]
        self._arms = np.einsum("nba,nb->na", self._axes[self.frame_of], offsets)
        self.reach = float(max(body.comm.allgather(abs(self._arms).max(initial=0.0))))
        self._thickness = thickness
        self._frame_at = np.full(len(body.layout.node_x), -1)
        self._frame_at[self.nodes] = self.frame_of
        if thickness is not None:
            thickness.bond(self._frame_at)
        #: (k, 3, 3) kg m^2, rotary inertia of the nodes on each frame about the frame's axes
        self.rotary: FloatArray = np.zeros((len(names), 3, 3))
        if rotary is not None:
            self._take_rotary_inertia(body, rotary)
        self.frames = self._frames(body, parts)

    def arms(self, motion: FrameMotion) -> FloatArray:
        """(n, 3) m, from the frames' origins to their nodes, in inertial axes."""
        return np.einsum("nab,nb->na", motion.R[self.frame_of], self._arms)

    def positions(self, motion: FrameMotion) -> FloatArray:
        """(n, 3) m, of the nodes, in inertial axes."""
        return np.asarray(motion.p[self.frame_of] + self.arms(motion))

    def velocities(self, motion: FrameMotion) -> FloatArray:
        """(n, 3) m/s, of the nodes."""
        turning = _skew(motion.w) @ motion.R
        return motion.v[self.frame_of] + np.einsum("nab,nb->na", turning[self.frame_of], self._arms)

    def accelerations(self, motion: FrameMotion) -> FloatArray:
        """(n, 3) m/s^2, of the nodes."""
        spin = _skew(motion.w)
        turning = (_skew(motion.alpha) + spin @ spin) @ motion.R
        return motion.a[self.frame_of] + np.einsum("nab,nb->na", turning[self.frame_of], self._arms)

    def wrenches(self, forces: FloatArray, arms: FloatArray) -> FloatArray:
        """Forces (n, 3) N at arms (n, 3) m as (k, 6) forces and moments about the frames' origins. Collective."""
        x, f = (values[self.own].T for values in (arms, forces))
        moments = np.array([x[1] * f[2] - x[2] * f[1], x[2] * f[0] - x[0] * f[2], x[0] * f[1] - x[1] * f[0]])
        of = self.frame_of[self.own]
        sums = [np.bincount(of, weights=part, minlength=len(self.frames)) for part in (*f, *moments)]
        return self.total(np.array(sums, dtype=float).T.copy())

    def total(self, values: FloatArray) -> FloatArray:
        """The sum over the ranks, made by one of them so that it is the same on all. Collective."""
        if self._comm.size == 1:
            return values
        summed = self._comm.reduce(values, op=MPI.SUM, root=0)
        return np.asarray(self._comm.bcast(summed, root=0))

    def take_lent_mass(self, mass: PETSc.Mat) -> None:
        """Subtract from a mass matrix the nodal masses that frames of averaged interfaces carry. Collective."""
        mine, first = self.own & self.averaged, mass.getOwnershipRange()[0]
        for dofs, lent in zip(self._dofs[mine] + first, self.mass[mine], strict=True):
            for dof in dofs:
                mass.setValue(dof, dof, -lent, addv=PETSc.InsertMode.ADD_VALUES)
        mass.assemble()

    def pose(self, motion: FrameMotion) -> tuple[FloatArray, FloatArray]:
        """Position (3,) and axes (3, 3) of the body frame that the first interface carries, in inertial axes."""
        R = self.axes_of(motion.R)
        return motion.p[0] - R @ self._origins[0], R

    def axes_of(self, frames: FloatArray) -> FloatArray:
        """(3, 3) axes of the body frame with axes (k, 3, 3) of the frames, to inertial ones."""
        return np.asarray(frames[0] @ self._axes[0].T)

    def _refuse_shared(self, names: list[str]) -> None:
        """An averaged face and another may not pull at one node: what each has of it would be open. Collective."""
        _, first, count = np.unique(self.nodes, return_index=True, return_counts=True)
        shared = self._comm.allreduce([names[k] for k in set(self.frame_of[first[count > 1]])])
        error = None
        if shared:
            error = InterfaceError(
                f"interface {shared[0]!r} and another have nodes in common: those of a body with history must not touch"
            )
        parallel.raise_collectively(self._comm, error)

    def _refuse_turned(self, body: NonlinearModel) -> None:
        """Unknowns that turn must have turned with their frames. Collective."""
        if not self.turns.any:
            return
        gap = abs(self.turns.increments(self._axes, np.eye(3), body.displacement))
        error = None
        if max(body.comm.allgather(float(gap.max(initial=0.0)))) > SAME_PLACE:
            error = InterfaceError(
                "the body is deformed already, and unknowns that turn with its interfaces have not turned as these; "
                "hold them too where the body is loaded before, or take a body that is new"
            )
        parallel.raise_collectively(self._comm, error)

    def _take_rotary_inertia(self, body: NonlinearModel, rotary: FloatArray) -> None:
        """Sum the frames' rotary inertia. Collective."""
        for k, found in enumerate(body.interfaces):
            mine = self.nodes[self.own & (self.frame_of == k)]
            self.rotary[k] = found.R.T @ self.total(rotary[mine].sum(axis=0)) @ found.R

    def _frames(self, body: NonlinearModel, parts: Mapping[str, RigidBody]) -> tuple[InteriorFrame, ...]:
        frames, error = [], None
        for k, found in enumerate(body.interfaces):
            mine = self.own & (self.frame_of == k)
            mass = self.total(mass_of_points(self.mass[mine], self._arms[mine] @ found.R.T))  # undeformed
            if self._thickness is not None:
                edges = self._thickness
                held = edges.mine & (self._frame_at[edges.nodes[:, 0]] == k)
                turning = mass_of_points(edges.added[held], edges.arms[held])[3:, 3:]
                mass[3:, 3:] = mass[3:, 3:] + self.total(turning)
            mass[3:, 3:] = mass[3:, 3:] + found.R @ self.rotary[k] @ found.R.T
            if found.name in parts:
                mass = mass + mass_of_part(parts[found.name], found.R)
            try:
                frame = interface_frame(found, mass)
                frames.append(replace(frame, p_BI_B=self._origins[k], R_BI=self._axes[k]))
            except InterfaceError as caught:
                error = error or caught
        parallel.raise_collectively(self._comm, error)
        return tuple(frames)


def _skew(w: FloatArray) -> FloatArray:
    """(k, 3, 3) matrices of the products with vectors (k, 3)."""
    out = np.zeros((len(w), 3, 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        out[:, j, i], out[:, i, j] = w[:, k], -w[:, k]
    return out
