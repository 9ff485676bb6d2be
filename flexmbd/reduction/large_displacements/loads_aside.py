"""Loads aside of the stated ones: what keeps a bent body from locking against them.

A beam that was bent in one plane bends out of it and twists by products of both motions (a bent beam's twist moves its
tip sideways), and a bend out of the plane shortens it as one in the plane does. On a basis without these products the
body is right under the stated loads and several times too stiff, or more, against any other.

The products are the mixed second derivatives of the response: u_fg = -K^-1 D2F[u_f, u_g] of the stated loads f and
the forces and moments g on all interfaces that move (`load_series`, of which the mixed part is taken by polarisation:
u_2(f + g) - u_2(f) - u_2(g)), and those of two loads g on one interface.

How many are kept is decided by the compliance of bent states against further small loads g, c = g^T T^-1 g with T the
full model's tangent stiffness there on the basis: it is compared with that on the basis and all products. The states
are those under the stated loads, and those under each load g alone of a share of their size. The next shape is the one
that the worst pair of a state and a load lacks. Compliances against one load are compared, so that forces and moments
are each measured by themselves.

The next shapes after these are not in the body, but watched: a run says so where the energy that they would relieve is
a large share of the body's (`flexmbd.record.relief`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

from mpi4py import MPI

import numpy as np
import scipy.linalg

from flexmbd.continuum import parallel
from flexmbd.continuum.matrices.blocks import FloatArray, inner, multiply, symmetric
from flexmbd.record.turned_face import turned_face
from flexmbd.reduction.large_displacements.force_derivatives import ForceDerivatives
from flexmbd.reduction.large_displacements.load_series import FaceFields, load_series
from flexmbd.reduction.large_displacements.unit_fields import further
from flexmbd.reduction.static_shapes.statics import Statics
from flexmbd.reduction.stiffening.geometric_stiffness import inertia_loads, interface_loads

# Of the stated loads: the size of those aside that bend the body by themselves.
_SHARE = 0.3
# Of the largest strain energy among the products: one that is not looked at.
_NEGLIGIBLE = 1e-8
# Errors of compliances are compared to so many digits, so that round-off does not choose among equals.
_DIGITS = 6
# How many shapes a run watches.
_WATCHED = 8


@dataclass(frozen=True, eq=False)
class StatedLoads:
    """What the body was reduced for so far.

    Attributes:
        forces: (owned dofs, m) N, each of the stated loads.
        basis: fields of unit strain energies, none in common.
        bent: (n, r) coordinates of the equilibria under sampled loads.
        energy: J, the largest strain energy of these.
        held: names of the interfaces that are held under them.
    """

    forces: FloatArray
    basis: FaceFields
    bent: FloatArray
    energy: float
    held: Sequence[str]


@dataclass(frozen=True, eq=False)
class ShapesAside:
    """What was found.

    Attributes:
        shapes: to be added to the basis, orthonormal to it and each other in the strain energy.
        watched: (owned dofs, w) further ones, likewise.
        error: of a compliance, the largest with these shapes.
    """

    shapes: FaceFields
    watched: FloatArray
    error: float


def shapes_aside(
    statics: Statics, derivatives: ForceDerivatives, stated: StatedLoads, *, tol: float, none: bool
) -> ShapesAside:
    """Find the products, and choose. Collective.

    Args:
        statics: of the body.
        derivatives: of its internal forces.
        stated: the loads, and the basis for them.
        tol: largest relative error of a compliance.
        none: add no shape; all that are found are there to be watched.
    """
    numbers = range(0 if statics.floating else 1, len(statics.interfaces))
    moving = [i for i in numbers if statics.interfaces[i].name not in stated.held]
    basis, model = stated.basis, statics.model
    loads = _sized(statics, stated, moving)
    alone, products = _products(statics, derivatives, stated, loads)
    count = products.u.shape[1]
    found = further(statics, basis, products, most=count, least=_NEGLIGIBLE * _largest(statics, products))
    whole = basis.joined(found)
    states = np.hstack([_padded(stated.bent, whole.u.shape[1]), inner(model.comm, multiply(model.K, whole.u), alone)])
    tangents = np.stack([_tangent(statics, whole.u, q) for q in states.T])
    names = [one.name in stated.held for one in statics.interfaces]
    search = _LoadsAside(
        basis.u.shape[1],
        tangents,
        np.stack(
            [
                _unit_rows(whole.faces[moving], q, axes=statics.R) if moving else inner(model.comm, loads, whole.u)
                for q in states.T
            ]
        ),
        _held_rows(whole.faces[names]),
    )
    chosen, errors = parallel.on_root(model.comm, search.ordered)
    kept = 0 if none else int(np.argmax(errors <= tol)) if (errors <= tol).any() else chosen.shape[1]
    turned = found.combined(chosen)
    first = np.eye(chosen.shape[1])
    return ShapesAside(
        turned.combined(first[:, :kept]),
        turned.u[:, kept : kept + _WATCHED],
        float(errors[kept]),
    )


def _largest(statics: Statics, fields: FaceFields) -> float:
    k = inner(statics.model.comm, fields.u, multiply(statics.model.K, fields.u))
    return float(np.diag(k).max(initial=0.0))


def _padded(q: FloatArray, n: int) -> FloatArray:
    return np.vstack([q, np.zeros((n - len(q), q.shape[1]))])


def _products(
    statics: Statics, derivatives: ForceDerivatives, stated: StatedLoads, aside: FloatArray
) -> tuple[FloatArray, FaceFields]:
    """(owned dofs, c) u_1 + u_2 under each load aside alone, and the mixed second derivatives."""
    m, c = stated.forces.shape[1], aside.shape[1]
    pairs = [(i, m + j) for i in range(m) for j in range(c)]
    pairs += [(m + j, m + k) for j, k in combinations(range(c), 2) if j // 6 == k // 6]
    single = np.hstack([stated.forces, aside])
    first, second = np.array(pairs).T
    forces = np.asfortranarray(np.hstack([single, single[:, first] + single[:, second]]))
    one, two = load_series(statics, derivatives, forces, order=2, held=stated.held)
    number = m + c
    mixed = np.zeros((number + len(pairs), len(pairs)))
    for column, (i, j) in enumerate(pairs):
        mixed[[number + column, i, j], column] = 1.0, -1.0, -1.0
    own = np.zeros((len(mixed), c))
    own[m + np.arange(c), np.arange(c)] = 1.0
    fields = two.combined(np.hstack([own, mixed]))
    return one.u @ own + two.u @ own, fields


def _sized(statics: Statics, stated: StatedLoads, moving: Sequence[int]) -> FloatArray:
    """(owned dofs, 6 b) forces and moments on the interfaces that move, of a share of the stated loads' size.

    No larger force than theirs, no larger moment than theirs at an arm of the body's size, and of no more strain
    energy. A body on which nothing but the frame's interface moves has the inertia forces of its frame's accelerations.
    """
    model = statics.model
    if moving:
        forces = interface_loads(model, [statics.interfaces[i] for i in moving], R=statics.R).forces
    else:
        forces = inertia_loads(model, p=statics.p, R=statics.R, floating=False).forces[:, :6]
    motions = model.rigid_motions(statics.p, statics.R)
    nodes = model.node_x[: model.n_owned_nodes] - statics.p
    arm = float(np.sqrt(model.comm.allreduce((nodes**2).sum(axis=1).max(initial=0.0), op=MPI.MAX)))

    def size(loads: FloatArray) -> FloatArray:
        resultant = inner(model.comm, motions, loads)
        parts = np.linalg.norm(resultant[:3], axis=0), np.linalg.norm(resultant[3:], axis=0) / arm
        return np.asarray(np.maximum(*parts))

    by_force = size(stated.forces).max() / size(forces)
    if statics.floating and statics.rigid is not None:
        forces = statics.rigid.balanced(forces)
    u = statics.static_response(np.asfortranarray(forces))
    energy = 0.5 * np.einsum("ii->i", inner(model.comm, u, forces))
    return np.asarray(forces * (_SHARE * np.minimum(by_force, np.sqrt(stated.energy / energy))))


def _tangent(statics: Statics, u: FloatArray, q: FloatArray) -> FloatArray:
    """(n, n) the full model's tangent stiffness at a state, on a basis. Collective."""
    matrix = statics.model.tangent(u @ q)
    found = symmetric(inner(statics.model.comm, u, multiply(matrix, u)))
    matrix.destroy()
    return found


