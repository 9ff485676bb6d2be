"""Statics of a body with its interfaces: one factor for shapes, modes and loads.

Rigid interfaces are the boundary of `interior_stiffness`. Averaged ones stay inside, held by
multipliers (`flexmbd.reduction.static_shapes.constraint`). A body without rigid interfaces is held by six dofs that
keep it from moving and no more; a load in equilibrium calls no reaction there, so that, with the
rigid modes' part taken off loads and displacements, A = P K_s^-1 P^T with P = 1 - R (R^T M R)^-1 R^T M
does not depend on their choice.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property

from petsc4py import PETSc

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from flexmbd.continuum.finite_elements.held_surface import held_dofs
from flexmbd.continuum.finite_elements.interface import AveragedInterface, FoundInterface, RigidInterface
from flexmbd.continuum.finite_elements.linear_model import LinearModel
from flexmbd.continuum.finite_elements.nodal_interface import retained_dofs
from flexmbd.continuum.finite_elements.prestressed import turning_forces
from flexmbd.continuum.matrices.blocks import FloatArray, inner, multiply, symmetric
from flexmbd.continuum.matrices.eigen import BlockOperator
from flexmbd.errors import ReductionError
from flexmbd.reduction.static_shapes.constraint import Constraint, constrain
from flexmbd.reduction.static_shapes.factor import SINGULAR
from flexmbd.reduction.static_shapes.frame_motions import FrameMotions, frame_motions
from flexmbd.reduction.static_shapes.interior_stiffness import (
    HeldFactor,
    InteriorStiffness,
    Solver,
    continued,
    equilibrated,
    factorised,
)
from flexmbd.reduction.static_shapes.memory import multigrid_memory, stored, workspace
from flexmbd.reduction.static_shapes.nodal_shapes import NodalDofs, check_retained, nodal_dofs
from flexmbd.reduction.static_shapes.rigid_modes import RigidModes, rigid_modes
from flexmbd.reduction.static_shapes.stiffness_round_off import MARGIN, WORTHLESS, round_off
from flexmbd.reduction.static_shapes.support import is_held, minimal_support

# Responses to the inertia forces of the body's own motion, about as many as that.
_RESPONSES = 12


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
    def size(self) -> int:
        """Number of independent deformations on all ranks when all interfaces are fixed."""
        held = len(_averaged(self.interfaces)) if self.interfaces else int(self._supported)
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
        """Whether no interface is rigid or nodal and no support there, so that six dofs hold the body."""
        return not (_rigid(self.interfaces) or self.model.supports or self.model.nodal)

    @cached_property
    def frame_motions(self) -> FrameMotions:
        """What supports leave to the frames of all interfaces but the first. Collective at the first call."""
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
        displacement = _flexibility(self._interior, self._interior.solve, self._free, block)
        if self._constraint is None:
            return displacement
        return self._constraint.held(displacement, block)

    def approximate(self, block: FloatArray) -> FloatArray:
        """Nearly `solve`, at the least cost, of a body without averaged interfaces. Collective."""
        return _flexibility(self._interior, self._interior.inverse.approximate, self._free, block)

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
        motions = _rigid_columns(self.model, self.interfaces, axes=self.R)
        held = held_dofs(self.model.supports, layout=self.model.layout) | retained_dofs(self.model)
        motions[held] = 0.0
        shapes, forces = continued(self.model, self._interior, motions) if self.interfaces else (motions, motions)
        if self._constraint is not None:
            columns = _average_columns(self.model, self.interfaces, axes=self.R)
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
        if self.model.supports or self.model.nodal:
            # a rigid motion takes the supports and retained nodes along
            along = np.where(held[:, None], self.model.rigid_motions(origin, self.R), 0.0)
            found = found + continued(self.model, self._interior, np.asfortranarray(along))[0]
        if self.model.has_surface_energy:
            # springs hold a rigid motion back: it is that of the shapes once their forces are taken off
            back = multiply(self.model.K, self.model.rigid_motions(origin, self.R))
            found[self.mask] += self.solve(np.asfortranarray(back[self.mask]))
        error = _check_rigid_motions(self.model, found=found, origin=origin, axes=self.R)
        return StaticShapes(shapes, forces, error)

    def _shapes_of_free_body(self) -> StaticShapes:
        model, motions = self.model, self.model.rigid_motions(self.p, self.R)
        held = np.where(self._interior.mask[:, None], 0.0, motions)
        carried, _ = continued(model, self._interior, np.asfortranarray(held))
        error = _check_rigid_motions(model, found=carried, origin=self.p, axes=self.R)
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


@contextmanager
def body_statics(
    model: LinearModel,
    *,
    frame: str | None,
    solver: Solver | None = None,
    modes: int = 0,
    grounded: bool = False,
    carrying: Sequence[str] = (),
) -> Iterator[Statics]:
    """Factorise the stiffness of a body for a `with` block, or make another inverse. Collective.

    Args:
        model: the body.
        frame: the interface that carries the body frame; None: it floats on the mean axis.
        solver: the same on all ranks; None: the quickest that fits in memory.
        modes: how many will be looked for, by which the memory that is left is judged.
        grounded: whether supports may hold the body alone; else they are at rest in the frame of an interface.
        carrying: nodal interfaces whose nodes tell the rigid motions of a body without frames, as far as they can.

    Yields:
        The statics; its memory is given back at the end of the block.

    Raises:
        InterfaceError: on all ranks: the model has no interface `frame`.
        ReductionError: on all ranks: the stiffness is singular, averages depend on each other, or
            there is not enough memory; or the solver does not fit the formulation.
        ConvergenceError: on all ranks, where the statics are used: an iterative solver does not converge.
    """
    interfaces = model.interfaces
    if model.state is not None and frame != model.state.frame:
        raise ReductionError(
            f"the loaded state is that of a body held at {model.state.frame!r}, and so must its reduction be: "
            f"give frame={model.state.frame!r}, not {frame!r}"
        )
    if frame is not None:
        carrier = model.interface(frame)
        interfaces = (carrier, *(other for other in model.interfaces if other is not carrier))
    supported = not (_rigid(interfaces) or model.supports or model.nodal)
    check_retained(model)
    if model.supports and not grounded and (frame is None or not isinstance(interfaces[0], RigidInterface)):
        raise ReductionError(
            f"{model.supports[0].text}: supports are at rest in the body frame, which must therefore be that of a "
            "rigid interface, frame=...; a frame that floats with the body is no ground to them"
        )
    if model.supports and _averaged(interfaces):
        raise ReductionError(
            f"{model.supports[0].text}: a part with supports has no averaged interfaces, for half an average is none "
            f"of the whole; make {_averaged(interfaces)[0].name!r} Coupling.RIGID"
        )
    if model.has_surface_energy and (frame is None or supported):
        raise ReductionError(
            "springs on facets (surface_energy) reach from the surface to the body frame, which must therefore be that "
            "of an interface, frame=..., on a body with a rigid interface (Coupling.RIGID); a frame that floats with "
            "the body is no ground to them"
        )
    rigid = rigid_modes(model) if supported or (frame is None and not model.supports) else None
    if frame is None and rigid is not None:
        p, R = rigid.com, np.eye(3)
    elif not interfaces:
        p, R = np.zeros(3), np.eye(3)
    else:
        p, R = interfaces[0].p, interfaces[0].R
    if supported and rigid is not None:
        boundary = minimal_support(model, rigid)
    else:
        boundary = _bound(model, interfaces)
    if not is_held(model, boundary):
        raise ReductionError(f"the stiffness of the interior has no inverse: {SINGULAR}")
    shapes = 6 * len(interfaces) + model.comm.allreduce(int(retained_dofs(model).sum())) + _RESPONSES
    beside = workspace(model, shapes=shapes, modes=modes)
    with factorised(model, boundary, solver=solver, beside=beside) as interior:
        mask = np.ones_like(interior.mask) if supported else interior.mask
        constraint = None
        averaged = _averaged(interfaces)
        if averaged:
            free = rigid if supported else None
            constraint = constrain(
                model.comm,
                lambda block: _flexibility(interior, interior.solve, free, block),
                _average_columns(model, interfaces, axes=R)[mask],
                rigid=np.zeros((int(mask.sum()), 0)) if free is None else free.motions,
                names=[one.name for one in averaged],
            )
        yield Statics(
            model=model,
            interfaces=interfaces,
            floating=frame is None and not model.supports,
            p=p,
            R=R,
            rigid=rigid,
            mask=mask,
            M=model.M if supported else interior.M,
            _interior=interior,
            _constraint=constraint,
            _beside=beside,
            _carrying=tuple(carrying),
        )


def rigid_coordinates(
    interfaces: Sequence[FoundInterface], *, origin: FloatArray, axes: FloatArray
) -> FloatArray:
    """(6 b, 6) the interfaces' motions in a rigid motion of the body about `origin`, along `axes`."""
    coordinates = np.tile(np.eye(6), (len(interfaces), 1))
    for i, interface in enumerate(interfaces):
        arm = axes.T @ (interface.p - origin)
        coordinates[6 * i : 6 * i + 3, 3:] = np.cross(np.eye(3), arm).T
    return coordinates


