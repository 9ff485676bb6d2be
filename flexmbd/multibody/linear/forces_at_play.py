"""The forces at play at a state: what is balanced, and what resists a motion, is judged against them.

Forces in balance add up to nothing, however large they are; what is left is round-off of each of them.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.kernels.base.arrays import Plan, Work
from flexmbd.multibody.kernels.inverse_dynamics.residual import residual
from flexmbd.multibody.kernels.reading.evaluated_motion import required_wrenches
from flexmbd.multibody.kernels.reading.force_tables import keep_forces
from flexmbd.multibody.kernels.reading.tree import modal_places, parents, tree_joints
from flexmbd.multibody.linear.balance import ForceBalance
from flexmbd.multibody.linear.round_off import energies_at_play
from flexmbd.multibody.linear.working_point import WorkingPoint
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.plan.scene_matrices import coordinate_sizes

FloatArray = NDArray[np.float64]

BALANCED = 1e-9  #: of the forces at play: what drives nothing, or is balanced along motions that nothing resists


def forces_at_play(scene: CompiledScene, work: Work, at: ForceBalance) -> FloatArray:
    """(nv,) J, what all forces on the bodies that a coordinate carries would do along the machine's extent, or 1 rad.

    Of each force element and each force on a joint by itself, of weights, and of reactions, all by their sizes.
    """
    plan, size = scene.plan, coordinate_sizes(scene)
    rest, none = np.zeros(scene.nv), np.zeros(len(plan.rows))

    def alone(one: Plan) -> tuple[FloatArray, FloatArray]:
        """(links,) J on each link, and (nv,) on each coordinate."""
        along = np.zeros(scene.nv)
        residual(one, work, at.x, rest, rest, none, along)
        wrenches = required_wrenches(work)[: len(plan.tree)]
        sizes = scene.extent * np.linalg.norm(wrenches[:, :3], axis=1) + np.linalg.norm(wrenches[:, 3:], axis=1)
        return sizes, np.abs(along) * size

    found = energies_at_play(WorkingPoint(scene, 0.0, at.x, at.v, at.multipliers), work)
    links = np.zeros(len(plan.tree))
    for one in _one_by_one(plan.replace(gravity=np.zeros(3))):
        on_links, on_coordinates = alone(one)
        links += on_links
        found += on_coordinates
    for row, parent in reversed(list(enumerate(parents(plan)))):
        if parent >= 0:
            links[parent] += links[row]
    for joint in tree_joints(plan):
        found[joint.v] += links[joint.row]
    for modes in modal_places(plan):
        found[modes.v] += links[modes.row]
    return found


def _one_by_one(plan: Plan) -> Iterator[Plan]:
    """The plan without forces, whose bodies are elastic, then with each one alone."""
    yield keep_forces(plan, [], [])
    for k in range(len(plan.forces)):
        yield keep_forces(plan, [k], [])
    for k in range(len(plan.elements)):
        yield keep_forces(plan, [], [k])
