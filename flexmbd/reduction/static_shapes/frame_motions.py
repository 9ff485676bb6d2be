"""Motions that the supports of a part leave to the frames of its interfaces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.finite_elements.interface import FoundInterface
from flexmbd.continuum.finite_elements.linear_model import LinearModel
from flexmbd.continuum.matrices.blocks import FloatArray, total
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


def _own_motions(model: LinearModel, interface: FoundInterface, *, axes: FloatArray) -> FloatArray:
    """(6, k) orthogonal motions. Collective."""
    gram = np.zeros((6, 6))
    for support in model.supports:
        shared = np.intersect1d(interface.nodes, support.nodes)
        shared = shared[shared < model.n_owned_nodes]
        if model.comm.allreduce(len(shared)) == 0:
            continue
        normal = np.eye(3)[support.axis]
        arms = model.node_x[shared] - interface.p
        size = np.sqrt(total(model.comm, np.array([(arms**2).sum()])).item() / model.comm.allreduce(len(shared)))
        if support.symmetric:
            rows = np.zeros((4, 6))
            rows[0, :3], rows[1:, 3:] = normal, np.eye(3) - np.outer(normal, normal)
            gram += rows.T @ rows
        else:
            rows = np.hstack([np.tile(normal, (len(arms), 1)), np.cross(arms, normal)])
            scaled = rows / np.repeat([1.0, size or 1.0], 3)
            gram += total(model.comm, scaled.T @ scaled) / model.comm.allreduce(len(shared))
    if not gram.any():
        return np.eye(6)
    turn = np.kron(np.eye(2), axes)
    values, vectors = np.linalg.eigh(turn.T @ gram @ turn)
    free = vectors[:, values <= _FREE * values[-1]]
    units = np.flatnonzero(abs(np.linalg.norm(free, axis=1) - 1.0) < _FREE)
    found: FloatArray = np.eye(6)[:, units] if len(units) == free.shape[1] else free
    return np.asarray(model.comm.bcast(found, root=0))
