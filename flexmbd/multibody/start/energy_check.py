"""Users' laws between frames that give an energy: whether their wrench is its derivative, as energy accounts need."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import SceneError
from flexmbd.multibody.kernels.base.arrays import Plan, Work
from flexmbd.multibody.kernels.elements.frame_law import STORING_FRAME_LAW
from flexmbd.multibody.kernels.elements.table import are_of
from flexmbd.multibody.kernels.inverse_dynamics.residual import residual
from flexmbd.multibody.kernels.inverse_dynamics.stored_energy import energy_slopes
from flexmbd.multibody.plan.compiled_scene import CompiledScene

FloatArray = NDArray[np.float64]

_STEP = 6e-6  # of the machine's extent, and of 1 rad: the cube root of round-off
_FALSE = 1e-3  # of the wrench; what differences of a law with kinks miss is far less
_ROUND_OFF = 1e-9  # of the energy over these sizes


def gives_energies(plan: Plan) -> bool:
    """Whether laws between frames give energies, which ``refuse_false_energies`` compares."""
    return bool(are_of(plan, STORING_FRAME_LAW).any())


def refuse_false_energies(scene: CompiledScene, work: Work, x: FloatArray) -> None:
    """Compare wrenches at rest with their energies' slopes at a start (nx,).

    Raises:
        SceneError: they differ; the message names the law.
    """
    laws = np.flatnonzero(are_of(scene.plan, STORING_FRAME_LAW))
    if not len(laws):
        return
    still = np.zeros(scene.nv)
    residual(scene.plan, work, x, still, still, np.zeros(len(scene.plan.rows)), np.zeros(scene.nv))
    step = _STEP * np.array([scene.extent, 1.0])
    for k in laws:
        found = np.zeros((3, 6))
        energy_slopes(scene.plan, work, int(k), step, found)
        scene.refuse_failed(work)
        for name, unit, part, size in (("force", "N", slice(3), scene.extent), ("torque", "N m", slice(3, 6), 1.0)):
            wrench, slope = found[0, part], -found[1, part]
            allowed = _FALSE * np.linalg.norm(wrench) + _ROUND_OFF * abs(found[2, 0]) / size
            if np.linalg.norm(wrench - slope) > allowed:
                raise SceneError(
                    f"{scene.element_names[k]}: at the start its {name} at rest, {wrench} {unit}, is not that of the "
                    f"energy it returns, {slope} {unit}; mend one of them, or return nothing"
                )
