"""The range of loads for which a body with large displacements is to be accurate, and its samples."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexmbd.continuum.matrices.blocks import FloatArray
from flexmbd.errors import ReductionError
from flexmbd.record.reduced_body import FRAME_DOFS
from flexmbd.reduction.large_displacements.face_fields import cross_matrices
from flexmbd.reduction.large_displacements.modal_derivatives import ModalDerivatives
from flexmbd.reduction.static_shapes.frame_motions import on_supports
from flexmbd.reduction.static_shapes.statics import Statics
from flexmbd.reduction.stiffening.geometric_stiffness import UnitLoads


@dataclass(frozen=True, eq=False)
class LoadRange:
    """Sampled loads: each alone, and each two with both signs, on the range's ellipsoid.

    Attributes:
        forces: (owned dofs, r) N at rest, those of wrenches on interfaces included; of a body whose frame floats less
            the inertia forces that they cause.
        in_cells: (owned dofs, r) N of these, without those of wrenches, which turn with their faces.
        wrenches: (b, 6, r) N and N m on the interfaces, in the mesh's axes.
    """

    forces: FloatArray
    in_cells: FloatArray
    wrenches: FloatArray

    def both_signs(self) -> LoadRange:
        """These and their opposites."""
        forces, in_cells = (np.asfortranarray(np.hstack([one, -one])) for one in (self.forces, self.in_cells))
        return LoadRange(forces, in_cells, np.concatenate([self.wrenches, -self.wrenches], axis=2))


def load_range(statics: Statics, loads: UnitLoads, choice: ModalDerivatives) -> LoadRange:
    """The loads of a choice. Collective.

    Args:
        statics: of the body.
        loads: all that the choice may name.
        choice: checked.

    Raises:
        ReductionError: on all ranks: an unknown load or interface to hold, or a load that a support takes up.
    """
    _check_held(statics, choice)
    samples = _samples(loads, choice)
    _check_supported(statics, choice)
    forces = np.asfortranarray(loads.forces @ samples)
    on_faces = loads.forces @ (samples * _of_interfaces(statics, loads)[:, None])
    if statics.floating and statics.rigid is not None:
        forces = np.asfortranarray(statics.rigid.balanced(forces))
    return LoadRange(forces, np.asfortranarray(forces - on_faces), _wrenches(statics, loads, samples))


def _check_held(statics: Statics, choice: ModalDerivatives) -> None:
    others = [one.name for one in statics.interfaces[0 if statics.floating else 1 :]]
    for name in choice.held:
        if statics.floating:
            raise ReductionError(f"ModalDerivatives: {name!r} cannot be held in a frame that floats; give frame=")
        if name not in others:
            raise ReductionError(f"ModalDerivatives: no interface {name!r} to hold; there are: {', '.join(others)}")


def _check_supported(statics: Statics, choice: ModalDerivatives) -> None:
    """Refuse wrenches on frames that supports leave no motion for, and faces they do not let turn. Collective."""
    model = statics.model
    if not model.supports:
        return
    motions = statics.frame_motions.motions
    for i, one in enumerate(statics.interfaces[1:]):
        if one.name not in choice.held:
            turns = cross_matrices(statics.R @ motions[6 * i + 3 : 6 * i + 6])
            products = np.einsum("abi,bcj->acij", turns, turns).reshape(3, 3, -1)
            on_supports(model, one, products + np.einsum("abi,bcj->acji", turns, turns).reshape(3, 3, -1))
    names = [f"{one.name}.{dof}" for one in statics.interfaces[1:] for dof in FRAME_DOFS]
    for name, row in zip(names, motions, strict=True):
        if name in choice.loads and not row.any():
            raise ReductionError(
                f"ModalDerivatives names the load {name!r}, which the supports of the part take up: it deforms "
                "nothing; leave it out"
            )


def _samples(loads: UnitLoads, choice: ModalDerivatives) -> FloatArray:
    """(l, r) sizes of the loads: each alone, and each two with both signs, on the range's ellipsoid."""
    unknown = sorted(set(choice.loads) - set(loads.names))
    if unknown:
        raise ReductionError(f"ModalDerivatives names the load {unknown[0]!r}; there are: {', '.join(loads.names)}")
    units = [np.array([float(size) * (name == one) for one in loads.names]) for name, size in choice.loads.items()]
    pairs = [
        (units[i] + sign * units[j]) / np.sqrt(2.0) for i in range(len(units)) for j in range(i) for sign in (1.0, -1.0)
    ]
    return np.column_stack([*units, *pairs])


def _of_interfaces(statics: Statics, loads: UnitLoads) -> FloatArray:
    """(l,) 1.0 for forces and moments on interfaces, else 0.0."""
    frames = {f"{one.name}.{dof}" for one in statics.interfaces for dof in FRAME_DOFS}
    return np.array([float(name in frames) for name in loads.names])


def _wrenches(statics: Statics, loads: UnitLoads, samples: FloatArray) -> FloatArray:
    """(b, 6, r) N and N m on the interfaces, in the mesh's axes."""
    found = np.zeros((len(statics.interfaces), 6, samples.shape[1]))
    for i, one in enumerate(statics.interfaces):
        for j, dof in enumerate(FRAME_DOFS):
            if f"{one.name}.{dof}" in loads.names:
                found[i, j] = samples[loads.names.index(f"{one.name}.{dof}")]
    turn = np.kron(np.eye(2), statics.R)
    return np.asarray(np.einsum("ij,bjr->bir", turn, found))
