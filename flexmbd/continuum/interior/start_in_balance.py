"""The start of a body that moves: the accelerations that forces cause, and the wrenches on its frames."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.interior.nodal_solution import NodalSolution
from flexmbd.continuum.interior.step_equations import NodalState
from flexmbd.multibody.bodies.continuum_body import FrameMotion

FloatArray = NDArray[np.float64]


def begin_balanced(
    nodes: NodalSolution, now: NodalState, motion: FrameMotion, *, weight: FloatArray, gravity: FloatArray,
    internal: FloatArray, unknowns: FloatArray, R: FloatArray,
) -> tuple[NodalState, FloatArray]:
    """The state with the accelerations that internal forces cause. Collective.

    Args:
        nodes: of the body.
        now: their state; its accelerations are not read.
        motion: of the frames.
        weight: (owned nodes, 3) N, of gravity, in inertial axes.
        gravity: (3,) m/s^2.
        internal: (owned nodes, 3) N, less what acts, in inertial axes.
        unknowns: (owned dofs,) forces of unknowns beside the displacement, in the body's axes.
        R: as of `NodalSolution.accelerations`.

    Returns:
        The state, and (k, 6) wrenches on the body's frames.
    """
    bonds = nodes.bonds
    a = nodes.accelerations(motion, weight - internal, R=R)
    state = replace(now, a=a, auxiliary=a.copy())
    nodal_forces = nodes.frames.nodal_forces(internal + nodes.inertia(a - gravity), a[nodes.bonded] - gravity)
    wrenches = bonds.wrenches(nodal_forces, bonds.arms(motion))
    if nodes.turning is not None and state.turns is not None:
        turns, forces = nodes.turning.started(state.turns, motion, unknowns)
        state, unknowns = replace(state, turns=turns), unknowns.copy()
        unknowns[nodes.turning.inertia.own] += forces
    couples = bonds.turns.wrenches(unknowns, motion.R, nodes.axes(motion).R)
    return state, wrenches + couples + nodes.frames.frame_couples(motion)
