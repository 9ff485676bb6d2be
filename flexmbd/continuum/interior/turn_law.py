"""What finite rotation a node's rotational unknowns stand for: the law of a formulation, found by turning the body.

A vector theta along the axis e of a rotation by the angle phi, small ones being phi e, is s(phi) e. A formulation of
finite rotations has one s for which a rigid rotation costs nothing; for one of small rotations phi e will do. With
small turns delta of the node, exp(delta) R, the vector changes by T delta,

    T = s' e e^T + s/2 cot(phi/2) (1 - e e^T) - [theta]/2,

and a moment m on the node is T^T f of the forces f that belong to theta.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from flexmbd.continuum.history.fresh_body import as_fresh
from flexmbd.continuum.history.nonlinear_model import NonlinearModel
from flexmbd.errors import ConvergenceError
from flexmbd.round_off import SQUARED

FloatArray = NDArray[np.float64]

# A rigid rotation, rad, by which a law is told from others, and another beyond it; about no axis of a mesh.
_FIRST, _SECOND = np.array([0.12, -0.2, 0.17]), np.array([-0.15, -0.1, 0.22])

# A perturbation so small that no digit of the real part feels it.
_TINY = 1e-30

# rad below which 1 - (phi/2) cot(phi/2) is phi^2 / 12 to round-off
_SMALL = 1e-4


@dataclass(frozen=True, eq=False)
class TurnVector:
    """One way to write rotations as vectors.

    Attributes:
        length: s of the angle, rad.
        angle: rad, of s.
        slope: ds/dphi of the angle.
    """

    length: Callable[[FloatArray], FloatArray]
    angle: Callable[[FloatArray], FloatArray]
    slope: Callable[[FloatArray], FloatArray]

    def vectors(self, R: FloatArray) -> FloatArray:
        """(n, 3) of rotations (n, 3, 3)."""
        turns = Rotation.from_matrix(R).as_rotvec().reshape(-1, 3)
        phi = np.linalg.norm(turns, axis=1)
        share = np.divide(self.length(phi), phi, out=np.ones_like(phi), where=phi > 0.0)
        return np.asarray(share[:, None] * turns)

    def rotations(self, theta: FloatArray) -> FloatArray:
        """(n, 3, 3) of vectors (n, 3)."""
        s = np.linalg.norm(theta, axis=1)
        share = np.divide(self.angle(s), s, out=np.ones_like(s), where=s > 0.0)
        return np.asarray(Rotation.from_rotvec(share[:, None] * theta).as_matrix())

    def angles(self, theta: FloatArray) -> FloatArray:
        """(n,) rad, of vectors (n, 3)."""
        return self.angle(np.linalg.norm(theta, axis=1))

    def tangents(self, theta: FloatArray) -> FloatArray:
        """(n, 3, 3) T, changes of vectors (n, 3), complex ones too, by small turns of their nodes."""
        s = np.sqrt((theta * theta).sum(axis=1))
        phi = self.angle(s)
        e = np.divide(theta, s[:, None], out=np.zeros_like(theta), where=s[:, None] != 0.0)
        small = abs(phi) < _SMALL
        half = np.where(small, 1.0, phi / 2)
        across = np.where(small, 1.0 - phi**2 / 12, half / np.tan(half))
        across *= np.divide(s, phi, out=np.ones_like(s), where=phi != 0.0)
        along = np.einsum("na,nb->nab", e, e)
        T = self.slope(phi)[:, None, None] * along + across[:, None, None] * (np.eye(3) - along)
        for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
            T[:, i, j] += theta[:, k] / 2
            T[:, j, i] -= theta[:, k] / 2
        return np.asarray(T)

    def moment_changes(self, theta: FloatArray, forces: FloatArray, turns: FloatArray) -> FloatArray:
        """(n, 3) changes of the moments T^T f of forces (n, 3) that stay, where nodes turn by small vectors (n, 3).

        T is taken at complex vectors (n, 3): the imaginary part is the exact derivative.
        """
        ways = np.einsum("nab,nb->na", self.tangents(theta), turns)
        T = self.tangents(theta + 1j * _TINY * ways)
        return np.asarray(np.einsum("nba,nb->na", T.imag, forces) / _TINY)


#: theta = phi e: the rotation vector.
ANGLE = TurnVector(lambda phi: phi, lambda s: s, lambda phi: np.ones_like(phi))

_LAWS = (
    ANGLE,
    TurnVector(lambda phi: 2 * np.tan(phi / 2), lambda s: 2 * np.arctan(s / 2), lambda phi: 1 / np.cos(phi / 2) ** 2),
)


@dataclass(frozen=True, eq=False)
class TurnLaw:
    """What a body's rotational unknowns stand for.

    Attributes:
        vector: how they write a rotation.
        is_finite: whether a rigid rotation, however large, costs nothing; else rotations are to be small.
        by_steps: whether the vector is that of a step alone, and the unknown the sum of all steps' vectors.
    """

    vector: TurnVector
    is_finite: bool
    by_steps: bool


#: Of rotations that are small.
SMALL_TURNS = TurnLaw(ANGLE, is_finite=False, by_steps=False)


def find_turn_law(body: NonlinearModel, scale: FloatArray) -> TurnLaw:
    """Turn the undeformed body and see what costs nothing. Collective.

    Args:
        body: with rotations at its nodes.
        scale: (owned dofs,) the diagonal of its stiffness.
    """
    layout = body.layout
    if len(layout.fields) > 1 or layout.space.dofmap.index_map_bs != 6:
        return SMALL_TURNS
    dofs = layout.displacement_dofs + 3
    x = layout.node_x - _middle(body)
    first = Rotation.from_rotvec(_FIRST).as_matrix()

    def field(R: FloatArray, theta: FloatArray) -> FloatArray:
        found = layout.at_dofs(x @ (R - np.eye(3)).T, owned=False)
        found[dofs] = theta
        return found

    def cost(increment: FloatArray) -> float:
        try:
            force = body.force(increment, dt=0.0)
        except ConvergenceError:
            return np.inf
        return body.norm(force) / body.norm(scale * increment[: body.n_owned])

    with as_fresh(body):
        vectors = [vector.vectors(first[None])[0] for vector in _LAWS]
        fields = [field(first, vector) for vector in vectors]
        costs = [cost(found) for found in fields]
        best = int(np.argmin(costs))
        by_steps = False
        if costs[best] < SQUARED and any(group.optional.state is not None for group in body.groups):
            body.force(fields[best], dt=0.0)
            body.commit(fields[best], dt=0.0)
            whole = Rotation.from_rotvec(_SECOND).as_matrix() @ first
            to_whole = field(whole, vectors[best] + _LAWS[best].vectors((whole @ first.T)[None])[0])
            by_steps = cost(to_whole - fields[best]) < SQUARED
    return TurnLaw(_LAWS[best], True, by_steps) if costs[best] < SQUARED else SMALL_TURNS


def _middle(body: NonlinearModel) -> FloatArray:
    """(3,) m, of the nodes' box: large coordinates would leave nothing of a rotation but round-off. Collective."""
    x = body.layout.node_x[: body.layout.n_owned_nodes]
    ends = body.comm.allgather((x.min(axis=0, initial=np.inf), x.max(axis=0, initial=-np.inf)))
    low, high = (np.array([end[k] for end in ends]) for k in (0, 1))
    return np.asarray(0.5 * (low.min(axis=0) + high.max(axis=0)))
