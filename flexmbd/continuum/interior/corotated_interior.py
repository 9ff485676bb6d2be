"""A linear elastic mesh between rigid frames, stepped by central differences, that may turn finitely.

The constant stiffness acts in the axes of the first frame, which carry the gross rotation; displacements and
rotations against it are to be small.  Nodes have absolute accelerations (Ambrosio & Nikravesh 1992, eq. 43-46):
positions and velocities are inertial ones, so there are no gyroscopic terms and the mass is diagonal and constant.
Nodes on the interfaces are bonded to the frames (eq. 47-53), whose masses are those of their rigid parts and nodes.

Of the energy U(u) = u K u / 2 in displacements u seen from the first frame, forces and moments are the derivatives by
the nodes' places and rotations; what acts on the first frame is minus the resultant of the others, since U does not
change in a rigid motion.  So no momentum is made and, but for the steps, no energy.
"""

from __future__ import annotations

from collections.abc import Mapping

from mpi4py import MPI

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from flexmbd.continuum import parallel
from flexmbd.continuum.interior.machine_frames import check_frames, interface_frame, mass_of_part, path_of_frames
from flexmbd.continuum.interior.rotational_dofs import ExplicitOperator
from flexmbd.continuum.matrices.blocks import FloatArray
from flexmbd.errors import ConvergenceError, FormulationError
from flexmbd.given import checked
from flexmbd.multibody.bodies.body import RigidBody
from flexmbd.multibody.bodies.continuum_body import FrameMotion, Memory, Push
from flexmbd.rotation import to_quaternion
from flexmbd.round_off import TEN_DIGITS

# Sizes of the body that a node may be away from the first frame.
_FAR = 100.0

# What is remembered of nodes that move by themselves, and of their rotations.
_OF_NODES, _OF_TURNS = ("x", "v", "a"), ("e", "w", "alpha")