def _rigid(interfaces: Sequence[FoundInterface]) -> list[RigidInterface]:
    return [one for one in interfaces if isinstance(one, RigidInterface)]


def _averaged(interfaces: Sequence[FoundInterface]) -> list[AveragedInterface]:
    return [one for one in interfaces if isinstance(one, AveragedInterface)]


def _flexibility(
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


def _bound(model: LinearModel, interfaces: Sequence[FoundInterface]) -> NDArray[np.bool_]:
    """(owned dofs,) whether a rigid interface binds a dof, a nodal one keeps it, or a support holds it."""
    boundary = held_dofs(model.supports, layout=model.layout) | retained_dofs(model)
    for interface in _rigid(interfaces):
        boundary[interface.dofs[interface.dofs < model.n_owned]] = True
    return boundary


def _rigid_columns(
    model: LinearModel, interfaces: Sequence[FoundInterface], *, axes: FloatArray
) -> FloatArray:
    """(owned dofs, 6 b) unit motions of the rigid interfaces on the dofs they bind, else zero."""
    motions = np.zeros((model.n_owned, 6 * len(interfaces)), order="F")
    for i, interface in enumerate(interfaces):
        if isinstance(interface, RigidInterface):
            dofs = interface.dofs[interface.dofs < model.n_owned]
            motions[dofs, 6 * i : 6 * i + 6] = model.rigid_motions(interface.p, axes)[dofs]
    return motions


def _average_columns(
    model: LinearModel, interfaces: Sequence[FoundInterface], *, axes: FloatArray
) -> FloatArray:
    """(owned dofs, 6 a) C^T of the averaged interfaces, for motions along `axes`."""
    averaged = _averaged(interfaces)
    columns = np.zeros((model.n_owned, 6 * len(averaged)), order="F")
    turn = np.kron(np.eye(2), axes)
    for i, interface in enumerate(averaged):
        owned = interface.dofs < model.n_owned
        columns[interface.dofs[owned], 6 * i : 6 * i + 6] = interface.average[owned] @ turn
    return columns


def _check_rigid_motions(
    model: LinearModel, *, found: FloatArray, origin: FloatArray, axes: FloatArray
) -> float:
    """Whether the rigid motions of the body cost no energy, and static shapes reproduce them. Collective.

    Args:
        model: the body.
        found: (owned dofs, 6) static shapes of a boundary that moves rigidly.
        origin: (3,) m, about which it turns.
        axes: (3, 3), along whose columns it moves.

    Returns:
        The relative error of the worst motion.

    Raises:
        ReductionError: on all ranks: they cost energy, or the error is above its bound.
    """
    expected = model.rigid_motions(origin, axes)
    # coordinates are known to the last digit of themselves, however far from zero the mesh lies
    sizes = abs(expected) + abs(model.rigid_motions(np.zeros(3), axes))
    with round_off(model.K) as noise:
        excess = 0.0 if model.has_surface_energy else noise.excess(multiply(model.K, expected), sizes)
        error = noise.distance(found, expected)
    if not excess <= MARGIN:
        raise ReductionError(
            f"the formulation's rigid_motion costs energy, so that the static shapes miss a rigid motion of the body: "
            f"its forces are {excess:.1e} times the round-off of their terms, bound {MARGIN:.0f}"
        )
    if not error <= WORTHLESS:
        raise ReductionError(
            f"the static shapes miss a rigid motion of the body by {error:.1e} of it, bound {WORTHLESS:.0e}: "
            "a part of the body is connected to no interface or not to the rest, or the formulation has deformations "
            "without energy, or the body is so thin, slender or nearly incompressible that double precision does not "
            "tell its softest deformations from its stiffest: take a formulation for it, of plates or beams"
        )
    return error
