"""Linear equations of a body with history about the state it stands in: Craig and Bampton's, with that state's tangent.

The nodes' small displacements are combinations of static modes, in which they follow the frames in equilibrium, and of
fixed-interface modes, of the tangent stiffness at the state and the consistent mass. Taking fewer fixed-interface modes
than there are costs as much as in any reduced body; the response to slow motions of the frames is exact.
"""

from __future__ import annotations

from petsc4py import PETSc

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.interior.frame_columns import BalancedNodes
from flexmbd.continuum.interior.frame_response import Condensation, FrameResponse
from flexmbd.continuum.interior.nodal_turns import TurnState
from flexmbd.continuum.matrices.blocks import inner, multiply
from flexmbd.continuum.matrices.eigen import BlockLanczos, Modes
from flexmbd.errors import ConvergenceError
from flexmbd.multibody.bodies.continuum_body import FrameMotion
from flexmbd.multibody.interiors.steady import InteriorModes, LinearInterior

FloatArray = NDArray[np.float64]

# Of the eigensolver: start vectors, and vectors of the basis for each mode and beside.
_WIDTH, _PER_MODE, _SPARE = 8, 10, 100


def linear_equations(
    frames: Condensation,
    at: BalancedNodes,
    *,
    modes: InteriorModes,
    prescribed: NDArray[np.int32],
    turns: TurnState | None,
) -> LinearInterior:
    """See `SteadyInterior.linear`. Collective.

    Args:
        frames: the body and its frames.
        at: the nodes at rest.
        modes: how many vibrations.
        prescribed: owned dofs that move with the frames, or never.
        turns: rotations of nodes that have rotary inertia; None: there are none.

    Raises:
        ConvergenceError: on all ranks: the body buckles between its frames, or the eigensolver did not converge.
    """
    body, comm, motion = frames.body, frames.body.comm, at.motion
    R = frames.bonds.pose(motion)[1]
    matrix = body.unloading_tangent()
    stiffness = matrix.copy()
    response = frames.condense(lambda: matrix, at)
    static_modes: FloatArray = frames.columns(response.fields @ R, further=response.relative)
    present_mass = frames.mass.copy()
    if frames.turning is not None and turns is not None:
        # with the body's axes, which the first frame carries
        static_modes[frames.turning.inertia.own, 3:6] += frames.turning.tangents(turns) @ R.T
        present_mass = frames.turning.present_mass(turns)
    fixed_modes = _fixed_interface_modes(
        frames, stiffness.copy(), present_mass.copy(), motion, modes=modes, prescribed=prescribed
    )
    fields = np.asfortranarray(np.hstack([static_modes, fixed_modes.shapes]))
    k, n = static_modes.shape[1], fixed_modes.shapes.shape[1]
    mass = inner(comm, fields, multiply(present_mass, fields))
    present_mass.destroy()
    mass[:k, :k] -= _bonded_mass(frames, static_modes)
    if frames.turning is not None:
        for j, block in enumerate(frames.turning.inertial(motion)):
            mass[6 * j + 3 : 6 * j + 6, 6 * j + 3 : 6 * j + 6] -= block
    forces = multiply(stiffness, fixed_modes.shapes)
    stiffness_matrix = np.zeros((k + n, k + n))
    stiffness_matrix[:k, :k] = -response.slopes
    stiffness_matrix[:k, k:] = inner(comm, static_modes, forces)
    stiffness_matrix[:k, k:] -= _averaged_moments(frames, response, fixed_modes.shapes, R)
    stiffness_matrix[k:, k:] = inner(comm, fixed_modes.shapes, forces)
    damping = _damping_matrix(frames, fields)
    unbalanced = inner(comm, fixed_modes.shapes, frames.columns((at.residual @ R)[None]))[:, 0]
    stiffness.destroy()
    residual_load = np.concatenate([-response.wrenches.reshape(-1), unbalanced])
    return LinearInterior(0.5 * (mass + mass.T), damping, stiffness_matrix, residual_load)


def _damping_matrix(frames: Condensation, fields: FloatArray) -> FloatArray:
    """Of the formulations' dissipation, at the state, in the coordinates of the fields. Collective."""
    body = frames.body
    if body.viscous_forces is None:
        return np.zeros((fields.shape[1], fields.shape[1]))
    with body.present_mesh():
        matrix = body.viscous_forces.matrix()
    damping = inner(body.comm, fields, multiply(matrix, fields))
    matrix.destroy()
    return np.asarray(0.5 * (damping + damping.T))


def _fixed_interface_modes(
    frames: Condensation,
    stiffness: PETSc.Mat,
    mass: PETSc.Mat,
    motion: FrameMotion,
    *,
    modes: InteriorModes,
    prescribed: NDArray[np.int32],
) -> Modes:
    """The lowest modes with the frames fixed, shapes in body axes; matrices are used up. Collective."""
    body, R = frames.body, frames.bonds.pose(motion)[1]
    constraints = frames.averages.constraints(motion, R)
    solve = frames.newton.inverse(stiffness, constraints)
    free = int(body.comm.allreduce(body.n_owned - len(prescribed)))
    free -= 0 if constraints is None else len(constraints.gap)
    count = min(modes.count, free)
    if count == 0:
        mass.destroy()
        return Modes(np.zeros(0), np.zeros((body.n_owned, 0)))
    first = mass.getOwnershipRange()[0]
    mass.zeroRowsColumns((prescribed + first).astype(PETSc.IntType), diag=0.0)
    start = np.random.default_rng(body.comm.rank).normal(size=(_WIDTH, body.n_owned)).T
    process = BlockLanczos(solve, mass, start=np.asfortranarray(start), limit=_PER_MODE * count + _SPARE)
    if np.isfinite(modes.below_hz):
        highest = (2.0 * np.pi * modes.below_hz) ** 2
        process.find_beyond(highest, most=count)
        if process.exhausted or bool(np.any(process.eigenvalues > highest)):
            count = min(count, int(np.sum(process.eigenvalues <= highest)))
    process.find(count)
    if not process.is_definite:
        raise ConvergenceError(
            "in this state the body buckles between its frames: a vibration with the frames held has a negative "
            "stiffness; linearise about a stable state"
        )
    fixed_modes = process.modes(count)
    mass.destroy()
    return fixed_modes


def _bonded_mass(frames: Condensation, static_modes: FloatArray) -> FloatArray:
    """(6 k, 6 k) mass matrix of the bonded nodes' lumped mass, which is the frames'. Collective."""
    bonds = frames.bonds
    mine = bonds.own & ~bonds.averaged
    moved = frames.body.layout.displacements(static_modes)[bonds.nodes[mine]]
    weighted = bonds.mass[mine, None, None] * moved
    columns = static_modes.shape[1]
    return inner(frames.body.comm, moved.reshape(-1, columns), weighted.reshape(-1, columns))


def _averaged_moments(frames: Condensation, response: FrameResponse, shapes: FloatArray, R: FloatArray) -> FloatArray:
    """(6 k, n) moments of the nodal forces on averaged frames, as modes move their points of attack. Collective."""
    bonds, columns = frames.bonds, np.zeros((6 * len(frames.bonds.frames), shapes.shape[1]))
    mine = bonds.own & bonds.averaged
    for j, shape in enumerate(shapes.T):
        arms = np.zeros((len(bonds.nodes), 3))
        arms[mine] = frames.body.layout.displacements(shape)[bonds.nodes[mine]] @ R.T
        wrench = bonds.wrenches(response.nodal_forces, arms)
        wrench[:, :3] = 0.0
        columns[:, j] = wrench.reshape(-1)
    return columns
