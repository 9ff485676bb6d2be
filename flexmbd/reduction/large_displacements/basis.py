"""What a body that bends a lot has in its basis and its record: modal derivatives, and `NonlinearStiffness`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flexmbd.continuum.matrices.blocks import FloatArray, inner, multiply
from flexmbd.continuum.matrices.eigen import Modes
from flexmbd.record.groups import NonlinearStiffness
from flexmbd.record.reduced_body import FRAME_DOFS
from flexmbd.reduction.large_displacements.energy_polynomial import energy_polynomial
from flexmbd.reduction.large_displacements.force_derivatives import ForceDerivatives, force_derivatives
from flexmbd.reduction.large_displacements.load_series import FaceFields, face_motions
from flexmbd.reduction.large_displacements.modal_derivatives import ModalDerivatives, modal_derivatives
from flexmbd.reduction.static_shapes.statics import Statics
from flexmbd.reduction.stiffening.geometric_stiffness import UnitLoads, joined, unit_loads
from flexmbd.reduction.unit_loads import Load, load_vectors

# S of a face, xx yy zz yz xz xy.
_SYMMETRIC = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))


@dataclass(frozen=True, eq=False)
class NonlinearShapes:
    """Modal derivatives as shapes of a basis.

    Attributes:
        shapes: (owned dofs, m) in the mesh's axes.
        rows: (6 b, m) motions (m, rad) of the frames, in B's axes.
        face_strain: (b, 6, m) symmetric parts of the faces' motions, in B's axes.
        derivatives: of the body's internal forces.
        energy: J, the largest strain energy of the states that were compared.
        tolerance: of the relative error there.
        compared: (owned dofs, m) N, the loads of these states.
        notes: for the provenance.
    """

    shapes: FloatArray
    rows: FloatArray
    face_strain: FloatArray
    derivatives: ForceDerivatives
    energy: float
    tolerance: float
    compared: FloatArray
    notes: dict[str, str]

    def placed(self, first: int, n: int) -> LargeDisplacements:
        """Among n shapes of a basis, from a place on."""
        strain = np.zeros((*self.face_strain.shape[:2], n))
        strain[:, :, first : first + self.shapes.shape[1]] = self.face_strain
        return LargeDisplacements(strain, self.derivatives, self.energy, self.tolerance, self.compared)


@dataclass(frozen=True, eq=False)
class LargeDisplacements:
    """What is kept of them for the record.

    Attributes:
        face_strain: (b, 6, n) by the coordinates of the basis.
        derivatives: of the body's internal forces.
        energy: J.
        tolerance: of the relative error.
        compared: (owned dofs, m) N.
    """

    face_strain: FloatArray
    derivatives: ForceDerivatives
    energy: float
    tolerance: float
    compared: FloatArray

    def group(self, modes: FloatArray, change: FloatArray) -> tuple[NonlinearStiffness, str]:
        """The record's group for modes (local dofs including ghosts, n), by change (n, n) of the basis. Collective.

        And a note of what energy it is, for the provenance.
        """
        found = energy_polynomial(self.derivatives, modes)
        strain = self.face_strain @ change
        model = self.derivatives.model
        forces = inner(model.comm, modes[: model.n_owned], self.compared)
        numbers = np.array([self.energy]), np.array([self.tolerance])
        return NonlinearStiffness(found.cubic, found.quartic, strain, *numbers, forces), found.note


def nonlinear_shapes(
    statics: Statics, fixed: Modes, loads: Sequence[Load], *, choice: ModalDerivatives
) -> NonlinearShapes:
    """The modal derivatives of static shapes and modes. Collective.

    Args:
        statics: of the body.
        fixed: the modes, on all owned dofs.
        loads: distributed loads that the choice may name beside those of motion, of interfaces and of modes.
        choice: checked.

    Raises:
        ReductionError: on all ranks: as `modal_derivatives`.
    """
    model = statics.model
    base = np.hstack([statics.moving[0], fixed.shapes])
    if statics.floating and statics.rigid is not None:
        base = statics.rigid.deformation(base)
    derivatives = force_derivatives(model)
    every = joined(unit_loads(statics, statics.interfaces), _named(statics, loads), _of_modes(statics, fixed))
    known = FaceFields(np.asfortranarray(base), face_motions(statics, base))
    found = modal_derivatives(statics, known, derivatives, loads=every, choice=choice)
    rows, strain = _in_body_axes(statics.R, found.shapes.faces)
    # what holds an interface loads it
    stated = {*choice.loads, *(f"{name}.{dof}" for name in choice.held for dof in FRAME_DOFS)}
    forces = every.forces[:, [name in stated for name in every.names]]
    return NonlinearShapes(found.shapes.u, rows, strain, derivatives, found.energy, choice.tol, forces, found.notes)


def _named(statics: Statics, loads: Sequence[Load]) -> UnitLoads:
    names = tuple(f"load {load.name}" for load in loads)
    return UnitLoads(names, load_vectors(statics.model, loads), np.zeros(len(names)))


def _of_modes(statics: Statics, fixed: Modes) -> UnitLoads:
    """The loads that make each mode's largest displacement one metre. Collective."""
    model, count = statics.model, fixed.shapes.shape[1]
    nodes = fixed.shapes[model.displacement_dofs[: model.n_owned_nodes]]
    largest = np.zeros(count)
    if len(nodes):
        largest = np.linalg.norm(nodes, axis=1).max(axis=0)
    size = np.max(model.comm.allgather(largest), axis=0)
    forces = np.asfortranarray(multiply(model.K, fixed.shapes) / size)
    return UnitLoads(tuple(f"fixed-interface {i + 1}" for i in range(count)), forces, np.zeros(count))


def _in_body_axes(R: FloatArray, faces: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rows (6 b, m) and symmetric parts (b, 6, m) of faces' motions (b, 3, 4, m) in the mesh's axes."""
    turned = np.einsum("pa,bpqm,qc->bacm", R, faces[:, :, 1:], R)
    rows = np.zeros((len(faces), 6, faces.shape[3]))
    rows[:, :3] = np.einsum("pa,bpm->bam", R, faces[:, :, 0])
    for axis, (a, b) in enumerate(((1, 2), (2, 0), (0, 1))):
        rows[:, 3 + axis] = 0.5 * (turned[:, b, a] - turned[:, a, b])
    strain = np.stack([0.5 * (turned[:, a, b] + turned[:, b, a]) for a, b in _SYMMETRIC], axis=1)
    return rows.reshape(6 * len(faces), faces.shape[3]), strain
