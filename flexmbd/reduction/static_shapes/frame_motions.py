"""Motions that the supports of a part leave to the frames of its interfaces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum import parallel
from flexmbd.continuum.finite_elements.interface import FoundInterface
from flexmbd.continuum.finite_elements.linear_model import LinearModel
from flexmbd.continuum.matrices.blocks import FloatArray, total
from flexmbd.errors import ReductionError
from flexmbd.record.reduced_body import FRAME_DOFS

# Of a constraint's size, what is round-off of its square.
_FREE = 1e-10


@dataclass(frozen=True, eq=False)
class FrameMotions:
    """Independent motions of frames.

    Attributes:
        motions: (6 b, m) of b frames, three translations (m) and three small rotations (rad) of each, along B's axes.
        owner: (m,) the frame that each is of, from 0.
        names: (m,).
    """

    motions: FloatArray
    owner: NDArray[np.int64]
    names: tuple[str, ...]


def frame_motions(model: LinearModel, interfaces: Sequence[FoundInterface], *, axes: FloatArray) -> FrameMotions:
    """All six of an interface that no support touches, else those in which its nodes keep to the support. Collective.

    An interface that a symmetry plane cuts is half a rigid frame: it moves along the plane and turns about its normal
    alone, whatever its nodes in the plane would allow.

    Args:
        model: the body.
        interfaces: b of them.
        axes: (3, 3) rotation; motions are along and about its columns.
    """
    blocks = [_own_motions(model, one, axes=axes) for one in interfaces]
    motions = np.zeros((6 * len(blocks), sum(block.shape[1] for block in blocks)))
    owner = np.repeat(np.arange(len(blocks)), [block.shape[1] for block in blocks])
    names: list[str] = []
    for i, (one, block) in enumerate(zip(interfaces, blocks, strict=True)):
        motions[6 * i : 6 * i + 6, owner == i] = block
        units = block.argmax(axis=0)
        plain = np.array_equal(block, np.eye(6)[:, units])
        names += [f"{one.name}.{FRAME_DOFS[unit] if plain else f'motion {j + 1}'}" for j, unit in enumerate(units)]
    return FrameMotions(motions, owner, tuple(names))


def on_supports(model: LinearModel, interface: FoundInterface, displaced: FloatArray) -> FloatArray:
    """(6, r) the least motions of a rigid face that take its nodes back to the supports which touch it. Collective.

    Args:
        model: the body.
        interface: rigid.
        displaced: (3, 3, r) displacement gradients of the face from its origin, which may leave the supports.

    Returns:
        Translations (m) and small rotations (rad) about the face's origin, in the mesh's axes.

    Raises:
        ReductionError: on all ranks: no motion does.
    """
    equations = _Equations.of(model, interface, displaced)
    if equations is None:
        return np.zeros((6, displaced.shape[2]))
    found = np.linalg.pinv(equations.gram, rcond=_FREE, hermitian=True) @ equations.right
    # sums of squares: what is left of what is to be taken back
    left = equations.square - np.einsum("ir,ir->r", found, equations.right)
    allowed = _FREE * equations.scale[-1] ** 2 * (displaced**2).sum(axis=(0, 1))
    if not parallel.on_root(model.comm, lambda: bool((left <= allowed).all())):
        raise ReductionError(
            f"interface {interface.name!r} is rigid, and its nodes on {equations.text} let it turn by small angles "
            "only: for a body that bends a lot take a support that touches it in one line, or not at all"
        )
    return np.asarray(model.comm.bcast(found / equations.scale[:, None], root=0))


@dataclass(frozen=True, eq=False)
class _Equations:
    """Least squares of what a motion moves a face's nodes off the supports, translations and turned arms alike in m.

    Attributes:
        gram: (6, 6).
        right: (6, r) for displacements that are to be taken back.
        square: (r,) m^2, mean squares of these.
        scale: (6,) m per m and m per rad.
        text: the supports.
    """

    gram: FloatArray
    right: FloatArray
    square: FloatArray
    scale: FloatArray
    text: str

    @staticmethod
    def of(model: LinearModel, interface: FoundInterface, displaced: FloatArray) -> _Equations | None:
        """None: no support touches the face. Collective."""
        own = interface.nodes[interface.nodes < model.n_owned_nodes]
        squares = ((model.node_x[own] - interface.p) ** 2).sum()
        size = np.sqrt(total(model.comm, np.array([squares])).item() / model.comm.allreduce(len(own)))
        scale = np.repeat([1.0, size], 3)
        gram, right, square = np.zeros((6, 6)), np.zeros((6, displaced.shape[2])), np.zeros(displaced.shape[2])
        texts: list[str] = []
        for support in model.supports:
            shared = np.intersect1d(own, support.nodes)
            count = model.comm.allreduce(len(shared))
            if count == 0:
                continue
            texts.append(support.text)
            normal = np.eye(3)[support.axis]
            if support.symmetric:
                # the face turns about the normal alone, which leaves nodes in the plane
                rows = np.zeros((4, 6))
                rows[0, :3], rows[1:, 3:] = normal, size * (np.eye(3) - np.outer(normal, normal))
                gram += (rows / scale).T @ (rows / scale)
            else:
                arms = model.node_x[shared] - interface.p
                rows = np.hstack([np.tile(normal, (len(arms), 1)), np.cross(arms, normal)]) / scale
                off = arms @ displaced[support.axis]
                gram += total(model.comm, rows.T @ rows) / count
                right -= total(model.comm, rows.T @ off) / count
                square += total(model.comm, (off**2).sum(axis=0)) / count
        return _Equations(gram, right, square, scale, " and ".join(texts)) if texts else None


def _own_motions(model: LinearModel, interface: FoundInterface, *, axes: FloatArray) -> FloatArray:
    """(6, k) independent motions. Collective."""
    equations = _Equations.of(model, interface, np.zeros((3, 3, 0)))
    if equations is None:
        return np.eye(6)
    turn = np.kron(np.eye(2), axes)
    values, vectors = np.linalg.eigh(turn.T @ equations.gram @ turn)
    free = vectors[:, values <= _FREE * values[-1]]
    units = np.flatnonzero(abs(np.linalg.norm(free, axis=1) - 1.0) < _FREE)
    plain = len(units) == free.shape[1]
    found: FloatArray = np.eye(6)[:, units] if plain else free / equations.scale[:, None]
    return np.asarray(model.comm.bcast(found, root=0))