class CorotatedInterior:
    """An `ExplicitInterior` of the machine.

    Attributes:
        operator: the masses and the stiffness.
        frames: of the model's interfaces, with their rigid parts and bonded nodes.
        mass: kg, of the nodes that are not bonded.
    """

    @checked(error=FormulationError, agree=parallel.told_to_all)
    def __init__(self, operator: ExplicitOperator, *, rigid_parts: Mapping[str, RigidBody] | None = None) -> None:
        """Collect the frames and find the stable step. Collective.

        Args:
            operator: of a model with at least one rigid interface.
            rigid_parts: by interface, the rigid part bonded there: mass, inertia, and centre of mass from the
                interface's origin, in the interface's axes.

        Raises:
            InterfaceError: on all ranks: the model has no interface, or none of the name of a rigid part; a frame
                has no inertia about an axis.
        """
        model, parts = operator.model, dict(rigid_parts or {})
        self.operator, self._comm = operator, model.comm
        check_frames(model.interfaces, parts)
        self._P = np.array([found.p for found in model.interfaces])
        self._R = np.array([found.R for found in model.interfaces])
        heavy = [self._mass_matrix(i, parts.get(found.name)) for i, found in enumerate(model.interfaces)]
        self.frames = tuple(interface_frame(*pair) for pair in zip(model.interfaces, heavy, strict=True))
        self._limit = operator.stable_step(heavy)
        nodes = model.displacement_dofs[: model.n_owned_nodes]
        self._places = _Places(operator, nodes, model.node_x[: model.n_owned_nodes])
        reach = abs(self._places.X - self._P[0]).max(initial=0.0)
        self._size = float(self._comm.allreduce(reach, op=MPI.MAX))
        self._turns = _Places(operator, operator.rotations, np.zeros(operator.rotations.shape))
        self._m, self._J = self._places.inertia, self._turns.inertia
        self.mass = float(self._comm.allreduce(self._m.sum()))
        # a node's place and velocity, the quaternion from the mesh's axes to inertial ones and its angular velocity
        self._x: FloatArray = np.zeros((len(self._m), 3))
        self._v, self._a = self._x.copy(), self._x.copy()
        self._e: FloatArray = np.tile((1.0, 0.0, 0.0, 0.0), (len(self._J), 1))
        self._w: FloatArray = np.zeros((len(self._J), 3))
        self._alpha = self._w.copy()
        self._wrenches: FloatArray = np.zeros((len(heavy), 6))
        self._u: FloatArray = np.zeros(len(operator.masses))
        self._elastic = 0.0
        self._g: FloatArray = np.zeros(3)

    def begin(self, t: float, motion: FrameMotion, gravity: FloatArray) -> FloatArray:
        """See `ExplicitInterior`. The nodes move as the first frame, rigidly. Collective."""
        R = motion.R[0] @ self._R[0].T
        arm = (self._places.X[self._places.free] - self._P[0]) @ R.T
        self._x = motion.p[0] + arm
        self._v = motion.v[0] + np.cross(motion.w[0], arm)
        self._e = np.tile(to_quaternion(R), (len(self._J), 1))
        self._w = np.tile(motion.w[0], (len(self._J), 1))
        self._g = np.array(gravity, dtype=float)
        self._load(motion.p, motion.R)
        return self._wrenches.copy()

    def stable_step(self) -> float:
        """See `ExplicitInterior`: 2 over the largest angular frequency, the frames moving with their own mass."""
        return self._limit

    def advance(self, h: float, start: FrameMotion, end: FrameMotion) -> Push:
        """See `ExplicitInterior`. Collective."""
        steps = max(1, int(np.ceil(h / self._limit * (1.0 - TEN_DIGITS))))
        d = h / steps
        mean = np.zeros_like(self._wrenches)
        for frames in path_of_frames(start, end, h=h, steps=steps):
            self._x += d * self._v + d * d / 2 * self._a
            self._e = _product(_quaternions(d * self._w + d * d / 2 * self._alpha), self._e)
            before, a_before, alpha_before = self._wrenches, self._a, self._alpha
            self._load(frames.p, frames.R)
            self._v += d / 2 * (a_before + self._a)
            self._w += d / 2 * (alpha_before + self._alpha)
            mean += (before + self._wrenches) / (2 * steps)
        return Push(self._wrenches.copy(), mean)

    def snapshot(self) -> Memory:
        """See `Interior`. Of all ranks' nodes. Collective."""
        own = {name: getattr(self, f"_{name}") for name in (*_OF_NODES, *_OF_TURNS)}
        whole = {name: np.concatenate(self._comm.allgather(part)) for name, part in own.items()}
        return {**whole, "wrenches": self._wrenches.copy(), "elastic": np.array(self._elastic), "g": self._g.copy()}

    def restore(self, memory: Memory) -> None:
        """See `Interior`; on as many ranks as the snapshot. Collective."""
        for names, count in ((_OF_NODES, len(self._m)), (_OF_TURNS, len(self._J))):
            first = sum(self._comm.allgather(count)[: self._comm.rank])
            for name in names:
                setattr(self, f"_{name}", np.array(memory[name][first : first + count], dtype=float))
        self._wrenches = np.array(memory["wrenches"], dtype=float)
        self._elastic, self._g = float(memory["elastic"]), np.array(memory["g"], dtype=float)

    def energies(self) -> Mapping[str, float]:
        """Kinetic, elastic, and gravitational energy, J, of the nodes that are not bonded. Collective."""
        kinetic = (self._m @ (self._v**2).sum(axis=1) + self._J @ (self._w**2).sum(axis=1)) / 2
        weight = -float(self._m @ self._x @ self._g)
        total = self._comm.allreduce(np.array([kinetic, weight]))
        return {"kinetic": float(total[0]), "elastic": self._elastic, "gravitational": float(total[1])}

    def displacements(self) -> FloatArray:
        """(owned dofs,) m, rad, seen from the first frame, in the mesh's axes, after `begin` or a step."""
        return self._u.copy()

    def _load(self, p: FloatArray, R: FloatArray) -> None:
        """Accelerations of the nodes and wrenches on the frames for the frames' places. Collective."""
        Q = R @ self._R.transpose(0, 2, 1)
        places, turns, x0, R0 = self._places, self._turns, p[0], Q[0]
        tilts = Rotation.from_matrix(R0.T @ Q).as_rotvec()
        x, theta = np.empty_like(places.X), np.zeros_like(turns.X)
        x[places.free] = self._x
        theta[turns.free] = _vectors(_product(to_quaternion(R0.T)[None], self._e))
        for i in range(len(p)):
            x[places.of[i]] = p[i] + (places.X[places.of[i]] - self._P[i]) @ Q[i].T
            theta[turns.of[i]] = tilts[i]
        away = x - x0
        self._check(away)
        u = np.zeros(len(self.operator.masses))
        u[places.dofs], u[turns.dofs] = away @ R0 - (places.X - self._P[0]), theta
        self.operator.complete(u)
        f = -self.operator.force(u)
        force = f[places.dofs] @ R0.T
        self._a = force[places.free] / self._m[:, None] + self._g
        # a rotation dof is the vector of a finite rotation
        moment = _turned(theta[turns.free], f[turns.dofs[turns.free]]) @ R0.T
        self._alpha = moment / self._J[:, None]
        # the first frame's is minus that of all others
        wrenches, total, about = np.zeros((len(p), 6)), force[places.free], moment.sum(axis=0)
        about += _moment(away[places.free], total)
        wrenches[0] = -np.append(total.sum(axis=0), about)
        for i in range(1, len(p)):
            of, dofs = places.of[i], turns.dofs[turns.of[i]]
            wrenches[i, :3] = force[of].sum(axis=0)
            own = (_turned(np.tile(tilts[i], (len(dofs), 1)), f[dofs]) @ R0.T).sum(axis=0)
            wrenches[i, 3:] = own + _moment(x[of] - p[i], force[of])
            wrenches[0] -= np.append(wrenches[i, :3], wrenches[i, 3:] + np.cross(p[i] - x0, wrenches[i, :3]))
        local = np.append(wrenches, -f @ u / 2)
        self._comm.Allreduce(MPI.IN_PLACE, local, op=MPI.SUM)
        self._wrenches, self._elastic, self._u = local[:-1].reshape(-1, 6), float(local[-1]), u

    def _check(self, away: FloatArray) -> None:
        """Refuse nodes that fly off. Collective."""
        far = not (abs(away) < _FAR * self._size).all()
        if self._comm.allreduce(far, op=MPI.LOR):
            raise ConvergenceError(
                f"nodes are {_FAR:g} times the body's size away from its first frame: the step is too long for what "
                "the frames carry, or a load too large"
            )

    def _mass_matrix(self, i: int, part: RigidBody | None) -> FloatArray:
        """(6, 6) of the nodes and the rigid part on a frame, about its origin, in the mesh's axes. Collective."""
        bond = self.operator.bonds[i]
        masses = self.operator.masses[bond.dofs]
        own = (bond.columns * masses[:, None]).T @ bond.columns
        self._comm.Allreduce(MPI.IN_PLACE, own, op=MPI.SUM)
        return own if part is None else own + mass_of_part(part, self._R[i])


