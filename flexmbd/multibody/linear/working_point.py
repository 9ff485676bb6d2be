"""The state that a machine is linearised about: an equilibrium, or a steady motion."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from flexmbd.brief import brief
from flexmbd.multibody.bodies.body import Frame
from flexmbd.multibody.interiors.scene_interiors import NO_INTERIORS, InteriorSnapshot
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.kernels.sampling.series import frame_series
from flexmbd.multibody.motion.instant import Instant
from flexmbd.multibody.plan.compiled_scene import CompiledScene, add_probe

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class WorkingPoint(Instant):
    """A state that stays, or goes on steadily.

    Attributes:
        scene: the compiled scene, without redundant rows.
        t: s, at which functions of time are taken.
        x, v: (nx,), (nv,) configuration and velocities.
        multipliers: (m,) reactions of the loops (N or N m).
        interiors: what bodies with history remember there.
        unstable: of an equilibrium how many independent motions have a negative tangent stiffness: with none it is
            stable; None of a state of a trajectory. In a steady motion gyroscopic forces may hold what they count.
        steady_accelerations: (nv,) of a steady motion; None where all are zero.
        neutral: of an equilibrium names of coordinates, one for each independent motion that nothing resists; they
            stay where they were.
    """

    scene: CompiledScene
    t: float
    x: FloatArray
    v: FloatArray
    multipliers: FloatArray
    interiors: InteriorSnapshot = NO_INTERIORS
    unstable: int | None = None
    steady_accelerations: FloatArray | None = field(default=None, kw_only=True)
    neutral: tuple[str, ...] = field(default=(), kw_only=True)

    __repr__ = brief

    @cached_property
    def a(self) -> FloatArray:  # type: ignore[override]
        """(nv,) accelerations of a steady motion: of coordinates that do not turn with it zeros."""
        return np.zeros_like(self.v) if self.steady_accelerations is None else self.steady_accelerations


def frame_motion(scene: CompiledScene, frame: Frame, x: FloatArray, v: FloatArray) -> FloatArray:
    """(21,) a row of ``kernels.series.frame_series`` at configuration x (nx,) and velocities v (nv,)."""
    plan = add_probe(scene, frame)
    out = np.zeros((1, 21))
    frame_series(plan, new_work(plan), len(plan.frames) - 1, x[None], v[None], np.zeros((1, scene.nv)), out)
    return out[0]
