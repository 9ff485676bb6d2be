"""A reduced body as a superelement: positions, stiffness, mass and damping (P, K, M, D) of its interfaces.

The coordinates are the absolute small motions of the interface frames, each Tx Ty Tz Rx Ry Rz along the axes of B, then
where they are wanted those of the nodes of nodal interfaces, Tx Ty Tz, then the amplitudes of fixed-interface modes.
They are the six motions of B and the n coordinates q, in another basis (Craig & Bampton 1968, doi:10.2514/3.4741).

With z = sqrt(k) q the strain energy is |z|^2 / 2, and the motions relative to the first interface, or to six dofs of
nodes that tell all rigid motions, are g = C z.  Let C^T = Q L, L triangular.  Of all deformations with the motions g
the one of least energy is z = Q L^-T g, so the stiffness is (L L^T)^-1, and what is orthogonal to Q are the
deformations with all interfaces fixed.  No names of coordinates are needed for that, so it works for any body whose
modes move its interfaces independently.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from flexmbd.brief import brief
from flexmbd.errors import ExportError
from flexmbd.given import checked, shaped_numbers
from flexmbd.record.carrying_dofs import carrying_dofs
from flexmbd.record.groups import FloatArray, IntArray
from flexmbd.record.reduced_body import NodalInterfaces, ReducedBody
from flexmbd.round_off import WORTHLESS_PIVOT


@dataclass(frozen=True, eq=False)
class Superelement:
    """A free linear elastic body by its interfaces.

    Attributes:
        names: of the b interfaces.
        p: (b, 3) m, their positions in the common axes.
        R: (b, 3, 3) rotations from their axes to the common ones; the coordinates do not depend on them.
        K: (6 b + 3 k + m, same) stiffness: N/m, N, N m, and 1/s^2 for the modes.
        M: (6 b + 3 k + m, same) mass: kg, kg m, kg m^2, and 1 for the modes.
        D: (6 b + 3 k + m, same) damping.
        frame: the interface that carries the body frame, or None where that floats.
        node: (k,) numbers of the nodes of nodal interfaces in the mesh.
        x: (k, 3) m, their positions in the common axes.
        node_interface: (k,) names of their interfaces.
        motion: (6 + n, 6 b + 3 k + m) motion of B (m, rad, in its axes) and modal coordinates per coordinate; (0, 0)
            where the body is not known.
    """

    names: tuple[str, ...]
    p: FloatArray
    R: FloatArray
    K: FloatArray
    M: FloatArray
    D: FloatArray
    frame: str | None
    node: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    x: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    node_interface: tuple[str, ...] = ()
    motion: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))

    __repr__ = brief

    @property
    def n_modes(self) -> int:
        """Number of fixed-interface modes m."""
        return len(self.K) - self.n_boundary

    @property
    def n_boundary(self) -> int:
        """Number of rows before the modes."""
        return 6 * len(self.names) + 3 * len(self.node)

    def rigid_motions(self, origin: FloatArray) -> FloatArray:
        """(rows of K, 6) coordinates of the rigid motions about a point (3,): translations (m), rotations (rad).

        Raises:
            SceneError: the origin is no point.
        """
        about, motions = shaped_numbers(origin, (3,), "origin"), np.zeros((len(self.K), 6))
        motions[: self.n_boundary] = _rigid_rows(self.p - about, self.x - about)
        return motions


def rigid_motion(p: FloatArray) -> FloatArray:
    """(6, 6) motion of a frame at p (3,) per translation (m) and rotation (rad) of the body about the origin."""
    x, y, z = p
    motion = np.eye(6)
    motion[:3, 3:] = [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]
    return motion


@checked(error=ExportError)
def superelement(
    body: ReducedBody, *, interfaces: Sequence[str] | None = None, nodes: bool = False
) -> Superelement:
    """The superelement of a reduced body, in B's axes, with B's origin as theirs.

    Args:
        body: with at least one interface.
        interfaces: names of those that become boundary dofs, the others are left free; all, in the record's order,
            by default.
        nodes: whether the nodes of nodal interfaces become boundary dofs too.

    Returns:
        K is zero between interfaces and modes and for rigid motions; the modes' mass is the identity.

    Raises:
        ExportError: there is no interface, or the modes do not move the interfaces independently.
        InterfaceError: the body has no interface of such a name.
    """
    frames = body.interfaces if interfaces is None else tuple(body.interface(name) for name in interfaces)
    nodal = body.nodal if nodes else None
    if nodal is None:
        nothing = np.zeros(0, dtype=np.int64)
        nodal = NodalInterfaces((), nothing, np.zeros((0, 3)), nothing, np.zeros((0, 3, body.n_modes)))
    if not frames and nodal.node.size == 0:
        raise ExportError(
            "the body has no interface frame and no node of a nodal interface, and a superelement is made of those: "
            "name one at least, or reduce it with one that keeps its own, InterfaceModes(..., joints=[...])"
        )
    names = (*(frame.name for frame in frames), *nodal.names)
    p = np.array([frame.p_BI_B for frame in frames]).reshape(-1, 3)
    motions = _rigid_rows(p, nodal.x)
    shapes = np.vstack([*(frame.modes for frame in frames), nodal.phi.reshape(-1, body.n_modes)])
    first = np.arange(6) if frames else _carriers(nodal.x)
    others = np.setdiff1d(np.arange(len(motions)), first)
    # motion of B that goes with each deformation while the first interface, or those six dofs, rest
    back = np.linalg.inv(motions[first])
    carried = -back @ shapes[first]
    relative = np.zeros((len(others), len(motions)))
    relative[:, first] = -motions[others] @ back
    relative[np.arange(len(others)), others] = 1.0
    weight = 1.0 / np.sqrt(body.stiffness)
    q_of_g, inside, factor = _split(relative @ shapes * weight, names)
    mass = body.mass_matrix()
    modes = _fixed_interface_modes(weight[:, None] * inside, carried, mass)
    n_boundary = relative.shape[1]
    q = np.hstack([weight[:, None] * (q_of_g @ relative), modes])
    rigid = carried @ q
    rigid[:, first] += back
    motion = np.vstack([rigid, q])
    static = factor @ relative
    K = np.zeros((q.shape[1], q.shape[1]))
    K[:n_boundary, :n_boundary] = static.T @ static
    inner = np.arange(n_boundary, len(K))
    K[inner, inner] = np.einsum("ij,i,ij->j", modes, body.stiffness, modes)
    M = motion.T @ mass @ motion
    signs = np.ones(len(K))
    signs[inner] = _signs(M[:n_boundary, n_boundary:])
    flip = np.outer(signs, signs)
    return Superelement(
        names=tuple(frame.name for frame in frames),
        p=p,
        R=np.array([frame.R_BI for frame in frames]).reshape(-1, 3, 3),
        K=K,
        M=_symmetric(flip * M),
        D=_symmetric(flip * (q.T @ body.damping @ q)),
        frame=body.frame if body.frame in [frame.name for frame in frames] else None,
        node=nodal.node,
        x=nodal.x,
        node_interface=tuple(nodal.names[i] for i in nodal.interface),
        motion=signs * motion,
    )


def _rigid_rows(p: FloatArray, x: FloatArray) -> FloatArray:
    """(6 b + 3 k, 6) motions of frames at p (b, 3) and of nodes at x (k, 3) per rigid motion about the origin."""
    return np.vstack([np.zeros((0, 6)), *map(rigid_motion, p), *(rigid_motion(place)[:3] for place in x)])


def _carriers(x: FloatArray) -> IntArray:
    found = carrying_dofs(x)
    if found is None:
        raise ExportError("the nodes of the nodal interfaces lie in one line and cannot tell how the body turns")
    return found


def _split(C: FloatArray, boundary: Sequence[str]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(n, g) z of least energy per g, (n, m) z with all interfaces fixed, and F with F^T F the stiffness."""
    n_static, n = C.shape
    size = np.linalg.norm(C, axis=1)
    scaled = C / np.where(size > 0.0, size, 1.0)[:, None]
    if n_static > n or (n_static and np.linalg.svd(scaled, compute_uv=False)[-1] <= WORTHLESS_PIVOT):
        raise ExportError(
            f"the body's {n} modes do not move its interfaces ({', '.join(boundary)}) independently of each other, "
            "so it has no superelement: reduce it by craig_bampton or guyan, or name fewer interfaces"
        )
    Q, upper = np.linalg.qr(scaled.T, mode="complete")
    factor = np.linalg.inv(upper[:n_static].T) / size
    return Q[:, :n_static] @ factor, Q[:, n_static:], factor


def _fixed_interface_modes(inside: FloatArray, carried: FloatArray, mass: FloatArray) -> FloatArray:
    """(n, m) modes of unit mass, frequencies ascending, from deformations of unit stiffness."""
    motion = np.vstack([carried @ inside, inside])
    values, vectors = np.linalg.eigh(_symmetric(motion.T @ mass @ motion))
    modes: FloatArray = inside @ (vectors / np.sqrt(values))[:, ::-1]
    return modes


def _signs(coupling: FloatArray) -> FloatArray:
    """Signs of the modes that make the first large entry of each one's coupling (6 b, m) to the interfaces positive."""
    large = abs(coupling) > 0.5 * abs(coupling).max(axis=0)
    first = coupling[np.argmax(large, axis=0), np.arange(coupling.shape[1])]
    signs: FloatArray = np.where(first < 0.0, -1.0, 1.0)
    return signs


def _symmetric(matrix: FloatArray) -> FloatArray:
    half: FloatArray = 0.5 * (matrix + matrix.T)
    return half
