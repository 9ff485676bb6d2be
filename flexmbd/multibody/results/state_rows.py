"""Rows of states that limits are looked for in, and what of them costs more than to read it."""

from __future__ import annotations

from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.bodies.body import Body
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.kernels.sampling.series import body_series
from flexmbd.multibody.plan.compiled_scene import CompiledScene

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# What changes slowly from step to step is looked at in every so manieth of many rows.
_STRIDE, _FEW = 16, 32


class StateRows:
    """Some states of a machine.

    Attributes:
        scene: the machine.
        t: (k,) s, or load factors.
        x: (k, nx) configurations.
        v: (k, nv) velocities.
        first: (1, nx) the configuration of the run's first row.
        some: numbers of the rows that stand for all: all of few, else every sixteenth and the last.
    """

    def __init__(self, scene: CompiledScene, t: FloatArray, x: FloatArray, v: FloatArray, first: FloatArray) -> None:
        self.scene, self.t, self.x, self.v, self.first = scene, t, x, v, first
        every = np.arange(len(t)) if len(t) <= _FEW else np.arange(0, len(t), _STRIDE)
        self.some: IntArray = np.union1d(every, [len(t) - 1]).astype(np.int64)

    def modal(self, body: Body) -> FloatArray:
        """(some, n) modal coordinates of a flexible body."""
        return self.x[self.some, self.scene.index.modes[body].x]

    @cached_property
    def motions(self) -> FloatArray:
        """(some, links, 21) of the bodies' axes: place, rotation (9), velocity, angular velocity, acceleration."""
        return self.motions_of(self.some)

    def motions_of(self, which: IntArray) -> FloatArray:
        """(rows, links, 21) the same of other rows."""
        plan = self.scene.plan
        x, v = np.ascontiguousarray(self.x[which]), np.ascontiguousarray(self.v[which])
        motions = np.zeros((len(which), len(plan.tree), 21))
        body_series(plan, new_work(plan), x, v, np.zeros(v.shape), motions)  # velocities need no accelerations
        return motions

    def spins(self, body: Body) -> FloatArray:
        """(some, 3) rad/s, a body's angular velocity in its own axes."""
        own = self.motions[:, self.scene.index.bodies[body]]
        spin: FloatArray = np.einsum("kab,ka->kb", own[:, 3:12].reshape(-1, 3, 3), own[:, 15:18])
        return spin


class Limit(Protocol):
    """The interface of what rows may pass."""

    def tells(self, rows: StateRows) -> bool:
        """Look at rows, the first of which may be the last of those before; whether it has told of one of them."""
