"""Statics of a body with its interfaces: one factor for shapes, modes and loads.

Rigid interfaces are the boundary of `interior_stiffness`. Averaged ones stay inside, held by
multipliers (`flexmbd.reduction.static_shapes.constraint`). A body without rigid interfaces is held by six dofs that
keep it from moving and no more; a load in equilibrium calls no reaction there, so that, with the
rigid modes' part taken off loads and displacements, A = P K_s^-1 P^T with P = 1 - R (R^T M R)^-1 R^T M
does not depend on their choice.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from petsc4py import PETSc

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from flexmbd.continuum.finite_elements.held_surface import held_dofs
from flexmbd.continuum.finite_elements.interface import AveragedInterface, FoundInterface
from flexmbd.continuum.finite_elements.linear_model import LinearModel
from flexmbd.continuum.finite_elements.nodal_interface import retained_dofs
from flexmbd.continuum.finite_elements.prestressed import turning_forces
from flexmbd.continuum.matrices.blocks import FloatArray, inner, multiply, symmetric
from flexmbd.continuum.matrices.eigen import BlockOperator
from flexmbd.errors import ReductionError
from flexmbd.reduction.static_shapes.constraint import Constraint
from flexmbd.reduction.static_shapes.frame_motions import FrameMotions, frame_motions
from flexmbd.reduction.static_shapes.interface_motions import (
    average_columns,
    averaged,
    rigid_columns,
    rigid_coordinates,
)
from flexmbd.reduction.static_shapes.interior_stiffness import (
    HeldFactor,
    InteriorStiffness,
    continued,
    equilibrated,
)
from flexmbd.reduction.static_shapes.memory import multigrid_memory, stored
from flexmbd.reduction.static_shapes.nodal_shapes import NodalDofs, nodal_dofs
from flexmbd.reduction.static_shapes.rigid_modes import RigidModes
from flexmbd.reduction.static_shapes.rigid_motion_check import check_rigid_motions
from flexmbd.reduction.static_shapes.stiffness_round_off import round_off
from flexmbd.reduction.static_shapes.support import needs_support


@dataclass(frozen=True, eq=False)
class StaticShapes:
    """Static shapes of all interfaces: each moved by one unit with the others fixed.

    Attributes:
        shapes: (owned dofs, 6 b) displacements: of each interface three translations by 1 m, three
            small rotations by 1 rad about its origin, along B's axes.
        forces: (owned dofs, 6 b) K times them.
        rigid_error: largest error of the rigid motions among them.
    """

    shapes: FloatArray
    forces: FloatArray
    rigid_error: float


@dataclass(frozen=True, eq=False)
class Statics:
    """The static response of a body; made by `body_statics`.

    Attributes:
        model: the body.
        interfaces: the found interfaces; the first carries the body frame unless that floats.
        floating: whether the body frame B floats on the mean axis.
        p: (3,) m, B's origin in the mesh's axes: the first interface's, or the centre of mass.
        R: (3, 3) rotation from B's axes to the mesh's: the first interface's, or the identity.
        rigid: the rigid modes of a body that nothing holds or whose frame floats, or None.
        mask: (owned dofs,) the dofs of this rank that move when all interfaces are fixed.
        M: mass of these dofs.
    """

    model: LinearModel
    interfaces: tuple[FoundInterface, ...]
    floating: bool
    p: FloatArray
    R: FloatArray
    rigid: RigidModes | None
    mask: NDArray[np.bool_]
    M: PETSc.Mat
    _interior: InteriorStiffness
    _constraint: Constraint | None
    _beside: int
    _carrying: tuple[str, ...] = ()

    @property
    def solver(self) -> str:
        """How the stiffness is inverted, for the record's provenance."""
        return self._interior.inverse.name

    @property
    def has_factor(self) -> bool:
        """Whether it is inverted by a factor."""
        return isinstance(self._interior.inverse, HeldFactor)

    @property
    def tolerance(self) -> float:
        """To which the factor is compressed; 0: it is not, or there is none."""
        return self._interior.inverse.tolerance if isinstance(self._interior.inverse, HeldFactor) else 0.0

    @cached_property
    def memory(self) -> int:
        """Bytes that the reduction takes on all ranks, by estimate, beside its model. Collective.

        With a second factor, by which modes are counted, as far as both fit in the memory there is.
        """
        inverse = self._interior.inverse
        if not isinstance(inverse, HeldFactor):
            return self._beside + multigrid_memory(self.model)
        # the factor is made of a copy of K
        return self._beside + 2 * inverse.memory + stored(self.model.K)

    def release_factor(self) -> None:
        """Give the factor's memory back; it is made again where it is needed. Collective."""
        if isinstance(self._interior.inverse, HeldFactor):
            self._interior.inverse.release()

    @property
    def held_averages(self) -> FloatArray | None:
        """(rows of `mask`, c) C^T of the averages that are zero when all interfaces are fixed, if there are some."""
        return None if self._constraint is None else self._constraint.columns

    @property
    def massless(self) -> NDArray[np.bool_]:
        """(rows of `mask`,) the unknowns without mass."""
        return np.asarray(self.M.getDiagonal().array_r == 0.0)

    @property
    def size(self) -> int:
        """Number of independent deformations on all ranks when all interfaces are fixed."""
        held = len(averaged(self.interfaces)) if self.interfaces else int(self._supported)
        return int(self.M.getSize()[0]) - 6 * held

    @property
    def is_exact(self) -> bool:
        """Whether one solution with the stiffness is as cheap as an approximate one."""
        return self.has_factor and self.tolerance == 0.0

    @property
    def _free(self) -> RigidModes | None:
        """The rigid modes of a body that nothing holds."""
        return self.rigid if self._supported else None

    @property
    def _supported(self) -> bool:
        """Whether six dofs hold the body, nothing else doing so."""
        return needs_support(self.model, self.interfaces)

    @cached_property
    def frame_motions(self) -> FrameMotions:
        """The motions of all interfaces' frames but the first that supports allow. Collective at the first call."""
        return frame_motions(self.model, self.interfaces[1:], axes=self.R)

    @cached_property
    def moving(self) -> tuple[FloatArray, FloatArray]:
        """(owned dofs, m) static shapes of these motions, then of nodal interfaces, and K times them.

        Collective at the first call.
        """
        shapes, forces = self.static.shapes[:, 6:], self.static.forces[:, 6:]
        if self.model.supports:
            motions = self.frame_motions.motions
            shapes, forces = np.asfortranarray(shapes @ motions), np.asfortranarray(forces @ motions)
        if self.nodal is None:
            return shapes, forces
        more, their_forces = continued(self.model, self._interior, self.nodal.unit_motions)
        return np.asfortranarray(np.hstack([shapes, more])), np.asfortranarray(np.hstack([forces, their_forces]))

    @cached_property
    def nodal(self) -> NodalDofs | None:
        """The dofs that nodal interfaces keep, if there are some. Collective at the first call."""
        if not self.model.nodal:
            return None
        return nodal_dofs(self.model, axes=self.R, framed=bool(self.interfaces), carrying=self._carrying)

    def solve(self, block: FloatArray) -> FloatArray:
        """Displacements under loads with all interfaces fixed, averaged ones in the mean. Collective.

        Args:
            block: (rows of `mask`, k), N.

        Returns:
            The same shape, m. Of a body without interfaces: the deformation under the loads and the
            inertia forces they cause.
        """
        displacement = flexibility(self._interior, self._interior.solve, self._free, block)
        if self._constraint is None:
            return displacement
        return self._constraint.held(displacement, block)

    def approximate(self, block: FloatArray) -> FloatArray:
        """Nearly `solve`, at the least cost, of a body without averaged interfaces. Collective."""
        return flexibility(self._interior, self._interior.inverse.approximate, self._free, block)

    def deformation(self, block: FloatArray) -> FloatArray:
        """Displacements (rows of `mask`, k) less rigid motions, where nothing holds the body. Collective."""
        return block if self._free is None else np.asfortranarray(self._free.deformation(block))

    def stiffness(self, block: FloatArray) -> FloatArray:
        """K times displacements (rows of `mask`, k) with all interfaces fixed, N, on the same rows. Collective."""
        return np.asfortranarray(multiply(self.model.K, self._on_all(block))[self.mask])

    def noise(self, block: FloatArray) -> FloatArray:
        """Sizes of the round-off of `stiffness`, N. Collective."""
        with round_off(self.model.K) as measure:
            return np.asfortranarray(measure.forces(self._on_all(block))[self.mask])

    def _on_all(self, block: FloatArray) -> FloatArray:
        whole = np.zeros((len(self.mask), block.shape[1]), order="F")
        whole[self.mask] = block
        return whole

    def held_response(self, loads: FloatArray) -> FloatArray:
        """`solve` on all owned dofs: (owned dofs, k), m, under loads (owned dofs, k), N. Collective."""
        u = np.zeros(loads.shape, order="F")
        u[self.mask] = self.solve(np.asfortranarray(loads[self.mask]))
        return u

    def cancelled_energies(self, loads: FloatArray, *, forces: FloatArray) -> FloatArray:
        """(k,) twice the strain energies of what the reactions of averages take off a response. Collective.

        Where a load acts on an averaged interface alone that is all of it, and `held_response` its round-off.

        Args:
            loads: (owned dofs, k), N.
            forces: K times `held_response` to them.
        """
        if self._constraint is None:
            return np.zeros(loads.shape[1])
        return self._constraint.energies((forces - loads)[self.mask])

    def static_response(self, loads: FloatArray, *, held: FloatArray | None = None) -> FloatArray:
        """Solve K u = f for a block of loads: body held at its frame, all else free. Collective.

        Rigid interfaces other than the frame's move as rigid frames. Where B floats nothing holds the
        body: the loads are first made self-equilibrated by the inertia forces they cause
        (`RigidModes.balanced`), and u fulfils the mean-axis conditions. The response with all
        interfaces fixed, plus the static shapes Psi times (Psi^T K Psi)^-1 Psi^T f, is exact, since
        the two have no energy in common.

        Args:
            loads: (owned dofs, k), N, or what forces belong to the dofs.
            held: `held_response` to the same, where it is known; read where nothing is added to the loads.

        Returns:
            (owned dofs, k) displacements in the mesh's axes, m.

        Raises:
            ReductionError: on all ranks: see `static`.
        """
        balance = self.rigid if self.floating else None
        f = loads if balance is None else balance.balanced(loads)
        shapes, forces = self.moving
        u = self.response_of(f, shapes=shapes, forces=forces, held=held if balance is None else None)
        return u if balance is None else balance.deformation(u)

    def response_of(
        self, loads: FloatArray, *, shapes: FloatArray, forces: FloatArray, held: FloatArray | None = None
    ) -> FloatArray:
        """Solve K u = f where the interfaces move by some static shapes only. Collective.

        Args:
            loads: (owned dofs, k) f, N.
            shapes: (owned dofs, s) combinations Psi of the static shapes, without a rigid motion of the body.
            forces: (owned dofs, s) K times them.
            held: `held_response` to the loads, where it is known.

        Returns:
            (owned dofs, k) displacements in the mesh's axes, m.

        Raises:
            ReductionError: on all ranks: a shape without a positive stiffness.
        """
        u = self.held_response(loads) if held is None else held.copy(order="F")
        if shapes.shape[1] > 0:
            stiffness = symmetric(inner(self.model.comm, shapes, forces))
            if not (np.diag(stiffness) > 0.0).all():
                raise ReductionError("the body is not stable: a motion of an interface has no positive stiffness")
            scale = 1.0 / np.sqrt(np.diag(stiffness))
            right = scale[:, None] * inner(self.model.comm, shapes, loads)
            q = scipy.linalg.solve(stiffness * np.outer(scale, scale), right, assume_a="pos")
            u += shapes @ (scale[:, None] * q)
        return u

    @cached_property
    def static(self) -> StaticShapes:
        """The static shapes. Collective at the first call.

        Raises:
            ReductionError: on all ranks: the shapes are out of equilibrium, or miss a rigid motion.
        """
        if self._supported:
            return self._shapes_of_free_body()
        if not self.interfaces and not self.model.nodal:
            none = np.zeros((self.model.n_owned, 0), order="F")
            return StaticShapes(none, none, 0.0)
        motions = rigid_columns(self.model, self.interfaces, axes=self.R)
        held = held_dofs(self.model.supports, layout=self.model.layout) | retained_dofs(self.model)
        held |= self.model.tied_dofs
        motions[held] = 0.0
        shapes, forces = continued(self.model, self._interior, motions) if self.interfaces else (motions, motions)
        if self._constraint is not None:
            columns = average_columns(self.model, self.interfaces, axes=self.R)
            lacks = self._unit_averages() - inner(self.model.comm, columns, shapes)
            small = self._constraint.multipliers(lacks)
            shapes[self.mask] += self._constraint.responses @ small
            shapes, forces = self._equilibrated(self._constraint, shapes, small)
        state = self.model.state
        if state is not None:
            # loads that stay with the body frame work on its rigid rotations
            turning = turning_forces(self.model, state, self.interfaces, axes=self.R)
            return StaticShapes(shapes, forces + turning, state.rigid_error)
        origin = self.interfaces[0].p if self.interfaces else self.p
        found = shapes @ rigid_coordinates(self.interfaces, origin=origin, axes=self.R)
        if self.model.supports or self.model.nodal or self.model.ties is not None:
            # a rigid motion takes the supports, retained nodes and what follows by ties along
            along = np.where(held[:, None], self.model.rigid_motions(origin, self.R), 0.0)
            found = found + continued(self.model, self._interior, np.asfortranarray(along))[0]
        if self.model.has_surface_energy:
            # springs hold a rigid motion back: it is that of the shapes once their forces are taken off
            back = multiply(self.model.K, self.model.rigid_motions(origin, self.R))
            found[self.mask] += self.solve(np.asfortranarray(back[self.mask]))
        error = check_rigid_motions(self.model, found=found, origin=origin, axes=self.R)
        return StaticShapes(shapes, forces, error)

    def _shapes_of_free_body(self) -> StaticShapes:
        model, motions = self.model, self.model.rigid_motions(self.p, self.R)
        held = np.where(self._interior.mask[:, None], 0.0, motions)
        carried, _ = continued(model, self._interior, np.asfortranarray(held))
        error = check_rigid_motions(model, found=carried, origin=self.p, axes=self.R)
        if self._constraint is None:
            none = np.zeros((model.n_owned, 0), order="F")
            return StaticShapes(none, none, error)
        small = self._constraint.multipliers(self._unit_averages())
        shapes = np.asfortranarray(self._constraint.responses @ small)
        # a single interface's shapes are the rigid motions, without a load to measure by
        single = len(self.interfaces) == 1
        if single:
            return StaticShapes(shapes, multiply(model.K, shapes), error)
        return StaticShapes(*self._equilibrated(self._constraint, shapes, small), error)

    def _equilibrated(
        self, constraint: Constraint, shapes: FloatArray, multipliers: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Shapes in equilibrium with the forces on the averages, and K times them. Collective."""
        load = np.zeros_like(shapes)
        load[self.mask] = constraint.columns @ multipliers[: constraint.columns.shape[1]]
        return equilibrated(self.model, self.solve, shapes, mask=self.mask, load=load)

    def _unit_averages(self) -> FloatArray:
        """(6 a, 6 b) averages of the a averaged interfaces in the unit motions of all b."""
        rows = [isinstance(one, AveragedInterface) for one in self.interfaces]
        return np.eye(6 * len(rows))[np.repeat(rows, 6)]


def flexibility(
    interior: InteriorStiffness, solve: BlockOperator, free: RigidModes | None, block: FloatArray
) -> FloatArray:
    """A times a block: K_II^-1, or the elastic flexibility of a body that nothing holds. Collective.

    By `solve`, the interior's inverse or nearly that.
    """
    if free is None:
        return solve(block)
    loads = free.balanced(block)
    displacement = np.zeros(loads.shape, order="F")
    displacement[interior.mask] = solve(np.asfortranarray(loads[interior.mask]))
    return np.asfortranarray(free.deformation(displacement))
