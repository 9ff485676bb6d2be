"""Linear equations of a body with history about the state it stands in: Craig and Bampton's, with that state's tangent.

The nodes' small displacements are those that follow the frames in balance and vibrations with the frames held, of the
tangent stiffness at the state and the consistent mass. What is left out by taking fewer vibrations than there are is
what it is of any reduced body; the answer to slow motions of the frames is exact.
"""

from __future__ import annotations

from petsc4py import PETSc

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.interior.frame_response import Condensation, FrameResponse
from flexmbd.continuum.matrices.blocks import inner, multiply
from flexmbd.continuum.matrices.eigen import BlockLanczos, Modes
from flexmbd.errors import ConvergenceError
from flexmbd.multibody.bodies.continuum_body import FrameMotion
from flexmbd.multibody.interiors.steady import InteriorModes, LinearInterior

FloatArray = NDArray[np.float64]

# Of the eigensolver: start vectors, and vectors of the basis for each mode and beside.
_WIDTH, _A_MODE, _BESIDE = 8, 10, 100


def linear_equations(
    frames: Condensation,
    motion: FrameMotion,
    *,
    internal: FloatArray,
    x: FloatArray,
    felt: FloatArray,
    modes: InteriorModes,
    held: NDArray[np.int32],
) -> LinearInterior:
    """See `SteadyInterior.linear`. Collective.

    Args:
        frames: the body and its frames.
        motion: of the frames.
        internal: (owned dofs,) N, internal forces in inertial axes.
        x: (local nodes, 3) m, of the nodes.
        felt: (local nodes, 3) m/s^2, minus gravity.
        modes: how many vibrations.
        held: owned dofs that the frames hold.

    Raises:
        ConvergenceError: on all ranks: the body buckles between its frames, or the eigensolver did not converge.
    """
    body, comm = frames.body, frames.body.comm
    R = frames.bonds.pose(motion)[1]
    residual = internal + frames.product(felt)
    matrix = body.unloading_tangent()
    stiffness = matrix.copy()
    found = frames.respond(lambda: matrix, residual, motion, x=x, felt=felt, slopes=(np.inf, 1.0))
    vibrations = _vibrations(frames, stiffness.copy(), motion, modes=modes, held=held)
    follows: FloatArray = (found.fields @ R).reshape(len(found.fields), -1).T
    fields = np.asfortranarray(np.hstack([follows, vibrations.shapes]))
    k, n = follows.shape[1], vibrations.shapes.shape[1]
    mass = inner(comm, fields, multiply(frames.mass, fields))
    mass[:k, :k] -= _lumped(frames, follows)
    forces = multiply(stiffness, vibrations.shapes)
    whole = np.zeros((k + n, k + n))
    whole[:k, :k] = -found.slopes
    whole[:k, k:] = inner(comm, follows, forces) - _swung(frames, found, vibrations.shapes, R)
    whole[k:, k:] = inner(comm, vibrations.shapes, forces)
    unbalanced = inner(comm, vibrations.shapes, (residual.reshape(-1, 3) @ R).reshape(-1, 1))[:, 0]
    stiffness.destroy()
    lacking = np.concatenate([-found.wrenches.reshape(-1), unbalanced])
    return LinearInterior(0.5 * (mass + mass.T), np.zeros_like(whole), whole, lacking)


def _vibrations(
    frames: Condensation,
    stiffness: PETSc.Mat,
    motion: FrameMotion,
    *,
    modes: InteriorModes,
    held: NDArray[np.int32],
) -> Modes:
    """The slowest vibrations with the frames held, shapes in body axes. Collective."""
    body, R = frames.body, frames.bonds.pose(motion)[1]
    conditions = frames.averages.conditions(motion, R)
    solve = frames.newton.inverse(stiffness, conditions)
    free = int(body.comm.allreduce(body.n_owned - len(held))) - (0 if conditions is None else len(conditions.missing))
    count = min(modes.count, free)
    if count == 0:
        return Modes(np.zeros(0), np.zeros((body.n_owned, 0)))
    mass = frames.mass.copy()
    first = mass.getOwnershipRange()[0]
    mass.zeroRowsColumns((held + first).astype(PETSc.IntType), diag=0.0)
    start = np.random.default_rng(body.comm.rank).normal(size=(_WIDTH, body.n_owned)).T
    process = BlockLanczos(solve, mass, start=np.asfortranarray(start), limit=_A_MODE * count + _BESIDE)
    if np.isfinite(modes.below_hz):
        highest = (2.0 * np.pi * modes.below_hz) ** 2
        process.find_beyond(highest, most=count)
        if process.exhausted or bool(np.any(process.eigenvalues > highest)):
            count = min(count, int(np.sum(process.eigenvalues <= highest)))
    process.find(count)
    if not process.is_definite:
        raise ConvergenceError(
            "where the body stands it buckles between its frames: a vibration with the frames held has a negative "
            "stiffness; linearise about a state that stays"
        )
    found = process.modes(count)
    mass.destroy()
    return found


def _lumped(frames: Condensation, follows: FloatArray) -> FloatArray:
    """(6 k, 6 k) mass matrix of the bonded nodes' lumped mass, which is the frames'. Collective."""
    bonds = frames.bonds
    mine = bonds.own & ~bonds.averaged
    moved = follows.reshape(-1, 3, follows.shape[1])[bonds.nodes[mine]]
    weighted = bonds.mass[mine, None, None] * moved
    return inner(frames.body.comm, moved.reshape(-1, follows.shape[1]), weighted.reshape(-1, follows.shape[1]))


def _swung(frames: Condensation, found: FrameResponse, shapes: FloatArray, R: FloatArray) -> FloatArray:
    """(6 k, n) wrenches of the pushes on averaged frames by what vibrations move their nodes. Collective."""
    bonds, columns = frames.bonds, np.zeros((6 * len(frames.bonds.frames), shapes.shape[1]))
    mine = bonds.own & bonds.averaged
    for j, shape in enumerate(shapes.T):
        arms = np.zeros((len(bonds.nodes), 3))
        arms[mine] = shape.reshape(-1, 3)[bonds.nodes[mine]] @ R.T
        wrench = bonds.wrenches(found.pushes, arms)
        wrench[:, :3] = 0.0
        columns[:, j] = wrench.reshape(-1)
    return columns
