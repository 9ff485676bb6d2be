"""Exact beams whose slack strains are functions of time: the energy that they store then, and the power of the strains.

Integrators take the energy as if nothing were given, and what is given for a load (``elements.given_strain``).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.beams.pose_logarithm import logarithm_change, pose_logarithm
from flexmbd.multibody.bodies.body import Frame
from flexmbd.multibody.force.beam_element import BeamElement
from flexmbd.multibody.force.beam_strain import BeamStrain
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.kernels.physics.time_functions import evaluate_times
from flexmbd.multibody.kernels.reading.force_tables import force_elements
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.scene_index import IdentityMap, SceneIndex

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class GivenStrain:
    """What is given to an element beside its rest, times its length, and its rates: (nt, 6) m and rad, and 1/s."""

    value: FloatArray
    rate: FloatArray


def given_strains(scene: CompiledScene, t: FloatArray) -> IdentityMap[BeamElement, GivenStrain]:
    """Of each element to which a strain is given, at times t (nt,).

    Raises:
        SceneError: a user's function failed, which is asked anew.
    """
    found: IdentityMap[BeamElement, GivenStrain] = IdentityMap()
    forces = [force for force in scene.index.forces if isinstance(force, BeamStrain)]
    if not forces:
        return found
    scene.forget_failure()
    times = force_elements(scene.plan).time
    for force in forces:
        function = int(times[scene.index.forces[force].elements.start])
        alone, out = scene.plan.replace(times=scene.plan.times[function : function + 1]), np.zeros((2, 3))
        given = np.zeros((2, len(t)))
        for k, instant in enumerate(t):
            evaluate_times(alone, float(instant), out)
            given[:, k] = out[0, :2]
        for element, length in zip(force.elements, force.lengths, strict=True):
            if element not in found:
                found[element] = GivenStrain(*np.zeros((2, len(t), 6)))
            found[element].value[:, force.component] += length * given[0]
            found[element].rate[:, force.component] += length * given[1]
    scene.refuse_failed(new_work(scene.plan))
    return found


def energy_of_given(scene: CompiledScene, t: FloatArray, motion: FloatArray) -> FloatArray:
    """(nt,) J, elastic energy less that as if nothing were given; ``motion`` is ``body_motion``'s."""
    total = np.zeros(len(t))
    for element, given in given_strains(scene, t).items():
        stiffness, _ = element.matrices()
        bent = _logarithm(scene.index, motion, element) - np.asarray(element.rest)
        total += np.einsum("ki,ij,kj->k", 0.5 * given.value - bent, stiffness, given.value)
    return total


def power_of_given(
    scene: CompiledScene, t: FloatArray, motion: FloatArray, elements: tuple[BeamElement, ...]
) -> FloatArray:
    """(nt,) W that the given strains of some elements do: less their resultants times the rates of what is given."""
    total = np.zeros(len(t))
    for element, given in given_strains(scene, t).items():
        if not any(element is one for one in elements):
            continue
        stiffness, damping = element.matrices()
        resultants = (_logarithm(scene.index, motion, element) - np.asarray(element.rest) - given.value) @ stiffness
        if damping.any():
            resultants += (_logarithm_rate(scene.index, motion, element) - given.rate) @ damping
        total -= np.sum(resultants * given.rate, axis=1)
    return total


@dataclass(frozen=True, eq=False)
class _FrameMotion:
    """p (nt, 3), R (nt, 3, 3), velocity and angular velocity (nt, 3), in inertial axes."""

    p: FloatArray
    R: FloatArray
    v: FloatArray
    w: FloatArray


def _of_frame(index: SceneIndex, motion: FloatArray, frame: Frame) -> _FrameMotion:
    body = motion[:, index.bodies[frame.body]]
    R = body[:, 3:12].reshape(-1, 3, 3)
    arm = R @ frame.p_BF_B
    w = body[:, 15:18]
    return _FrameMotion(body[:, :3] + arm, R @ frame.R_BF, body[:, 12:15] + np.cross(w, arm), w)


def _pose(first: _FrameMotion, second: _FrameMotion) -> tuple[FloatArray, FloatArray]:
    back = first.R.swapaxes(1, 2)
    return np.einsum("kij,kj->ki", back, second.p - first.p), back @ second.R


def _logarithm(index: SceneIndex, motion: FloatArray, element: BeamElement) -> FloatArray:
    """(nt, 6) m and rad."""
    return pose_logarithm(*_pose(*(_of_frame(index, motion, frame) for frame in element.frames)))


def _logarithm_rate(index: SceneIndex, motion: FloatArray, element: BeamElement) -> FloatArray:
    """(nt, 6) m/s and rad/s."""
    first, second = (_of_frame(index, motion, frame) for frame in element.frames)
    apart = second.v - first.v - np.cross(first.w, second.p - first.p)
    rates = np.einsum("kji,knj->kni", first.R, np.stack([apart, second.w - first.w], axis=1)).reshape(-1, 6)
    poses = zip(*_pose(first, second), rates, strict=True)
    return np.array([logarithm_change(d, R) @ rate for d, R, rate in poses]).reshape(-1, 6)
