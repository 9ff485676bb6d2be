"""Geometric stiffness of a reduced body, load by load and by its modes.

A mode of small displacement theory keeps no length: without the stiffness that a load's stress adds, a
spinning beam goes soft (Kane, Ryan & Banerjee 1987, doi:10.2514/3.20195).  K_l,ij is the integral of
stress(u_l) : (grad phi_i^T grad phi_j) with u_l the static displacement of the whole model under the unit
load l (Wallrapp & Schwertassek 1991, Representation of geometric stiffening in multibody system
simulation, Int. J. Numer. Methods Eng. 32); see `flexmbd.reduction.stiffening.stress_stiffness`.

A machine that multiplies K_l by the loads of the moment takes the stress to follow them at once, and has no energy to
keep.  With the stress of the membrane fields (`flexmbd.reduction.stiffening.membrane`) in the place of the loads' the
strain energy itself is at hand, projected on these fields' strains (`ModalStretch`), under any load and for any
motion.  The fields hold the membrane part of the full model's static response to the loads of the body's own motion
and of its interfaces (`flexmbd.reduction.stiffening.stretch_modes`), so that the membrane force of such a load is
complete whatever the number of modes; under it their frequencies converge from above, as Ritz's do.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from dolfinx import fem

from flexmbd.continuum.finite_elements.interface import FoundInterface, RigidInterface
from flexmbd.continuum.finite_elements.linear_model import LinearModel
from flexmbd.continuum.matrices.blocks import FloatArray, inner, multiply, symmetric
from flexmbd.record.inertia_loads import ACCELERATIONS, ANGULAR_ACCELERATIONS, CENTRIFUGAL, CENTRIFUGAL_FIELDS
from flexmbd.record.reduced_body import FRAME_DOFS, GeometricStiffness, ModalStretch
from flexmbd.reduction.static_shapes.statics import Statics
from flexmbd.reduction.stiffening.gradient_parts import strain_over_rotation
from flexmbd.reduction.stiffening.membrane import membrane_fields, stretching_fields
from flexmbd.reduction.stiffening.resolved import resolved_deformations
from flexmbd.reduction.stiffening.stress_stiffness import stress_stiffness
from flexmbd.reduction.stiffening.thermal_stiffness import thermal_stiffness


@dataclass(frozen=True, eq=False)
class UnitLoads:
    """Loads of size one on a model, as the record's `GeometricStiffness` calls them.

    Attributes:
        names: (l,) of the loads.
        forces: (owned dofs, l) nodal forces, N per unit of each load, in the mesh's axes.
        accelerations: (l,) kg^(1/2) m/s^2, of inertia forces the norm a^T M a, to the power of 1/2, of the nodes'
            accelerations a that they belong to; zero of other loads.
        rises: K, of those that are temperatures, by their names.
    """

    names: tuple[str, ...]
    forces: FloatArray
    accelerations: FloatArray
    rises: Mapping[str, fem.Function] = field(default_factory=dict)

    def first(self, count: int) -> UnitLoads:
        """The first ones."""
        return UnitLoads(self.names[:count], self.forces[:, :count], self.accelerations[:count], self.rises)


def n_inertia_loads(*, floating: bool) -> int:
    """How many `inertia_loads` there are."""
    return len(CENTRIFUGAL) + (0 if floating else len(ACCELERATIONS) + len(ANGULAR_ACCELERATIONS))


def inertia_loads(
    model: LinearModel, *, p: FloatArray, R: FloatArray, floating: bool
) -> UnitLoads:
    """Inertia forces of the body frame's motion. Collective.

    Args:
        model: the body.
        p: (3,) m, the body frame's origin in the mesh's axes.
        R: (3, 3) rotation from the body frame's axes to the mesh's.
        floating: whether the frame floats on the mean axis: accelerations then deform nothing, since a rigid
            motion's inertia forces are what loads are balanced by, and are left out.

    Returns:
        -rho e_a and -rho e_a x r for accelerations, and the centrifugal forces -rho w x (w x r) split into the six
        products of the angular velocity (`flexmbd.record.inertia_loads`).
    """
    nodes = model.n_owned_nodes
    r = (model.node_x[:nodes] - p) @ R
    fields: FloatArray = np.zeros((model.n_owned, len(CENTRIFUGAL)), order="F")
    for column, slope in enumerate(CENTRIFUGAL_FIELDS):
        fields[model.displacement_dofs[:nodes], column] = r @ slope.T @ R.T
    names = CENTRIFUGAL
    if not floating:
        fields = np.hstack([-model.rigid_motions(p, R), fields])
        names = ACCELERATIONS + ANGULAR_ACCELERATIONS + CENTRIFUGAL
    forces = multiply(model.M, fields)
    sizes = np.sqrt(model.comm.allreduce(np.einsum("ij,ij->j", fields, forces)))
    return UnitLoads(names, forces, sizes)


def interface_loads(
    model: LinearModel, interfaces: Sequence[FoundInterface], *, R: FloatArray
) -> UnitLoads:
    """Unit forces and moments on interface frames, along the body frame's axes. Collective.

    On a rigid interface any nodal forces of that resultant do; those linear in the position are taken.

    Args:
        model: the body.
        interfaces: those that are loaded.
        R: (3, 3) rotation from the body frame's axes to the mesh's.
    """
    names = tuple(f"{interface.name}.{dof}" for interface in interfaces for dof in FRAME_DOFS)
    forces: FloatArray = np.zeros((model.n_owned, 6 * len(interfaces)), order="F")
    for i, interface in enumerate(interfaces):
        own = interface.dofs < model.n_owned
        dofs, block = interface.dofs[own], slice(6 * i, 6 * i + 6)
        if isinstance(interface, RigidInterface):
            motions = model.rigid_motions(interface.p, R)[dofs]
            forces[dofs, block] = motions @ np.linalg.inv(inner(model.comm, motions, motions))
        else:
            forces[dofs, block] = interface.average[own] @ np.kron(np.eye(2), R)
    return UnitLoads(names, forces, np.zeros(len(names)))


def joined(*loads: UnitLoads) -> UnitLoads:
    """Several sets of loads as one."""
    names = tuple(name for part in loads for name in part.names)
    forces = np.asfortranarray(np.hstack([part.forces for part in loads]))
    rises = {name: rise for part in loads for name, rise in part.rises.items()}
    return UnitLoads(names, forces, np.concatenate([part.accelerations for part in loads]), rises)


def unit_loads(statics: Statics, interfaces: Sequence[FoundInterface]) -> UnitLoads:
    """The loads of a body's motion and of its interfaces, as in `GeometricStiffness`. Collective.

    Args:
        statics: of the body.
        interfaces: those with frames, the first of `statics` at first. Where the body frame floats all are loaded, else
            all but that.
    """
    model, floating = statics.model, statics.floating
    moving = interfaces if floating else interfaces[1:]
    return joined(
        inertia_loads(model, p=statics.p, R=statics.R, floating=floating),
        interface_loads(model, moving, R=statics.R),
    )


@dataclass(frozen=True, eq=False)
class Stiffening:
    """The record's groups.

    Attributes:
        geometric: load by load.
        stretch: by the membrane fields.
        resolved: how many deformations are stiffened, or None: all.
    """

    geometric: GeometricStiffness
    stretch: ModalStretch
    resolved: int | None

    @property
    def note(self) -> str:
        """The record's provenance of geometric stiffness."""
        said = f"{len(self.geometric.loads)} loads, {len(self.stretch.strain)} membrane strains"
        if self.resolved is None:
            return said
        return f"{said}; of {self.resolved} deformations of {self.stretch.strain.shape[1]}, those that are resolved"


