"""Arrays in which an explicit Runge-Kutta step works."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.integrate.explicit.force_noise import ForceNoise
from flexmbd.integrate.explicit.step_errors import N_ERRORS
from flexmbd.multibody.kernels.base.array_struct import ArrayStruct
from flexmbd.multibody.plan.compiled_scene import CompiledScene

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class RungeKuttaWorkspace(ArrayStruct):
    """Work arrays of a step: the stage at hand and the derivatives of all stages.

    rate_x, rate_v: (s + 1, nv) du/dt and dv/dt.  error_x, error_v: (2, nv).
    noise: what is remembered of rounding.  noise_v: (2, nv) what it makes of the errors, or (2, 0).
    axes, spins (k, 3): see ``round_bodies``; no rows where no body is round.
    errors: (N_ERRORS,) of fixed steps, see ``step_errors``.
    """

    x: FloatArray
    v: FloatArray
    a: FloatArray
    u: FloatArray
    multipliers: FloatArray
    rate_x: FloatArray
    rate_v: FloatArray
    error_x: FloatArray
    error_v: FloatArray
    noise: ForceNoise
    noise_v: FloatArray
    axes: FloatArray
    spins: FloatArray
    errors: FloatArray


def new_workspace(scene: CompiledScene, stages: int, axes: FloatArray, noise: ForceNoise) -> RungeKuttaWorkspace:
    """Allocate for a tableau of so many stages."""
    nv = scene.nv
    if not axes.any():
        axes = axes[:0]
    zeros = np.zeros
    return RungeKuttaWorkspace(
        x=zeros(scene.nx),
        v=zeros(nv),
        a=zeros(nv),
        u=zeros(nv),
        multipliers=zeros(len(scene.plan.rows)),
        rate_x=zeros((stages + 1, nv)),
        rate_v=zeros((stages + 1, nv)),
        error_x=zeros((2, nv)),
        error_v=zeros((2, nv)),
        noise=noise,
        noise_v=zeros((2, len(noise.acceleration))),
        axes=axes,
        spins=zeros((len(axes), 3)),
        errors=zeros(N_ERRORS),
    )
