"""Modal derivatives: the further shapes with which a body bends a lot, chosen by what its full model says.

A slender body that bends shortens by the square of its bending, and its sections turn by sines and cosines. On a basis
of linear shapes this stretches the body, which locks. The further shapes are those that the equilibria of the full
model need under the loads of a stated range (`flexmbd.reduction.large_displacements.load_series`), as far as the basis
does not have them, ordered by strain energy (proper orthogonal decomposition in the energy's inner product). See Jain,
Tiso, Rutzmoser & Rixen 2017, doi:10.1016/j.compstruc.2017.04.005, for modal derivatives and quadratic manifolds; here
they are coordinates of their own, so that the energy stays a polynomial of degree four.

How many are kept is decided by an error: at the reduced body's equilibria under sampled loads of the range the full
model's forces are out of balance by r, and u_r = K^-1 r, with all interfaces held, says what displacement is lacking.
Its energy over the body's strain energy is the estimate.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import scipy.linalg

from flexmbd.continuum import parallel
from flexmbd.continuum.finite_elements.ghosts import with_ghosts
from flexmbd.continuum.finite_elements.interface import AveragedInterface, RigidInterface
from flexmbd.continuum.matrices.blocks import FloatArray, inner, multiply, symmetric, total
from flexmbd.errors import ConvergenceError, ReductionError
from flexmbd.record.strain_polynomial import StrainPolynomial
from flexmbd.record.turned_face import turned_face
from flexmbd.reduction.large_displacements.energy_polynomial import energy_polynomial
from flexmbd.reduction.large_displacements.face_fields import (
    FaceFields,
    cross_matrices,
    followed,
    prescribe,
    small_motion,
)
from flexmbd.reduction.large_displacements.face_membranes import FaceMembranes
from flexmbd.reduction.large_displacements.force_derivatives import ForceDerivatives
from flexmbd.reduction.large_displacements.load_range import LoadRange, load_range
from flexmbd.reduction.large_displacements.load_series import load_series
from flexmbd.reduction.large_displacements.modal_derivatives import ModalDerivatives
from flexmbd.reduction.static_shapes.frame_motions import on_supports
from flexmbd.reduction.static_shapes.statics import Statics
from flexmbd.reduction.stiffening.geometric_stiffness import UnitLoads
from flexmbd.round_off import EQUAL

# Averaged interfaces in sampled states and their rotations, by the numbers of interface and state.
_Averages: TypeAlias = "dict[tuple[int, int], tuple[AveragedInterface, FloatArray]]"
# How often what is lacking at the sampled loads is added to the candidates.
_ROUNDS = 8
# Of the tolerated error: strain energy of a shape that is not looked at.
_NEGLIGIBLE = 1e-2
# Relative change of the forces by the turn of the faces, at which an equilibrium is found, and in how many steps.
_SAME = 1e-7
_TURNS = 60


@dataclass(frozen=True, eq=False)
class ChosenDerivatives:
    """The shapes that were chosen.

    Attributes:
        shapes: without stiffness in common with the other shapes of the basis.
        energy: J, the largest strain energy at the sampled loads.
        notes: for the provenance.
    """

    shapes: FaceFields
    energy: float
    notes: dict[str, str]


def modal_derivatives(
    statics: Statics,
    base: FaceFields,
    derivatives: ForceDerivatives,
    *,
    loads: UnitLoads,
    choice: ModalDerivatives,
    membranes: FloatArray,
) -> ChosenDerivatives:
    """Choose the derivatives beside a basis. Collective.

    Args:
        statics: of the body.
        base: static shapes and modes, of a body whose frame floats without rigid motions.
        derivatives: of the internal forces.
        loads: all that the choice may name.
        choice: checked.
        membranes: (b, 6, 6) J, see `FaceMembranes`.

    Raises:
        ReductionError: on all ranks: an unknown load, forces that are linear, or an error above the tolerance.
    """
    if derivatives.vanish:
        raise ReductionError(
            f"{statics.model.form_name} has a strain energy without third and fourth derivatives, so that its body "
            "stays linear; leave nonlinear= out, or take a form of finite strain, as flexmbd.forms.st_venant_kirchhoff"
        )
    sampled = load_range(statics, loads, choice)
    known = _unit_energies(statics, base)
    series = load_series(
        statics, derivatives, sampled.forces, order=choice.order, wrenches=sampled.wrenches, held=choice.held
    )
    found = series[1]
    for more in series[2:]:
        found = found.joined(more)
    size = np.einsum("ij,ij->j", series[0].u, multiply(statics.model.K, series[0].u))
    least = _NEGLIGIBLE * choice.tol * float(total(statics.model.comm, size).max())
    search = _Search(statics, derivatives, known, sampled.both_signs(), choice, least, membranes)
    return search.chosen(found)


def _unit_energies(statics: Statics, fields: FaceFields) -> FaceFields:
    """The same span, orthonormal in the strain energy. Collective."""
    model = statics.model
    k = symmetric(inner(model.comm, fields.u, multiply(model.K, fields.u)))
    scale = 1.0 / np.sqrt(np.diag(k))
    factor = np.linalg.cholesky(k * np.outer(scale, scale))
    return fields.combined(scale[:, None] * np.linalg.inv(factor).T)


@dataclass(frozen=True, eq=False)
class _State:
    """What is known at the sampled loads, of a number of derivatives.

    Attributes:
        error: the estimate, the largest.
        energy: J, the largest strain energy.
        lacking: what the basis has not, with all interfaces held.
    """

    error: float
    energy: float
    lacking: FaceFields


@dataclass(frozen=True, eq=False)
class _Search:
    """The search for as few derivatives as are good enough.

    Attributes:
        statics: of the body.
        derivatives: of the internal forces.
        known: the basis there is, of unit energies.
        loads: sampled, r of them.
        choice: the tolerance.
        least: J, twice the energy of shapes that are not looked at.
        membranes: (b, 6, 6) J, see `FaceMembranes`.
    """

    statics: Statics
    derivatives: ForceDerivatives
    known: FaceFields
    loads: LoadRange
    choice: ModalDerivatives
    least: float
    membranes: FloatArray

    def chosen(self, candidates: FaceFields) -> ChosenDerivatives:
        """As few of the candidates as reach the tolerance, and more candidates where all do not. Collective."""
        shapes = self._further(self.known, candidates, most=self.choice.most)
        for _ in range(_ROUNDS):
            basis = self.known.joined(shapes)
            polynomial, local = self._polynomial(basis)
            whole = self._state(polynomial, basis, local)
            if whole.error <= self.choice.tol or shapes.u.shape[1] >= self.choice.most:
                break
            room = self.choice.most - shapes.u.shape[1]
            more = self._further(basis, whole.lacking, most=room)
            if more.u.shape[1] == 0:
                break
            shapes = shapes.joined(more)
        if whole.error > self.choice.tol:
            self._refuse(whole, shapes.u.shape[1])
        few, count, state = 0, shapes.u.shape[1], whole
        while count - few > 1:
            middle = (few + count) // 2
            found = self._state(polynomial, basis, local, middle)
            if found.error <= self.choice.tol:
                count, state = middle, found
            else:
                few = middle
        notes = {
            "modal derivatives": str(count),
            "loads of the modal derivatives": ", ".join(f"{one}: {size:g}" for one, size in self.choice.loads.items()),
            "error of the strain energy at these loads": f"{state.error:.1e}",
            **({"held under these loads": ", ".join(self.choice.held)} if self.choice.held else {}),
        }
        return ChosenDerivatives(shapes.combined(np.eye(shapes.u.shape[1])[:, :count]), state.energy, notes)

    def _further(self, known: FaceFields, candidates: FaceFields, *, most: int) -> FaceFields:
        """What candidates have beside known fields of unit energy: unit energies, none in common, most needed first.

        Args:
            known: the fields.
            candidates: more.
            most: how many are taken.
        """
        for _ in range(2):
            candidates = candidates.less(known, self._work(known, candidates))
        k = symmetric(self._work(candidates, candidates))

        def change() -> FloatArray:
            values, vectors = np.linalg.eigh(k)
            own = np.flatnonzero(values > max(self.least, EQUAL * values[-1]))[::-1][:most]
            found: FloatArray = vectors[:, own] / np.sqrt(values[own])
            return found

        return candidates.combined(parallel.on_root(self.statics.model.comm, change))

    def _work(self, one: FaceFields, other: FaceFields) -> FloatArray:
        """(k, m) J, the work of the fields' forces on others, membranes on faces included. Collective."""
        model = self.statics.model
        between = self._membranes(one).products(self._membranes(other))
        return np.asarray(inner(model.comm, one.u, multiply(model.K, other.u)) + between)

    def _membranes(self, fields: FaceFields) -> FaceMembranes:
        return FaceMembranes(self.membranes, fields.faces[:, :, 1:])

    def _polynomial(self, basis: FaceFields) -> tuple[StrainPolynomial, FloatArray]:
        """The strain energy on the basis and all shapes, and these on the local dofs. Collective."""
        local = with_ghosts(self.statics.model, basis.u)
        found = energy_polynomial(self.derivatives, local, self._membranes(basis))
        return StrainPolynomial(np.ones(local.shape[1]), found.cubic, found.quartic), local

    def _state(
        self, polynomial: StrainPolynomial, basis: FaceFields, local: FloatArray, count: int | None = None
    ) -> _State:
        """The error with the first so many derivatives. Collective."""
        n = local.shape[1] if count is None else self.known.u.shape[1] + count
        model, part = self.statics.model, polynomial.first(n)
        faces = basis.faces[..., :n]
        modal = inner(model.comm, basis.u[:, :n], self.loads.in_cells)
        q = parallel.on_root(model.comm, lambda: self._equilibria(part, faces, modal))
        u = np.asfortranarray(local[:, :n] @ q)
        rest = np.column_stack([self.derivatives.force(u[:, i]) for i in range(u.shape[1])]) - self.loads.in_cells
        averages = self._averages(u, faces @ q)
        for (i, k), (average, _) in averages.items():
            own = average.dofs < model.n_owned
            rest[average.dofs[own], k] -= average.average[own] @ self.loads.wrenches[i, :, k]
        rest = np.asfortranarray(rest)
        back, gradients = self._unstrained_faces(faces @ q)
        # what takes rigid faces back to rigid ones, and the rest of the body to equilibrium there
        lacking = self.statics.held_response(np.asfortranarray(-rest - multiply(model.K, back))) + back
        half = 0.5 * total(model.comm, np.einsum("ij,ij->j", lacking, multiply(model.K, lacking)))
        excess = half + abs(total(model.comm, np.einsum("ij,ij->j", back, rest)))
        energy = np.array([part.energy(one) for one in q.T])
        if not (energy > 0.0).all():
            raise ReductionError(
                f"ModalDerivatives: a load of the range {dict(self.choice.loads)} deforms nothing; leave it out"
            )
        moved = FaceFields(np.asfortranarray(lacking), gradients + self._small(lacking, averages))
        return _State(float((excess / energy).max()), float(energy.max()), moved)

    def _unstrained_faces(self, motions: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Displacements (owned dofs, r) of rigid faces that are strained, back to turned ones, and [0 | A] of these.

        motions: [d | A] (b, 3, 4, r); the rotation is that of the polar decomposition 1 + A = R U.
        """
        statics, changes = self.statics, np.zeros_like(motions)
        back = np.zeros((statics.model.n_owned, motions.shape[3]), order="F")
        for i, one in enumerate(statics.interfaces):
            if isinstance(one, RigidInterface):
                for k in range(motions.shape[3]):
                    F = np.eye(3) + motions[i, :, 1:, k]
                    changes[i, :, 1:, k] = turned_face(F, np.zeros((3, 3, 0)))[0] - F
                kept = on_supports(statics.model, one, changes[i, :, 1:])
                changes[i] += np.concatenate([kept[:3, None], cross_matrices(kept[3:])], axis=1)
                prescribe(statics.model, one, changes[i], back)
        return back, changes

    def _averages(self, u: FloatArray, motions: FloatArray) -> _Averages:
        """Averaged interfaces i that move, and their rotations, in states k: u (local dofs, r), [d | A] (b, 3, 4, r).

        Collective.
        """
        statics = self.statics
        found: _Averages = {}
        for i in range(0 if statics.floating else 1, len(statics.interfaces)):
            one = statics.interfaces[i]
            if isinstance(one, AveragedInterface) and one.name not in self.choice.held:
                for k in range(u.shape[1]):
                    found[i, k] = followed(statics.model, one, motions[i, ..., k], u[:, k])
        return found

    def _small(self, u: FloatArray, averages: _Averages) -> FloatArray:
        """(b, 3, 4, r) how displacements (owned dofs, r) move averaged frames on from these states. Collective."""
        model, faces = self.statics.model, np.zeros((len(self.statics.interfaces), 3, 4, u.shape[1]))
        for (i, k), (average, R) in averages.items():
            motion = small_motion(model, average, u[:, k : k + 1])[:, 0]
            faces[i, :, 0, k], faces[i, :, 1:, k] = motion[:3], cross_matrices(motion[3:, None])[..., 0] @ R
        return faces

    def _equilibria(self, polynomial: StrainPolynomial, faces: FloatArray, modal: FloatArray) -> FloatArray:
        """(n, r) coordinates under the sampled loads."""
        held = [one.name in self.choice.held for one in self.statics.interfaces]
        rows = _frame_rows(faces[held])
        free = scipy.linalg.null_space(rows) if len(rows) else np.eye(modal.shape[0])
        try:
            return np.column_stack(
                [
                    _equilibrium(polynomial, faces, modal[:, i], self.loads.wrenches[..., i], free)
                    for i in range(modal.shape[1])
                ]
            )
        except ConvergenceError as error:
            raise ReductionError(
                f"ModalDerivatives: {error} under loads of the range {dict(self.choice.loads)}; state smaller loads"
            ) from error

    def _refuse(self, state: _State, count: int) -> None:
        raise ReductionError(
            f"with {count} modal derivatives the body locks under the loads {dict(self.choice.loads)}: "
            f"{state.error:.1e} of its strain energy is what further shapes would relieve, tol={self.choice.tol:g}; "
            f"raise most= (now {self.choice.most}), the number of modes, or tol=, or state smaller loads"
        )


def _equilibrium(
    polynomial: StrainPolynomial, faces: FloatArray, modal: FloatArray, wrenches: FloatArray, free: FloatArray
) -> FloatArray:
    """(n,) coordinates under forces (n,) and wrenches (b, 6) of fixed directions on faces [d | A] (b, 3, 4, n).

    free: (n, m) orthonormal directions in which they may change.
    """
    q: FloatArray = np.zeros(faces.shape[3])
    before = np.full_like(q, np.inf)
    for _ in range(_TURNS):
        force = modal + sum(
            face[:, 0].T @ wrench[:3] + turned_face(np.eye(3) + face[:, 1:] @ q, face[:, 1:])[1].T @ wrench[3:]
            for face, wrench in zip(faces, wrenches, strict=True)
        )
        if np.linalg.norm(force - before) <= _SAME * np.linalg.norm(force):
            return q
        # a moment's part goes with the turn of its face, of which the next step knows the end
        q, before = polynomial.equilibrium(force, start=q, directions=free), force
    raise ConvergenceError("the faces of the reduced body turn on and on")


def _frame_rows(faces: FloatArray) -> FloatArray:
    """(6 b, n) translations and twice the small rotations of faces [d | A] (b, 3, 4, n)."""
    A = faces[:, :, 1:]
    skew = [A[:, b, a] - A[:, a, b] for a, b in ((1, 2), (2, 0), (0, 1))]
    rows = np.concatenate([faces[:, :, 0], *(row[:, None] for row in skew)], axis=1)
    return rows.reshape(6 * len(faces), faces.shape[3])
