"""Users' laws between frames that give an energy: whether their wrench is its derivative, as energy accounts need."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import SceneError
from flexmbd.multibody.kernels.base.arrays import Plan, Work
from flexmbd.multibody.kernels.elements.differences import STEP
from flexmbd.multibody.kernels.elements.frame_law import STORING_FRAME_LAW
from flexmbd.multibody.kernels.elements.pairs import STORING_PAIRS_LAW
from flexmbd.multibody.kernels.elements.table import are_of, of_pairs
from flexmbd.multibody.kernels.inverse_dynamics.recursion import forward_kinematics
from flexmbd.multibody.kernels.inverse_dynamics.residual import residual
from flexmbd.multibody.kernels.inverse_dynamics.stored_energy import ROUNDINGS, energy_slopes, pair_faults
from flexmbd.multibody.kernels.reading.force_tables import frames_of_group
from flexmbd.multibody.plan.compiled_scene import CompiledScene

FloatArray = NDArray[np.float64]



def gives_energies(plan: Plan) -> bool:
    """Whether users' laws between frames give energies, which ``refuse_false_energies`` compares."""
    return bool(are_of(plan, STORING_FRAME_LAW).any() or are_of(plan, STORING_PAIRS_LAW).any())


def refuse_false_energies(scene: CompiledScene, work: Work, x: FloatArray) -> None:
    """Compare wrenches at rest with their energies' slopes at a start (nx,).

    A law is refused where its wrench lies farther from the central difference than that can be wrong.  It differs from
    that over twice the step by as much as it misses where the slope is smooth or bends (a missed term of order p is
    2^p - 1 of the difference); from the slopes on either side where these jump; and by the rounding of energies and of
    where the frames are.

    Raises:
        SceneError: they differ; the message names the law.
    """
    laws = np.flatnonzero(are_of(scene.plan, STORING_FRAME_LAW))
    groups = np.flatnonzero(are_of(scene.plan, STORING_PAIRS_LAW))
    if not len(laws) + len(groups):
        return
    still = np.zeros(scene.nv)
    residual(scene.plan, work, x, still, still, np.zeros(len(scene.plan.rows)), np.zeros(scene.nv))
    for k in groups:
        _refuse_false_pairs(scene, work, int(k))
    for k in laws:
        found = np.zeros((2, 4, 6))
        for twice in range(2):
            step = (1.0 + twice) * STEP * np.array([scene.extent, 1.0])
            energy_slopes(scene.plan, work, int(k), step, found[twice])
        scene.refuse_failed(work)
        for name, unit, part, size in (("force", "N", slice(3), scene.extent), ("torque", "N m", slice(3, 6), 1.0)):
            wrench, before, behind = found[0, :3, part]
            slope, wider = 0.5 * (before + behind), 0.5 * (found[1, 1, part] + found[1, 2, part])
            known = np.linalg.norm(behind - before) + np.linalg.norm(wider - slope)
            of_values = abs(found[0, 3, 0]) / size + np.linalg.norm(slope)
            known += ROUNDINGS * np.finfo(float).eps / (2.0 * STEP) * of_values
            if np.linalg.norm(wrench + slope) > known:
                raise SceneError(
                    f"{scene.element_names[k]}: at the start its {name} at rest, {wrench} {unit}, is not that of the "
                    f"energy it returns, {-slope} {unit}; mend one of them, or return nothing"
                )


def _refuse_false_pairs(scene: CompiledScene, work: Work, k: int) -> None:
    found = np.zeros(7)
    pair_faults(scene.plan, work, k, True, found)
    scene.refuse_failed(work)
    if found[2] > 0.0:
        raise SceneError(
            f"{scene.element_names[k]}: at the start its force at rest between {_pair(scene, k, *found[3:5])}, "
            f"{found[5]:g} N, is not that of the energy it returns, {-found[6]:g} N; mend one, or return nothing"
        )


def refuse_meeting(scene: CompiledScene, work: Work, x: FloatArray) -> None:
    """Raise SceneError where two frames of a group attract or repel each other and are at one place, at x (nx,)."""
    groups = np.flatnonzero(of_pairs(scene.plan))
    if not len(groups):
        return
    forward_kinematics(scene.plan, work, x, np.zeros(scene.nv), np.zeros(scene.nv))
    for k in map(int, groups):
        found = np.zeros(7)
        pair_faults(scene.plan, work, k, False, found)
        if found[0] >= 0.0:
            raise SceneError(
                f"{scene.element_names[k]}: {_pair(scene, k, *found[:2])} meet at the start, where a force along their "
                "line has no direction"
            )


def _pair(scene: CompiledScene, k: int, i: float, j: float) -> str:
    """Two frames of the group of element k, in words."""
    rows = frames_of_group(scene.plan, k)
    markers = [scene.sources.markers[rows[int(one)]] for one in (i, j)]
    return " and ".join(marker.frame.label for marker in markers if marker is not None)
