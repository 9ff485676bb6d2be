"""Equilibria under a growing load as power series: u(s) = u_1 s + u_2 s^2 + ... under the load s f.

Each u_k is one linear solution with the stiffness at rest, the terms before it being loads (asymptotic numerical
method: Cochelin 1994, Computers & Structures 53, doi:10.1016/0045-7949(94)90165-1); u_2 is the static modal derivative
along u_1 (Idelsohn & Cardona 1985, doi:10.1016/0045-7825(85)90125-2).

A rigid face turns by a finite angle: its nodes at X from its origin are displaced by d + (exp(t) - 1) X, with d and the
rotation vector t(s) as series. What t has from lower orders is prescribed on the face, as t_1 x (t_1 x X) / 2 in u_2;
then the face moves on as a rigid frame.  So an interface may turn without being stretched.  On an averaged one nothing
is prescribed: its frame turns by the average of what the nodes have moved, and a wrench on it by the frame.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from itertools import combinations_with_replacement
from math import factorial

import numpy as np

from flexmbd.continuum.finite_elements.ghosts import with_ghosts
from flexmbd.continuum.finite_elements.interface import AveragedInterface, FoundInterface
from flexmbd.continuum.finite_elements.linear_model import LinearModel
from flexmbd.continuum.matrices.blocks import FloatArray, multiply
from flexmbd.reduction.large_displacements.face_fields import (
    AveragedSeries,
    FaceFields,
    cross_matrices,
    prescribe,
    small_motion,
)
from flexmbd.reduction.large_displacements.force_derivatives import ForceDerivatives
from flexmbd.reduction.static_shapes.frame_motions import on_supports
from flexmbd.reduction.static_shapes.statics import Statics


def load_series(
    statics: Statics,
    derivatives: ForceDerivatives,
    loads: FloatArray,
    *,
    order: int,
    wrenches: FloatArray,
    held: Sequence[str] = (),
) -> list[FaceFields]:
    """u_1 .. u_order under each of several loads. Collective.

    Args:
        statics: of the body.
        derivatives: of its internal forces.
        loads: (owned dofs, r), N; of a body whose frame floats less the inertia forces that they cause.
        order: 1 or more.
        wrenches: (b, 6, r) N and N m, the part of the loads on the interfaces, in the mesh's axes.
        held: names of interfaces that are held beside that of the body frame.
    """
    model, faces = statics.model, statics.interfaces
    moving = [i for i in range(0 if statics.floating else 1, len(faces)) if faces[i].name not in held]
    averages = {
        i: AveragedSeries.of(model, one, wrenches[i])
        for i, one in enumerate(faces)
        if i in moving and isinstance(one, AveragedInterface)
    }
    series: list[FaceFields] = []
    local: list[FloatArray] = []
    turns: list[FloatArray] = []
    for k in range(1, order + 1):
        finite = _finite_rotation(turns, k) if turns else np.zeros((len(faces), 3, 3, loads.shape[1]))
        motions = np.zeros((len(faces), 3, 4, loads.shape[1]))
        turn = np.zeros((len(faces), 3, loads.shape[1]))
        prescribed, forces = np.zeros_like(loads, order="F"), loads
        if k > 1:
            for i in moving:
                if i not in averages:
                    motions[i], turn[i] = _prescribed(model, faces[i], finite[i])
                    prescribe(model, faces[i], motions[i], prescribed)
            forces = -_forces_of_order(derivatives, local, k) - multiply(model.K, prescribed)
            for average in averages.values():
                average.add_forces(forces)
        u = prescribed + _response(statics, np.asfortranarray(forces), held)
        if statics.floating and statics.rigid is not None:
            u = np.asfortranarray(statics.rigid.deformation(u))
        for i in moving:
            if i in averages:
                averages[i], motions[i], turn[i] = averages[i].next(u, finite[i])
            else:
                own = small_motion(model, faces[i], u - prescribed)
                motions[i] += np.concatenate([own[:3, None], cross_matrices(own[3:])], axis=1)
                turn[i] += own[3:]
        turns.append(turn)
        series.append(FaceFields(u, motions))
        local.append(with_ghosts(model, u))
    return series


def _prescribed(model: LinearModel, interface: FoundInterface, finite: FloatArray) -> tuple[FloatArray, FloatArray]:
    """[d | A] (3, 4, r) and t (3, r) that turns of lower orders, A (3, 3, r), ask of a rigid face. Collective.

    Where a support touches it the face moves so that its nodes stay there.
    """
    back = on_supports(model, interface, finite)
    return np.concatenate([back[:3, None], finite + cross_matrices(back[3:])], axis=1), back[3:]


def _response(statics: Statics, forces: FloatArray, held: Sequence[str]) -> FloatArray:
    """`Statics.static_response` with some interfaces held. Collective."""
    if not held:
        return statics.static_response(forces)
    names = [one.name for one in statics.interfaces[1:]]
    free = np.array([names[i] not in held for i in statics.frame_motions.owner])
    shapes, images = (np.asfortranarray(block[:, free]) for block in statics.moving)
    return statics.response_of(forces, shapes=shapes, forces=images)


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
    t = [cross_matrices(turn) for turn in turns[: k - 1]]
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
