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

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from flexmbd.continuum import parallel
from flexmbd.continuum.finite_elements.ghosts import with_ghosts
from flexmbd.continuum.finite_elements.interface import RigidInterface
from flexmbd.continuum.finite_elements.linear_model import LinearModel
from flexmbd.continuum.matrices.blocks import FloatArray, inner, multiply, symmetric, total
from flexmbd.errors import ConvergenceError, ReductionError
from flexmbd.given import checked, is_number
from flexmbd.record.reduced_body import FRAME_DOFS
from flexmbd.record.strain_polynomial import StrainPolynomial
from flexmbd.record.turned_face import turned_face
from flexmbd.reduction.large_displacements.energy_polynomial import energy_polynomial
from flexmbd.reduction.large_displacements.force_derivatives import ForceDerivatives
from flexmbd.reduction.large_displacements.load_series import FaceFields, load_series
from flexmbd.reduction.static_shapes.statics import Statics
from flexmbd.reduction.stiffening.geometric_stiffness import UnitLoads

# Of the largest strain energy among the candidates: what is left of it by round-off.
_ROUND_OFF = 1e-13
# How often what is lacking at the sampled loads is added to the candidates.
_ROUNDS = 8
# Of the tolerated error: strain energy of a shape that is not looked at.
_NEGLIGIBLE = 1e-2
# Relative change of the forces by the turn of the faces, at which an equilibrium is found, and in how many steps.
_SAME = 1e-7
_TURNS = 60


@checked("held", error=ReductionError)
@dataclass(frozen=True)
class ModalDerivatives:
    """How a body that bends a lot is reduced: by modal derivatives and a strain energy of degree four.

    Attributes:
        loads: largest sizes of the loads between which the body is to be right, in either direction, each alone and
            by twos: by the names of `GeometricStiffness`, as ``{"tip.y": 200.0, "acceleration z": 50.0}``, in N, N m,
            m/s^2, rad/s^2, rad^2/s^2 or factors of named loads; or ``fixed-interface 1`` and so on, a mode's largest
            displacement in m.
        held: names of interfaces that are held in the body frame beside that of the frame itself while the loads are on
            the body, as both ends of a panel that is clamped there.
        tol: largest estimated error of the strain energy at these loads, relative.
        most: how many derivatives may be kept.
        order: to which power of the loads the full model's equilibria are followed, 2 or more.
    """

    loads: Mapping[str, float]
    held: Sequence[str] = ()
    tol: float = 1e-3
    most: int = 24
    order: int = 5

    def __post_init__(self) -> None:
        if not isinstance(self.loads, Mapping) or not self.loads:
            raise ReductionError(
                f"ModalDerivatives takes loads by their names, as {{'tip.y': 200.0}}, got {self.loads!r:.100}"
            )
        for name, size in self.loads.items():
            if not isinstance(name, str) or not is_number(size) or not float(size) > 0.0:
                raise ReductionError(f"ModalDerivatives: load {name!r:.50} needs a positive size, got {size!r:.50}")
        if isinstance(self.held, str) or not all(isinstance(name, str) for name in self.held):
            raise ReductionError(f"ModalDerivatives: held must be a list of interfaces' names, got {self.held!r:.50}")
        if not is_number(self.tol) or not 0.0 < float(self.tol) < 1.0:
            raise ReductionError(f"ModalDerivatives: tol must lie between 0 and 1, got {self.tol!r:.50}")
        for name, least in (("most", 1), ("order", 2)):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int) or value < least:
                raise ReductionError(f"ModalDerivatives: {name} must be an integer from {least} on, got {value!r:.50}")


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


def refuse_other_nonlinear(value: object) -> None:
    """Refuse what is neither `ModalDerivatives` nor None; not collective.

    Raises:
        ReductionError: it is another object.
    """
    if value is not None and not isinstance(value, ModalDerivatives):
        raise ReductionError(f"nonlinear must be ModalDerivatives(loads=...), got {value!r:.100}")


