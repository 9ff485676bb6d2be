"""Equilibria under a growing load as power series: u(s) = u_1 s + u_2 s^2 + ... under the load s f.

Each u_k is one linear solution with the stiffness at rest, the terms before it being loads (asymptotic numerical
method: Cochelin 1994, Computers & Structures 53, doi:10.1016/0045-7949(94)90165-1); u_2 is the static modal derivative
along u_1 (Idelsohn & Cardona 1985, doi:10.1016/0045-7825(85)90125-2).

A rigid face turns by a finite angle: its nodes at X from its origin are displaced by d + (exp(t) - 1) X, with d and the
rotation vector t(s) as series. What t has from lower orders is prescribed on the face, as t_1 x (t_1 x X) / 2 in u_2;
then the face moves on as a rigid frame.  So an interface may turn without being stretched.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement
from math import factorial

import numpy as np

from flexmbd.continuum.finite_elements.ghosts import with_ghosts
from flexmbd.continuum.finite_elements.interface import FoundInterface, RigidInterface
from flexmbd.continuum.finite_elements.linear_model import LinearModel
from flexmbd.continuum.matrices.blocks import FloatArray, inner, multiply
from flexmbd.reduction.large_displacements.force_derivatives import ForceDerivatives
from flexmbd.reduction.static_shapes.statics import Statics


@dataclass(frozen=True, eq=False)
class FaceFields:
    """Displacements with affine motions of the rigid faces.

    Attributes:
        u: (owned dofs, k), m, in the mesh's axes.
        faces: (b, 3, 4, k) of all b interfaces: [d | A] with d + A X the displacement of a face's point X from the
            interface's origin, in the mesh's axes; zero where the body frame is.
    """

    u: FloatArray
    faces: FloatArray

    def joined(self, other: FaceFields) -> FaceFields:
        """These and more."""
        u = np.asfortranarray(np.hstack([self.u, other.u]))
        return FaceFields(u, np.concatenate([self.faces, other.faces], axis=3))

    def combined(self, change: FloatArray) -> FaceFields:
        """Combinations, change (k, m)."""
        return FaceFields(np.asfortranarray(self.u @ change), self.faces @ change)

    def less(self, other: FaceFields, part: FloatArray) -> FaceFields:
        """Without combinations of others."""
        return FaceFields(np.asfortranarray(self.u - other.u @ part), self.faces - other.faces @ part)


def load_series(
    statics: Statics, derivatives: ForceDerivatives, loads: FloatArray, *, order: int, held: Sequence[str] = ()
) -> list[FaceFields]:
    """u_1 .. u_order under each of several loads. Collective.

    Args:
        statics: of the body, all of whose moving interfaces are rigid.
        derivatives: of its internal forces.
        loads: (owned dofs, r), N; of a body whose frame floats less the inertia forces that they cause.
        order: 1 or more.
        held: names of interfaces that are held beside that of the body frame.
    """
    model = statics.model
    numbers = range(0 if statics.floating else 1, len(statics.interfaces))
    moving = [i for i in numbers if statics.interfaces[i].name not in held]
    series: list[FaceFields] = []
    local: list[FloatArray] = []
    turns: list[FloatArray] = []
    for k in range(1, order + 1):
        finite: FloatArray = np.zeros((len(statics.interfaces), 3, 3, loads.shape[1]))
        prescribed = np.zeros_like(loads, order="F")
        if k == 1:
            forces = loads
        else:
            finite = _finite_rotation(turns, k)
            for i in moving:
                _prescribe(model, statics.interfaces[i], finite[i], prescribed)
            forces = -_forces_of_order(derivatives, local, k) - multiply(model.K, prescribed)
        u = prescribed + _response(statics, np.asfortranarray(forces), held)
        if statics.floating and statics.rigid is not None:
            u = np.asfortranarray(statics.rigid.deformation(u))
        faces = np.zeros((len(statics.interfaces), 3, 4, loads.shape[1]))
        turn = np.zeros((len(statics.interfaces), 3, loads.shape[1]))
        for i in moving:
            motion = _rigid_motion(model, statics.interfaces[i], u - prescribed)
            faces[i, :, 0], turn[i] = motion[:3], motion[3:]
            faces[i, :, 1:] = _cross_matrices(turn[i]) + finite[i]
        turns.append(turn)
        series.append(FaceFields(u, faces))
        local.append(with_ghosts(model, u))
    return series


def _response(statics: Statics, forces: FloatArray, held: Sequence[str]) -> FloatArray:
    """`Statics.static_response` with some interfaces held. Collective."""
    if not held:
        return statics.static_response(forces)
    names = [one.name for one in statics.interfaces[1:]]
    free = np.array([names[i] not in held for i in statics.frame_motions.owner])
    shapes, images = (np.asfortranarray(block[:, free]) for block in statics.moving)
    return statics.response_of(forces, shapes=shapes, forces=images)


def face_motions(statics: Statics, u: FloatArray) -> FloatArray:
    """(b, 3, 4, k) [d | A] of displacements (owned dofs, k) that leave every rigid face rigid. Collective."""
    faces = np.zeros((len(statics.interfaces), 3, 4, u.shape[1]))
    for i in range(0 if statics.floating else 1, len(statics.interfaces)):
        motion = _rigid_motion(statics.model, statics.interfaces[i], u)
        faces[i, :, 0], faces[i, :, 1:] = motion[:3], _cross_matrices(motion[3:])
    return faces


def _forces_of_order(derivatives: ForceDerivatives, fields: list[FloatArray], k: int) -> FloatArray:
    """(owned dofs, r) the coefficient of s^k in F(u(s)) - K u(s), which is of u_1 .. u_(k-1) alone. Collective."""
    total = np.zeros((derivatives.model.n_owned, fields[0].shape[1]), order="F")
    for degree, derivative in ((2, derivatives.second), (3, derivatives.third)):
        for orders in combinations_with_replacement(range(1, k), degree):
            if sum(orders) != k:
                continue
            repeated = np.prod([factorial(count) for count in Counter(orders).values()])
            for ray in range(total.shape[1]):
                total[:, ray] += derivative(*(fields[i - 1][:, ray] for i in orders)) / repeated
    return total


def _finite_rotation(turns: list[FloatArray], k: int) -> FloatArray:
    """(b, 3, 3, r) the coefficient of s^k in exp(t(s)) - 1 - t(s), of t_1 .. t_(k-1)."""
    t = [_cross_matrices(turn) for turn in turns[: k - 1]]
    # power[j]: the coefficient of s^j in t(s)^m / m!
    power = {j + 1: matrix for j, matrix in enumerate(t)}
    total = np.zeros_like(t[0])
    for m in range(2, k + 1):
        after: dict[int, FloatArray] = {}
        for j, left in power.items():
            for i, right in enumerate(t, start=1):
                if i + j <= k:
                    product = np.einsum("...abr,...bcr->...acr", left, right) / m
                    after[i + j] = after.get(i + j, 0.0) + product
        power = after
        total = total + power.get(k, 0.0)
    return total


def _cross_matrices(turn: FloatArray) -> FloatArray:
    """(..., 3, 3, r) of vectors (..., 3, r): [w] with [w] x = w cross x."""
    found = np.zeros((*turn.shape[:-2], 3, *turn.shape[-2:]))
    for a, b, c in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        found[..., a, b, :], found[..., b, a, :] = -turn[..., c, :], turn[..., c, :]
    return found


def _prescribe(model: LinearModel, interface: FoundInterface, finite: FloatArray, u: FloatArray) -> None:
    """Set the displacements A X of a face's nodes in u (owned dofs, r), A (3, 3, r)."""
    nodes = interface.nodes[interface.nodes < model.n_owned_nodes]
    arm = model.node_x[nodes] - interface.p
    u[model.displacement_dofs[nodes]] = np.einsum("abr,nb->nar", finite, arm)


def _rigid_motion(model: LinearModel, interface: FoundInterface, u: FloatArray) -> FloatArray:
    """(6, r) translation and small rotation of a rigid face about its origin, in the mesh's axes. Collective."""
    assert isinstance(interface, RigidInterface)  # noqa: S101  (checked before)
    dofs = interface.dofs[interface.dofs < model.n_owned]
    motions = model.rigid_motions(interface.p, np.eye(3))[dofs]
    gram = inner(model.comm, motions, motions)
    return np.asarray(np.linalg.solve(gram, inner(model.comm, motions, u[dofs])))
