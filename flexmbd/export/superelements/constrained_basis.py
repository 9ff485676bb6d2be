"""Craig and Bampton's basis of full matrices, of interfaces whose nodes are rigid or that are averages of their nodes.

A rigid interface prescribes its nodes. An averaged one is the motion g = A u of a frame that fits the displacements of
its nodes best in the mean, A = (sum w T^T T)^-1 (w T^T), T of a node at x its motion by the frame's; the nodes stay
free, and loads on the frame are spread over them (RBE3).  Shapes and modes solve with Lagrange multipliers,

    [K A^T] [u]   [f]
    [A  0 ] [l] = [g].
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import ExportError
from flexmbd.record.groups import FloatArray

# Residual of the static shapes relative to the load: a singular stiffness shows here.
_EQUILIBRIUM = 1e-6

#: A scipy.sparse matrix; scipy comes without types.
Sparse = Any


@dataclass(frozen=True, eq=False)
class BoundFrame:
    """A frame that moves with its nodes.

    Attributes:
        p: (3,) m, its origin.
        R: (3, 3) its axes.
        rows: of its nodes in the node table.
        weights: (nodes,) of an average; None: the nodes are rigid.
    """

    p: FloatArray
    R: FloatArray
    rows: NDArray[np.int64]
    weights: FloatArray | None = None


def basis(K: Sparse, M: Sparse, x: FloatArray, frames: Mapping[str, BoundFrame], modes: int) -> FloatArray:
    """(3 k, 6 b + m) static shapes of the interfaces, along the table's axes, and fixed-interface modes.

    Raises:
        ExportError: there are not so many modes, or a part of the body is connected to no interface.
    """
    import scipy.linalg
    import scipy.sparse.linalg

    shapes = np.zeros((3 * len(x), 6 * len(frames)))
    inside = np.ones(3 * len(x), dtype=bool)
    averages, wanted = [], []
    for i, one in enumerate(frames.values()):
        motion = np.vstack([_motion(x[row] - one.p) for row in one.rows])
        dofs = (3 * one.rows[:, None] + np.arange(3)).ravel()
        if one.weights is None:
            inside[dofs] = False
            shapes[dofs, 6 * i : 6 * i + 6] = motion
        else:
            weight = np.repeat(one.weights, 3)[:, None]
            average = np.zeros((6, 3 * len(x)))
            average[:, dofs] = np.linalg.solve(motion.T @ (weight * motion), (weight * motion).T)
            averages.append(average)
            wanted.append(np.eye(6, shapes.shape[1], 6 * i))
    free = np.flatnonzero(inside)
    A = np.vstack([np.zeros((0, 3 * len(x))), *averages])[:, free]
    if not 0 <= modes <= len(free) - len(A):
        raise ExportError(f"modes={modes}: the body has {len(free) - len(A)} dofs inside, and so many modes")
    if len(free) == 0:
        return shapes
    load = (K @ shapes)[free]
    K_inside, M_inside = K[free][:, free].tocsc(), M[free][:, free].tocsc()
    solve = _solver(K_inside, A)
    g = np.vstack([np.zeros((0, shapes.shape[1])), *wanted])
    shapes[free] = solve(-load, g)
    held = K_inside @ shapes[free] + load
    left = np.linalg.norm(held - A.T @ np.linalg.lstsq(A.T, held, rcond=None)[0] if len(A) else held, axis=0).max()
    size = np.linalg.norm(abs(K_inside) @ abs(shapes[free]) + abs(load), axis=0).max()
    if not left <= _EQUILIBRIUM * (np.linalg.norm(load, axis=0).max() if not len(A) else size):
        raise ExportError(_singular(f"the static shapes leave {left:.1e} N"))
    if modes == 0:
        return shapes
    if 2 * (modes + len(A)) + 2 >= len(free):
        Z = scipy.linalg.null_space(A) if len(A) else np.eye(len(free))
        inner = Z.T @ (M_inside @ Z), Z.T @ (K_inside @ Z)
        values = Z @ scipy.linalg.eigh(*inner)[1][:, ::-1][:, :modes]
    else:
        nothing = np.zeros((len(A), 1))
        inverse = scipy.sparse.linalg.LinearOperator(K_inside.shape, matvec=lambda f: solve(f.reshape(-1, 1), nothing))
        start = solve((M_inside @ np.random.default_rng(0).normal(size=len(free)))[:, None], nothing).ravel()
        values = scipy.sparse.linalg.eigsh(K_inside, k=modes, M=M_inside, sigma=0.0, OPinv=inverse, v0=start)[1]
    fixed = np.zeros((3 * len(x), modes))
    fixed[free] = values / np.sqrt(np.einsum("ij,ij->j", values, M_inside @ values))
    return np.hstack([shapes, fixed])


def _motion(arm: FloatArray) -> FloatArray:
    """(3, 6) displacement by a frame's translation and rotation."""
    return np.hstack([np.eye(3), np.cross(np.eye(3), arm).T])


def _solver(K: Sparse, A: FloatArray) -> Any:
    """(forces, averages) -> displacements, of the stiffness inside and the averaged interfaces."""
    import scipy.sparse.linalg

    try:
        if not len(A):
            factor = scipy.sparse.linalg.splu(K, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
            return lambda f, g: factor.solve(np.ascontiguousarray(f))
        # multipliers in the scale of the stiffness, so that pivots are of one size; rotations in that of translations
        scale = float(abs(K.diagonal()).mean()) / np.linalg.norm(A, axis=1)
        rows = scipy.sparse.csc_array(scale[:, None] * A)
        whole = scipy.sparse.block_array([[K, rows.T], [rows, None]]).tocsc()
        factor = scipy.sparse.linalg.splu(whole)
    except RuntimeError as error:
        raise ExportError(_singular(str(error))) from error
    return lambda f, g: factor.solve(np.vstack([f, scale[:, None] * g]))[: K.shape[0]]


def _singular(why: str) -> str:
    return f"the stiffness inside is singular ({why}): a part of the body is connected to no interface"