def check_nonlinear(model: LinearModel, frame: str | None) -> None:
    """Refuse a body that modal derivatives do not know. Collective.

    Raises:
        ReductionError: on all ranks.
    """
    for there, what in (
        (bool(model.interfaces) is False, "bodies without interfaces"),
        (bool(model.nodal), "nodal interfaces"),
        (model.state is not None, "prestressed bodies"),
        (bool(model.supports), "parts with supports (symmetry planes, rollers)"),
        (model.has_surface_energy, "springs on facets"),
        (any(group.has_sections for group in model.groups), f"rotations of cross-sections, as of {model.form_name}"),
        (int(model.layout.kinematic.sum()) != model.layout.n_local, f"further unknowns, as of {model.form_name}"),
    ):
        if there:
            raise ReductionError(f"nonlinear=ModalDerivatives(...) is for solids at rest with interfaces, no {what}")
    for one in model.interfaces:
        if not isinstance(one, RigidInterface) and one.name != frame:
            raise ReductionError(
                f"nonlinear: interface {one.name!r} is averaged, and its mean says nothing of how far its face turns; "
                "make it Coupling.RIGID"
            )


def modal_derivatives(
    statics: Statics, base: FaceFields, derivatives: ForceDerivatives, *, loads: UnitLoads, choice: ModalDerivatives
) -> ChosenDerivatives:
    """Choose the derivatives beside a basis. Collective.

    Args:
        statics: of the body.
        base: static shapes and modes, of a body whose frame floats without rigid motions.
        derivatives: of the internal forces.
        loads: all that the choice may name.
        choice: checked.

    Raises:
        ReductionError: on all ranks: an unknown load, forces that are linear, or an error above the tolerance.
    """
    if derivatives.vanish:
        raise ReductionError(
            f"{statics.model.form_name} has a strain energy without third and fourth derivatives, so that its body "
            "stays linear; leave nonlinear= out, or take a form of finite strain, as flexmbd.forms.st_venant_kirchhoff"
        )
    _check_held(statics, choice)
    samples = _samples(loads, choice)
    forces = np.asfortranarray(loads.forces @ samples)
    if statics.floating and statics.rigid is not None:
        forces = np.asfortranarray(statics.rigid.balanced(forces))
    wrenches = _wrenches(statics, loads, samples)
    # what is left is in the cells; a wrench turns with its face
    on_faces = np.asfortranarray(loads.forces @ (samples * _of_interfaces(statics, loads)[:, None]))
    ranges = _Range(forces - on_faces, wrenches)
    known = _unit_energies(statics, base)
    series = load_series(statics, derivatives, forces, order=choice.order, held=choice.held)
    found = series[1]
    for more in series[2:]:
        found = found.joined(more)
    size = np.einsum("ij,ij->j", series[0].u, multiply(statics.model.K, series[0].u))
    least = _NEGLIGIBLE * choice.tol * float(total(statics.model.comm, size).max())
    search = _Search(statics, derivatives, known, ranges.both_signs(), choice, least)
    return search.chosen(found)


def _check_held(statics: Statics, choice: ModalDerivatives) -> None:
    others = [one.name for one in statics.interfaces[0 if statics.floating else 1 :]]
    for name in choice.held:
        if statics.floating:
            raise ReductionError(f"ModalDerivatives: {name!r} cannot be held in a frame that floats; give frame=")
        if name not in others:
            raise ReductionError(f"ModalDerivatives: no interface {name!r} to hold; there are: {', '.join(others)}")


def _samples(loads: UnitLoads, choice: ModalDerivatives) -> FloatArray:
    """(l, r) sizes of the loads: each alone, and each two with both signs, on the range's ellipsoid."""
    unknown = sorted(set(choice.loads) - set(loads.names))
    if unknown:
        raise ReductionError(
            f"ModalDerivatives names the load {unknown[0]!r}; there are: {', '.join(loads.names)}"
        )
    units = [np.array([float(size) * (name == one) for one in loads.names]) for name, size in choice.loads.items()]
    pairs = [
        (units[i] + sign * units[j]) / np.sqrt(2.0) for i in range(len(units)) for j in range(i) for sign in (1.0, -1.0)
    ]
    return np.column_stack([*units, *pairs])


@dataclass(frozen=True, eq=False)
class _Range:
    """Sampled loads.

    Attributes:
        forces: (owned dofs, r) N in the cells.
        wrenches: (b, 6, r) N and N m on the interfaces, in the mesh's axes.
    """

    forces: FloatArray
    wrenches: FloatArray

    def both_signs(self) -> _Range:
        """These and their opposites."""
        wrenches = np.concatenate([self.wrenches, -self.wrenches], axis=2)
        return _Range(np.asfortranarray(np.hstack([self.forces, -self.forces])), wrenches)


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


