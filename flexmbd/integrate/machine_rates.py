"""Rates of a machine at its start: its motion, and its vibrations with what the start excites of each.

The machine linearised about its start, loops eliminated, has vibrations (Bathe 2014, section 9.3).  The start lets go
of each by what its accelerations and velocities lack of the equilibrium; so much of it an integrator is going to see.
Stops and friction are taken as they are once they bear what the motion brings against them, whether or not they do at
the start.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from flexmbd.integrate.krylov_rates import krylov_motions
from flexmbd.integrate.motions import Motions
from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base.arrays import Plan, new_work
from flexmbd.multibody.kernels.physics.time_functions import evaluate_times
from flexmbd.multibody.kernels.reading.force_tables import gripped_velocities, gripping, grips, keep_forces
from flexmbd.multibody.kernels.tangent.residual_tangent import tangent
from flexmbd.multibody.kernels.tangent.tangent_layout import new_tangent_work
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.plan.scene_matrices import constraint_jacobian, coordinate_sizes, fastest_rate
from flexmbd.multibody.start.consistent_start import Start
from flexmbd.overflow import looked_at

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class MachineRates:
    """Rates (1/s), all the same in any units.

    Attributes:
        motion: of the machine's motion.
        fastest: of the fastest vibration, contacts included, or of the fastest decay by dampers.
        contact: of the fastest contact that bears the load of the motion, which every method follows; 0 without one,
            and with elastic bodies, where it is one of the vibrations (``lasting``).
        gripped: how many stops and frictions there are.
        vibrations: (k,) those faster than the motion, in ascending order.
        amplitudes: (k,) what the start excites of each: the largest share of a coordinate's size; for modes that is
            what the body deforms by.
    """

    motion: float
    fastest: float
    contact: float
    gripped: int
    vibrations: FloatArray
    amplitudes: FloatArray


@looked_at()
def machine_rates(start: Start, t: float) -> MachineRates:
    """Rates at the start, at time t (s): dense, in O(nv^3).  A start or inertias beyond numbers: infinite."""
    return _rates(start, _vibrations(start, t))


@looked_at()
def rates_of_many(start: Start, t: float) -> MachineRates | None:
    """As ``machine_rates``, of a machine of many bodies by its sparse matrices; None where it has none."""
    work = new_work(start.scene.plan)
    evaluate_times(start.scene.plan, t, work.time)
    found = krylov_motions(start, _without_grips(start.scene), work, rate=_joint_rate(start))
    return None if found is None else _rates(start, found)


def _rates(start: Start, found: Motions | None) -> MachineRates:
    """By vibrations; None: they are beyond numbers."""
    motion = _joint_rate(start)
    if found is None or not np.isfinite(found.squares).all():
        return MachineRates(motion, np.inf, 0.0, 0, *np.zeros((2, 0)))
    squares = found.squares
    if not len(squares):
        return MachineRates(motion, 0.0, 0.0, 0, *np.zeros((2, 0)))
    motion = max(motion, float(np.sqrt(max(-squares[0], 0.0))))
    contact, held = _grips(start, motion, found.shapes)
    decay = np.abs(np.linalg.eigvalsh(found.damping + held)).max()
    fastest = max(float(np.sqrt(np.abs(squares).max())), contact, float(decay))
    quick = squares > motion * motion
    rates = np.sqrt(squares[quick])
    swings = np.hypot(found.pushes[quick] / squares[quick], found.runs[quick] / rates)
    moved = np.abs(found.shapes[:, quick]) * swings  # (free, k): each coordinate by each vibration
    amplitudes = (moved / _sizes(start, moved)[:, None]).max(axis=0, initial=0.0)
    followed = 0.0 if len(start.scene.plan.flex) else contact
    gripped = int(np.count_nonzero(gripping(start.scene.plan)))
    return MachineRates(motion, fastest, followed, gripped, rates, amplitudes)


def _vibrations(start: Start, t: float) -> Motions | None:
    """All vibrations, by dense matrices; None where these are beyond numbers."""
    mass, damping, stiffness, along = _linearised(start, t)
    if not all(np.isfinite(part).all() for part in (mass, damping, stiffness)):
        return None
    if not len(mass):
        return Motions(np.zeros(0), along, damping, *np.zeros((2, 0)))
    try:
        squares, shapes = scipy.linalg.eigh(stiffness, mass)
    except scipy.linalg.LinAlgError:  # inertias so unlike that round-off takes the smallest
        return None
    modal = shapes.T @ mass @ np.linalg.pinv(along)
    pushes, runs = (modal @ part[start.scene.plan.free] for part in (start.a, start.v))
    return Motions(squares, along @ shapes, shapes.T @ damping @ shapes, pushes, runs)


def _without_grips(scene: CompiledScene) -> Plan:
    """The plan without stops and friction."""
    return keep_forces(scene.plan, range(len(scene.plan.forces)), ~gripping(scene.plan))


def _grips(start: Start, motion: float, shapes: FloatArray) -> tuple[float, FloatArray]:
    """The fastest contact's rate (1/s), and the damping (k, k) of stops and friction by unit shapes (free, k).

    Each is taken to bear what it needs to turn the motion of its coordinate within 1 rad of it: the inertia that it
    feels, all else being free, by the coordinate's size and the square of the motion's rate (1/s).
    """
    scene = start.scene
    every = np.zeros((scene.nv, shapes.shape[1]))
    every[scene.plan.free] = shapes
    on = gripped_velocities(scene.plan)
    felt = every[on]
    mobility = np.sum(felt**2, axis=1)
    inertia = np.divide(1.0, mobility, out=np.zeros(len(on)), where=mobility > 0.0)
    stiffness, damping = grips(scene.plan, inertia * scene.group_full[scene.group_of[on]] * (motion * motion)).T
    return float(np.sqrt((stiffness * mobility).max(initial=0.0))), (felt.T * damping) @ felt


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
    """Symmetric M, D and K of the motions that loops leave, without stops and friction, and these (free, k)."""
    scene = start.scene
    plan, n = _without_grips(scene), scene.nv
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
    states = scene.group_kind[scene.group_of] == kinds.GROUP_STATE
    parts[:, states[:, None] != states] = 0.0  # what acts one way alone, in units of states: no rate of either
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
    of_machine = scene.group_kind[of] != kinds.GROUP_STATE
    rates, joints = rates[of_machine], (scene.group_kind[of] != kinds.GROUP_MODAL)[of_machine]
    return float(rates[joints].max() if joints.any() else rates.max(initial=0.0))
