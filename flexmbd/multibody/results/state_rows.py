"""Rows of states that limits are looked for in, and what of them costs more than to read it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.bodies.body import Body
from flexmbd.multibody.kernels.base.arrays import Work, new_work
from flexmbd.multibody.kernels.sampling.series import body_series
from flexmbd.multibody.plan.compiled_scene import CompiledScene

FloatArray = NDArray[np.float64]

# What changes slowly from step to step is looked at in every so manieth of many rows; steps resolve vibrations.
_STRIDE, _FEW = 32, 64


@dataclass(frozen=True, eq=False)
class Before:
    """Of the rows before these: x (1, nx) of the run's first, and t (1,), x, v of the last."""

    first: FloatArray
    t: FloatArray
    x: FloatArray
    v: FloatArray


class StateRows:
    """Some states of a machine.

    Attributes:
        scene: the machine.
        t: (k,) s, or load factors.
        x: (k, nx) configurations.
        v: (k, nv) velocities.
        before: of the rows that were looked at before these.
        some: the rows that stand for all where bodies' motions are asked for: all of few, else every 32nd.
        most: likewise where vibrations are, every fourth.
    """

    def __init__(
        self,
        scene: CompiledScene,
        t: FloatArray,
        x: FloatArray,
        v: FloatArray,
        *,
        work: Work | None = None,
        before: Before | None = None,
    ) -> None:
        self.scene, self.t, self.x, self.v, self.before = scene, t, x, v, before
        self.some = slice(0, None, 1 if len(t) <= _FEW else _STRIDE)
        self.most = slice(0, None, 1 if len(t) <= _FEW else 4)
        self._work = work

    @property
    def first(self) -> FloatArray:
        """(1, nx) the configuration of the run's first row."""
        return self.x[:1] if self.before is None else self.before.first

    def after(self) -> Before:
        """What the next rows ask of these."""
        return Before(self.first.copy(), self.t[-1:].copy(), self.x[-1:].copy(), self.v[-1:].copy())

    @cached_property
    def motions(self) -> FloatArray:
        """(some, links, 21) of the bodies' axes: place, rotation (9), velocity, angular velocity, acceleration."""
        return self.motions_of(self.x[self.some], self.v[self.some])

    def motions_of(self, x: FloatArray, v: FloatArray) -> FloatArray:
        """(rows, links, 21) the same of configurations (rows, nx) and velocities."""
        plan = self.scene.plan
        motions = np.zeros((len(x), len(plan.tree), 21))
        x, v = np.ascontiguousarray(x), np.ascontiguousarray(v)
        if self._work is None:
            self._work = new_work(plan)
        body_series(plan, self._work, x, v, np.zeros(v.shape), motions)  # velocities need no accelerations
        return motions

    def spins(self, body: Body) -> FloatArray:
        """(some, 3) rad/s, a body's angular velocity in its own axes."""
        own = self.motions[:, self.scene.index.bodies[body]]
        spin: FloatArray = (own[:, None, 15:18] @ own[:, 3:12].reshape(-1, 3, 3))[:, 0]
        return spin


class Limit(Protocol):
    """The interface of what rows may pass."""

    def tells(self, rows: StateRows) -> bool:
        """Look at rows; whether it has told of one of them."""
