"""What a load factor scales: the machine's functions of time, or the forces that a start lacks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuation.space import LOAD_DIFFERENCE
from flexmbd.multibody.kernels.base.arrays import Work
from flexmbd.multibody.kernels.inverse_dynamics.residual import residual
from flexmbd.multibody.kernels.reading.constraint_tables import constraint_rows, driven_coordinates
from flexmbd.multibody.linear.elimination import Prescribed
from flexmbd.multibody.plan.compiled_scene import CompiledScene

FloatArray = NDArray[np.float64]

#: Brings ``Work.time`` of a scene up to date for a time (s), as ``run.stepping.evaluate_inputs``.
Inputs = Callable[[CompiledScene, Work, float], None]



class Loading(Protocol):
    """How a machine's loads follow one factor."""

    def apply(self, work: Work, factor: float) -> FloatArray | float:
        """Bring ``work.time`` to a factor; (nv,) forces to be added to the residual."""

    def slopes(self, work: Work, x: FloatArray, v: FloatArray, *, factor: float, width: float) -> LoadSlopes:
        """Derivatives by the factor at x (nx,), v (nv,), in a range of factors; leaves ``work.time`` at the factor."""


@dataclass(frozen=True, eq=False)
class TimeAsFactor:
    """The factor is what functions of time take for the time; what is constant does not scale.

    Prescribed motions are gone along so slowly that they have no rates.
    """

    scene: CompiledScene
    inputs: Inputs

    def apply(self, work: Work, factor: float) -> FloatArray | float:
        """As of ``Loading``; no further forces.

        Raises:
            SceneError: a function failed.
        """
        self.inputs(self.scene, work, factor)
        work.time[:-1, 1:] = 0.0
        return 0.0

    def slopes(self, work: Work, x: FloatArray, v: FloatArray, *, factor: float, width: float) -> LoadSlopes:
        """As of ``Loading``, by central differences."""
        return load_slopes(self.scene, work, self, x, v, factor=factor, width=width)


@dataclass(frozen=True, eq=False)
class LackingTakenAway:
    """Newton's homotopy: the forces that are out of balance at a start are held, and let go as the factor goes to 1.

    Attributes:
        lacking: (nv,) those forces.
        rows: how many constraint rows there are, which the factor leaves as they are.
    """

    lacking: FloatArray
    rows: int

    def apply(self, work: Work, factor: float) -> FloatArray | float:
        """As of ``Loading``: what holds the rest."""
        return (factor - 1.0) * self.lacking

    def slopes(self, work: Work, x: FloatArray, v: FloatArray, *, factor: float, width: float) -> LoadSlopes:
        """As of ``Loading``."""
        motion, row = np.zeros((3, len(self.lacking), 1)), np.zeros((2, self.rows, 1))
        return LoadSlopes(self.lacking, Prescribed(motion, row, np.zeros((1, 1))))


@dataclass(frozen=True, eq=False)
class LoadSlopes:
    """Derivatives by the factor at a configuration that stays.

    Attributes:
        force: (nv,) of the residual.
        given: what prescribed coordinates and rows change by; the factor is its only input.
    """

    force: FloatArray
    given: Prescribed


def load_slopes(
    scene: CompiledScene, work: Work, loading: Loading, x: FloatArray, v: FloatArray, *, factor: float, width: float
) -> LoadSlopes:
    """Central differences by the factor; leaves ``work.time`` at it.

    Args:
        scene: the machine.
        work: scratch.
        loading: the loads.
        x: (nx,) configuration.
        v: (nv,) velocities.
        factor: where.
        width: of the range of factors.
    """
    plan, m = scene.plan, len(scene.plan.rows)
    driven, rows = driven_coordinates(plan), constraint_rows(plan).time
    forces, places, gaps = np.zeros((2, scene.nv)), np.zeros((2, scene.nv)), np.zeros((2, m))
    rest = np.zeros(scene.nv)
    for k, side in enumerate((-1.0, 1.0)):
        further = loading.apply(work, factor + side * LOAD_DIFFERENCE * width)
        residual(plan, work, x, v, rest, np.zeros(m), forces[k])
        scene.refuse_failed(work)
        forces[k] += further
        places[k, driven.v] = work.time[driven.time, 0]
        gaps[k] = np.where(rows >= 0, work.time[rows, 0], 0.0)
    loading.apply(work, factor)
    force, place, gap = (np.diff(pair, axis=0)[0] / (2.0 * LOAD_DIFFERENCE * width) for pair in (forces, places, gaps))
    motion, row = np.zeros((3, scene.nv, 1)), np.zeros((2, m, 1))
    motion[0, :, 0], row[0, :, 0] = place, gap
    return LoadSlopes(force, Prescribed(motion, row, np.zeros((1, 1))))

