"""Implicit methods of one's own: a compiled function that writes the weights of a step, and the check of its order."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import SceneError
from flexmbd.given import checked
from flexmbd.integrate import state as st
from flexmbd.integrate.alpha.implicit_steps import implicit_stepper
from flexmbd.integrate.alpha.relation import POINT, A, RelationChoice, U, V
from flexmbd.integrate.controller import Stepper
from flexmbd.integrate.interior_support import refuse_interiors
from flexmbd.multibody.functions.compiled_function import Compiled, Signature
from flexmbd.multibody.kernels.base.arrays import Work
from flexmbd.multibody.plan.compiled_scene import CompiledScene

FloatArray = NDArray[np.float64]

# The equation that measures the order, y'' = - STIFFNESS y - DAMPING y' - LOAD sin(RATE t), over one second.
_STIFFNESS, _DAMPING, _LOAD, _RATE = 1.3, 0.4, 0.7, 1.9
_STEPS = 24  # of the coarser of two runs
_SHORTFALL = 0.25  # by which the order that two runs show may lie below the true one
_PATTERNS = {"equal steps": (1.0,), "steps that double and halve": (1.0, 2.0)}


@checked()
@dataclass(frozen=True)
class ImplicitMethod:
    """A method of one's own, of stages at whose ends forces balance with the accelerations there.

    ``relation`` is ``fm.compiled`` of ``f(data, h, h_before, nodes, u, v, memory)``.  For a step of h (s) after one of
    ``h_before``, 0 where nothing is remembered, it writes the ends of the s stages in steps, the last 1, into ``nodes``
    (s,), and into zeros how displacement from the step's start and velocity at the end of each stage hang on others:
    ``u`` (s, n), ``v`` (s, n) with n = 3 (s + 1) + r are weights of u, v, a of the start (u = 0), of the first stage
    and so on, then of the r vectors remembered, which ``memory`` (r, n) makes for the next step.  Row i takes the
    stages before; of its own stage ``v`` takes the acceleration, and ``u`` velocity and acceleration.  It is called
    where h or h_before have changed.

    Newton's iteration and its matrix, closed loops, events, checkpoints, error control are those of
    ``fm.GeneralizedAlpha``: the estimate compares the step's end with the parabola through the last three accelerations
    and holds orders up to 2 to rtol; a step of higher order is held to what that parabola misses.  In rotations u is
    the vector of the turn, whose rate differs from v by terms that leave order 2.  Where stages have different shares
    of their own acceleration, each is factored anew in each step.

    Attributes:
        name: how ``explain`` and checkpoints call it, its options included.
        relation: the weights.
        order: of positions and velocities at the step's end; measured here on a linear vibration.
        stages: s.
        memories: r.
        numbers: (k,) what ``relation`` gets as ``data``.

    Raises:
        SceneError: the weights are not such ones, or show a lower order, with equal or with changing steps.
    """

    name: str
    relation: Compiled
    order: int = 2
    stages: int = 1
    memories: int = 0
    numbers: Sequence[float] = ()

    def __post_init__(self) -> None:
        for what, least in (("order", 1), ("stages", 1), ("memories", 0)):
            if getattr(self, what) < least:
                raise SceneError(f"{self.name}: {what} must be at least {least}, got {getattr(self, what)}")
        if self.relation.signature is not Signature.RELATION:
            raise SceneError(
                f"{self.name}: relation must be fm.compiled of f(data, h, h_before, nodes, u, v, memory), "
                f"got {self.relation.name}"
            )
        object.__setattr__(self, "numbers", tuple(map(float, self.numbers)))
        for h, before in ((1e-3, 0.0), (1e-3, 1e-3), (2e-3, 1e-3), (1e-3, 2e-3)):
            _refuse_weights(self, h, before)
        for pattern, lengths in _PATTERNS.items():
            shown = _shown_order(self, lengths)
            if not shown > self.order - _SHORTFALL:
                raise SceneError(
                    f"{self.name} says order {self.order}, but with {pattern} it shows {shown:.2f} on a linear "
                    "vibration"
                )

    def check(self, scene: CompiledScene) -> None:
        """Runs every scene without bodies that have a history."""
        refuse_interiors(scene, self.name, why="their interiors step along with generalized-alpha")

    def stepper(self, scene: CompiledScene, state: st.State, groups: st.Groups, work: Work) -> Stepper:
        """See ``integrate.protocol.Integrator``."""
        address = self.relation.as_it_is_now().address
        choice = RelationChoice(address, tuple(self.numbers), self.stages, self.memories)
        return implicit_stepper(scene, state, groups, work, choice, order=self.order)


class _Weights:
    """Weights of a step as the function writes them, in Python."""

    def __init__(self, method: ImplicitMethod, h: float, before: float) -> None:
        s, r = method.stages, method.memories
        n = POINT * (s + 1) + r
        self.nodes, self.u, self.v, self.memory = np.zeros(s), np.zeros((s, n)), np.zeros((s, n)), np.zeros((r, n))
        data = np.array(method.numbers)
        try:
            method.relation.source(data, h, before, self.nodes, self.u, self.v, self.memory)
        except (IndexError, ZeroDivisionError) as reason:
            raise SceneError(
                f"{method.name}: {method.relation.name} failed for h = {h}, h_before = {before} with {s} stages and "
                f"{r} memories: {reason}"
            ) from reason


def _refuse_weights(method: ImplicitMethod, h: float, before: float) -> None:
    """Raise SceneError where the weights of a step are no relation of stages one after the other."""
    w = _Weights(method, h, before)
    where = f"{method.name}, a step h = {h} after h_before = {before}:"
    for name, part in (("nodes", w.nodes), ("u", w.u), ("v", w.v), ("memory", w.memory)):
        if not np.isfinite(part).all():
            raise SceneError(f"{where} {name} is not finite")
    if w.nodes[-1] != 1.0 or (w.nodes < 0.0).any() or (w.nodes > 1.0).any():
        raise SceneError(f"{where} nodes must lie in the step and end with 1, got {w.nodes}")
    end = POINT * (method.stages + 1)
    for i in range(method.stages):
        own = POINT * (i + 1)
        if w.u[i, own + U] or w.u[i, own + POINT : end].any() or w.v[i, own : own + A].any() or w.v[
            i, own + POINT : end
        ].any():
            raise SceneError(
                f"{where} stage {i + 1} hangs on itself or on later ones beyond v on its own a, u on its own v and a"
            )
        per_v = w.v[i, own + A]
        if not (per_v > 0.0 and w.u[i, own + A] + w.u[i, own + V] * per_v > 0.0):
            raise SceneError(f"{where} u and v of stage {i + 1} must grow with the acceleration at its end")


def _shown_order(method: ImplicitMethod, lengths: Sequence[float]) -> float:
    """The order that errors of two runs show, whose steps repeat these lengths; infinite where they are round-off."""
    coarse, fine = (_error_of_run(method, lengths, count) for count in (_STEPS, 2 * _STEPS))
    if not math.isfinite(coarse + fine):
        return -math.inf
    return math.log2(coarse / fine) if fine > 1e-12 and coarse > 0.0 else math.inf


def _error_of_run(method: ImplicitMethod, lengths: Sequence[float], count: int) -> float:
    """The error of place and velocity after ``count`` steps, each stage solved for its acceleration."""
    steps = np.resize(lengths, count)
    steps = steps / steps.sum()
    known: dict[tuple[float, float], _Weights] = {}
    t, before = 0.0, 0.0
    y, v = _exact(0.0)
    a = _acceleration(t, y, v)
    remembered: FloatArray = np.zeros(method.memories)
    for h in steps.tolist():
        if (h, before) not in known:
            known[h, before] = _Weights(method, h, before)
        w = known[h, before]
        points = np.zeros(w.u.shape[1])
        points[: POINT], points[POINT * (method.stages + 1) :] = (0.0, v, a), remembered
        for i in range(method.stages):
            own = POINT * (i + 1)
            per_v = w.v[i, own + A]
            per_x = w.u[i, own + A] + w.u[i, own + V] * per_v
            rate = w.v[i] @ points
            place = w.u[i] @ points + w.u[i, own + V] * rate
            lack = _acceleration(t + w.nodes[i] * h, y + place, rate)
            new = lack / (1.0 + _STIFFNESS * per_x + _DAMPING * per_v)
            points[own : own + POINT] = place + per_x * new, rate + per_v * new, new
        y, v, a = y + points[POINT * method.stages], *points[POINT * method.stages + V : POINT * method.stages + POINT]
        remembered = w.memory @ points
        t, before = t + h, h
    true = _exact(t)
    return math.hypot(y - true[0], v - true[1])


def _acceleration(t: float, y: float, v: float) -> float:
    return -_STIFFNESS * y - _DAMPING * v - _LOAD * math.sin(_RATE * t)


def _exact(t: float) -> tuple[float, float]:
    """y and y' of the equation, of a particular solution and of the free vibration that begins at 1."""
    real, imaginary = _STIFFNESS - _RATE**2, _DAMPING * _RATE
    size = real**2 + imaginary**2
    s, c = -_LOAD * real / size, _LOAD * imaginary / size
    forced = s * math.sin(_RATE * t) + c * math.cos(_RATE * t)
    forced_rate = _RATE * (s * math.cos(_RATE * t) - c * math.sin(_RATE * t))
    decay = 0.5 * _DAMPING
    own = math.sqrt(_STIFFNESS - decay**2)
    faded = math.exp(-decay * t)
    free = faded * math.cos(own * t)
    free_rate = faded * (-decay * math.cos(own * t) - own * math.sin(own * t))
    return forced + free, forced_rate + free_rate