def _unit_energies(statics: Statics, fields: FaceFields) -> FaceFields:
    """The same span, orthonormal in the strain energy. Collective."""
    model = statics.model
    k = symmetric(inner(model.comm, fields.u, multiply(model.K, fields.u)))
    scale = 1.0 / np.sqrt(np.diag(k))
    factor = np.linalg.cholesky(k * np.outer(scale, scale))
    return fields.combined(scale[:, None] * np.linalg.inv(factor).T)


def _further(statics: Statics, known: FaceFields, candidates: FaceFields, *, most: int, least: float) -> FaceFields:
    """What candidates have beside known fields of unit energy: unit energies, none in common, most needed first.

    Args:
        statics: of the body.
        known: the fields.
        candidates: more.
        most: how many are taken.
        least: twice the energy that is not looked at.
    """
    model = statics.model
    for _ in range(2):
        part = inner(model.comm, known.u, multiply(model.K, candidates.u))
        candidates = candidates.less(known, part)
    k = symmetric(inner(model.comm, candidates.u, multiply(model.K, candidates.u)))

    def change() -> FloatArray:
        values, vectors = np.linalg.eigh(k)
        own = np.flatnonzero(values > max(least, _ROUND_OFF * values[-1]))[::-1][:most]
        found: FloatArray = vectors[:, own] / np.sqrt(values[own])
        return found

    return candidates.combined(parallel.on_root(model.comm, change))


@dataclass(frozen=True, eq=False)
class _State:
    """What is known at the sampled loads, of a number of derivatives.

    Attributes:
        error: the estimate, the largest.
        energy: J, the largest strain energy.
        lacking: (owned dofs, r) m, with all interfaces held.
    """

    error: float
    energy: float
    lacking: FloatArray


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
    """

    statics: Statics
    derivatives: ForceDerivatives
    known: FaceFields
    loads: _Range
    choice: ModalDerivatives
    least: float

    def chosen(self, candidates: FaceFields) -> ChosenDerivatives:
        """As few of the candidates as reach the tolerance, and more candidates where all do not. Collective."""
        shapes = _further(self.statics, self.known, candidates, most=self.choice.most, least=self.least)
        for _ in range(_ROUNDS):
            basis = self.known.joined(shapes)
            polynomial, local = self._polynomial(basis)
            whole = self._state(polynomial, basis, local)
            if whole.error <= self.choice.tol or shapes.u.shape[1] >= self.choice.most:
                break
            room = self.choice.most - shapes.u.shape[1]
            lacking = FaceFields(whole.lacking, np.zeros((*shapes.faces.shape[:3], whole.lacking.shape[1])))
            more = _further(self.statics, basis, lacking, most=room, least=self.least)
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

    def _polynomial(self, basis: FaceFields) -> tuple[StrainPolynomial, FloatArray]:
        """The strain energy on the basis and all shapes, and these on the local dofs. Collective."""
        local = with_ghosts(self.statics.model, basis.u)
        found = energy_polynomial(self.derivatives, local)
        return StrainPolynomial(np.ones(local.shape[1]), found.cubic, found.quartic), local

    def _state(
        self, polynomial: StrainPolynomial, basis: FaceFields, local: FloatArray, count: int | None = None
    ) -> _State:
        """The error with the first so many derivatives. Collective."""
        n = local.shape[1] if count is None else self.known.u.shape[1] + count
        model, part = self.statics.model, polynomial.first(n)
        modal = inner(model.comm, basis.u[:, :n], self.loads.forces)
        q = parallel.on_root(model.comm, lambda: self._equilibria(part, basis.faces[..., :n], modal))
        u = np.asfortranarray(local[:, :n] @ q)
        rest = np.column_stack([self.derivatives.force(u[:, i]) for i in range(u.shape[1])]) - self.loads.forces
        rest = np.asfortranarray(rest)
        lacking = self.statics.held_response(rest)
        excess = 0.5 * total(model.comm, np.einsum("ij,ij->j", lacking, rest))
        energy = np.array([part.energy(one) for one in q.T])
        errors = excess / energy
        return _State(float(errors.max()), float(energy.max()), lacking)

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
