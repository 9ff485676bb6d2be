"""Basis and record of a body with large displacements: modal derivatives, and `NonlinearStiffness`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flexmbd.continuum.matrices.blocks import FloatArray, inner, multiply
from flexmbd.continuum.matrices.eigen import Modes
from flexmbd.record.groups import NonlinearStiffness
from flexmbd.record.reduced_body import FRAME_DOFS
from flexmbd.reduction.large_displacements.derivative_search import modal_derivatives
from flexmbd.reduction.large_displacements.energy_polynomial import energy_polynomial
from flexmbd.reduction.large_displacements.face_fields import FaceFields, face_motions
from flexmbd.reduction.large_displacements.face_membranes import FaceMembranes, membrane_stiffness
from flexmbd.reduction.large_displacements.force_derivatives import ForceDerivatives, force_derivatives
from flexmbd.reduction.large_displacements.modal_derivatives import ModalDerivatives
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
        faces: of these shapes.
        linear: of the static shapes and modes, one after the other.
        derivatives: of the body's internal forces.
        R: (3, 3) rotation from B's axes to the mesh's.
        energy: J, the largest strain energy of the states that were compared.
        tolerance: of the relative error there.
        compared: (owned dofs, m) N, the loads of these states.
        notes: for the provenance.
    """

    shapes: FloatArray
    rows: FloatArray
    faces: FaceMembranes
    linear: FaceMembranes
    derivatives: ForceDerivatives
    R: FloatArray
    energy: float
    tolerance: float
    compared: FloatArray
    notes: dict[str, str]

    def placed(self, first: int) -> LargeDisplacements:
        """Among the shapes of a basis, from a place on."""
        before, after = np.split(self.linear.gradients, [first], axis=3)
        gradients = np.concatenate([before, self.faces.gradients, after], axis=3)
        faces = FaceMembranes(self.faces.stiffness, gradients)
        return LargeDisplacements(faces, self.derivatives, self.R, self.energy, self.tolerance, self.compared)


@dataclass(frozen=True, eq=False)
class LargeDisplacements:
    """Large displacements as the record keeps them.

    Attributes:
        faces: by the coordinates of the basis.
        derivatives: of the body's internal forces.
        R: (3, 3) rotation from B's axes to the mesh's.
        energy: J.
        tolerance: of the relative error.
        compared: (owned dofs, m) N.
    """

    faces: FaceMembranes
    derivatives: ForceDerivatives
    R: FloatArray
    energy: float
    tolerance: float
    compared: FloatArray

    @property
    def stiffness(self) -> FloatArray:
        """(n, n) N/m and so on: the membranes' stiffness, which keeps rigid faces rigid."""
        return self.faces.products(self.faces)

    def group(self, modes: FloatArray, change: FloatArray) -> tuple[NonlinearStiffness, str]:
        """The record's group for modes (local dofs including ghosts, n), by change (n, n) of the basis. Collective.

        And a note of what energy it is, for the provenance.
        """
        faces = FaceMembranes(self.faces.stiffness, self.faces.gradients @ change)
        found = energy_polynomial(self.derivatives, modes, faces)
        strain = _in_body_axes(self.R, faces.gradients)[1]
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
    membranes = membrane_stiffness(statics)
    found = modal_derivatives(statics, known, derivatives, loads=every, choice=choice, membranes=membranes)
    rows = _frame_rows(statics.R, found.shapes.faces)
    faces, linear = (FaceMembranes(membranes, one.faces[:, :, 1:]) for one in (found.shapes, known))
    # what holds an interface loads it
    stated = {*choice.loads, *(f"{name}.{dof}" for name in choice.held for dof in FRAME_DOFS)}
    forces = every.forces[:, [name in stated for name in every.names]]
    own = found.shapes.u, rows, faces, linear, derivatives, statics.R
    return NonlinearShapes(*own, found.energy, choice.tol, forces, found.notes)


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


def _frame_rows(R: FloatArray, faces: FloatArray) -> FloatArray:
    """(6 b, m) motions of the frames in B's axes, of faces' motions (b, 3, 4, m) in the mesh's."""
    rows = np.concatenate([np.einsum("pa,bpm->bam", R, faces[:, :, 0]), _in_body_axes(R, faces[:, :, 1:])[0]], axis=1)
    return rows.reshape(6 * len(faces), faces.shape[3])


def _in_body_axes(R: FloatArray, gradients: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Small rotations (b, 3, m) and symmetric parts (b, 6, m) of gradients A (b, 3, 3, m) in the mesh's axes."""
    turned = np.einsum("pa,bpqm,qc->bacm", R, gradients, R)
    rotation = [0.5 * (turned[:, b, a] - turned[:, a, b]) for a, b in ((1, 2), (2, 0), (0, 1))]
    strain = [0.5 * (turned[:, a, b] + turned[:, b, a]) for a, b in _SYMMETRIC]
    return np.stack(rotation, axis=1), np.stack(strain, axis=1)