def stiffening(
    model: LinearModel,
    loads: UnitLoads,
    *,
    displacements: FloatArray,
    modes: FloatArray,
    stiffness: FloatArray,
    springs: FloatArray | None = None,
    resolved: float | None = None,
) -> Stiffening | None:
    """The groups from the static displacements under the loads and from the modes. Collective.

    Args:
        model: the body.
        loads: l of them.
        displacements: (local dofs including ghosts, l) m per unit of each load, with the body held at its frame.
        modes: (local dofs including ghosts, n) in normal form.
        stiffness: (n,) 1/s^2.
        springs: (n, n) 1/s^2, the part of the stiffness that springs on facets have, which is no strain; None: none.
        resolved: 1/s^2, of the fixed-interface modes the highest eigenvalue, where only what the reduction resolves is
            stiffened (`resolved_deformations`); None: all.

    Returns:
        The groups, the same to the bit on every rank; None where the formulation does not tell how a stress changes
        the stiffness (`stress_stiffness`).
    """
    energy = np.diag(stiffness)
    if springs is None:
        basis = np.diag(1.0 / np.sqrt(stiffness))
    else:
        # where the modes have strain energy in common: one in which they have none
        energy = symmetric(energy - springs)
        squares, x = np.linalg.eigh(energy)
        basis = x / np.sqrt(squares)
    if resolved is not None:
        responses = inner(model.comm, modes[: model.n_owned], loads.forces) / stiffness[:, None]
        chosen = resolved_deformations(
            basis.T @ basis,
            basis.T @ energy @ responses,
            accelerations=loads.accelerations,
            eigenvalue=resolved,
        )
        basis = np.asarray(model.comm.bcast(basis @ chosen, root=0))
    # what modal coordinates are in this basis
    coordinates = basis.T @ energy
    fields = modes @ basis
    found = stress_stiffness(model, np.hstack([displacements, fields]), fields)
    if found is None:
        return None
    by_load, by_field = np.split(found, [len(loads.names)])
    hot = [name for name in loads.names if name in loads.rises]
    if hot:
        by_load[[loads.names.index(name) for name in hot]] += thermal_stiffness(
            model, [loads.rises[name] for name in hot], fields
        )
    stretch = _stretch(by_field, strain_over_rotation(model, fields), coordinates)
    geometric = GeometricStiffness(loads.names, _symmetric(coordinates.T @ by_load @ coordinates))
    return Stiffening(geometric, stretch, None if resolved is None else basis.shape[1])


def _stretch(second_order: FloatArray, gradients: FloatArray, coordinates: FloatArray) -> ModalStretch:
    """Membrane strains of the modes.

    Args:
        second_order: (r, r, r) P_k,ij of deformations of the same energy without energy in common.
        gradients: (r, r) `strain_over_rotation`.
        coordinates: (r, n) theirs per unit of each mode.
    """
    fields = membrane_fields(second_order)
    strains = np.tensordot(fields.T, second_order, 1)
    others = np.eye(len(fields)) - fields @ fields.T
    pure = stretching_fields(fields, gradients)
    own = pure @ pure.T
    P = others @ strains @ others + own @ strains @ own
    return ModalStretch(fields.T @ coordinates, _symmetric(coordinates.T @ P @ coordinates))


def _symmetric(matrices: FloatArray) -> FloatArray:
    half: FloatArray = 0.5 * (matrices + matrices.transpose(0, 2, 1))
    return half
