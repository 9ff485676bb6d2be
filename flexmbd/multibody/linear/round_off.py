"""Round-off in linear equations: sizes below which entries of K, C and Ty are zeros.

An entry is told from round-off by what it is the sum of, never by entries beside it, which are of other units: the
stiffness of a slow coordinate is not lost beside that of a stiff spring.  What K sums are the forces at play on the
coordinate, times their levers; through a body they go from joint to joint, so that those of one coordinate are what
acts on the bodies that it carries.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.kernels.base.arrays import Work
from flexmbd.multibody.kernels.inverse_dynamics.residual import residual
from flexmbd.multibody.kernels.reading.constraint_tables import constraint_rows
from flexmbd.multibody.kernels.reading.evaluated_motion import required_wrenches
from flexmbd.multibody.kernels.reading.tree import frame_owner, masses, modal_places, parents, tree_joints
from flexmbd.multibody.linear.derivatives import Derivatives
from flexmbd.multibody.linear.elimination import Coordinates, Elimination
from flexmbd.multibody.linear.working_point import WorkingPoint
from flexmbd.round_off import ROUND_OFF

FloatArray = NDArray[np.float64]



def energies_at_play(point: WorkingPoint, work: Work) -> FloatArray:
    """(nv,) J, what the forces on all bodies that a coordinate carries would do along the machine's extent, or 1 rad.

    Of each body its weight, what its joints pass on and the reactions of loops, all by their sizes.
    """
    scene, plan = point.scene, point.scene.plan
    residual(plan, work, point.x, point.v, point.a, point.multipliers, np.zeros(scene.nv))
    length, wrenches = scene.extent, required_wrenches(work)[: len(plan.tree)]
    passed = length * np.linalg.norm(wrenches[:, :3], axis=1)
    passed += np.linalg.norm(wrenches[:, 3:], axis=1)
    at_play = passed + length * masses(plan) * np.linalg.norm(plan.gravity)
    rows = constraint_rows(plan)
    levers = np.where(rows.in_rad, 1.0, length)
    for f, g, lever, force in zip(rows.f, rows.g, levers, point.multipliers, strict=True):
        for frame in (f, g):
            if frame >= 0 and frame_owner(plan, frame) >= 0:
                at_play[frame_owner(plan, frame)] += lever * abs(force)
    for i, parent in enumerate(parents(plan)):
        if parent >= 0:
            at_play[parent] += passed[i]
    for i, parent in reversed(list(enumerate(parents(plan)))):
        if parent >= 0:
            at_play[parent] += at_play[i]
    found = np.zeros(scene.nv)
    for joint in tree_joints(plan):
        found[joint.v] = at_play[joint.row]
    for modes in modal_places(plan):
        found[modes.v] = at_play[modes.row]
    return found


@dataclass(frozen=True, eq=False)
class RoundOff:
    """Sizes below which entries are round-off; all of the units of the entries.

    Attributes:
        C, K: (nz, nz), (nz, ny).
        Ty: (ny, ny).
    """

    C: FloatArray
    K: FloatArray
    Ty: FloatArray


def round_off(
    of: Derivatives, by: Elimination, coordinates: Coordinates, energies: FloatArray, rate: float
) -> RoundOff:
    """Of the equations that ``by`` leaves.

    Args:
        of: the machine's derivatives.
        by: the elimination.
        coordinates: n of them.
        energies: (n,) J of ``energies_at_play``.
        rate: 1/s, the largest speed at hand over the coordinate's size.
    """
    size, mass = coordinates.size, np.sqrt(np.abs(np.diag(of.mass)))
    inertia = np.outer(mass, mass) * rate  # kg m^2/s and the like: what Coriolis' and gyroscopic terms sum
    stiffness = np.abs(of.stiffness) + np.minimum.outer(energies, energies) / np.outer(size, size) + inertia * rate
    damping = np.abs(of.damping) + inertia
    Vz, Vy, Xy, Ty = (np.abs(part) for part in (by.Vz, by.Vy, by.Xy, by.Ty))
    push = Vz.T @ np.abs(of.mass)
    C = Vz.T @ damping @ Vz + push @ Vy @ np.abs(by.Tz)
    K = Vz.T @ (damping @ Vy + stiffness @ Xy) + push @ Vy @ Ty
    if len(by.y) == len(by.z):  # y' takes the place of z
        K += (C + push @ Vz @ Ty) @ Ty
        C += push @ Vz @ Ty
    y = size[by.y]
    return RoundOff(ROUND_OFF * C, ROUND_OFF * K, ROUND_OFF * rate * np.outer(y, 1.0 / y))


def without_round_off(matrix: FloatArray, noise: FloatArray) -> FloatArray:
    """Round-off made zeros, so that what turns or rolls freely has eigenvalues that are zero."""
    return np.where(np.abs(matrix) > noise, matrix, 0.0)