def _unit_rows(faces: FloatArray, q: FloatArray, *, axes: FloatArray) -> FloatArray:
    """(6 b, n) generalised forces of unit forces and moments, along B's axes, on faces [d | A] (b, 3, 4, n) at q."""
    rows = []
    for face in faces:
        _, turn = turned_face(np.eye(3) + face[:, 1:] @ q, face[:, 1:])
        rows += [axes.T @ face[:, 0], axes.T @ turn]
    return np.vstack(rows)


def _held_rows(faces: FloatArray) -> FloatArray:
    """(12 b, n) the whole affine motions of faces that are held."""
    return faces.reshape(-1, faces.shape[3])


@dataclass(frozen=True, eq=False)
class _LoadsAside:
    """Which combinations of the further coordinates the bent states need; not collective.

    Attributes:
        known: number of the coordinates that the basis has.
        tangents: (s, n, n) of the states.
        rows: (s, l, n) of the loads.
        held: (h, n) what must not move.
    """

    known: int
    tangents: FloatArray
    rows: FloatArray
    held: FloatArray

    def ordered(self) -> tuple[FloatArray, FloatArray]:
        """(m, k) orthonormal combinations, most needed first, and the largest error with the first 0 .. k of them."""
        n = self.tangents.shape[1]
        m = n - self.known
        exact, response = self._compliances(np.eye(n))
        parts = response[:, :, self.known :]
        chosen, errors = np.zeros((m, 0)), []
        while True:
            basis = scipy.linalg.block_diag(np.eye(self.known), chosen)
            with np.errstate(invalid="ignore", divide="ignore"):
                error = 1.0 - self._compliances(basis)[0] / exact
            error = np.nan_to_num(error)
            errors.append(float(error.max(initial=0.0)))
            if chosen.shape[1] == m or errors[-1] < 10.0**-_DIGITS:
                return chosen, np.array(errors)
            worst = np.unravel_index(np.argmax(np.round(error, _DIGITS)), error.shape)
            more = parts[worst]
            for _ in range(2):
                more = more - chosen @ (chosen.T @ more)
            chosen = np.column_stack([chosen, more / np.linalg.norm(more)])

    def _compliances(self, basis: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(s, l) g^T T^-1 g on a basis (n, p), and (s, l, n) the responses; zero in a state that is not stable."""
        still = basis @ scipy.linalg.null_space(self.held @ basis) if len(self.held) else basis
        found = np.zeros(self.rows.shape[:2])
        response = np.zeros(self.rows.shape)
        for s, (tangent, rows) in enumerate(zip(self.tangents, self.rows, strict=True)):
            own = rows @ still
            try:
                factor = scipy.linalg.cho_factor(still.T @ tangent @ still)
            except scipy.linalg.LinAlgError:
                continue
            q = scipy.linalg.cho_solve(factor, own.T)
            found[s], response[s] = np.einsum("li,il->l", own, q), (still @ q).T
        return found, response
