"""Whether a fixed step is beyond the stability of an explicit method, by the machine's fastest motions at the start.

A disturbance of the linearised machine, y'' = -K y - C y', grows from step to step by the method's amplification.
Where that outruns the growth of the machine's own motions, exp(h Re lambda), it is the method's (Hairer & Wanner 1996,
section IV.2).  Friction is left out: what it lets grow is bounded by its own reversal.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import SceneError
from flexmbd.integrate import state as st
from flexmbd.integrate.explicit.explicit_machine import ExplicitMachine
from flexmbd.integrate.explicit.machine_response import N_SCRATCH, respond_to_each, respond_to_fastest
from flexmbd.integrate.explicit.step_growth import StepGrowth, companion
from flexmbd.multibody.kernels.reading.force_tables import keep_forces, reversing, without_forces
from flexmbd.multibody.plan.compiled_scene import CompiledScene

FloatArray = NDArray[np.float64]

_GROWTH = math.log(1000.0)  # of a disturbance over the run, beyond which a step is refused
_EACH = 16  # free velocities up to which each is disturbed by itself
_AT_ONCE, _MOST = 6, 30  # Lanczos' steps between two looks, and in all
_SAME = 5e-3  # change of the fastest rate between two looks that is none
_FAR = 4.0  # times the rates found, of which more steps are not going to find the rest


@dataclass(frozen=True, eq=False)
class FastMotions:
    """The machine, y'' = -K y - C y', on shapes (k, nv) that hold its fastest motions: K, C (k, k)."""

    stiffness: FloatArray
    damping: FloatArray
    shapes: FloatArray

    def largest(self) -> tuple[float, float]:
        """The largest eigenvalues of K (1/s^2) and C (1/s), by magnitude."""
        return _radius(self.stiffness), _radius(self.damping)

    def rates(self) -> tuple[FloatArray, FloatArray]:
        """Eigenvalues (2 k,) in 1/s, complex, and their shapes (nv, 2 k)."""
        values, vectors = np.linalg.eig(companion(self.stiffness, self.damping))
        return values, self.shapes.T @ vectors[: len(self.shapes)]


def beyond_stability(
    scene: CompiledScene, machine: ExplicitMachine, state: st.State, groups: st.Groups, *, method: StepGrowth
) -> str | None:
    """What to tell where the step lets a disturbance of the state grow a thousandfold until TIME_END; None elsewhere.

    ``machine``: its work arrays are written to; ``work.time`` is up to date.
    """
    h, span = float(state.numbers[st.STEP]), float(state.numbers[st.TIME_END] - state.numbers[st.TIME])
    if not len(scene.plan.free) or span <= h:
        return None
    friction = reversing(scene.plan)
    if friction.any():
        machine = machine.replace(plan=keep_forces(scene.plan, range(len(scene.plan.forces)), ~friction))
    found = _fast_motions(machine, state, groups, h, method.keeps)
    if found is None or scene.plan.flag[0] != 0:
        scene.callbacks.reset()
        return None
    rates, shapes = found.rates()
    own = max(0.0, float(rates.real.max()))

    def grows(step: float) -> float:
        return float((method.growth(found.stiffness, found.damping, step) - own * step) * span / step)

    if grows(h) <= _GROWTH:
        return None
    worst = int(np.argmax(np.abs(rates)))
    name = scene.velocity_names[int(np.argmax(np.abs(shapes[:, worst]) / groups.full[groups.of]))]
    factor = math.exp(min(700.0, grows(h) * h / span))
    kind = "vibration" if abs(rates[worst].imag) > abs(rates[worst].real) else "decay"
    return (
        f"the step h = {h:.4g} s is beyond the stability of {method.name}: the fastest {kind}, {abs(rates[worst]):.4g} "
        f"1/s and mostly of {name!r}, grows by a factor of {factor:.6g} in each step. "
        f"Take h = {_longest(grows, h):.3g} s at most{method.otherwise}"
    )


def _longest(grows: Callable[[float], float], h: float) -> float:
    """The longest step (s) below h that is stable, rounded down."""
    above, below = h, 0.9 * h
    while grows(below) > _GROWTH and below > 1e-9 * h:
        above, below = below, 0.9 * below
    for _ in range(20):
        middle = 0.5 * (above + below)
        above, below = (middle, below) if grows(middle) > _GROWTH else (above, middle)
    digit = 10.0 ** (math.floor(math.log10(below)) - 2)
    return math.floor(below / digit) * digit


def _fast_motions(
    machine: ExplicitMachine, state: st.State, groups: st.Groups, h: float, keeps: Callable[[float, float], bool]
) -> FastMotions | None:
    """The machine on its fastest motions; None where they are certainly stable, or no numbers."""
    plan, nv = machine.plan, len(state.v)
    place = np.zeros((N_SCRATCH, nv)), np.zeros(len(state.x)), np.zeros(len(plan.rows))
    if (n := len(plan.free)) <= _EACH:
        stiffness, damping = np.zeros((2, n, n))
        respond_to_each(machine, state, groups, h, *place, stiffness, damping)
        shapes = np.zeros((n, nv))
        shapes[np.arange(n), plan.free] = groups.full[groups.of[plan.free]]
        found = FastMotions(stiffness, damping, shapes)
        return None if not _finite(found) or _kept(found, h, keeps) else found
    bare = without_forces(plan)
    basis, momenta, stiff, damp = np.zeros((4, _MOST + 1, nv))
    count, before = 0, 0.0
    while True:
        last = min(count + _AT_ONCE, _MOST)
        reached = respond_to_fastest(
            machine, bare, state, groups, h, *place, count, last, basis, momenta, stiff, damp
        )
        on = momenta[:reached]
        found = FastMotions(on @ stiff[:reached].T, on @ damp[:reached].T, basis[:reached])
        if reached == 0 or not _finite(found):
            return None
        k, c = found.largest()
        seen = h * h * k + 4.0 * h * c
        if abs(seen - before) <= _SAME * seen or reached < last or last == _MOST:
            return None if _kept(found, h, keeps) else found
        if keeps((_FAR * h) ** 2 * k, _FAR * h * c):
            return None
        count, before = reached, seen


def _kept(found: FastMotions, h: float, keeps: Callable[[float, float], bool]) -> bool:
    k, c = found.largest()
    return keeps(h * h * k, h * c)


def _finite(found: FastMotions) -> bool:
    return bool(np.isfinite(found.stiffness).all() and np.isfinite(found.damping).all())


def _radius(matrix: FloatArray) -> float:
    if not matrix.any():
        return 0.0
    return float(np.abs(np.linalg.eigvals(matrix)).max()) if len(matrix) > 1 else abs(float(matrix[0, 0]))


def judge(
    scene: CompiledScene,
    machine: Callable[[], ExplicitMachine],
    state: st.State,
    groups: st.Groups,
    *,
    growth: StepGrowth,
) -> Callable[[], None]:
    """``Stepper.refuse_step`` of a method; ``machine`` gives its arrays, whose work is written to."""

    def refuse_step() -> None:
        told = beyond_stability(scene, machine(), state, groups, method=growth) if state.counts[st.FIXED_STEP] else None
        if told is not None:
            raise SceneError(told)

    return refuse_step