class _Places:
    """Dofs in threes, of displacements or rotations, and who moves them.

    X: (n, 3) m, places in the mesh's axes.  free: (n,) whether they move by themselves.  of: for each frame (n,)
    which are bonded to it.  inertia: of the free ones, kg or kg m^2.
    """

    def __init__(self, operator: ExplicitOperator, dofs: NDArray[np.int32], X: FloatArray) -> None:
        self.dofs, self.X = dofs, X
        self.free = operator.moving[dofs[:, 0]]
        self.of = [np.isin(dofs[:, 0], bond.dofs) for bond in operator.bonds]
        # about all axes the same: a node has no gyroscopic moment
        self.inertia = operator.masses[dofs[self.free]].max(axis=1, initial=0.0)


def _moment(arms: FloatArray, forces: FloatArray) -> FloatArray:
    """Sum of arms x forces, both (n, 3)."""
    m = arms.T @ forces
    return np.array([m[1, 2] - m[2, 1], m[2, 0] - m[0, 2], m[0, 1] - m[1, 0]])


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Row by row; numpy's own takes three times as long."""
    out = np.empty_like(b)
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        out[:, i] = a[:, j] * b[:, k] - a[:, k] * b[:, j]
    return out


def _quaternions(turns: FloatArray) -> FloatArray:
    """Unit quaternions (n, 4) of rotation vectors (n, 3)."""
    half = np.sqrt((turns**2).sum(axis=1)) / 2
    # sinc(x) is sin(pi x) / (pi x)
    return np.column_stack([np.cos(half), turns * (np.sinc(half / np.pi) / 2)[:, None]])


def _product(a: FloatArray, b: FloatArray) -> FloatArray:
    """Quaternions a b, of rotations b first, normalised; a may be one for all."""
    out = np.empty_like(b)
    out[:, 0] = a[:, 0] * b[:, 0] - a[:, 1] * b[:, 1] - a[:, 2] * b[:, 2] - a[:, 3] * b[:, 3]
    for i, j, k in ((1, 2, 3), (2, 3, 1), (3, 1, 2)):
        out[:, i] = a[:, 0] * b[:, i] + a[:, i] * b[:, 0] + a[:, j] * b[:, k] - a[:, k] * b[:, j]
    return np.asarray(out / np.sqrt((out**2).sum(axis=1))[:, None])


def _vectors(e: FloatArray) -> FloatArray:
    """Rotation vectors (n, 3), by angles up to pi, of unit quaternions (n, 4)."""
    e = np.where(e[:, :1] < 0.0, -e, e)
    half = np.arctan2(np.sqrt((e[:, 1:] ** 2).sum(axis=1)), e[:, 0])
    # sin(half) / half by the same rule as forth
    return np.asarray(e[:, 1:] * (2.0 / np.sinc(half / np.pi))[:, None])


def _turned(theta: FloatArray, f: FloatArray) -> FloatArray:
    """Moments (n, 3), N m, that do on turns about the axes the work that f does on the rotation vectors theta."""
    square = (theta**2).sum(axis=1)[:, None]
    half = np.sqrt(square) / 2
    small = half < 1e-4
    safe = np.where(small, 1.0, half)
    c = np.where(small, 1.0 / 12.0, (1.0 - safe / np.tan(safe)) / np.where(small, 1.0, square))
    once = _cross(theta, f)
    return np.asarray(f + once / 2 + c * _cross(theta, once))
