"""A body with history between rigid frames, stepped by central differences: an `ExplicitInterior` of the machine.

The nodes of an interface are bonded to its frame and move with it; the frame's constant mass matrix is that of its
rigid part and of these nodes (Ambrosio & Nikravesh 1992, eq. 47-51, 56), which the machine knows as a rigid body with
the gyroscopic terms s_omega.  What is left of the reaction (eq. 52-53) is the sum of the internal forces on them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from flexmbd.continuum.contact_plane import RigidPlane
from flexmbd.continuum.interface import RigidInterface
from flexmbd.continuum.nodal_motion import NodalMotion, Support
from flexmbd.continuum.updated_lagrangian import UpdatedLagrangian
from flexmbd.errors import InterfaceError
from flexmbd.multibody.body import RigidBody
from flexmbd.multibody.continuum_body import FrameMotion, InterfaceFrame, Memory, Push

FloatArray = NDArray[np.float64]

# Steps after which the stable one is found anew.
_RENEWAL = 5

# A step that is the stable one but for the accuracy of the estimate is taken whole.
_ESTIMATE = 1e-4


class ExplicitContinuum:
    """What lies between the frames of a body with history. Constructing one is collective.

    Attributes:
        motion: of the nodes.
        frames: of the body's interfaces, with their rigid parts and bonded nodes.
        mass: kg, of the nodes that are not bonded.
    """

    def __init__(
        self,
        body: UpdatedLagrangian,
        *,
        rigid_parts: Mapping[str, RigidBody] | None = None,
        planes: Sequence[RigidPlane] = (),
        supports: Sequence[Support] = (),
    ) -> None:
        """Collect the frames and find the stable step.

        Args:
            body: at rest and undeformed, with at least one interface; all of them rigid.
            rigid_parts: by interface, the rigid part bonded there: mass, inertia, and centre of mass from the
                interface's origin, in the interface's axes.
            planes: what the nodes that are not bonded may meet.
            supports: components of nodes that are not bonded held at zero.

        Raises:
            InterfaceError: no interface, an averaged one, or none of the name of a rigid part.
            FormulationError: the mass cannot be lumped.
        """
        parts, names = dict(rigid_parts or {}), [found.name for found in body.interfaces]
        averaged = [found.name for found in body.interfaces if not isinstance(found, RigidInterface)]
        if not names or not set(parts) <= set(names) or averaged:
            raise InterfaceError(
                f"rigid parts {sorted(parts)} on interfaces {names}, of them averaged {averaged}: a body in a machine "
                "needs an interface, all of them Coupling.RIGID, and a rigid part one of its name"
            )
        owned = body.n_owned // 3
        self._bonds = [np.sort(found.nodes[found.nodes < owned]) for found in body.interfaces]
        self._nodes: NDArray[np.int32] = np.concatenate(self._bonds)
        self.motion = NodalMotion(body, supports=supports, planes=planes, bonded=self._nodes)
        self._P = np.array([found.p for found in body.interfaces])
        self._Q = np.array([found.R for found in body.interfaces])
        X = self.motion.mesh.X
        self._arms = [(X[bond] - p) @ R for bond, p, R in zip(self._bonds, self._P, self._Q, strict=True)]
        self.frames = tuple(self._frame(k, name, parts.get(name)) for k, name in enumerate(names))
        self.mass = self.motion.mass
        self._wrenches: FloatArray = np.zeros((len(names), 6))
        self._calls = 0

    def begin(self, t: float, motion: FrameMotion, gravity: FloatArray) -> FloatArray:
        """See `ExplicitInterior`. The nodes move as the first frame, rigidly. Collective."""
        R = motion.R[0] @ self._Q[0].T
        nodes = self.motion
        nodes.begin(motion.p[0] - R @ self._P[0], R, gravity)
        nodes.v[:] = motion.v[0] + np.cross(motion.w[0], nodes.x - motion.p[0])
        nodes.v[self._nodes] = 0.0
        self._wrenches[:] = 0.0
        self._calls = 0
        return self._wrenches.copy()

    def stable_step(self) -> float:
        """See `ExplicitInterior`. The frames, which bind nodes and add mass, only make it longer. Collective."""
        return self.motion.renew_limit()

    def advance(self, h: float, start: FrameMotion, end: FrameMotion) -> Push:
        """See `ExplicitInterior`. Collective."""
        # a body that is crushed may need shorter steps before the machine asks again
        limit = self.motion.renew_limit() if self._calls % _RENEWAL == 0 else self.motion.limit
        self._calls += 1
        steps = max(1, int(np.ceil(h / limit * (1.0 - _ESTIMATE))))
        d = h / steps
        mean = np.zeros_like(self._wrenches)
        # what carries the frames from the start to the end with constant accelerations
        a = 2.0 * (end.p - start.p - h * start.v) / h**2
        turn = Rotation.from_matrix(end.R @ start.R.transpose(0, 2, 1)).as_rotvec()
        alpha = 2.0 * (turn - h * start.w) / h**2
        for i in range(1, steps + 1):
            s = i * d
            p, R = end.p, end.R
            if i < steps:
                p = start.p + s * start.v + s * s / 2 * a
                R = Rotation.from_rotvec(s * start.w + s * s / 2 * alpha).as_matrix() @ start.R
            before = self._wrenches
            self.motion.advance(d, self._places(p, R))
            self._wrenches = self._resultants(p)
            mean += (before + self._wrenches) / (2 * steps)
        return Push(self._wrenches.copy(), mean)

    def snapshot(self) -> Memory:
        """See `Interior`. Of all ranks. Collective."""
        return {**self.motion.snapshot(), "wrenches": self._wrenches.copy(), "calls": np.array(self._calls)}

    def restore(self, memory: Memory) -> None:
        """See `Interior`; on as many ranks as the snapshot. Collective."""
        self.motion.restore({name: np.asarray(part, dtype=float) for name, part in memory.items()})
        self._wrenches = np.array(memory["wrenches"], dtype=float)
        self._calls = int(memory["calls"])

    def energies(self) -> Mapping[str, float]:
        """Energies, J, of the nodes that are not bonded and of the deformation (`NodalMotion.energies`). Collective."""
        return self.motion.energies()

    def _places(self, p: FloatArray, R: FloatArray) -> FloatArray:
        """(bonded nodes, 3) m, inertial, with the frames at p turned by R."""
        return np.concatenate([p[k] + arms @ R[k].T for k, arms in enumerate(self._arms)])

    def _resultants(self, p: FloatArray) -> FloatArray:
        """(k, 6) of the internal forces on the bonded nodes, moments about p. Collective."""
        sums = np.zeros((len(p), 6))
        for k, bond in enumerate(self._bonds):
            force = self.motion.force[bond]
            sums[k, :3] = force.sum(axis=0)
            sums[k, 3:] = np.cross(self.motion.x[bond] - p[k], force).sum(axis=0)
        return self.motion.mesh.sum(sums)

    def _frame(self, k: int, name: str, part: RigidBody | None) -> InterfaceFrame:
        """The frame with its constant mass, about the centre of mass (eq. 51). Collective."""
        m, r = self.motion.masses[self._bonds[k]], self._arms[k]
        second = self.motion.mesh.sum(np.vstack([np.append(m.sum(), m @ r), np.zeros((3, 4))]) + _padded((r.T * m) @ r))
        mass, first, square = float(second[0, 0]), second[0, 1:], second[1:, 1:]
        if part is not None:
            own_first, own_square = part.moments()
            mass, first, square = mass + part.mass, first + own_first, square + own_square
        com = np.asarray(first / mass, dtype=float)
        square = square - mass * np.outer(com, com)
        inertia: FloatArray = np.asarray(np.trace(square) * np.eye(3) - square)
        return InterfaceFrame(name, self._P[k], self._Q[k], mass, com, (inertia + inertia.T) / 2)


def _padded(square: FloatArray) -> FloatArray:
    whole = np.zeros((4, 4))
    whole[1:, 1:] = square
    return whole
