"""Rates of a machine at its start: its motion, and its vibrations with what the start excites of each.

The machine linearised about its start, loops eliminated, has vibrations (Bathe 2014, section 9.3).  The start lets go
of each by what its accelerations and velocities lack of the equilibrium; so much of it an integrator is going to see.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.kernels.physics.time_functions import evaluate_times
from flexmbd.multibody.kernels.tangent.residual_tangent import tangent
from flexmbd.multibody.kernels.tangent.tangent_layout import new_tangent_work
from flexmbd.multibody.plan.scene_matrices import constraint_jacobian, coordinate_sizes, fastest_rate
from flexmbd.multibody.start.consistent_start import Start

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class MachineRates:
    """Rates (1/s), all the same in any units.

    Attributes:
        motion: of the machine's motion.
        fastest: of the fastest vibration, or of the fastest decay by dampers.
        vibrations: (k,) those faster than the motion, in ascending order.
        amplitudes: (k,) what the start excites of each: the largest share of a coordinate's size; for modes that is
            what the body deforms by.
    """

    motion: float
    fastest: float
    vibrations: FloatArray
    amplitudes: FloatArray


def machine_rates(start: Start, t: float) -> MachineRates:
    """Rates at the start, at time t (s): dense, in O(nv^3)."""
    mass, damping, stiffness, along = _linearised(start, t)
    motion = _joint_rate(start)
    if not len(mass):
        return MachineRates(motion, 0.0, *np.zeros((2, 0)))
    squares, shapes = scipy.linalg.eigh(stiffness, mass)
    decay = np.abs(scipy.linalg.eigh(damping, mass, eigvals_only=True)).max()
    motion = max(motion, float(np.sqrt(max(-squares[0], 0.0))))
    fastest = max(float(np.sqrt(np.abs(squares).max())), float(decay))
    quick = squares > motion**2
    rates = np.sqrt(squares[quick])
    modal = shapes.T @ mass @ np.linalg.pinv(along)
    free = start.scene.plan.free
    pushes, runs = (modal @ part[free] for part in (start.a, start.v))
    swings = np.hypot(pushes[quick] / squares[quick], runs[quick] / rates)
    moved = np.abs(along @ shapes[:, quick]) * swings  # (free, k): each coordinate by each vibration
    amplitudes = (moved / _sizes(start, moved)[:, None]).max(axis=0, initial=0.0)
    return MachineRates(motion, fastest, rates, amplitudes)


def _sizes(start: Start, moved: FloatArray) -> FloatArray:
    """What errors of the free coordinates (free,) are measured by (``state.Groups``).

    Modes are measured by the largest deformation that is going to be met: twice what the start lets go of.
    """
    scene = start.scene
    of = scene.group_of[scene.plan.free]
    position = scene.group_floor.copy()
    np.maximum.at(position, of, np.where(scene.group_kind[of] == kinds.GROUP_MODAL, 2.0 * moved.sum(axis=1), 0.0))
    return position[of]


def _linearised(start: Start, t: float) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Symmetric M, D and K of the motions that loops leave, and these (free, k)."""
    scene = start.scene
    plan, n = scene.plan, scene.nv
    sizes = np.stack([coordinate_sizes(scene), np.zeros(n)])
    work, tangent_work = new_work(plan), new_tangent_work(plan, n, sizes=sizes)
    evaluate_times(plan, t, work.time)
    parts = np.zeros((3, n, n))
    at_start = (start.x, start.v, start.a, start.multipliers)
    tangent(plan, work, tangent_work, *at_start, 1.0, 0.0, 0.0, parts[0])
    tangent(plan, work, tangent_work, *at_start, 0.0, 0.0, 1.0, parts[2])
    sizes[1] = sizes[0] * fastest_rate(parts[2], parts[0])
    tangent(plan, work, tangent_work, *at_start, 0.0, 1.0, 0.0, parts[1])
    free, m = plan.free, len(plan.rows)
    along = np.eye(len(free))
    if m:
        size = sizes[0][free]
        slopes = constraint_jacobian(scene, work, start.x)[:, free] * size
        along = size[:, None] * scipy.linalg.qr(slopes.T)[0][:, m:]
    stiffness, damping, mass = (along.T @ part[np.ix_(free, free)] @ along for part in parts)
    return _symmetric(mass), _symmetric(damping), _symmetric(stiffness), along


def _symmetric(matrix: FloatArray) -> FloatArray:
    return 0.5 * (matrix + matrix.T)


def _joint_rate(start: Start) -> float:
    """The rate (1/s) of the motion at the start: of the joints where there are any."""
    scene = start.scene
    free = scene.plan.free
    of = scene.group_of[free]
    size = scene.group_full[of]
    rates = np.maximum(np.abs(start.v[free]) / size, np.sqrt(np.abs(start.a[free]) / size))
    joints = scene.group_kind[of] != kinds.GROUP_MODAL
    return float(rates[joints].max() if joints.any() else rates.max(initial=0.0))
