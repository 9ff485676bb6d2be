"""Report of a consistent start: coordinates that moved, and bodies that were deformed to close the loops."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.kernels.base.arrays import Work
from flexmbd.multibody.kernels.inverse_dynamics.residual import residual
from flexmbd.multibody.kernels.reading.tree import tree_joints
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.plan.mass_solver import MassSolver
from flexmbd.multibody.plan.scene_matrices import coordinate_sizes, mass_matrix, modal_stiffness
from flexmbd.multibody.start.loop_closing import CLOSED, own_rate
from flexmbd.overflow import looked_at
from flexmbd.round_off import EQUAL

FloatArray = NDArray[np.float64]
Mask = NDArray[np.bool_]

# Of the machine's energy: what closing the loops may put into the bodies untold.  Energies go with the squares of
# speeds, so bodies let go from there vibrate at some 3 % of the machine's own speeds.
_SMALL = 1e-3
_CHANGED = 0.1  # of a velocity that the user set: how much of it may change untold


@dataclass(frozen=True)
class Strain:
    """Deformation by which the loops were closed.

    Attributes:
        energy: J, elastic, of the deformations that closed the loops: they are all in this instant's ``energy``.
        left_open: m, the gap that rigid motions leave.
        machine: J, the machine's energy at the start: kinetic, and what its loads would do along each joint
            coordinate's full size (1 rad, or the machine's extent).
        bodies: whose modes moved.
    """

    energy: float = 0.0
    left_open: float = 0.0
    machine: float = 0.0
    bodies: tuple[str, ...] = ()

    @property
    def warning(self) -> str | None:
        """The warning that only a considerable deformation of bodies closes the loops; None without."""
        if self.energy <= _SMALL * self.machine or not self.bodies:
            return None
        return (
            f"the loops close only where bodies are bent ({', '.join(self.bodies)}): rigid motions leave "
            f"{self.left_open:.3g} m open, and {self.energy:.3g} J of elastic energy at the start close it, beside "
            f"{self.machine:.3g} J that the machine's motion and loads have; check lengths, frames and what was set"
        )


def closing_strain(
    scene: CompiledScene, work: Work, x: FloatArray, v: FloatArray, change: FloatArray, *, left_open: float
) -> Strain:
    """The deformation of the change (nv,) of coordinates that closed the loops; ``left_open`` as of ``Closing``."""
    share = 0.5 * modal_stiffness(scene) * change**2
    energy = float(share.sum())
    if left_open <= CLOSED:
        return Strain(energy, left_open * scene.extent)
    rest = np.zeros(scene.nv)
    load = np.zeros(scene.nv)
    residual(scene.plan, work, x, rest, rest, np.zeros(len(scene.plan.rows)), load)
    work_of_loads = np.abs(load) * coordinate_sizes(scene)
    for slots in scene.index.modes.values():
        work_of_loads[slots.v] = 0.0
    kinetic = 0.5 * float(v @ mass_matrix(scene, work, x) @ v)
    bodies = [b.outer.body for b in scene.topology.branches if b.outer.body.reduced() is not None]
    bent = tuple(body.name for body in bodies if share[scene.index.modes[body].v].sum() > _SMALL * energy)
    return Strain(energy, left_open * scene.extent, kinetic + float(work_of_loads.sum()), bent)


def moved_coordinates(
    scene: CompiledScene,
    work: Work,
    x: FloatArray,
    x_new: FloatArray,
    v: FloatArray,
    v_new: FloatArray,
    *,
    held: Mask,
    solve: MassSolver | None = None,
) -> tuple[tuple[str, float, float], ...]:
    """(coordinate, from, to) of positions, then of velocities; ``held`` (nv,): those set by the user.

    ``solve``: by the mass matrix at x_new, if it is factored.

    Changes of velocities count beside the machine's own rate as well: at rest all of them are round-off.
    """
    if np.array_equal(x, x_new) and np.array_equal(v, v_new):
        return ()
    old, new = coordinate_values(scene, x), coordinate_values(scene, x_new)
    size = coordinate_sizes(scene)
    enough = np.where(held, EQUAL, CLOSED) * size
    rate = float(np.abs(np.concatenate([v / size, v_new / size])).max(initial=0.0))
    told = [(scene.velocity_names[k], k, old, new) for k in np.flatnonzero(np.abs(new - old) > enough)]
    changes = np.abs(v_new - v) / size
    if (changes > EQUAL * rate).any():
        rate = max(rate, own_rate(scene, work, x_new, solve))
    told += [(f"rate of {scene.velocity_names[k]}", k, v, v_new) for k in np.flatnonzero(changes > EQUAL * rate)]
    return tuple((name, float(before[k]), float(after[k])) for name, k, before, after in told)


@looked_at()
def changed_velocities(scene: CompiledScene, wanted: FloatArray, v: FloatArray, *, held: Mask) -> str:
    """A complaint where velocities (nv,) that the user set were changed by more than a tenth; empty without.

    One that was set to zero counts beside the machine's largest rate, and so does one that is nothing beside it.
    """
    size = coordinate_sizes(scene)
    rate = float(np.abs(v / size).max(initial=0.0))
    allowed = np.maximum(_CHANGED * np.where(wanted == 0.0, rate * size, np.abs(wanted)), EQUAL * rate * size)
    changed = np.flatnonzero(held & (np.abs(v - wanted) > allowed))
    if not len(changed):
        return ""
    worst = changed[np.argsort(-np.abs(v - wanted)[changed] / size[changed], kind="stable")]
    told = [f"{scene.velocity_names[k]!r} was set to {wanted[k]:.4g} and begins with {v[k]:.4g}" for k in worst[:3]]
    more = f", and {len(worst) - 3} more" if len(worst) > 3 else ""
    return (
        f"the loops forbid the velocities that were set: {', '.join(told)}{more} (m/s, rad/s, or modal); set as many "
        "as the machine has freedoms and leave the others None, or set such as go together"
    )


def coordinate_values(scene: CompiledScene, x: FloatArray) -> FloatArray:
    """(nv,) coordinates, of balls and free bodies rotation vectors (rad)."""
    values = np.zeros(scene.nv)
    for joint in tree_joints(scene.plan):
        values[joint.plain_v] = x[joint.plain_x]
        if joint.quaternion is not None:
            from scipy.spatial.transform import Rotation  # on need: 0.1 s

            values[joint.spin] = Rotation.from_quat(np.roll(x[joint.quaternion], -1)).as_rotvec()
    for slots in scene.index.modes.values():
        values[slots.v] = x[slots.x]
    return values
