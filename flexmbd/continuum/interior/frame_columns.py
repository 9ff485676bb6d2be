"""What a unit displacement or rotation of a frame does to a body's nodes, at a step's end or at rest."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.interior.bonded_nodes import BondedNodes
from flexmbd.continuum.interior.touched_nodes import TouchedNodes
from flexmbd.multibody.bodies.continuum_body import FrameMotion

FloatArray = NDArray[np.float64]

#: Of a frame's unit motion: displacement and acceleration of the interface nodes (n, 3), its rotation, shift (3,).
UnitMotion: TypeAlias = tuple[FloatArray, FloatArray, FloatArray, FloatArray]


@dataclass(frozen=True, eq=False)
class BalancedNodes:
    """Nodes in balance at a step's end or at rest, from where frames move.

    Attributes:
        motion: of the frames.
        residual: (owned nodes, 3) N, of internal and inertia forces less loads, in inertial axes.
        x: (local nodes, 3) m.
        apparent_acceleration: (local nodes, 3) m/s^2, acceleration less gravity.
        dead_load: (owned nodes, 3) N, in inertial axes, all that acts and does not turn with the body, but ``touched``.
        slopes: of ``Scheme.slopes``; (inf, 1) at rest.
        couples: (k, 6) wrenches of what holds unknowns that turn with the frames (`BondedTurns.wrenches`).
        touched: the contact forces there, where the body may touch shapes.
    """

    motion: FrameMotion
    residual: FloatArray
    x: FloatArray
    apparent_acceleration: FloatArray
    dead_load: FloatArray
    slopes: tuple[float, float]
    couples: FloatArray
    touched: TouchedNodes | None = None


@dataclass(frozen=True, eq=False)
class FrameColumns:
    """What c unit motions of frames do, those of the body's own first, where other nodes go with the body's axes.

    Attributes:
        R: (3, 3) from the body's axes to inertial ones.
        at: where.
        moves: of the body's own frames.
        carried: (c, owned nodes, 3) m, displacement of nodes with the body's axes, in inertial ones.
        relative: (c, owned nodes, 3) m, of those on frames against these axes, in inertial ones.
        given: (owned dofs, c) the same in the body's axes, and of unknowns that turn with frames.
        left: (owned dofs, c) N, change of the residual, in the body's axes.
        kept: (owned dofs, c) N, of the forces that keep averages.
        nodal_forces: (interface nodes, 3) N, on the frames.
        arms: (interface nodes, 3) m.
    """

    R: FloatArray
    at: BalancedNodes
    moves: tuple[UnitMotion, ...]
    carried: FloatArray
    relative: FloatArray
    given: FloatArray
    left: FloatArray
    kept: FloatArray
    nodal_forces: FloatArray
    arms: FloatArray

    def and_others(self, more: int) -> FrameColumns:
        """With so many columns behind these, of motions that move no node of this body's by themselves."""
        carried, relative = (
            np.concatenate([part, np.zeros((more, *part.shape[1:]))]) for part in (self.carried, self.relative)
        )
        given = np.hstack([self.given, np.zeros((len(self.given), more))])
        return replace(self, carried=carried, relative=relative, given=given)


def unit_motion(
    bonds: BondedNodes, arms: FloatArray, motion: FrameMotion, j: int, per_x: float, per_v: float
) -> UnitMotion:
    """What a unit displacement or rotation of a frame does to its nodes.

    Returns:
        (interface nodes, 3) their displacement and acceleration; (3,) the frame's rotation and shift.
    """
    k, axis = divmod(j, 6)
    mine = bonds.frame_of == k
    dx, da = np.zeros((2, len(arms), 3))
    shift, turn = np.zeros((2, 3))
    if axis < 3:
        shift[axis] = 1.0
        dx[mine], da[mine] = shift, shift / per_x
        return dx, da, turn, shift
    turn[axis - 3] = 1.0
    arm, w, alpha = arms[mine], motion.w[k], motion.alpha[k]
    moved, dw = crossed(turn, arm), per_v / per_x * turn
    dx[mine] = moved
    if bonds.averaged[mine].any():
        # they go by the scheme as all free nodes do
        da[mine] = moved / per_x
        return dx, da, turn, shift
    da[mine] = (
        moved / per_x
        + crossed(alpha, moved)
        + crossed(dw, crossed(w, arm))
        + crossed(w, crossed(dw, arm))
        + crossed(w, crossed(w, moved))
    )
    return dx, da, turn, shift


def crossed(w: FloatArray, vectors: FloatArray) -> FloatArray:
    """w x each of vectors (n, 3); numpy's own takes several times as long."""
    return np.asarray(vectors @ np.array([[0.0, w[2], -w[1]], [-w[2], 0.0, w[0]], [w[1], -w[0], 0.0]]))
